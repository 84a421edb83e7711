import numpy as np
import pytest

from pipeline.io.opensim.sto import read_sto
from pipeline.io.opensim.trial import read_opensim_trial

TRIALS = {
    "opensim_subject01": ("subject01_walk1.trc", "subject01_walk1_grf.mot", 72.6),
    "truth_walk": ("markers.trc", "grf.mot", 72.84),
}
G = 9.80665


@pytest.fixture(params=TRIALS)
def trial(shared_data, request):
    trc, mot, mass_kg = TRIALS[request.param]
    folder = shared_data / request.param
    return read_opensim_trial(folder / trc, folder / mot), read_sto(folder / mot), mass_kg


def test_plates_carry_the_walker_upwards(trial):
    recording, _, mass_kg = trial
    assert len(recording.plates) == 2
    vertical = sum(plate.wrench[:, 2] for plate in recording.plates)
    assert np.median(vertical) == pytest.approx(mass_kg * G, rel=0.1)
    assert recording.notes[0].values["axes"] == ("forward", "up", "right")


def test_plates_and_markers_share_a_clock_that_starts_at_the_first_frame(trial):
    recording, _, _ = trial
    assert recording.markers.time[0] == 0
    for plate in recording.plates:
        assert plate.time[0] == pytest.approx(0, abs=1e-9)
        assert plate.time[-1] == pytest.approx(recording.markers.time[-1], abs=0.01)


def test_the_wrench_about_the_origin_is_force_at_its_point_and_torque(trial):
    recording, table, _ = trial
    stem = next(name for name in table.names if name.endswith("_vx")).removesuffix("_vx")
    force, point, torque = (
        np.column_stack([table.column(f"{prefix}{axis}") for axis in "xyz"])
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
    (plate,) = read_opensim_trial(folder / "markers.trc", path).plates
    np.testing.assert_array_equal(plate.wrench[0], np.zeros(6))
    np.testing.assert_allclose(plate.wrench[1], [0, 0, 800, -160, -80, 1], atol=1e-9)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("a b c", "grf.mot: no forces such as ground_force_vx; columns: a, b, c"),
        ("ground_force_vx b c", "grf.mot: no column 'ground_force_vy'"),
    ],
)
def test_a_table_without_forces_is_refused(tmp_path, shared_data, columns, message):
    path = tmp_path / "grf.mot"
    path.write_text(f"x\nendheader\ntime {columns}\n0 1 2 3\n")
    with pytest.raises(ValueError, match=message):
        read_opensim_trial(shared_data / "truth_walk" / "markers.trc", path)
