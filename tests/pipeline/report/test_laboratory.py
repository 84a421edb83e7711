"""The laboratory's page has the numbers of the calibration, of checks, and of several commands."""

import os
import re
import shutil
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from functools import cache
from html.parser import HTMLParser
from itertools import islice

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from compensation import from_json
from compensation.inertia.quality import MAX_GAIN, MAX_LEFT
from compensation.protocol import pitch_and_sway_signals
from hbm.spatial import WRENCH_COMPONENTS, rotation_about
from pipeline.cli.app import main
from pipeline.config.schema import Treadmill
from pipeline.config.study import read_laboratory, read_study
from pipeline.io.read_options import ReadOptions
from pipeline.report import laboratory
from pipeline.report.blocks import Table
from pipeline.report.empty_treadmill import measure_empty
from pipeline.report.laboratory import (
    CHECKS,
    PAGE,
    STATE,
    Part,
    calibration_verdict,
    frequency_table,
    page_of_study,
    read_checks,
    recordings_table,
    write_laboratory,
)
from pipeline.trial.ground.calibrations import fit_calibration, read_empty
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.virtual_lab.faults import AccelerometerFaults, Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.walking_study import write_recording
from pipeline.virtual_lab.protocol.walking_trial import run_signal
from tests.pipeline import lab
from tests.pipeline.browser import needs_chromium, open_browser

DAYS = ("2026-05-04", "2026-05-11")


class Rows(HTMLParser):
    """The rows of all tables of a page, each a list of texts."""

    def __init__(self, page):
        super().__init__()
        self.rows, self.cell = [], None
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.cell = ""

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self.rows[-1].append(" ".join(self.cell.split()))
            self.cell = None

    def handle_data(self, data):
        if self.cell is not None:
            self.cell += data

    def answer(self, question):
        return next(row[1] for row in self.rows if row[:1] == [question])


@cache
def empty(seed):
    return lab.on_platform(lab.without_people(20.0), lab.shaken(20.0, seed), seed=seed)


def turned(recording):
    """A sensor turned by 4°: no calibration is valid after that."""
    values = recording.analog.values.copy()
    values[:, :3] = values[:, :3] @ rotation_about(np.array([0.0, 0, 1]), np.radians(4)).T
    return replace(recording, analog=replace(recording.analog, values=values))


def saved(recording, path, day):
    lab.save(recording, path)
    noon = datetime.fromisoformat(f"{day}T12:00:00+00:00").timestamp()
    os.utime(path, (noon, noon))
    return path


@contextmanager
def figures_of(count):
    """Draw the first so many plates on pages, which takes most of their time."""
    every = laboratory._of_recording

    def few(calibration, empty):
        parts = {name: getattr(empty, name) for name in ("before", "spectra")}
        first = {name: dict(islice(of.items(), count)) for name, of in parts.items()}
        return every(calibration, replace(empty, **first))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(laboratory, "_of_recording", few)
        yield


