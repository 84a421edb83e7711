"""Plates on a moving platform are compensated first and then brought to the lab."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.notes import Note
from hbm.signals.filtering import butterworth
from hbm.signals.resampling import resample
from pipeline.config.schema import Platform, Treadmill
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import ON_MARKERS, TREADMILL, ground_of

COMMANDED = Platform(sway_channel="Sway", pitch_channel="Pitch", pivot_m=tuple(lab.PIVOT_M))
INSIDE = slice(60, -60)
DURATION_S = 12.0


@pytest.fixture(scope="module")
def motions():
    both = lab.shaken(DURATION_S, seed=3)
    return {"pitch": lab.pitching(DURATION_S), "both": both}


def filtered_total(recording, laboratory, *, plate_delay_s=0.0):
    """Sum of the plates per variant after the filter, the ground itself, and the notes on it."""
    time = recording.markers.time
    ground = ground_of(recording, laboratory, time, plate_delay_s)
    total = {
        name: butterworth(np.sum(wrenches, axis=0), time, 6.0, "zero_phase").value
        for name, wrenches in ground.variants.items()
    }
    return total, ground, ground.notes


def truth(walker):
    """The subject's own wrench in the lab: that on the plates of a treadmill that stands still."""
    total = np.sum([plate.wrench for plate in walker.plates], axis=0)
    time = walker.markers.time
    at_frames = resample(walker.plates[0].time, total, time)
    return butterworth(at_frames, time, 6.0, "zero_phase").value


def error(found, true):
    return np.abs(found - true)[INSIDE].max(axis=0)


def test_a_persons_known_wrench_is_recovered_on_a_moving_platform(walker, calibration, motions):
    """Belt assemblies of 150 kg each, 10°, 5 cm: only the plates' noise is left."""
    recording = lab.on_platform(walker, motions["both"])
    found, *_ = filtered_total(recording, Laboratory(TREADMILL, calibration))
    limit = np.array([2, 2, 2, 1, 1, 1])
    assert (error(found["compensated"], truth(walker)) < limit).all()
    assert error(found["measured"], truth(walker)).max() > 200


def test_the_platforms_pose_applies_to_the_measured_plates_too(walker, motions):
    """Without belt assemblies nothing is to be compensated, but the pose is to be applied."""
    recording = lab.on_platform(walker, motions["both"], assembly=False, noise=0)
    found, ground, _ = filtered_total(recording, Laboratory(TREADMILL))
    assert list(found) == ["measured"]
    assert error(found["measured"], truth(walker)).max() < 0.05
    rotation, position = motions["both"].pose(recording.markers.time)
    np.testing.assert_allclose(ground.pose.rotation, rotation, atol=1e-8)
    np.testing.assert_allclose(ground.pose.position, position, atol=1e-8)


def test_a_commanded_pose_gives_the_wrenches_that_markers_give(walker, calibration, motions):
    recording = lab.on_platform(walker, motions["both"])
    treadmill = TREADMILL.model_copy(update={"platform": COMMANDED})
    found, _, found_notes = filtered_total(recording, Laboratory(treadmill, calibration))
    assert (error(found["compensated"], truth(walker)) < [2, 2, 2, 1, 1, 1]).all()
    (pose,) = (note for note in found_notes if note.code == "platform_pose")
    assert "by Sway, Pitch" in pose.text


def test_an_empty_plate_keeps_only_what_the_fit_itself_could_not_explain(empty, calibration):
    """Plates and accelerometers pass the same filter, so that it leaves no artefact."""
    model, clock = calibration.plates["plate 1"], empty.plates[0].time
    level = TREADMILL.model_copy(update={"platform": None})
    ground = ground_of(empty, Laboratory(level, calibration), clock, 0.0)
    left = np.linalg.norm(ground.variants["compensated"][0][:, :3], axis=1)
    left_rms_n = np.sqrt(np.nanmean(left**2))
    assert left_rms_n == pytest.approx(np.linalg.norm(model.rms_compensated[:3]), rel=1e-6)


@pytest.mark.parametrize("delay_s", [0.03, -0.03])
def test_a_delayed_command_is_shifted_and_leaves_a_gap_at_one_end(walker, motions, delay_s):
    recording = lab.on_platform(
        walker, motions["both"], assembly=False, noise=0, command_delay_s=delay_s
    )
    platform = COMMANDED.model_copy(update={"delay_s": delay_s})
    _, ground, _ = filtered_total(recording, Laboratory(Treadmill(platform=platform)))
    known = np.isfinite(ground.pose.position).all(axis=1)
    assert np.count_nonzero(~known) == 3
    assert not known[-1 if delay_s > 0 else 0]
    _, position = motions["both"].pose(recording.markers.time)
    np.testing.assert_allclose(ground.pose.position[known], position[known], atol=2e-6)


