"""The Methods say what was done, for these settings and no others."""

import re
from dataclasses import replace

import pytest

from pipeline.config.schema import Settings
from pipeline.config.study import read_study
from pipeline.report.methods import cited, methods
from pipeline.report.references import bibtex, references
from pipeline.run.load import collect
from pipeline.statistics.comparison import statistics
from tests.pipeline.fake_results import write_fake_results, write_fake_study


def text_of(folder, study=None, **made):
    results = collect(write_fake_results(folder, cycles=2, **made))
    tests = statistics(results.residuals, results.subjects)
    return " ".join(methods(results, tests, study)), results


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    folder = tmp_path_factory.mktemp("usual")
    study = read_study(write_fake_study(folder / "study", subjects=3))
    return text_of(folder / "results", study, subjects=3)


def test_the_study_is_told_as_it_was(usual):
    text, _ = usual
    for said in (
        "3 subjects (2 male; 1 female; age 24 ± 1 years; stature 1.68 ± 0.03 m; "
        "body mass 64.0 ± 3.0 kg)",
        "conditions baseline, sway and pitch",
        "weighed by the plates",
        "marker set hbm2",
        "Harrington et al. 2007",
        "9 mm from the skin",
        "forward and backward (−3 dB at 6 Hz after both passes)",
        "platform's pose from 3 markers",
        "contact above 30 N",
        "2 triaxial accelerometers",
        "low-passed with zero phase (−3 dB at 20 Hz)",
        "first 12 cycles of the right foot after 10 s",
        "contain a perturbation (onset from the platform's motion)",
        "paired t-tests",
        "pingouin",
    ):
        assert said in text


def test_segments_that_are_known_better_are_named(usual):
    text, results = usual
    assert "but for those stated" not in text
    key, known = ("sub01", "sway"), ("left_shank", "right_foot")
    trial = replace(results.summaries[key], overridden_segments=known)
    found = replace(results, summaries=results.summaries | {key: trial})
    tests = statistics(found.residuals, found.subjects)
    told = " ".join(methods(found, tests, None))
    assert "stated of single segments (sub01: left_shank and right_foot)" in told


@pytest.mark.parametrize(
    ("stated", "said", "unsaid"),
    [
        ({"filter": "realtime", "cutoff_hz": 8}, "causal .*cut-off 8 Hz", "backward"),
        ({"hip": "bell"}, r"Bell et al\. 1990", "Harrington"),
        ({"marker_offset_m": 0.014}, "14 mm from the skin", " 9 mm"),
        ({"plate_delay_s": 0.004}, "4 ms later than the markers", "backward and forward"),
        ({"contact_threshold_n": 20}, "contact above 20 N", "30 N"),
    ],
)
def test_every_setting_changes_the_text(tmp_path, stated, said, unsaid):
    chosen = Settings.model_validate(stated)
    text, _ = text_of(tmp_path, subjects=1, conditions=("baseline",), settings=chosen)
    assert re.search(said, text)
    assert unsaid not in text


def test_without_compensation_none_is_claimed(tmp_path):
    text, _ = text_of(tmp_path, subjects=2, compensated=False)
    assert "No compensation for the treadmill's own inertia was applied" in text
    assert "accelerometer" not in text
    assert "planned pairs" not in text


def test_tests_that_were_not_done_are_not_told(tmp_path):
    text, _ = text_of(tmp_path, subjects=1)
    assert "analysis of variance" not in text
    assert "t-test" not in text
    assert "pingouin" not in text


def test_without_the_study_platform_and_sensors_are_not_told(tmp_path):
    text, _ = text_of(tmp_path, subjects=2)
    assert "platform's pose" not in text
    assert "triaxial" not in text


def test_whatever_is_cited_is_in_the_references(usual):
    text, results = usual
    entries = bibtex(cited(results), "0.1.0").split("\n\n")
    works = re.findall(r"([A-Z]\w+)(?: and [A-Z'\w]+| et al\.|'s table)?[ ,(]+(\d{4})\b", text)
    assert len(works) >= 6
    for author, year in works:
        assert any(author in entry and f"{{{year}}}" in entry for entry in entries), author
    assert not any("bell1990" in entry for entry in entries)


@pytest.mark.parametrize("key", references())
def test_every_reference_is_sound_bibtex(key):
    entry = bibtex([key], "1.2.3").strip()
    assert re.match(rf"@(article|software|mastersthesis){{{key},\n", entry)
    assert entry.count("{") == entry.count("}")
    assert entry.endswith("\n}")
    for field in ("author", "title", "year"):
        assert re.search(rf"\b{field}\s*= {{.+", entry)
    if entry.startswith("@article"):
        assert re.search(r"(doi|url)\s*= {(10\.\d{4,}/\S+|https://\S+)}", entry)