def fit(folder, seed):
    path = lab.save(empty(seed), folder / "empty.c3d")
    out = str(folder / "lab.json")
    assert main(["calibration", "fit", str(path), "-o", out]) == 0


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Folder of a calibration."""
    folder = tmp_path_factory.mktemp("fitted")
    with figures_of(1):
        fit(folder, 1)
    return folder


@pytest.fixture(scope="module")
def checked(fitted, tmp_path_factory):
    """Folder of that calibration after checks on two days, the second beyond its limits."""
    folder = shutil.copytree(fitted, tmp_path_factory.mktemp("checked") / "lab")
    calibration = folder / "lab.json"
    first = saved(empty(2), folder / "day1.c3d", DAYS[0])
    second = saved(turned(empty(3)), folder / "day2.c3d", DAYS[1])
    with figures_of(0):  # the page shows the figures of the last check
        assert main(["calibration", "check", str(calibration), str(second)]) == 1
    with figures_of(1):
        assert main(["calibration", "check", str(calibration), str(first)]) == 0
    return folder


def page_of(folder):
    return (folder / PAGE).read_text(encoding="utf-8")


def test_the_numbers_on_the_page_are_those_of_the_calibration(fitted):
    calibration = from_json((fitted / "lab.json").read_text(encoding="utf-8"))
    rows = {tuple(row[:2]): row[2:] for row in Rows(page_of(fitted)).rows}
    every = []
    for plate, of_plate in calibration.verdict.items():
        for one in of_plate:
            before, after, left, limit, explained, *_ = rows[plate, one.component]
            assert before == f"{one.excited:.2f} {one.unit}"
            assert after == f"{one.after:.2f} {one.unit}"
            assert left.removeprefix("✔ ").startswith(f"{one.left:.2f} {one.unit}")
            assert limit == f"{one.limit:.2f} {one.unit}"
            assert explained == f"{100 * one.r_squared:.2f} %"
            every.append(one.left / one.limit)
    answers = Rows(page_of(fitted))
    assert 75 * max(every) < 20
    assert answers.answer("Persons") == "any body mass"
    assert answers.answer("Fit for trials").startswith("✔ fit")


def test_a_calibration_that_leaves_four_fifths_of_a_limit_is_for_persons_of_60_kg(fitted):
    calibration = from_json((fitted / "lab.json").read_text(encoding="utf-8"))
    model = calibration.plates["plate 1"]
    slow = model.rms_slow.copy()
    slow[4] = 0.8 * MAX_LEFT[4]
    poorer = replace(
        calibration, plates={"plate 1": replace(model, rms_slow=slow)}, correlation=None
    )
    answers = dict(calibration_verdict(poorer, fitted / "lab.json").rows)
    assert answers["Persons"].startswith("60 kg")


def test_the_page_says_up_to_which_sway_and_pitch_the_calibration_is_fit(fitted):
    motion = lab.shaken(20.0, 1)
    up_to = Rows(page_of(fitted)).answer("Up to")
    sway, pitch = re.match(r"sway (\d+) mm, pitch ([\d.]+)°", up_to).groups()
    assert float(sway) == pytest.approx(1000 * np.abs(motion.sway).max(), abs=1)
    assert float(pitch) == pytest.approx(np.degrees(np.abs(motion.pitch).max()), abs=0.2)


def test_two_checks_on_different_days_are_two_rows(checked):
    table = pd.read_csv(checked / CHECKS, dtype=str)
    assert list(table["day"]) == list(DAYS)  # in order of days, not of checks
    assert list(table["valid"]) == ["True", "False"]
    by_calibration, by_new = (
        np.array([float(table[f"plate 1 {name} {what}"].iloc[1]) for name in WRENCH_COMPONENTS])
        for what in ("left", "by new fit")
    )
    worst = np.max(np.sqrt(by_calibration**2 - by_new**2) / (MAX_GAIN * MAX_LEFT))
    assert worst > 1  # and therefore it is not valid


def test_a_check_of_the_same_recording_again_adds_no_row_and_a_stated_day_counts(
    checked, tmp_path, plain_pages
):
    folder = shutil.copytree(checked, tmp_path / "lab")
    command = ["calibration", "check", str(folder / "lab.json"), str(folder / "day1.c3d")]
    assert main([*command, "--day", "2026-06-01"]) == 0
    assert list(read_checks(folder / "lab.json")["day"]) == [DAYS[1], "2026-06-01"]
    assert main([*command, "--day", "1 June"]) == 2


def test_the_page_says_for_how_long_by_all_checks_and_the_last_day_decides(checked):
    page = Rows(page_of(checked))
    assert re.match(r"✖ .*day2\.c3d", page.answer("Fit for trials"))
    assert re.search(f"1 of 2 days, .*{DAYS[0]}", page.answer("For how long"))
    assert page.answer("Calibration") == "✔ still valid"  # by the check of the first day, made last
    assert re.search(rf"lab\.json .*day1\.c3d, {DAYS[0]}", page_of(checked))
    days = [row[0] for row in page.rows if row[0] in DAYS]
    assert days == list(DAYS)


def test_a_check_leaves_tables_and_figures_of_the_fit_and_a_new_fit_drops_the_checks(
    fitted, checked, tmp_path, plain_pages
):
    def details(page):
        return re.search(r'<section id="calibration">.*?</section>', page, re.DOTALL)[0]

    assert details(page_of(checked)) == details(page_of(fitted))
    folder = shutil.copytree(checked, tmp_path / "lab")
    verdict = Table("Left <plate>", ("Question", "Answer"), [("A", "B")])
    errors = Table("Errors", ("Plate", "Error"), [("left", "1 N")])
    write_laboratory(folder, Part("plates", [verdict], [errors]))
    assert {"calibration", "check", "plates"} <= set(
        re.findall(r'<section id="(\w+)"', page_of(folder))
    )
    fit(folder, 5)
    sections = re.findall(r'<section id="(\w+)"', page_of(folder))
    assert sections == ["verdict", "calibration", "plates"]
    assert page_of(folder).count("Left &lt;plate&gt;") == 1
    assert Rows(page_of(folder)).answer("For how long").endswith(" yet")


def test_the_page_is_made_of_the_file_beside_it_and_holds_no_state(checked, tmp_path):
    folder = shutil.copytree(checked, tmp_path / "lab")
    assert "<!--" not in page_of(folder)
    (folder / PAGE).unlink()
    write_laboratory(folder)
    assert page_of(folder) == page_of(checked)


def test_a_damaged_file_beside_the_page_is_named(checked, tmp_path):
    folder = shutil.copytree(checked, tmp_path / "lab")
    for text in ("{", "[]", '{"calibration": {"name": "x"}}'):
        (folder / STATE).write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=r"laboratory.json: damaged.*move it away"):
            write_laboratory(folder)


def test_every_warning_that_the_console_prints_is_on_the_page(tmp_path, capsys, plain_pages):
    """Plate 2 is 5 ms late; with a check, the page keeps the warnings of the fit."""
    recording = empty(1)
    first, second = recording.plates
    late = np.roll(second.wrench_in_plate, 5, axis=0)
    apart = replace(recording, plates=(first, replace(second, wrench_in_plate=late)))
    path = lab.save(apart, tmp_path / "empty.c3d")
    assert main(["calibration", "fit", str(path), "-o", str(tmp_path / "lab.json")]) == 0
    printed = re.findall(r"^- warning: (.*) \[(\w+)\]$", capsys.readouterr().out, re.MULTILINE)
    assert "plates_timed_apart" in {code for _, code in printed}
    other = saved(empty(2), tmp_path / "day.c3d", DAYS[0])
    for _ in range(2):
        text = page_of(tmp_path)
        assert all(sentence in text and code in text for sentence, code in printed)
        main(["calibration", "check", str(tmp_path / "lab.json"), str(other)])


def test_a_dead_sensor_is_a_check_that_failed(fitted, tmp_path, plain_pages):
    folder = shutil.copytree(fitted, tmp_path / "lab")
    recording = empty(2)
    values = recording.analog.values.copy()
    values[:, :3] = 0
    dead = replace(recording, analog=replace(recording.analog, values=values))
    path = saved(dead, folder / "dead.c3d", DAYS[0])
    assert main(["calibration", "check", str(folder / "lab.json"), str(path)]) == 1
    assert list(read_checks(folder / "lab.json")["valid"]) == [False]
    assert Rows(page_of(folder)).answer("Calibration").startswith("✖")


CHANNELS = {name: list(channels) for name, channels in lab.CHANNELS.items()}


def measured(recording, channels=None):
    treadmill = Treadmill(accelerometers=channels or CHANNELS)
    calibration = fit_calibration(recording, treadmill)
    return measure_empty(recording, Laboratory(treadmill, calibration))


def test_unbalanced_rollers_are_found_at_their_frequency():
    """A roller of 14 cm at 3 m/s turns at 3.4 Hz."""
    recording = empty(1)
    clock, line_hz = recording.plates[0].time, 3.0 / (2 * np.pi * 0.14)
    shaken = np.zeros((len(clock), 6))
    shaken[:, 3] = 2 * np.sin(2 * np.pi * line_hz * clock)
    plates = tuple(
        replace(plate, wrench_in_plate=plate.wrench_in_plate + shaken) for plate in recording.plates
    )
    analog = recording.analog
    speed = replace(
        analog,
        names=(*analog.names, "Belt"),
        units=(*analog.units, "m/s"),
        values=np.column_stack([analog.values, np.full(len(clock), 3.0)]),
    )
    assert measured(recording).rollers_hz is None  # no belts, no rollers
    found = measured(replace(recording, plates=plates, analog=speed))
    assert found.rollers_hz == pytest.approx(line_hz, abs=0.07)


@pytest.mark.parametrize(("seed", "axes"), [(1, None), (2, "left,back,up")])
def test_accelerometers_are_where_they_are_and_the_front_is_known_by_stated_axes_alone(
    seed, axes, tmp_path
):
    """Four anywhere on the frame and turned anyhow; the file's y axis points back."""
    rng = np.random.default_rng(seed)
    treadmill = make_treadmill(Faults(accelerometers=AccelerometerFaults(sensors=4)), seed)
    sensors = tuple(
        replace(
            sensor,
            place=rng.uniform([-1.1, -0.7, -0.5], [1.1, 0.7, 0.1]),
            sensitivity=sensor.sensitivity @ Rotation.random(random_state=rng).as_matrix(),
        )
        for sensor in treadmill.sensors
    )
    signal = pitch_and_sway_signals(0, 1.3)[0]
    recording = run_signal(replace(treadmill, sensors=sensors), signal, rng)
    write_recording(tmp_path / "empty.c3d", recording)
    stated = ReadOptions(axes=axes)
    channels = {s.name: [f"{s.name}.{x}" for x in "XYZ"] for s in sensors}
    found = measured(read_empty(tmp_path / "empty.c3d", stated), channels)
    sign = 1 if axes else -1  # the file's y axis points back
    for sensor in sensors:
        place = found.places[sensor.name]
        assert place.along == pytest.approx(sign * sensor.place[0], abs=0.05)
        assert place.up == pytest.approx(sensor.place[2], abs=0.05)
    assert bool(found.recording.axes) == bool(axes)
    assert ("to the front" in frequency_table(found).legend) == bool(axes)