@pytest.mark.parametrize("delay_s", [0.02, -0.0135])
def test_late_plates_are_aligned_with_the_markers(walker, calibration, motions, delay_s):
    recording = lab.on_platform(
        walker, motions["both"], plate_delay_s=delay_s, accelerometer_delay_s=delay_s
    )
    laboratory = Laboratory(TREADMILL, calibration)
    found, *_ = filtered_total(recording, laboratory, plate_delay_s=delay_s)
    limit = np.array([2, 2, 2, 1, 1, 1])
    assert (error(found["compensated"], truth(walker)) < limit).all()
    found, *_ = filtered_total(recording, laboratory)
    assert (error(found["compensated"], truth(walker)) > limit).any()


@pytest.mark.parametrize("stated_s", [None, 0.025])
def test_accelerometers_that_lag_the_plates_are_aligned_in_calibration_and_trial(
    walker, motions, stated_s
):
    """By the delay that the calibration recording shows, or by the one that is stated."""
    late = {"accelerometer_delay_s": 0.025}
    empty = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0), **late)
    recording = lab.on_platform(walker, motions["both"], **late)
    limit = [2, 2, 2, 1, 1, 1]
    treadmill = TREADMILL.model_copy(update={"accelerometer_delay_s": stated_s})
    calibration = fit_calibration(empty, treadmill)
    for sensor in calibration.sensors:
        assert abs(sensor.delay_s - 0.025) <= 1.96 * sensor.delay_error_s
    found, *_ = filtered_total(recording, Laboratory(treadmill, calibration))
    assert (error(found["compensated"], truth(walker)) < limit).all()
    unaware = TREADMILL.model_copy(update={"accelerometer_delay_s": 0.0})
    found, *_ = filtered_total(recording, Laboratory(unaware, fit_calibration(empty, unaware)))
    assert (error(found["compensated"], truth(walker)) > limit).any()


def test_a_platform_marker_that_is_lost_leaves_a_gap_only_below_three(walker, motions):
    recording = lab.on_platform(walker, motions["pitch"], noise=0)
    position = recording.markers.position.copy()
    position[300:310, -1] = np.nan
    position[400:410, -2:] = np.nan
    lost = replace(recording, markers=replace(recording.markers, position=position))
    _, ground, found_notes = filtered_total(lost, Laboratory(TREADMILL))
    gap = np.isnan(ground.variants["measured"][0]).any(axis=1)
    assert np.flatnonzero(gap).tolist() == list(range(400, 410))
    assert Note.of("platform_pose_unknown", unknown=10, frames=1200) in found_notes


def in_volts(recording):
    analog = recording.analog
    units = ("V",) * len(analog.names)
    return replace(recording, analog=replace(analog, units=units))


@pytest.mark.parametrize(
    ("change", "platform", "message"),
    [
        (lambda r: lab.without_channels(r, "A2Z"), ON_MARKERS, "'A2Z'; .*Acc1.X"),
        (in_volts, ON_MARKERS, "'Acc1.X': .*unit 'V', expected g"),
        (lambda r: r, Platform(markers=("PF1", "PF2", "PF9")), "markers PF9 are"),
        (
            lambda r: replace(r, plates=(replace(r.plates[0], number=3),)),
            ON_MARKERS,
            "no plate 3; .*plate 1, plate 2",
        ),
    ],
)
def test_what_is_missing_is_named_in_one_line_with_the_file(
    walker, calibration, motions, change, platform, message
):
    recording = change(lab.on_platform(walker, motions["pitch"]))
    laboratory = Laboratory(TREADMILL.model_copy(update={"platform": platform}), calibration)
    with pytest.raises(ValueError, match=message) as caught:
        filtered_total(recording, laboratory)
    assert str(caught.value).startswith(walker.source.name)


def test_a_stated_unit_replaces_that_of_the_file(walker, calibration, motions):
    recording = in_volts(lab.on_platform(walker, motions["pitch"]))
    treadmill = TREADMILL.model_copy(update={"accelerometer_unit": "g"})
    found, *_ = filtered_total(recording, Laboratory(treadmill, calibration))
    assert (error(found["compensated"], truth(walker)) < [2, 2, 2, 1, 1, 1]).all()


def test_a_calibration_with_other_sensors_is_refused(walker, calibration, motions):
    recording = lab.on_platform(walker, motions["pitch"])
    other = {"front_right": lab.CHANNELS["front_right"], "rear_left": lab.CHANNELS["rear_left"]}
    treadmill = Treadmill(accelerometers=other, platform=ON_MARKERS)
    with pytest.raises(ValueError, match=r"plate 1: calibration .*sensors"):
        filtered_total(recording, Laboratory(treadmill, calibration))
