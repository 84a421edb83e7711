"""Forces of OpenSim's tables act where and as they are written, under every usual name."""

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from hbm.markers import Markers
from pipeline.export.tables import write_trc
from pipeline.io.opensim import read_sto
from pipeline.io.read import read_recording

TRIALS = {
    "opensim_subject01": ("subject01_walk1.trc", "subject01_walk1_grf.mot", 72.6),
    "truth_walk": ("markers.trc", "grf.mot", 72.84),
}
MADE_TO_ORDER = settings(
    max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(params=TRIALS)
def trial(shared_data, request):
    trc, mot, mass_kg = TRIALS[request.param]
    folder = shared_data / request.param
    return read_recording(folder / trc, forces=folder / mot), read_sto(folder / mot), mass_kg


def test_the_wrench_about_the_origin_is_force_at_its_point_and_torque(trial):
    recording, table, _ = trial
    stem = next(name for name in table.columns if name.endswith("_vx")).removesuffix("_vx")
    force, point, torque = (
        np.column_stack([table.columns[f"{prefix}{axis}"] for axis in "xyz"])
        for prefix in (f"{stem}_v", f"{stem}_p", stem.replace("force", "torque") + "_")
    )
    moment = np.cross(point, force) + torque
    for ours, theirs in ((slice(0, 3), force), (slice(3, 6), moment)):
        expected = np.column_stack([theirs[:, 0], -theirs[:, 2], theirs[:, 1]])
        np.testing.assert_allclose(recording.plates[0].wrench[:, ours], expected, atol=1e-9)


def test_forces_act_under_the_feet(trial):
    recording, _, _ = trial
    markers = recording.markers
    feet = [
        k
        for k, name in enumerate(markers.names)
        if any(part in name for part in ("Heel", "Toe", "CAL", "TOE", "MT5"))
    ]
    for plate in recording.plates:
        wrench = plate.wrench
        loaded = wrench[:, 2] > 200
        cop = np.column_stack([-wrench[:, 4], wrench[:, 3]])[loaded] / wrench[loaded, 2:3]
        frames = np.abs(plate.time[loaded, None] - markers.time).argmin(axis=1)
        gaps = np.linalg.norm(markers.position[frames][:, feet, :2] - cop[:, None], axis=-1)
        assert np.median(np.nanmin(gaps, axis=1)) < 0.12


def test_a_force_of_zero_needs_no_point(tmp_path, shared_data):
    folder = shared_data / "truth_walk"
    names = [f"ground_force_{a}" for a in ("vx", "vy", "vz", "px", "py", "pz")]
    names += [f"ground_torque_{a}" for a in "xyz"]
    rows = ["3.38 0 0 0 nan nan nan 0 0 0", "3.39 0 800 0 0.1 0 0.2 0 1 0"]
    path = tmp_path / "grf.mot"
    path.write_text("x\nendheader\ntime " + " ".join(names) + "\n" + "\n".join(rows))
    (plate,) = read_recording(folder / "markers.trc", forces=path).plates
    np.testing.assert_array_equal(plate.wrench[0], np.zeros(6))
    np.testing.assert_allclose(plate.wrench[1], [0, 0, 800, -160, -80, 1], atol=1e-9)


def test_a_table_without_forces_is_refused(tmp_path, shared_data):
    path = tmp_path / "grf.mot"
    path.write_text("x\nendheader\ntime a b c\n3.4 1 2 3\n3.5 1 2 3\n")
    with pytest.raises(ValueError, match=r"grf\.mot: .*ground_force_vx; columns: a"):
        read_recording(shared_data / "truth_walk" / "markers.trc", forces=path)


CLOCK = np.arange(300) / 100
UP = np.array([0.0, 1.0, 0.0])
NAMINGS = {
    "ground_force_vx": ("ground_force_v", "ground_force_p", "ground_torque_"),
    "1_ground_force_vx": ("1_ground_force_v", "1_ground_force_p", "1_ground_torque_"),
    "ground_force_1_vx": ("ground_force_1_v", "ground_force_1_p", "ground_torque_1_"),
    "ground_force_1_vx, mx": ("ground_force_1_v", "ground_force_1_p", "ground_force_1_m"),
    "FP1_vx, mx": ("FP1_v", "FP1_p", "FP1_m"),
    "ground_force_1_fx, mx": ("ground_force_1_f", "ground_force_1_p", "ground_force_1_m"),
    "ground_force_l_vx, moment": ("ground_force_l_v", "ground_force_l_p", "ground_moment_l_m"),
}


def steps(rng, origin=(0.0, 0.0, 0.0)):
    """Force, centre of pressure and free torque of a foot that rolls over a floor at y = 0."""
    load = 400 + 300 * np.sin(2 * np.pi * CLOCK)
    force = np.column_stack([40 * np.cos(7 * CLOCK), load, 20 * np.sin(3 * CLOCK)])
    point = np.asarray(origin) + np.column_stack(
        [0.1 + 0.12 * np.sin(2 * np.pi * CLOCK), np.zeros(300), 0.02 * np.cos(5 * CLOCK)]
    )
    point += rng.normal(0, 1e-5, point.shape) * [1, 0, 1]
    return force, point, np.outer(5 * np.sin(9 * CLOCK), UP)


def write_standing(path):
    """A subject's feet, pelvis and shoulders over the floor, y up, x forward."""
    places = {
        "LASI": (0.1, 1.0, -0.1),
        "RASI": (0.1, 1.0, 0.1),
        "LHEE": (0.0, 0.05, -0.1),
        "RHEE": (0.0, 0.05, 0.1),
    }
    position = np.tile(np.array([*places.values()]), (300, 1, 1))
    write_trc(Markers(CLOCK, tuple(places), position), path)
    return path


def write_forces(path, forces):
    """Write (naming, force, point, torque) as one table."""
    columns = {}
    for naming, *vectors in forces:
        for stem, vector in zip(naming, vectors, strict=True):
            columns |= {f"{stem}{axis}": vector[:, k] for k, axis in enumerate("xyz")}
    rows = (
        "\t".join(f"{x:.9g}" for x in row) for row in zip(CLOCK, *columns.values(), strict=True)
    )
    path.write_text("\n".join(["forces", "endheader", "\t".join(["time", *columns]), *rows]) + "\n")
    return path


def in_lab(vectors):
    """From x forward, y up to the lab's axes."""
    return np.column_stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]])


