"""Two methods that measure one delay: which is used, and when they contradict each other."""

import numpy as np
import pytest

from compensation import Delay, agreed_delay


def test_the_delay_in_motion_is_used_where_it_is_precise():
    found = agreed_delay(Delay(0.0040, 0.00001), Delay(0.0042, 0.0004))
    assert (found.method, found.delay.seconds) == ("motion", 0.0042)


def test_a_delay_in_motion_known_to_some_milliseconds_only_leaves_it_to_the_hammer():
    assert agreed_delay(Delay(0.0040, 0.0001), Delay(0.0042, 0.002)).method == "hammer"


def test_of_two_vague_delays_the_less_vague_one_is_used():
    assert agreed_delay(Delay(0.0040, 0.003), Delay(0.0042, 0.002)).method == "motion"


@pytest.mark.parametrize(
    ("hammer", "motion", "method"),
    [(Delay(0.004, 0.1), None, "hammer"), (None, Delay(0.004, 0.1), "motion")],
)
def test_the_only_delay_is_used_and_nothing_contradicts_it(hammer, motion, method):
    found = agreed_delay(hammer, motion)
    assert found.method == method
    assert np.isnan(found.difference_s)
    assert not found.disagree


def test_without_any_delay_there_is_none_to_agree_on():
    assert agreed_delay(None, None) is None


@pytest.mark.parametrize(("apart_s", "disagree"), [(0.00038, False), (0.00040, True)])
def test_methods_disagree_where_their_intervals_no_longer_overlap(apart_s, disagree):
    """Two standard errors of 0.1 ms: ± 0.196 ms each."""
    found = agreed_delay(Delay(0.004 + apart_s, 0.0001), Delay(0.004, 0.0001))
    assert found.disagree is disagree
    assert found.difference_s == pytest.approx(apart_s)


def test_few_impacts_widen_the_interval():
    """Student's t of two degrees of freedom is 4.30."""
    assert Delay(0.0, 0.001, degrees_of_freedom=2).uncertainty == pytest.approx(0.0043027, rel=1e-4)