def test_the_report_of_a_study_links_to_the_page_beside_its_calibration(moving_study, tmp_path):
    folder = shutil.copytree(moving_study, tmp_path / "my study")
    study = read_study(folder)
    assert page_of_study(study, tmp_path / "results") is None
    (folder / PAGE).write_text("", encoding="utf-8")
    assert page_of_study(study, tmp_path / "results") == "../my%20study/laboratory.html"


# In a real browser: drawn without errors or requests, readable on every screen


def test_recordings_that_a_study_has_are_done_and_the_others_missing(
    checked, moving_study, tmp_path, capsys
):
    shutil.copytree(moving_study, tmp_path, dirs_exist_ok=True)
    stated = read_laboratory(tmp_path)
    done = [row[1][0][0] for row in recordings_table(tmp_path, stated).rows]
    assert done == ["pass", "fail", "fail", "fail"]

    # a fitted calibration says itself what it was fitted to, and which checks there were
    for file in checked.glob("lab*"):
        shutil.copy(file, tmp_path)
    treadmill = stated.treadmill.model_copy(update={"calibration": "lab.json"})
    fitted = stated.model_copy(update={"treadmill": treadmill})
    *_, another_day = recordings_table(tmp_path, fitted).rows
    assert another_day[1][0][:2] == ("pass", "done")

    # what is stated before it is recorded is missing, and no subject is needed
    (tmp_path / treadmill.calibration).unlink()
    for file in tmp_path.glob("sub*"):
        file.unlink()
    empty, *_ = recordings_table(tmp_path, fitted).rows
    assert empty[1][0] == ("fail", "missing", "lab.json")
    assert main(["calibration", "checklist", str(tmp_path)]) == 0
    assert "missing" in capsys.readouterr().out


@pytest.fixture(scope="module")
def browser(checked):
    with open_browser() as browser:
        browser.resize(1200)
        browser.open(checked / PAGE)
        yield browser


@needs_chromium
def test_the_page_raises_no_error_requests_nothing_and_draws_every_figure(browser):
    assert browser.complaints == []
    other = [url for url in browser.requests if not url.startswith("data:")]
    assert len(other) == 1
    sizes = browser.evaluate("[...document.images].map(i => [i.complete, i.naturalWidth])")
    assert len(sizes) == 2 + 2  # a plate over time and its spectra, twice
    assert all(complete and width > 500 for complete, width in sizes)


@needs_chromium
@pytest.mark.parametrize("width", [390, 1024, 1200])
def test_no_width_needs_horizontal_scrolling(browser, width):
    browser.resize(width)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width


@needs_chromium
def test_the_verdict_is_visible_without_scrolling(browser):
    browser.resize(1200, 900)
    place = "document.querySelector('#verdict table').getBoundingClientRect()"
    assert browser.evaluate(f"{place}.bottom") < 900
    text = browser.evaluate("document.querySelector('#verdict table').innerText")
    assert "not valid any" in text
