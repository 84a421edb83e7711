"""The Methods section describes what was done with the settings of the trials."""

import re
from dataclasses import replace

import pytest

from hbm.engines.engine import EngineUsed
from hbm.notes import Note
from pipeline.config.schema import Settings
from pipeline.config.study import read_study
from pipeline.report.methods import bibtex, methods, references
from pipeline.run.load import collect
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3
from tests.pipeline.fake_results import write_fake_results, write_fake_study


def text_of(folder, study=None, **made):
    results = collect(write_fake_results(folder, cycles=2, **made))
    tests = statistics(results.residuals, results.subjects)
    return " ".join(methods(results, tests, EXPERIMENT_3, study)), results


def described(results, changed):
    """The Methods with another trial in place of sub01's sway."""
    key = ("sub01", "sway")
    found = replace(results, trials=results.trials | {key: changed(results.trials[key])})
    return " ".join(methods(found, statistics(found.residuals, found.subjects), EXPERIMENT_3, None))


def with_note(code, **values):
    return lambda trial: replace(trial, notes=(*trial.notes, Note.of(code, **values)))


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    folder = tmp_path_factory.mktemp("usual")
    study = read_study(write_fake_study(folder / "study", subjects=3))
    return text_of(folder / "results", study, subjects=3)


def test_the_methods_describe_the_study(usual):
    text, _ = usual
    for phrase in (
        "3 subjects (2 male, 1 female; age 24 ± 1 years; stature 1.68 ± 0.03 m; "
        "body mass 64.0 ± 3.0 kg)",
        "conditions baseline, sway and pitch",
        "measured by the force plates",
        "marker set hbm2",
        "Harrington et al. (2007)",
        "9 mm from the skin",
        "upper trunk extends from the cervicale (C7) to the xiphoid process",
        "forward and backward (−3 dB at 6 Hz after both passes)",
        "Newton–Euler algorithm with Pinocchio 4.1.0 (Carpentier et al. 2019) and verified in 144 "
        "frames with a second implementation (equations generated with CasADi 3.7.2): generalised "
        "forces and residuals agreed to 2e-14 of each frame's largest force and moment.",
        "platform's pose measured with 3 markers",
        "contact (threshold 30 N)",
        "2 triaxial accelerometers",
        "low-pass filtered with zero phase (−3 dB at 20 Hz)",
        "first 12 cycles of the right foot after 10 s",
        "contained a perturbation (onset from the platform's motion)",
        "paired t-tests",
        "pingouin",
    ):
        assert phrase in text


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (
            with_note("landmarks_substituted", rules=("XIPH (by mean proportions)",)),
            "Landmarks without markers were replaced: XIPH (by mean proportions).",
        ),
        (
            with_note("compensated_dynamically", lags_ms=("10", "20", "40")),
            "accelerometer signals and their second differences over 10, 20 and 40 ms",
        ),
        (
            lambda trial: replace(trial, notes=(Note.of("mass_of_file", mass_kg=70.0, file="a"),)),
            "steadiest second of standing still, or as stated in the recording; stature",
        ),
        (
            lambda trial: replace(trial, overridden_segments=("left_shank", "right_foot")),
            "stated values (sub01: left_shank and right_foot)",
        ),
    ],
)
def test_what_one_trial_was_processed_with_is_described(usual, changed, expected):
    text, results = usual
    assert expected not in text
    assert expected in described(results, changed)


def test_without_pinocchio_it_is_neither_named_nor_cited(usual):
    _, results = usual
    alone = EngineUsed("kernels", "casadi 3.7.2")
    trials = {
        key: replace(
            trial, variants={n: replace(d, engine=alone) for n, d in trial.variants.items()}
        )
        for key, trial in results.trials.items()
    }
    found = replace(results, trials=trials)
    text = " ".join(methods(found, statistics(found.residuals, found.subjects), EXPERIMENT_3, None))
    assert "algorithm with equations generated with CasADi 3.7.2. " in text
    assert "Pinocchio" not in text
    assert "carpentier2019" not in bibtex([text], "1")


