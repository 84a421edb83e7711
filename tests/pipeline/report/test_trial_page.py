"""The page of a trial: the numbers of its table, its warnings with their channels, in a browser."""

import re
from dataclasses import replace

import numpy as np
import pytest

from hbm.notes import Note, warnings_of
from pipeline.io.recording import Plate
from pipeline.report.trial_page import verdict_lines, write_trial_page
from pipeline.report.write import write_report
from pipeline.run.store import write_trial
from pipeline.trial.residuals import residual_table, threshold_table
from tests.pipeline.browser import needs_chromium, open_browser
from tests.pipeline.fake_results import fake_trial, write_fake_results

JUMP = Note.of("plate_jumps", plate=2, sizes={"Fz": 800.0}, jumps=3, first_s=4.2)


def recorded(number):
    """A plate with samples."""
    time = np.arange(0, 10, 0.001)
    wrench = np.outer(np.sin(time), np.ones(6))
    corners = [(1, 1, 0), (1, -1, 0), (-1, -1, 0), (-1, 1, 0)]
    return Plate(number, time, wrench, np.eye(3), np.zeros(3), np.array(corners, float))


@pytest.fixture(scope="module")
def trial():
    result = fake_trial(1, "sway", 12, True, None, 0.0)
    return replace(result, notes=(*result.notes, JUMP), doubted_plates=(2,))


@pytest.fixture(scope="module")
def page(trial, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    return write_trial_page(trial, folder / "trial.html", plates=(recorded(1), recorded(2)))


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
    for row in threshold_table(trial).query("compensated").itertuples():
        assert (
            f"Peak residual {row.quantity} {row.peak:.1f} {row.unit}, limit {row.limit:.1f}" in text
        )


@pytest.mark.parametrize(
    ("scale", "sentence"),
    [
        (
            1.0,
            "exceed healthy walking in Fy and Mz; peaks of force and moment exceed",
        ),
        (
            0.35,
            "are below healthy walking in all six axes; peaks of moment exceed",
        ),
        (
            0.01,
            "are below healthy walking in all six axes; peaks are within",
        ),
    ],
)
def test_the_first_sentence_compares_with_healthy_walking_and_with_published_limits(
    trial, scale, sentence
):
    dynamics = replace(trial.compensated, residual=scale * trial.compensated.residual)
    variants = {**trial.variants, "compensated": dynamics}
    first, *_ = verdict_lines(replace(trial, variants=variants))
    assert first == f"RMS residuals with compensation {sentence} published limits."


def test_markers_beyond_the_guideline_are_drawn_and_no_others(trial, page, tmp_path):
    assert "from the model" not in text_of(page)
    error = trial.motion.marker_error.copy()
    error[3, 4] = 0.05
    far = replace(trial, motion=replace(trial.motion, marker_error=error))
    text = text_of(write_trial_page(far, tmp_path / "far.html"))
    assert f"Markers more than 40 mm from the model: {trial.motion.markers[4]} " in text


def test_a_warning_has_its_advice_and_the_channels_of_its_plate(trial, page):
    source, text = page.read_text(encoding="utf-8"), text_of(page)
    for note in warnings_of(trial.notes):
        assert note.text in text
        assert note.advice in text
    assert re.findall('alt="(Channels of .*?)"', source) == ["Channels of plate 2, as recorded"]
    assert "Not explained yet: hbm explain" in text


def test_a_trial_without_residuals_has_a_page_that_says_why(tmp_path, trial):
    quality = np.full_like(trial.quality, 1)
    empty = replace(trial, quality=quality, shortage="nobody walked", notes=())
    text = text_of(write_trial_page(empty, tmp_path / "none.html"))
    assert "no residuals: nobody walked" in text.lower()


def test_every_trial_of_a_report_has_a_page_and_an_unchanged_one_is_kept(tmp_path):
    folder = write_fake_results(tmp_path, subjects=2, conditions=("baseline", "sway"))
    report = write_report(folder, pages=True)
    source = report.read_text(encoding="utf-8")
    pages = sorted((folder / "trials").glob("*.html"))
    assert len(pages) == 4
    for each in pages:
        assert f'href="trials/{each.name}"' in source
        assert 'href="../report.html"' in each.read_text(encoding="utf-8")
    before = [each.stat().st_mtime_ns for each in pages]
    changed = replace(fake_trial(1, "sway", 11, True, None, 0.0), condition="sway", key="another")
    write_trial(changed, folder / "trials" / "sub01_sway.parquet")
    write_report(folder, pages=True)
    rewritten = [
        each.name for each, old in zip(pages, before, strict=True) if each.stat().st_mtime_ns != old
    ]
    assert rewritten == ["sub01_sway.html"]


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
