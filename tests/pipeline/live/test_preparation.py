"""What is stated about a session, before its first sample."""

from dataclasses import replace

import pytest

from pipeline.live.preparation import prepare


@pytest.fixture(scope="module")
def prepared(moving_study):
    return prepare(moving_study, "sub01")


def test_a_study_says_where_the_platform_is(prepared):
    assert prepared.laboratory.calibration is not None
    assert prepared.laboratory.treadmill.platform is not None
    assert prepared.notes == ()
    assert prepared.streams == ("Markers", ("Plates", "Analog"))


def test_a_platform_that_is_taken_as_level_is_noted_as_in_trials(prepared):
    treadmill = prepared.laboratory.treadmill.model_copy(update={"platform": None})
    level = replace(prepared, laboratory=replace(prepared.laboratory, treadmill=treadmill))
    assert [note.code for note in level.notes] == ["platform_pose"]
    still = replace(level, laboratory=replace(level.laboratory, calibration=None))
    assert still.notes == ()


def test_a_calibration_without_a_study_is_refused_before_it_is_read(tmp_path):
    with pytest.raises(ValueError, match=r"^--calibration absent.json needs the study: [^\n]+$"):
        prepare(None, None, calibration=tmp_path / "absent.json")


def test_who_walks_has_to_be_clear(moving_study):
    with pytest.raises(ValueError, match=r"the study has \d+ subjects; state who walks"):
        prepare(moving_study, None)
