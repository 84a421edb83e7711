"""Star and arc movements show the hips of a body whose hips are known."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.calibration_pose.functional import functional_hips
from hbm.coordinates import INDEX, N_Q
from hbm.markers import Markers, marker_sets
from hbm.poses import marker_positions
from tests.hbm.motions import markers_of, motion_of, without
from tests.synthetic import MASS_KG, synthetic_body, synthetic_t_pose

RATE_HZ = 50.0
HBM2 = marker_sets()["hbm2"]


def swings(swing=30.0, sideways=30.0):
    """Each leg swings forward, back and sideways, while the pelvis sways and rotates."""
    time = np.arange(0, 12, 1 / RATE_HZ)
    q = np.zeros((len(time), N_Q))
    q[:, INDEX["PelvisYaw"]] = 2.0 + 0.2 * np.sin(0.7 * time)
    q[:, INDEX["PelvisX"]] = 0.05 * np.sin(1.1 * time)
    q[:, INDEX["PelvisZ"]] = 0.95
    for side, delay in (("R", 0.0), ("L", 0.4)):
        q[:, INDEX[f"{side}HipFlexion"]] = np.radians(swing) * np.sin(2 * time + delay)
        q[:, INDEX[f"{side}HipAbduction"]] = np.radians(sideways) * np.sin(1.3 * time + delay) ** 2
    return time, q


def star_arc(noise_m=0.0, swing=30.0, sideways=30.0):
    time, q = swings(swing, sideways)
    exact = markers_of(synthetic_body(), motion_of(time, q, q, q))
    noise = np.random.default_rng(8).normal(scale=noise_m, size=exact.position.shape)
    return Markers(time, exact.names, exact.position + noise)


def true_hips():
    """Hips from mid-ASIS in the pelvis' own frame."""
    body = synthetic_body()
    at = dict(zip(body.markers, body.marker_position, strict=True))
    origin = (at["LASIS"] + at["RASIS"]) / 2
    return {side: body.offsets[f"{side}_thigh"] - origin for side in ("right", "left")}


@pytest.mark.parametrize(("noise_m", "within_m"), [(0.0, 1e-9), (0.001, 0.002)])
def test_hips_are_found_from_star_and_arc_movements(noise_m, within_m):
    found = functional_hips(star_arc(noise_m), HBM2)
    for side, expected in true_hips().items():
        assert np.linalg.norm(found[side] - expected) < within_m


def test_gaps_cost_frames_but_not_accuracy():
    one = without(star_arc(), ["RLTHI"], slice(100, 200))
    found = functional_hips(without(one, ["LASIS"], slice(300, 310)))
    for side, expected in true_hips().items():
        np.testing.assert_allclose(found[side], expected, atol=1e-9)


def test_a_body_has_the_centres_that_it_is_built_with():
    hips = functional_hips(star_arc(), HBM2)
    body = build_body(synthetic_t_pose(), mass=MASS_KG, sex="male", hip=hips)
    at = dict(zip(body.markers, marker_positions(body, np.zeros((1, N_Q)))[0], strict=True))
    middle = (at["LASIS"] + at["RASIS"]) / 2
    for side in ("right", "left"):
        np.testing.assert_allclose(body.offsets[f"{side}_thigh"], middle + hips[side], atol=1e-9)


def test_swinging_in_one_plane_is_refused():
    with pytest.raises(ValueError, match=r"right thigh.* one plane"):
        functional_hips(star_arc(sideways=0.0), HBM2)
