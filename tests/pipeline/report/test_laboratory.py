"""The laboratory's page: numbers of the calibration, days of checks, parts of several commands."""

import os
import re
import shutil
from dataclasses import replace
from datetime import datetime
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from compensation import from_json
from compensation.inertia.quality import MAX_GAIN, MAX_LEFT
from hbm.spatial import WRENCH_COMPONENTS, rotation_about
from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.report.blocks import Table
from pipeline.report.laboratory import (
    CHECKS,
    PAGE,
    STATE,
    Part,
    calibration_verdict,
    page_of_study,
    read_checks,
    write_laboratory,
)
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


def fit(folder, seed):
    path = lab.save(empty(seed), folder / "empty.c3d")
    out = str(folder / "lab.json")
    assert main(["calibration", "fit", str(path), "-o", out]) == 0


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Folder of a calibration."""
    folder = tmp_path_factory.mktemp("fitted")
    fit(folder, 1)
    return folder


@pytest.fixture(scope="module")
def checked(fitted, tmp_path_factory):
    """Folder of that calibration after checks on two days, the second beyond its limits."""
    folder = shutil.copytree(fitted, tmp_path_factory.mktemp("checked") / "lab")
    calibration = folder / "lab.json"
    first = saved(empty(2), folder / "day1.c3d", DAYS[0])
    second = saved(turned(empty(3)), folder / "day2.c3d", DAYS[1])
    assert main(["calibration", "check", str(calibration), str(second)]) == 1
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
    assert answers["Persons"] == "60 kg and heavier"


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


def test_a_check_of_the_same_recording_again_adds_no_row_and_a_stated_day_counts(checked, tmp_path):
    folder = shutil.copytree(checked, tmp_path / "lab")
    command = ["calibration", "check", str(folder / "lab.json"), str(folder / "day1.c3d")]
    assert main([*command, "--day", "2026-06-01"]) == 0
    assert list(read_checks(folder / "lab.json")["day"]) == [DAYS[1], "2026-06-01"]
    assert main([*command, "--day", "1 June"]) == 2


def test_the_page_says_for_how_long_by_all_checks_and_the_last_day_decides(checked):
    page = Rows(page_of(checked))
    assert page.answer("Fit for trials").startswith("✖ not valid any more by day2.c3d")
    assert page.answer("For how long").endswith(f"valid on 1 of 2 days, last on {DAYS[0]}")
    assert page.answer("Calibration") == "✔ still valid"  # by the check of the first day, made last
    assert f"Check of lab.json by day1.c3d, {DAYS[0]}" in page_of(checked)
    days = [row[0] for row in page.rows if row[0] in DAYS]
    assert days == list(DAYS)


def test_a_check_leaves_tables_and_figures_of_the_fit_and_a_new_fit_drops_the_checks(
    fitted, checked, tmp_path
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
    assert Rows(page_of(folder)).answer("For how long").endswith("no check on another day yet")


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


def test_every_warning_that_the_console_prints_is_on_the_page(tmp_path, capsys, monkeypatch):
    """Plate 2 is 5 ms late; with a check, the page keeps the warnings of the fit."""
    monkeypatch.setattr("pipeline.report.laboratory._of_recording", lambda *given: [])
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


def test_a_dead_sensor_is_a_check_that_failed(fitted, tmp_path):
    folder = shutil.copytree(fitted, tmp_path / "lab")
    recording = empty(2)
    values = recording.analog.values.copy()
    values[:, :3] = 0
    dead = replace(recording, analog=replace(recording.analog, values=values))
    path = saved(dead, folder / "dead.c3d", DAYS[0])
    assert main(["calibration", "check", str(folder / "lab.json"), str(path)]) == 1
    assert list(read_checks(folder / "lab.json")["valid"]) == [False]
    assert "✖ not valid any more" in Rows(page_of(folder)).answer("Calibration")


def test_the_report_of_a_study_links_to_the_page_beside_its_calibration(moving_study, tmp_path):
    folder = shutil.copytree(moving_study, tmp_path / "my study")
    study = read_study(folder)
    assert page_of_study(study, tmp_path / "results") is None
    (folder / PAGE).write_text("", encoding="utf-8")
    assert page_of_study(study, tmp_path / "results") == "../my%20study/laboratory.html"


# In a real browser: drawn without errors or requests, readable on every screen


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
    assert len(sizes) == 4 + 4  # two plates over time and their spectra, twice
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
    assert "not valid any more" in text
