"""OpenSim, an independent implementation of mechanics, agrees on the exported body and trial."""

import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from hbm.body import Body, build_body
from hbm.coordinates import COORDINATES, INDEX, MOVING, N_Q, TREE
from hbm.dynamics import Dynamics, filter_motion, inverse_dynamics
from hbm.ik.tracking import solve_ik
from hbm.kernels.native import kernels
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.signals.resampling import interpolate
from hbm.spatial import GRAVITY_MPS2, Array, rotation_about
from pipeline.export.models import write_osim
from pipeline.export.tables import (
    write_coordinates,
    write_external_loads,
    write_trc,
)
from pipeline.io.c3d.read import read_c3d
from tests.synthetic import MASS_KG, RATE_HZ, synthetic_body

pytestmark = [
    pytest.mark.opensim,
    pytest.mark.skipif(find_spec("opensim") is None, reason="the OpenSim wheel is not installed"),
]
TRANSLATES = np.array([c.translates for c in TREE])
FRAMES = 80
INNER = slice(25, -25)


@dataclass(frozen=True)
class Case:
    """A body, poses and a trial of it, what we found, and what OpenSim answered."""

    folder: Path
    body: Body
    poses: Array
    speeds: Array
    markers: Markers
    raw: Motion
    motion: Motion
    wrenches: dict[str, Array]
    dynamics: Dynamics
    answers: dict[str, Array]

    def column(self, table, name):
        labels = list(self.answers[f"{table}: labels"])
        return self.answers[f"{table}: values"][:, labels.index(name)]


def marker_positions(body, q):
    poses = kernels().segment_poses(q, body.geometry)[0].reshape(len(q), len(MOVING), 4, 3)
    own = [MOVING.index(s) for s in body.marker_segment]
    local = np.column_stack([body.marker_position, np.ones(len(own))])
    return np.einsum("tkai,ka->tki", poses[:, own], local)


def synthetic_trial(rng):
    """Every coordinate swings in its own time, 10 to 25 degrees or mm; 5 mm of noise; a gap."""
    body, time = synthetic_body(), 0.5 + np.arange(FRAMES) / RATE_HZ
    size = np.where(TRANSLATES, 0.025, np.radians(25)) * rng.uniform(0.4, 1, N_Q)
    frequency, phase = rng.uniform(0.3, 1.5, N_Q), rng.uniform(0, 2 * np.pi, N_Q)
    q = size * np.sin(2 * np.pi * np.outer(time, frequency) + phase)
    q[:, INDEX["PelvisX"]] += 1.2 * time
    q[:, INDEX["PelvisZ"]] += 0.95
    position = marker_positions(body, q)
    position += rng.normal(scale=0.005, size=position.shape)
    position[40:60, body.markers.index("RLTHI")] = np.nan
    weight = MASS_KG * GRAVITY_MPS2 * np.sin(np.pi * (time - time[0]) / np.ptp(time)) ** 2
    wrenches = {}
    for foot, share in (("left_foot", 0.6), ("right_foot", 0.4)):
        wrench = np.tile(rng.normal(scale=5.0, size=6), (FRAMES, 1))
        wrench[:, 2] += share * weight
        wrench[:, 3] += 0.1 * share * weight
        wrenches[foot] = wrench
    return body, Markers(time, body.markers, position), wrenches


def treadmill_trial(shared_data):
    """A recorded walk with markers on legs and trunk, on two plates."""
    recording = read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")
    markers = recording.markers
    body = build_body(markers, mass=55.9, sex="female")
    rows = slice(500, 500 + FRAMES)
    time = markers.time[rows]
    wrenches = {
        foot: interpolate(plate.time, plate.wrench, time)
        for foot, plate in zip(("left_foot", "right_foot"), recording.plates, strict=True)
    }
    return body, Markers(time, markers.names, markers.position[rows]), wrenches


