"""The exported tables read back as what was written, whatever was in them."""

import numpy as np
import pytest

from hbm.coordinates import HBM_ORDER, INDEX, N_Q, TREE
from hbm.dynamics import Dynamics
from hbm.markers import Markers
from hbm.motion import Motion
from pipeline.export.tables import (
    write_coordinates,
    write_external_loads,
    write_forces,
    write_trc,
)
from pipeline.io.opensim import read_sto
from pipeline.io.read import read_recording
from tests.synthetic import synthetic_t_pose

TIME = 2.5 + np.arange(20) / 100


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def assert_same(back, written):
    """Equal but for the last bits, which pandas before 3.1 does not read."""
    np.testing.assert_allclose(back, written, rtol=1e-14, atol=1e-15)


def test_coordinates_come_back_in_degrees_and_metres_in_the_original_order(rng, tmp_path):
    q = rng.normal(size=(20, N_Q))
    q[7] = np.nan
    nothing = np.full((20, N_Q), np.nan)
    flags = np.ones(20, bool), np.ones((20, N_Q), bool)
    motion = Motion(TIME, q, nothing, nothing, (), np.empty((20, 0)), *flags)
    write_coordinates(motion, tmp_path / "trial.mot")
    table = read_sto(tmp_path / "trial.mot")
    assert tuple(table.columns) == HBM_ORDER
    assert "inDegrees=yes" in (tmp_path / "trial.mot").read_text()
    np.testing.assert_array_equal(table.time, TIME)
    assert_same(table.columns["PelvisZ"], motion.coordinate("PelvisZ"))
    knee = np.degrees(motion.coordinate("LKneeFlexion"))
    assert_same(table.columns["LKneeFlexion"], knee)


def test_forces_come_back_under_the_names_that_opensim_gives_them(rng, tmp_path):
    tau = rng.normal(size=(20, N_Q))
    dynamics = Dynamics(TIME, tau, np.zeros((20, 6)), np.zeros((20, N_Q)), "kernels")
    write_forces(dynamics, tmp_path / "trial_id.sto")
    table = read_sto(tmp_path / "trial_id.sto")
    assert "inDegrees=no" in (tmp_path / "trial_id.sto").read_text()
    for name in HBM_ORDER:
        kind = "force" if TREE[INDEX[name]].translates else "moment"
        assert_same(table.columns[f"{name}_{kind}"], dynamics.force(name))


def test_markers_and_loads_come_back_as_one_trial(rng, tmp_path):
    standing = synthetic_t_pose()
    position = standing.position[:20] + rng.normal(scale=0.01, size=(20, len(standing.names), 3))
    position[3:6, 4] = np.nan
    markers = Markers(TIME, standing.names, position)
    wrenches = {"left_foot": rng.normal(size=(20, 6)), "right_foot": rng.normal(size=(20, 6))}
    write_trc(markers, tmp_path / "trial.trc")
    write_external_loads(TIME, wrenches, tmp_path / "trial_grf.mot")
    back = read_recording(tmp_path / "trial.trc", "forward,left,up", tmp_path / "trial_grf.mot")
    assert back.markers.names == markers.names
    assert_same(back.markers.position, markers.position)
    np.testing.assert_allclose(back.markers.time, TIME - TIME[0], rtol=0, atol=1e-12)
    for plate, wrench in zip(back.plates, wrenches.values(), strict=True):
        assert_same(plate.wrench, wrench)
