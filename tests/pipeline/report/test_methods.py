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
            with_note(
                "plates_compensated",
                model="dynamic",
                accelerometers=("rear",),
                low_pass="",
                delay_s={"rear": 0.0},
            ),
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


def with_settings(**stated):
    return lambda trial: replace(trial, settings=Settings.model_validate(stated))


def with_engine(trial):
    alone = EngineUsed("kernels", "casadi 3.7.2")
    variants = {name: replace(own, engine=alone) for name, own in trial.variants.items()}
    return replace(trial, variants=variants)


def with_events(code):
    return lambda trial: replace(trial, notes=(Note.of(code, left=3, right=3),))


@pytest.mark.parametrize(
    ("changed", "expected", "absent", "not_cited"),
    [
        (
            with_engine,
            "algorithm with equations generated with CasADi 3.7.2. ",
            "Pinocchio",
            "carpentier2019",
        ),
        (
            with_settings(filter="realtime", cutoff_hz=8),
            "causal .*cut-off 8 Hz",
            "backward",
            None,
        ),
        (with_settings(hip="bell"), r"Bell et al\. \(1990\)", "Harrington", "harrington2007"),
        (with_settings(marker_offset_m=0.014), "14 mm from the skin", " 9 mm", None),
        (with_settings(plate_delay_s=0.004), "a delay of 4 ms", "backward and forward", None),
        (with_settings(contact_threshold_n=20), "threshold 20 N", "30 N", None),
        (with_settings(min_valid_share=0.8), "of which less than 80 % remained", "50 %", None),
        (with_events("events_of_file"), "those of the recordings", "Zeni", "zeni2008"),
        (with_events("events_from_markers"), "from heel, toe and sacrum markers", "20 N", None),
        (with_events("events_of_plates"), "one foot alone passes 20 N", "Zeni", "zeni2008"),
        (with_events("events_uncalibrated"), "motion of the feet relative to", "20 N", None),
    ],
)
def test_how_all_trials_were_processed_is_described_and_cited(
    usual, changed, expected, absent, not_cited
):
    _, results = usual
    trials = {key: changed(trial) for key, trial in results.trials.items()}
    found = replace(results, trials=trials)
    text = " ".join(methods(found, statistics(found.residuals, found.subjects), EXPERIMENT_3))
    assert re.search(expected, text)
    assert absent not in text
    assert not_cited is None or not_cited not in bibtex([text], "1")


def test_what_was_not_done_is_not_described(tmp_path):
    text, _ = text_of(tmp_path, subjects=1, compensated=False)
    assert "Treadmill inertia was not compensated" in text
    absent = ("accelerometer", "planned pair", "analysis of variance", "pingouin")
    assert not [words for words in (*absent, "t-test", "platform's pose") if words in text]


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