@pytest.fixture(scope="module", params=["synthetic", "treadmill"])
def case(request, tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("opensim"), np.random.default_rng(3)
    if request.param == "synthetic":
        body, markers, wrenches = synthetic_trial(rng)
    else:
        body, markers, wrenches = treadmill_trial(request.getfixturevalue("shared_data"))
    raw = solve_ik(body, markers)
    motion = filter_motion(raw)
    dynamics = inverse_dynamics(body, motion, wrenches)
    poses = rng.uniform(-1, 1, (200, N_Q)) * np.where(TRANSLATES, 0.3, np.pi)
    speeds = rng.normal(size=(200, N_Q)) * np.where(TRANSLATES, 0.3, 3)

    write_osim(body, folder / "body.osim")
    write_trc(markers, folder / "markers.trc")
    write_coordinates(motion, folder / "coordinates.mot")
    write_external_loads(markers.time, wrenches, folder / "grf.mot")
    trial = {"time": motion.time, "q": motion.q, "v": motion.v, "a": motion.a}
    np.savez(folder / "given.npz", coordinates=COORDINATES, poses=poses, speeds=speeds, **trial)
    oracle = Path(__file__).with_name("opensim_oracle.py")
    subprocess.run([sys.executable, str(oracle), str(folder)], cwd=folder, check=True, timeout=300)
    answers = dict(np.load(folder / "answers.npz"))
    return Case(folder, body, poses, speeds, markers, raw, motion, wrenches, dynamics, answers)


def residual_of(tau, q):
    """Lab-axes wrench on the pelvis about its origin, from the six generalized forces."""
    yaw, pitch = rotation_about([0, 0, 1], q[:, 3]), rotation_about([0, 1, 0], q[:, 4])
    axes = np.stack(
        [np.broadcast_to([0.0, 0, 1], (len(q), 3)), yaw[:, :, 1], (yaw @ pitch)[:, :, 0]], axis=1
    )
    moments = np.linalg.solve(axes, tau[:, 3:6, None])[..., 0]
    return np.hstack([tau[:, :3], moments])


def rms(error):
    return np.sqrt(np.mean(error**2, axis=0)).max()


def test_opensim_puts_all_markers_where_we_do_at_200_random_poses(case):
    assert tuple(case.answers["markers"]) == case.body.markers
    ours = marker_positions(case.body, case.poses)
    np.testing.assert_allclose(case.answers["positions"], ours, rtol=0, atol=1e-12)


def test_opensim_inverse_kinematics_finds_our_optimum(case):
    theirs = np.column_stack([case.column("ik.mot", name) for name in COORDINATES])
    theirs[:, ~TRANSLATES] = np.radians(theirs[:, ~TRANSLATES])
    difference = theirs - case.raw.q
    assert rms(difference[:, ~TRANSLATES]) < np.radians(0.001)
    assert rms(difference[:, TRANSLATES]) < 1e-6


def test_opensim_inverse_dynamics_gives_our_forces_at_our_accelerations(case):
    np.testing.assert_allclose(case.answers["tau"], case.dynamics.tau, rtol=0, atol=1e-8)


def test_opensim_tool_gives_our_forces_and_residual_from_the_exported_tables(case):
    """It differentiates by itself, so the ends of the trial, where splines differ, are left out."""
    theirs = np.column_stack([case.column("id.sto", name) for name in force_names(COORDINATES)])
    assert rms((theirs - case.dynamics.tau)[INNER]) < 1e-3
    residual = residual_of(theirs, case.motion.q)
    assert rms((residual - case.dynamics.residual)[INNER]) < 1e-3


def test_a_body_falling_freely_in_opensim_needs_no_forces_in_ours(case):
    """Forward dynamics on massless shoulder points is sound, and inverse to our dynamics."""
    fall = case.answers["falling"]
    assert np.abs(fall[:, ~TRANSLATES]).max() > 1
    tau, _, _ = kernels().newton_euler(
        case.poses, case.speeds, fall, case.body.geometry, case.body.inertia_vector
    )
    np.testing.assert_allclose(tau, 0, rtol=0, atol=1e-6)


def force_names(coordinates):
    return [
        f"{name}_{'force' if TREE[INDEX[name]].translates else 'moment'}" for name in coordinates
    ]
