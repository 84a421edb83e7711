"""The verdicts of a study in sentences: each thing once, and what is missing at the end."""

from pipeline.statistics.headline import headline, headlines
from pipeline.statistics.verdict import MeasurementInterval, Verdict


def verdict(condition="sway", answer="inconclusive", n=9, needed=12):
    return Verdict("Fx", "N", condition, answer, n=n, needed=needed)


def test_the_headline_counts_the_residuals_at_baseline_and_names_the_others():
    answers = dict(
        zip(
            ("Fx", "Fy", "Fz", "Mx"), ("at baseline", "above", "above", "inconclusive"), strict=True
        )
    )
    found = [Verdict(axis, "N", "sway", answer, n=9) for axis, answer in answers.items()]
    assert headline(found, "sway") == (
        "In sway, 1 of 4 residuals is at baseline level with compensation; "
        "Fy and Fz are above it; for Mx, the result is inconclusive with 9 subjects"
    )


def test_a_study_without_enough_subjects_says_so_once():
    found = [verdict(c, n=3, needed=40) for c in ("baseline", "sway", "pitch")]
    (sentence,) = headlines(found)
    assert sentence.startswith(
        "3 subjects are a demonstration: 3 of 3 comparisons are inconclusive"
    )
    assert "40 would show them to be at the level of the reference" in sentence


def test_decided_comparisons_of_few_subjects_are_told_first():
    found = [verdict("sway", "at baseline", n=3), verdict("pitch", n=3)]
    first, last = headlines(found)
    assert first == "In sway, 1 of 1 residuals is at baseline level with compensation."
    assert last.startswith("3 subjects are a demonstration: 1 of 2 comparisons is inconclusive")


def test_a_study_with_enough_subjects_names_its_inconclusive_residuals():
    found = [verdict("sway", "at baseline"), verdict("pitch", needed=None)]
    told = headlines(found)
    assert told[1] == (
        "In pitch, 0 of 1 residuals are at baseline level with compensation; for Fx, the result "
        "is inconclusive with 9 subjects."
    )
    assert told[2] == (
        "1 of 2 comparisons is inconclusive. Subjects differ so much that 1000 would not "
        "decide them."
    )


def test_more_subjects_are_not_asked_for_where_there_were_enough():
    found = [verdict("sway", needed=20), verdict("pitch", needed=7)]
    *_, last = headlines(found)
    assert "20 would show 1 of them to be at the level of the reference" in last
    assert last.endswith(
        "For 1, these subjects would have been enough if there were no difference: there may be "
        "one."
    )


def test_verdicts_that_errors_of_measurement_could_turn_are_named_last():
    wide, narrow = (MeasurementInterval(-9, 9, contains) for contains in (True, False))
    cells = (
        *(("Fx", "sway", wide), ("Fy", "sway", narrow)),
        *(("Fx", "pitch", wide), ("Fy", "pitch", wide)),
    )
    found = [
        Verdict(axis, "N", condition, "at baseline", n=9, measurement=own)
        for axis, condition, own in cells
    ]
    *others, last = headlines(found)
    assert last == (
        "For Fx in sway, and all residuals in pitch, errors of usual size alone could turn the "
        "verdict: by measurement, the residual may be on either side of the margin of 20 %."
    )
    assert len(others) == 2
    assert headlines([found[1]])[-1].startswith("In sway")
