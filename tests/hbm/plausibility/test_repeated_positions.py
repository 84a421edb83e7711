"""Positions that were repeated instead of measured."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.markers import Markers
from hbm.plausibility.labels import frozen_frames, repeated_positions
from tests.hbm.motions import markers_of, swinging, with_noise, without
from tests.synthetic import synthetic_body

BODY = synthetic_body()


@pytest.fixture(scope="module")
def long_walk():
    motion = swinging(np.random.default_rng(5), frames=200, degrees=20.0)
    return with_noise(markers_of(BODY, motion), np.random.default_rng(6), 0.001)


def held(markers, frames, names=None):
    """The same markers, some of them held at the first of these frames."""
    position = markers.position.copy()
    own = [markers.names.index(name) for name in names or markers.names]
    position[frames, own] = position[frames.start, own]
    return Markers(markers.time, markers.names, position)


def codes(markers):
    return [note.code for note in repeated_positions(BODY, markers)]


def test_a_walk_repeats_no_position(long_walk):
    assert repeated_positions(BODY, long_walk) == ()


@settings(deadline=None)
@given(start=st.integers(0, 100), repeats=st.integers(1, 90))
def test_a_drop_out_is_found_from_a_twentieth_of_a_second_on_and_never_below(
    long_walk, start, repeats
):
    frames = slice(start, start + repeats + 1)
    frozen = frozen_frames(held(long_walk, frames), BODY.markers)
    expected = np.zeros(200, bool)
    if repeats >= 5:
        expected[start + 1 : start + repeats + 1] = True
    np.testing.assert_array_equal(frozen, expected)


def test_the_note_states_frames_and_times(long_walk):
    (note,) = repeated_positions(BODY, held(long_walk, slice(40, 91)))
    assert (note.code, note.level) == ("markers_frozen", "warning")
    assert "in 50 frames from 0.41 to 0.90 s" in note.text


def test_a_trial_that_never_moves_is_frozen(long_walk):
    frozen = frozen_frames(held(long_walk, slice(0, 200)), BODY.markers)
    assert frozen.sum() == 199


def test_markers_of_others_do_not_matter(long_walk):
    """A platform's markers move on while the subject's are frozen, or stand still all the time."""
    frozen = held(long_walk, slice(40, 91))
    for size_m in (0.0, 0.01):
        platform = np.random.default_rng(0).normal(scale=size_m, size=(200, 1, 3))
        position = np.concatenate([frozen.position, platform], axis=1)
        both = Markers(frozen.time, (*frozen.names, "PLAT1"), position)
        assert codes(both) == ["markers_frozen"]


def test_frames_without_markers_are_gaps_and_not_frozen(long_walk):
    gone = without(long_walk, long_walk.names, slice(50, 120))
    assert codes(gone) == []
    some = without(held(long_walk, slice(40, 91)), ["LHEE"], slice(60, 80))
    assert codes(some) == ["markers_frozen"]


@settings(deadline=None)
@given(name=st.sampled_from(BODY.markers), repeats=st.integers(2, 150))
def test_a_marker_held_alone_is_found_from_half_a_second_on_and_never_below(
    long_walk, name, repeats
):
    notes = repeated_positions(BODY, held(long_walk, slice(20, 21 + repeats), [name]))
    if repeats < 50:
        assert notes == ()
    else:
        (note,) = notes
        assert (note.code, note.level) == ("markers_constant", "warning")
        assert note.values["constant_s"] == {name: pytest.approx(repeats / 100)}


def test_a_foot_that_rests_while_the_body_moves_is_not_constant(long_walk):
    """In the stance of a noise-free or rounded recording all its markers repeat together."""
    foot = [m for m, s in zip(BODY.markers, BODY.marker_segment, strict=True) if s == "left_foot"]
    assert codes(held(long_walk, slice(20, 120), foot)) == []