@pytest.mark.parametrize(
    ("stated", "expected", "absent"),
    [
        ({"filter": "realtime", "cutoff_hz": 8}, "causal .*cut-off 8 Hz", "backward"),
        ({"hip": "bell"}, r"Bell et al\. \(1990\)", "Harrington"),
        ({"marker_offset_m": 0.014}, "14 mm from the skin", " 9 mm"),
        ({"plate_delay_s": 0.004}, "a delay of 4 ms", "backward and forward"),
        ({"contact_threshold_n": 20}, r"threshold 20 N", "30 N"),
        ({"min_valid_share": 0.8}, r"of which less than 80 % remained", "50 %"),
    ],
)
def test_every_setting_changes_the_text(tmp_path, stated, expected, absent):
    chosen = Settings.model_validate(stated)
    text, _ = text_of(tmp_path, subjects=1, conditions=("baseline",), settings=chosen)
    assert re.search(expected, text)
    assert absent not in text


@pytest.mark.parametrize(
    ("code", "expected", "cites_zeni"),
    [
        ("events_of_file", "those of the recordings", False),
        ("events_from_markers", "detected from heel, toe and sacrum markers", True),
        ("events_of_plates", "a plate that carries one foot alone passes 20 N", False),
        ("events_uncalibrated", "the motion of the feet relative to the ground", True),
    ],
)
def test_the_origin_of_the_gait_events_is_described_and_cited(tmp_path, code, expected, cites_zeni):
    _, results = text_of(tmp_path, subjects=1)
    note = Note.of(code, left=3, right=3)
    summaries = {key: replace(each, notes=(note,)) for key, each in results.trials.items()}
    found = replace(results, trials=summaries)
    text = " ".join(methods(found, statistics(found.residuals, found.subjects), EXPERIMENT_3, None))
    assert text.count("Gait events were") == 1
    assert expected in text
    assert ("zeni2008" in bibtex([text], "1")) == cites_zeni


def test_without_compensation_none_is_described(tmp_path):
    text, _ = text_of(tmp_path, subjects=2, compensated=False)
    assert "Treadmill inertia was not compensated" in text
    assert "accelerometer" not in text
    assert "planned pairs" not in text


def test_tests_that_were_not_computed_are_not_described(tmp_path):
    text, _ = text_of(tmp_path, subjects=1)
    assert "analysis of variance" not in text
    assert "t-test" not in text
    assert "pingouin" not in text


def test_without_the_study_platform_and_sensors_are_not_described(tmp_path):
    text, _ = text_of(tmp_path, subjects=2)
    assert "platform's pose" not in text
    assert "triaxial" not in text


def test_all_citations_are_in_the_references(usual):
    text, _ = usual
    entries = bibtex([text], "0.1.0").split("\n\n")
    works = re.findall(r"([A-Z]\w+)(?: and [A-Z'\w]+| et al\.|'s table)?[ ,(]+(\d{4})\b", text)
    assert len(works) >= 6
    for author, year in works:
        assert any(author in entry and f"{{{year}}}" in entry for entry in entries), author
    assert not any("bell1990" in entry for entry in entries)


@pytest.mark.parametrize("key", references())
def test_every_reference_is_valid_bibtex(key):
    entry = references()[key]
    assert re.match(rf"@(article|inproceedings|software|mastersthesis){{{key},\n", entry)
    assert entry.count("{") == entry.count("}")
    assert entry.endswith("\n}")
    for field in ("author", "title", "year"):
        assert re.search(rf"\b{field}\s*= {{.+", entry)
    if entry.startswith(("@article", "@inproceedings")):
        assert re.search(r"(doi|url)\s*= {(10\.\d{4,}/\S+|https://\S+)}", entry)


def test_the_methods_are_six_paragraphs(usual):
    _, results = usual
    tests = statistics(results.residuals, results.subjects)
    assert len(methods(results, tests, EXPERIMENT_3)) == 6
    other = Settings(cutoff_hz=12, filter="realtime")
    mixed = described(results, lambda trial: replace(trial, settings=other))
    assert "as in the real-time filter of the Human Body Model) and a second-order" in mixed
