"""A session knows before its first sample who walks, with which body, on which platform."""

from dataclasses import replace

import pytest

from pipeline.live.preparation import prepare


@pytest.fixture(scope="module")
def prepared(moving_study):
    return prepare(moving_study, "sub01")


def test_a_platform_that_is_taken_as_level_is_noted_as_in_trials(prepared):
    treadmill = prepared.laboratory.treadmill.model_copy(update={"platform": None})
    level = replace(prepared, laboratory=replace(prepared.laboratory, treadmill=treadmill))
    assert [note.code for note in level.notes] == ["platform_pose"]
    still = replace(level, laboratory=replace(level.laboratory, calibration=None))
    assert still.notes == ()


def test_who_walks_has_to_be_clear(moving_study):
    with pytest.raises(ValueError, match=r"\d+ subjects; .*who walks"):
        prepare(moving_study, None)


def test_a_body_that_is_shown_live_wears_the_stated_shoes(prepared):
    person = prepared.person.model_copy(update={"shoe_mass_kg": 0.5})
    shod, bare = replace(prepared, person=person).body()[0], prepared.body()[0]
    for side in ("left", "right"):
        foot = f"{side}_foot"
        assert 0.45 < shod.segments[foot].mass - bare.segments[foot].mass < 0.5
    assert shod.mass == bare.mass


def test_a_recording_for_functional_hips_is_read_only_where_the_settings_use_it(prepared):
    person = prepared.person.model_copy(update={"hip_trial": "not_recorded_yet.c3d"})
    body, _ = replace(prepared, person=person).body()
    assert body.mass == prepared.body()[0].mass
