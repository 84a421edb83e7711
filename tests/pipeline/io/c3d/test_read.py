"""A C3D file is read in full, in metres and in axes of the lab."""

import numpy as np
import pytest

from hbm.notes import Note
from pipeline.io.c3d.read import read_c3d

ezc3d = pytest.importorskip("ezc3d", reason="ezc3d has no wheel for this system")

AXES = "forward,left,up"


def points_at(*places, frames=4):
    """Give visible points, (frames, len(places), 4), at places in mm."""
    return np.tile(np.array([[*place, 0.0] for place in places]), (frames, 1, 1))


def test_the_real_treadmill_trial_is_read_in_full(shared_data):
    recording = read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")
    markers = recording.markers
    assert markers.position.shape == (1206, 26, 3)
    assert markers.rate_hz == pytest.approx(100)
    assert [len(plate.time) for plate in recording.plates] == [12060, 12060]
    assert recording.first_frame == 45
    assert recording.metadata.mass_kg == pytest.approx(55.326, abs=1e-3)
    assert recording.metadata.height_m == pytest.approx(1.7197, abs=1e-4)
    assert recording.metadata.limbs["right"].leg_length_m == pytest.approx(0.9047, abs=1e-4)
    assert recording.metadata.limbs["left"].ankle_width_m == pytest.approx(0.0772, abs=1e-4)


def test_the_real_trial_is_in_metres_and_lab_axes(shared_data):
    recording = read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")
    assert recording.notes[0].values["axes"] == ("left", "back", "up")
    position = dict(
        zip(recording.markers.names, recording.markers.position.mean(axis=0), strict=True)
    )
    across = position["LASIS"] - position["RASIS"]
    assert across[1] == pytest.approx(0.25, abs=0.05)
    assert position["LASIS"][2] == pytest.approx(0.97, abs=0.1)
    assert position["LMT2"][0] > position["LHEE"][0]


def test_outputs_of_other_programs_are_untouched(shared_data):
    path = shared_data / "treadmill_hbm2" / "treadmill_events.c3d"
    outputs = read_c3d(path, AXES).model_outputs
    oracle = ezc3d.c3d(str(path))
    labels = oracle["parameters"]["POINT"]["LABELS"]["value"]
    for name in ("LKneeAngles", "RKneeMoment", "LHipPower", "LGroundReactionForce", "PELO"):
        expected = oracle["data"]["points"][:3, labels.index(name)].T
        valid = ~np.isnan(outputs[name])
        np.testing.assert_array_equal(outputs[name][valid], expected[valid])
        assert valid.any()


def test_foot_strikes_follow_the_rise_of_the_force_within_two_frames(shared_data):
    """The lab's own events were set on whole frames, at or just after the plate is loaded."""
    recording = read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")
    assert len(recording.events) == 43
    times = [event.time for event in recording.events]
    assert times == sorted(times)
    for plate, side in zip(recording.plates, ("left", "right"), strict=True):
        loaded = plate.wrench[:, 2] > 20
        rises = plate.time[1:][loaded[1:] & ~loaded[:-1]]
        strikes = [e.time for e in recording.events if (e.label, e.side) == ("foot_strike", side)]
        delay = [np.abs(rises - strike).min() for strike in strikes]
        assert np.median(delay) < 0.01


