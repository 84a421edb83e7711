"""Labels that change places in the middle of a trial."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hbm.markers import Markers
from hbm.plausibility.labels import counterparts, labels_exchanged
from tests.hbm.motions import exchanged, markers_of, swinging, with_noise, without
from tests.synthetic import synthetic_body

BODY = synthetic_body()
PAIRS = list(counterparts(BODY.marker_set).items())


@pytest.fixture(scope="module")
def long_walk():
    motion = swinging(np.random.default_rng(5), frames=200, degrees=20.0)
    return with_noise(markers_of(BODY, motion), np.random.default_rng(6), 0.001)


def found(markers):
    return [note.values for note in labels_exchanged(markers, BODY.markers)]


def test_a_walk_exchanges_no_labels(long_walk):
    assert found(long_walk) == []


@settings(deadline=None)
@given(
    pair=st.sampled_from(PAIRS),
    start=st.integers(5, 100),
    duration=st.integers(2, 90),
)
def test_every_pair_is_found_with_its_times_however_short(long_walk, pair, start, duration):
    """Where its markers are 5 cm apart; nearer ones pass each other in this motion."""
    own = [long_walk.names.index(name) for name in pair]
    left, right = long_walk.position[[start, start + duration]][:, own].swapaxes(0, 1)
    assume((np.linalg.norm(left - right, axis=1) > 0.05).all())
    (values,) = found(exchanged(long_walk, slice(start, start + duration), pair))
    assert values["named"] == ("/".join(pair),)
    assert values["first_s"] == pytest.approx(start / 100)
    assert values["last_s"] == pytest.approx((start + duration) / 100)


def test_labels_exchanged_to_the_end_are_found_where_they_begin(long_walk):
    (values,) = found(exchanged(long_walk, slice(120, None), ("LHEE", "RHEE")))
    assert (values["first_s"], values["last_s"]) == (1.2, 1.2)


def test_markers_of_one_segment_and_whole_legs_are_found(long_walk):
    (values,) = found(exchanged(long_walk, slice(50, 90), ("LHEAD", "FHEAD")))
    assert values["named"] == ("LHEAD/FHEAD",)
    (values,) = found(exchanged(long_walk, slice(50, 90), *PAIRS))
    assert values["pairs"] == len(PAIRS)
    assert values["named"][-1] == "…"


@pytest.mark.parametrize(("gap", "expected"), [(5, 1), (30, 0)])
def test_a_short_gap_at_the_exchange_does_not_hide_it(long_walk, gap, expected):
    """After a long gap the motion is unknown, and nothing is claimed."""
    swapped = exchanged(long_walk, slice(100, None), ("LHEE", "RHEE"))
    gone = without(swapped, ["LHEE", "RHEE"], slice(100 - gap, 100))
    assert len(found(gone)) == expected


@settings(deadline=None, max_examples=30)
@given(cm=st.floats(3.5, 80), frame=st.integers(5, 190), seed=st.integers(0, 99))
def test_a_marker_that_jumps_alone_has_exchanged_nothing(long_walk, cm, frame, seed):
    direction = np.random.default_rng(seed).normal(size=3)
    position = long_walk.position.copy()
    heel = long_walk.names.index("LHEE")
    position[frame:, heel] += cm / 100 * direction / np.linalg.norm(direction)
    assert found(Markers(long_walk.time, long_walk.names, position)) == []


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 99))
def test_glitches_of_many_markers_are_no_exchange(long_walk, seed):
    rng = np.random.default_rng(seed)
    position = long_walk.position.copy()
    glitch = rng.random(position.shape[:2]) < 0.02
    position[glitch] += rng.normal(scale=0.1, size=(glitch.sum(), 3))
    assert found(Markers(long_walk.time, long_walk.names, position)) == []


def test_the_end_of_a_drop_out_is_no_exchange(long_walk):
    position = long_walk.position.copy()
    position[60:160] = position[60]
    assert found(Markers(long_walk.time, long_walk.names, position)) == []
