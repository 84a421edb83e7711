"""The page of a trial shows the numbers of its table and its warnings with their channels."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.notes import warnings_of
from pipeline.cli.app import main
from pipeline.io.recording import Plate
from pipeline.report import write
from pipeline.report.trial_page import plate_figure, write_changed_page, write_trial_page
from pipeline.report.trial_tables import verdict_lines
from pipeline.report.write import write_report
from pipeline.run import load
from pipeline.run.store import read_trial, write_trial
from pipeline.trial.findings.finding import Correction, Finding
from pipeline.trial.findings.raw import RawFault
from pipeline.trial.findings.words import note_of, row_of
from pipeline.trial.gait.cycles import mean_and_sd
from pipeline.trial.residuals import (
    AXES,
    HEALTHY_RMS,
    residual_table,
    threshold_rows,
    worst_cycles,
)
from tests.pipeline.browser import needs_chromium, open_browser
from tests.pipeline.fake_results import fake_trial, write_fake_results

JUMPS = RawFault(2, "Fz", "jumps", 800.0, 2, ((4.2, 4.201), (6.5, 6.501)))
TRIED = Correction(
    mendings=("1: move x 0.040",),
    plate_delay_s=None,
    before=(20.0, 10.0, 12.0, 4.0, 38.8, 3.0),
    after=(20.0, 10.0, 12.0, 4.0, 6.1, 3.0),
    held_out_before=(20.0, 10.0, 12.0, 4.0, 37.9, 3.0),
    held_out_after=(20.0, 10.0, 12.0, 4.0, 6.3, 3.0),
    helps=True,
)
MOVED = Finding("moved", (1,), "", (0.04, 0.0), (0.01, 0.006), 60.0, correction=TRIED)
GAIN = Finding("gain", (1,), "Mx", (0.25,), (0.05,), 58.0)


def recorded(number):
    """A plate with samples."""
    time = np.arange(0, 10, 0.001)
    wrench = np.outer(np.sin(time), np.ones(6))
    corners = [(1, 1, 0), (1, -1, 0), (-1, -1, 0), (-1, 1, 0)]
    return Plate(number, time, wrench, np.eye(3), np.zeros(3), np.array(corners, float))


@pytest.fixture(scope="module")
def trial():
    result = fake_trial(1, "sway", 12, True, None, 0.0)
    return with_findings(result, Finding("jumps", (2,), channels=(JUMPS,)))


def with_findings(trial, *findings):
    """A trial of two plates with findings, and the notes that the program makes of them."""
    plates = tuple(recorded(number).place for number in (1, 2))
    notes = (note_of(finding, plates, trial.motion.time) for finding in findings)
    return replace(trial, plates=plates, findings=findings, notes=(*trial.notes, *notes))


@pytest.fixture(scope="module")
def page(trial, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    return write_trial_page(trial, folder / "trial.html", plates=(recorded(1), recorded(2)))


@pytest.fixture
def plain(undrawn, monkeypatch):
    """Pages without figures, which are not looked at."""
    for figure in ("residual_figure", "trial_figure"):
        monkeypatch.setattr(f"pipeline.report.trial_page.{figure}", lambda *given, **named: None)
    monkeypatch.setattr("pipeline.report.trial_page.drawing", lambda *given: "data:,")


def text_of(page):
    return " ".join(re.sub(r"<[^>]+>", " ", page.read_text(encoding="utf-8")).split())


def test_the_page_has_the_numbers_of_the_tables(trial, page):
    text = text_of(page)
    table = residual_table(trial, "")
    for row in table[table["headline"]].itertuples():
        plates = "compensated" if row.compensated else "measured"
        numbers = " ".join(f"{value:z.1f}" for value in (row.rms, row.mean, row.sd, row.peak))
        assert f"{row.axis} ({row.unit}) {plates} {numbers.replace('-', '−')}" in text
    assert not re.findall(r"(?<![\w.:])-\d", text)  # a minus sign is no hyphen
    for row in filter(lambda row: row.compensated, threshold_rows(trial)):
        assert f"IC {row.peak:.0f} {row.unit}, limit {row.limit:.0f} {row.unit}" in text


@pytest.mark.parametrize(
    ("scale", "sentence"),
    [
        (
            1.0,
            r"Fy and Mz above healthy values; peak force and peak moment above .* in [\d.]+ and",
        ),
        (0.35, r"RMS of all six axes below healthy values; peak moment above .*"),
        (0.01, r"Typical of level walking: RMS of all six axes below healthy values; peaks within"),
    ],
)
def test_the_first_sentence_compares_with_healthy_walking_and_with_published_limits(
    trial, scale, sentence
):
    dynamics = replace(trial.compensated, residual=scale * trial.compensated.residual)
    variants = {**trial.variants, "compensated": dynamics}
    first, *_ = verdict_lines(replace(trial, variants=variants))
    assert re.match(sentence, first)
    assert "Hicks et al." in first
    assert len(re.findall(r"\w[\w.]*", first)) <= 25


def test_a_pose_is_compared_with_walking_nowhere(trial, tmp_path):
    pose = replace(trial, cycles={}, events=(), span=(1.0, 3.0))
    first, *_ = verdict_lines(pose)
    assert first.startswith("No gait cycles")
    assert "Healthy" not in text_of(write_trial_page(pose, tmp_path / "pose.html"))


def test_an_offset_of_a_plate_has_its_unit():
    size = row_of(Finding("zero", (1,), "", (12.0,), ()), (), np.zeros(0)).size
    assert size.splitlines()[0] == "plate 1 Fz +12 N"


def test_a_single_gait_cycle_has_no_spread():
    mean, sd = mean_and_sd(np.ones((1, 3)))
    assert mean.tolist() == [1, 1, 1]
    assert np.isnan(sd).all()


def test_the_worst_gait_cycles_are_listed_with_what_shows_them(trial, tmp_path, plain):
    trial = replace(trial, condition="sway to side")
    first, *others = worst_cycles(trial)
    assert all(first.ratio >= other.ratio for other in others)
    start, stop = first.start_s, first.stop_s
    inside = (trial.motion.time >= start) & (trial.motion.time < stop)
    k = AXES.index(first.axis)
    rms = np.sqrt(np.mean(trial.compensated.residual[inside & trial.counts, k] ** 2))
    assert (first.rms, first.ratio) == pytest.approx((rms, rms / HEALTHY_RMS[k]))
    text = text_of(write_trial_page(trial, tmp_path / "trials/one.html", study="../report.html"))
    row = f"{first.side}, {start:.2f}–{stop:.2f} s {first.axis}, {first.ratio:.1f} × healthy"
    of_trial = "--subject sub01 --condition &#39;sway to side&#39;"
    command = f"hbm view {tmp_path} {of_trial} --at {start:.2f}"
    assert f"{row} {first.rms:.1f} {first.unit} {command}" in text
    assert text.count("--at") == 5


def test_a_warning_has_its_advice_and_a_finding_one_row_and_the_channels_of_its_plate(trial, page):
    source, text = page.read_text(encoding="utf-8"), text_of(page)
    *others, jumps = warnings_of(trial.notes)
    for note in others:
        assert note.text in text
    assert jumps.text not in text
    assert text.count(jumps.advice) == 1
    row = r"plate 2: Fz .*800 N .*4\.200 s .*"
    assert re.search(rf"{row}{re.escape(jumps.advice)}", text)
    assert re.findall('alt="(Channels of .*?)"', source) == ["Channels of plate 2, as recorded"]
    assert "hbm explain" in text


def test_a_correction_stands_with_its_effect_and_with_what_to_type(trial, tmp_path, plain):
    text = text_of(write_trial_page(with_findings(trial, MOVED), tmp_path / "moved.html"))
    tried = "My 38.8 → 6.1 N·m, .*37.9 → 6.3"
    assert re.search(rf"plate 1: place forward −40, left \+0, ± 10 mm 60 {tried} ", text)
    assert "--mend-plates &#34;1: move x 0.040&#34;" in text
    harmful = replace(TRIED, held_out_after=(20.0, 10.0, 19.0, 4.0, 6.3, 3.0), helps=False)
    trial = with_findings(trial, replace(MOVED, correction=harmful))
    text = text_of(write_trial_page(trial, tmp_path / "harmful.html"))
    assert re.search(rf"not advised: {tried}; but Fz 12.0 → 12.0 N, .*12.0 → 19.0", text)
    assert "--mend-plates" not in text


def test_what_cannot_be_told_apart_is_one_row(trial, tmp_path, plain):
    rivals = replace(MOVED, correction=None, rivals=(GAIN,))
    text = text_of(write_trial_page(with_findings(trial, rivals), tmp_path / "rivals.html"))
    assert re.search("plate 1: place or plate 1: gain of Mx, .*−40", text)
    assert re.search("± 10 mm 80 %, 77 to 83 % 60 not tried", text)


def test_the_drawing_of_a_plate_shows_where_its_samples_jump():
    jumps = Finding("jumps", (2,), channels=(JUMPS,))
    figure = plate_figure([recorded(1), recorded(2)], [jumps])
    dotted = {
        panel.get_title(loc="left"): [o.get_xdata()[0] for o in panel.lines if o.get_ls() == ":"]
        for panel in figure.axes
    }
    assert dotted.pop("Fz") == [4.2, 6.5]
    assert not any(dotted.values())


def test_a_trial_without_residuals_has_a_page_that_says_why(tmp_path, trial):
    quality = np.full_like(trial.quality, 1)
    empty = replace(trial, quality=quality, shortage="nobody walked", notes=(), findings=())
    text = text_of(write_trial_page(empty, tmp_path / "none.html"))
    assert ": nobody walked" in text


def test_commands_of_a_page_name_the_folder_as_it_was_given_last(tmp_path, plain, monkeypatch):
    folder = write_fake_results(tmp_path / "results", subjects=1, conditions=("sway",), cycles=3)
    page = folder / "trials" / "sub01_sway.html"
    result = read_trial(page.with_suffix(".parquet"))
    write_changed_page(result, folder, None, None)
    assert f"hbm explain {folder} " in page.read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    write_changed_page(result, Path("results"), None, None)
    assert "hbm explain results " in page.read_text(encoding="utf-8")


def test_every_trial_of_a_report_has_a_page_and_an_unchanged_one_is_kept(
    tmp_path, plain, monkeypatch
):
    folder = write_fake_results(tmp_path, subjects=1, conditions=("baseline", "sway"), cycles=3)
    report = write_report(folder, pages=True)
    source = report.read_text(encoding="utf-8")
    pages = sorted((folder / "trials").glob("*.html"))
    assert len(pages) == 2
    for each in pages:
        assert f'href="trials/{each.name}"' in source
        assert 'href="../report.html"' in each.read_text(encoding="utf-8")
    before = [each.stat().st_mtime_ns for each in pages]
    changed = replace(fake_trial(1, "sway", 2), condition="sway", key="another")
    write_trial(changed, folder / "trials" / "sub01_sway.parquet")
    frames_read = []

    def read(path):
        frames_read.append(path.stem)
        return read_trial(path)

    monkeypatch.setattr(load, "read_trial", read)
    write_report(folder, pages=True)
    assert sorted(frames_read) == ["sub01_baseline", "sub01_sway"]  # once each
    rewritten = [
        each.name for each, old in zip(pages, before, strict=True) if each.stat().st_mtime_ns != old
    ]
    assert rewritten == ["sub01_sway.html"]


@pytest.mark.parametrize("most", [0, 1])
def test_a_larger_study_says_that_trials_have_no_pages_and_what_writes_them(
    tmp_path, plain, monkeypatch, capsys, most
):
    monkeypatch.setattr(write, "MAX_PAGES", most)
    folder = write_fake_results(tmp_path, subjects=1, conditions=("sway",), cycles=3)
    assert main(["report", str(folder)]) == 0
    written = len([*(folder / "trials").glob("*.html")])
    assert written == most
    says_so = f"hbm report {folder} --pages writes them" in " ".join(
        capsys.readouterr().out.split()
    )
    in_page = "hbm report RESULTS --pages writes them" in text_of(folder / "report.html")
    assert says_so == in_page == (not written)


@needs_chromium
def test_in_a_browser_all_is_drawn_at_any_width_and_nothing_is_requested(page):
    with open_browser() as browser:
        browser.resize(1200)
        browser.open(page)
        sizes = browser.evaluate("[...document.images].map(i => [i.complete, i.naturalWidth])")
        assert len(sizes) == 3  # residuals, the plate of the warning, joints
        assert all(complete and width > 500 for complete, width in sizes)
        for width in (390, 1024):
            browser.resize(width)
            assert browser.evaluate("document.documentElement.scrollWidth") <= width
        assert browser.complaints == []
        assert {url for url in browser.requests if not url.startswith(("data:", "file:"))} == set()