def test_one_trial_is_the_same_in_every_byte_order(shared_data):
    intel, dec, sgi = (
        read_c3d(shared_data / "c3d_samples" / name)
        for name in ("pc_int.c3d", "DEC_INT.C3D", "sgi_real.c3d")
    )
    for other in (dec, sgi):
        assert other.markers.names == intel.markers.names
        np.testing.assert_allclose(other.markers.position, intel.markers.position, atol=1e-3)
        for plate, expected in zip(other.plates, intel.plates, strict=True):
            np.testing.assert_allclose(plate.wrench, expected.wrench, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("name", ["pc_int.c3d", "Gait.c3d", "TYPE-2.C3D"])
def test_in_inferred_axes_people_walk_forward_and_upright(shared_data, name):
    position = read_c3d(shared_data / "c3d_samples" / name).markers.position
    seen = np.isfinite(position).all(axis=-1)
    path = np.array(
        [
            frame[ok].mean(axis=0)
            for frame, ok in zip(position, seen, strict=True)
            if ok.sum() > len(ok) / 3
        ]
    )
    walked = path[-1] - path[0]
    assert walked[0] > 1.0
    assert abs(walked[1]) < 0.2 * walked[0]
    assert path[:, 2].min() > 0


def test_missing_points_are_gaps_never_zeros(raw_c3d):
    points = points_at((0, 0, 0), (100, 0, 0), (100, 200, 900), (0, 0, 900), frames=3)
    points[1, 2, 3] = -1
    points[2, 2, :] = (0, 0, 0, -1)
    points[2, 1, 0] = np.nan
    path = raw_c3d(points, POINT={"LABELS": ["ZERO", "ON_AXIS", "LOST", "SEEN"]})
    gaps = np.isnan(read_c3d(path, AXES).markers.position).all(axis=-1)
    np.testing.assert_array_equal(gaps, [[1, 0, 0, 0], [1, 0, 1, 0], [1, 1, 1, 0]])


def test_analog_channels_are_scaled_after_their_offset_is_removed(raw_c3d):
    analog = np.tile(np.array([100.0, 40.0]), (4, 5, 1))
    path = raw_c3d(
        points_at((0, 0, 1000)),
        analog,
        POINT={"LABELS": ["A"]},
        ANALOG={
            "GEN_SCALE": np.array([0.5]),
            "SCALE": np.array([2.0, -4.0]),
            "OFFSET": np.array([10, 20]),
            "LABELS": ["Acc.X", "Belt"],
            "UNITS": ["g", "m/s"],
        },
    )
    found = read_c3d(path, AXES).analog
    assert found.units == ("g", "m/s")
    np.testing.assert_allclose(found.channel("Acc.X"), np.full(20, 90.0))
    np.testing.assert_allclose(found.channel("Belt"), np.full(20, -40.0))
    np.testing.assert_allclose(np.diff(found.time), 1 / 500)


def test_unsigned_offsets_and_samples_reach_beyond_32767(raw_c3d):
    path = raw_c3d(
        points_at((0, 0, 1000)),
        np.full((4, 1, 1), 40000.0 - 65536),
        scale=1.0,
        POINT={"LABELS": ["A"]},
        ANALOG={"FORMAT": "UNSIGNED", "OFFSET": np.array([32768]), "BITS": np.array([16])},
    )
    np.testing.assert_allclose(read_c3d(path, AXES).analog.values, 40000 - 32768)


def test_events_are_on_the_clock_of_the_first_frame(raw_c3d):
    path = raw_c3d(
        points_at((0, 0, 1000)),
        first_frame=201,
        POINT={"LABELS": ["A"]},
        EVENT={
            "USED": np.array([4]),
            "CONTEXTS": ["Right", "Left", "General", "Left"],
            "LABELS": ["Foot Strike", "Foot Off", "Synch", "Foot Strike"],
            "TIMES": np.array([[1.0, 0, 0, 0], [2.5, 3.0, 2.0, 2.0]]),
        },
    )
    recording = read_c3d(path, AXES)
    assert [(e.label, e.side) for e in recording.events] == [
        ("foot_strike", "left"),
        ("foot_off", "left"),
        ("foot_strike", "right"),
    ]
    np.testing.assert_allclose([e.time for e in recording.events], [0, 1, 60.5])
    assert Note.of("events_left_out", events=1) in recording.notes


def test_outputs_are_separated_from_markers_by_group_or_by_name(raw_c3d):
    labels = ["LKNE", "S01:LKneeAngles", "CustomScalar", "PELO", "PELA", "PELL", "PELP", "CLAP"]
    points = points_at(*[(k, 100, 200 * k) for k in range(len(labels))])
    path = raw_c3d(points, POINT={"LABELS": labels, "SCALARS": ["CustomScalar"]})
    recording = read_c3d(path, AXES)
    assert recording.markers.names == ("LKNE", "CLAP")
    assert {"LKneeAngles", "CustomScalar", "PELO"} < set(recording.model_outputs)
    np.testing.assert_allclose(recording.model_outputs["LKneeAngles"][0], [1, 100, 200])


def test_an_implausible_mass_or_length_is_not_passed_on(raw_c3d):
    path = raw_c3d(
        points_at((0, 100, 1000)),
        POINT={"LABELS": ["A"]},
        PROCESSING={"Bodymass": np.array([0.0]), "Height": np.array([1.75])},
    )
    metadata = read_c3d(path, AXES).metadata
    assert metadata.mass_kg is metadata.height_m is None