def moment_of(force, point, torque):
    return np.cross(point, force) + torque


@pytest.mark.parametrize("naming", NAMINGS.values(), ids=NAMINGS)
def test_forces_are_found_under_every_name_that_programs_give_them(tmp_path, naming):
    force, point, torque = steps(np.random.default_rng(1))
    trc, mot = write_standing(tmp_path / "s.trc"), tmp_path / "s.mot"
    write_forces(mot, [(naming, force, point, torque)])
    recording = read_recording(trc, forces=mot)
    (plate,) = recording.plates
    np.testing.assert_allclose(plate.wrench[:, :3], in_lab(force), atol=1e-5)
    np.testing.assert_allclose(
        plate.wrench[:, 3:], in_lab(moment_of(force, point, torque)), atol=1e-5
    )


@given(
    seed=st.integers(0, 10_000),
    about=st.one_of(
        st.just((0.0, 0.0, 0.0)),
        st.tuples(st.floats(-2, 2), st.floats(-0.1, 0), st.floats(-2, 2)),
    ),
    origin=st.tuples(st.floats(-3, 3), st.just(0.0), st.floats(-3, 3)),
    naming=st.sampled_from(list(NAMINGS.values())),
)
@MADE_TO_ORDER
def test_torques_that_are_moments_about_a_point_are_not_counted_twice(
    tmp_path, seed, about, origin, naming
):
    """Written so by mistake about the origin, or about a plate's own one."""
    force, point, torque = steps(np.random.default_rng(seed), origin)
    moment = moment_of(force, point, torque)
    about = np.array(about)
    trc, mot = write_standing(tmp_path / "s.trc"), tmp_path / "s.mot"
    assume(np.linalg.norm((point.mean(axis=0) - about)[[0, 2]]) > 0.05)
    write_forces(mot, [(naming, force, point, moment - np.cross(about, force))])
    recording = read_recording(trc, forces=mot)
    wrench = recording.plates[0].wrench
    np.testing.assert_allclose(wrench[:, 3:], in_lab(moment), atol=1e-3 * np.abs(moment).max())


@given(seed=st.integers(0, 10_000), fixed=st.tuples(st.floats(-2, 2), st.floats(-2, 2)))
@MADE_TO_ORDER
def test_a_torque_about_a_point_that_does_not_move_belongs_to_that_point(tmp_path, seed, fixed):
    """As of programs that write the force at the plate's own origin."""
    force, point, torque = steps(np.random.default_rng(seed))
    moment = moment_of(force, point, torque)
    place = np.tile([fixed[0], 0.0, fixed[1]], (300, 1))
    trc, mot = write_standing(tmp_path / "s.trc"), tmp_path / "s.mot"
    names = NAMINGS["ground_force_vx"]
    write_forces(mot, [(names, force, place, moment - np.cross(place, force))])
    recording = read_recording(trc, forces=mot)
    np.testing.assert_allclose(
        recording.plates[0].wrench[:, 3:], in_lab(moment), atol=1e-5 * np.abs(moment).max() + 1e-5
    )


IK = """Coordinates
version=1
nRows=2
nColumns=4
inDegrees=yes

Angles are in degrees.

endheader
time\tpelvis_tilt\tpelvis_tx\tknee_angle_r
0.0\t90\t0.5\t-180
0.1\tnan\t0.6\t-90
"""


def test_columns_are_as_in_the_file(tmp_path):
    path = tmp_path / "table.mot"
    path.write_text(IK, encoding="utf-8")
    table = read_sto(path)
    np.testing.assert_array_equal(table.time, [0, 0.1])
    np.testing.assert_array_equal(table.columns["knee_angle_r"], [-180, -90])
    np.testing.assert_array_equal(table.columns["pelvis_tilt"], [90, np.nan])


def test_both_real_walks_have_hips_that_swing_like_walking(shared_data):
    for name in ("opensim_subject01/subject01_walk1_ik.mot", "truth_walk/coordinates.sto"):
        table = read_sto(shared_data / name)
        hip = table.columns["hip_flexion_r"]
        hip = np.radians(hip) if "inDegrees=yes" in (shared_data / name).read_text() else hip
        assert np.deg2rad(30) < np.ptp(hip) < np.deg2rad(70)
