"""End points of trunk and head on real recordings: what they say for those of the body."""

import numpy as np
import pytest

from tests.trunk_ends.choices import with_ends
from tests.trunk_ends.generated_model import our_trunk, true_trunk
from tests.trunk_ends.recordings import generated_walk, quiet_standing, stairs


@pytest.fixture(scope="module")
def standing(shared_data):
    return quiet_standing(shared_data)


def chosen(case, choice):
    return with_ends(case.body, choice, case.calibration, case.measures)


def ahead_of_the_head_s_centre(case, choice, names):
    """Mean position of markers of the head, from its centre of mass forward [m]."""
    body = chosen(case, choice)
    own = [body.marker_position[body.markers.index(name), 0] for name in names]
    return np.mean(own) - body.segments["head"].center[0]


def test_the_head_s_centre_is_nearer_to_the_mastoids_and_to_the_middle_of_the_head_band(
    standing, shared_data
):
    """It was 7 cm behind both while the head ended at the marker on C7."""
    for case, names in (
        (standing, ("LMAS", "RMAS")),
        (stairs(shared_data), ("LFHD", "RFHD", "LBHD", "RBHD")),
    ):
        assert 0 < ahead_of_the_head_s_centre(case, "CERV-XYPH", names) < 0.04
        assert ahead_of_the_head_s_centre(case, "CERV-XYPH, head to C7", names) > 0.06


def test_standing_still_the_centre_of_mass_is_nearer_to_the_centre_of_pressure(standing):
    own, old = (standing.residual(chosen(standing, c)) for c in ("CERV-XYPH", "midpoints"))
    assert abs(own[:, 4].mean()) < 0.7 * abs(old[:, 4].mean())


def test_the_generated_walk_s_trunk_is_nearer_to_that_of_the_model_that_made_it(shared_data):
    """Pelvis, trunk and head about mid-hip; the rest is that model's other masses."""
    case = generated_walk(shared_data)
    frame = int(np.flatnonzero(case.counted).mean())
    truth = true_trunk(shared_data / "truth_walk" / "subject01.osim", case.markers, frame)
    own, old = (
        our_trunk(chosen(case, c), case.motion, case.markers, frame)
        for c in ("CERV-XYPH", "midpoints")
    )
    assert old.center[2] < own.center[2] - 0.01
    assert own.center[2] < truth.center[2]
    assert old.tensor[1, 1] < own.tensor[1, 1] < truth.tensor[1, 1]
