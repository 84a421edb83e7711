"""The Methods section describes what was done with the settings of the trials."""

import re
from dataclasses import replace

import pytest

from pipeline.config.schema import Settings
from pipeline.config.study import read_study
from pipeline.report.methods import bibtex, methods
from pipeline.run.load import collect
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3
from tests.pipeline.fake_results import write_fake_results, write_fake_study


def text_of(folder, study=None, **made):
    results = collect(write_fake_results(folder, cycles=2, **made))
    tests = statistics(results.residuals, results.subjects)
    return " ".join(methods(results, tests, EXPERIMENT_3, study)), results, tests


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    folder = tmp_path_factory.mktemp("usual")
    study = read_study(write_fake_study(folder / "study", subjects=3))
    return text_of(folder / "results", study, subjects=3)


def test_the_methods_describe_the_study(usual):
    text, *_ = usual
    for phrase in (
        "3 subjects (2 male, 1 female; age 24 ± 1 years; stature 1.68 ± 0.03 m; "
        "body mass 64.0 ± 3.0 kg)",
        "conditions baseline, sway and pitch",
        "9 mm from the skin",
        "forward and backward (−3 dB at 6 Hz after both passes)",
        "Newton–Euler algorithm with Pinocchio 4.1.0 (Carpentier et al. 2019).",
        "platform's pose measured with 3 markers",
        "contact (threshold 30 N)",
        "low-pass filtered with zero phase (−3 dB at 20 Hz)",
        "first 12 cycles of the right foot after 10 s",
        "paired t-tests",
    ):
        assert phrase in text
    assert not re.search(
        r"\b(He|She|His|Her|he|she|his|her)\b", text
    )  # a reader takes it for whom?


def with_settings(**stated):
    return lambda trial: replace(trial, settings=Settings.model_validate(stated))


def with_engine(trial):
    engine = "kernels generated with CasADi 3.7.2"
    variants = {name: replace(dynamics, engine=engine) for name, dynamics in trial.variants.items()}
    return replace(trial, variants=variants)


def with_procedure(**known):
    return lambda trial: replace(trial, procedure=replace(trial.procedure, **known))


def with_landmarks(trial):
    rules = ("LPSIS (by the other side)",)
    return replace(trial, body=replace(trial.body, landmark_rules=rules))


def with_shoes(trial):
    return replace(trial, subject=trial.subject.model_copy(update={"shoe_mass_kg": 0.3}))


def as_it_is(trial):
    return trial


def with_braced_feet(trial):
    return replace(trial, overridden_segments=("right_foot",))


@pytest.mark.parametrize(
    ("changed", "expected", "absent", "not_cited"),
    [
        (
            with_engine,
            "algorithm with kernels generated with CasADi 3.7.2. ",
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
        (with_settings(plate_delay_s=0.004), "a delay of 4 ms", "backward and forward", None),
        (with_procedure(events="plates"), "one foot alone passes 20 N", "Zeni", "zeni2008"),
        (with_shoes, "Shoes of 0.3 kg each were added to the feet\\.", "had no shoes", None),
        (as_it_is, "The body models had no shoes", "Shoes of", None),
        (with_procedure(held=("neck",)), r"about neutral \(neck\)", "one foot alone", None),
        (
            with_procedure(plate_calibration="plates.json", delays_corrected=True),
            r"\(plates\.json\) and brought forward",
            "about neutral",
            None,
        ),
        (with_procedure(dynamic=True), "second differences over", "brought forward", None),
        (with_landmarks, r"replaced: LPSIS \(by the other side\)\.", "second differences", None),
        (with_braced_feet, "stated values .*right_foot", "had no shoes", None),
    ],
)
def test_how_all_trials_were_processed_is_described_and_cited(
    usual, changed, expected, absent, not_cited
):
    _, results, tests = usual
    trials = {key: changed(trial) for key, trial in results.trials.items()}
    text = " ".join(methods(replace(results, trials=trials), tests, EXPERIMENT_3))
    assert re.search(expected, text)
    assert absent not in text
    assert not_cited is None or not_cited not in bibtex([text], "1")


def test_what_was_not_done_is_not_described(tmp_path):
    text, *_ = text_of(tmp_path, subjects=1, compensated=False)
    absent = (
        "Treadmill inertia",
        "accelerometer",
        "analysis of variance",
        "t-test",
        "platform's pose",
    )
    assert not [words for words in absent if words in text]


def test_all_citations_are_in_the_references(usual):
    text, *_ = usual
    entries = bibtex([text], "0.1.0").split("\n\n")
    works = re.findall(r"([A-Z]\w+)(?: and [A-Z'\w]+| et al\.|'s table)?[ ,(]+(\d{4})\b", text)
    assert len(works) >= 6
    for author, year in works:
        assert any(author in entry and f"{{{year}}}" in entry for entry in entries), author
    assert not any("bell1990" in entry for entry in entries)


def test_only_analyses_that_were_made_are_described(tmp_path):
    """Two subjects, of whom one lacks sway and pitch: one pair of five has a test."""
    lacking = {("sub02", "sway"), ("sub02", "pitch")}
    results = collect(write_fake_results(tmp_path, subjects=2, cycles=2, without=lacking))
    tests = statistics(results.residuals, results.subjects, recordings=results.residuals)
    text = " ".join(methods(results, tests, EXPERIMENT_3, None))
    assert re.search(r"1 of the 5 .*baseline IC .*baseline no IC", text)
    assert "mixed model" not in text
    assert "non-inferiority" in text
    alone = {*lacking, ("sub02", "baseline")}
    results = collect(write_fake_results(tmp_path / "one", subjects=2, cycles=2, without=alone))
    tests = statistics(results.residuals, results.subjects, recordings=results.residuals)
    assert "non-inferiority" not in " ".join(methods(results, tests, EXPERIMENT_3, None))


def test_curves_are_described_only_where_they_were_compared(usual):
    _, results, tests = usual
    without, compared = (
        " ".join(methods(results, tests, EXPERIMENT_3, curves=curves)) for curves in (False, True)
    )
    assert "sign flips" not in without
    assert "sign flips" in compared
