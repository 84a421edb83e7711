"""Plates are corrected before anything is computed from them, and by one calibration throughout."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import estimate_delay
from hbm.signals.filtering import low_pass
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.io.c3d.read import read_c3d
from pipeline.trial.ground.calibrations import fit_calibration, plates_timed_apart
from pipeline.trial.ground.laboratory import (
    Laboratory,
    bind,
    plate_delays_s,
    with_corrected_plates,
)
from pipeline.trial.ground.wrenches import plate_artefacts, plate_loads
from pipeline.trial.process import process_recording
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import TREADMILL, ground_of
from tests.pipeline.wrong_plates import correction_of, wrongly_measured

PERSON = Subject(sex="male", mass_kg=74.6)


def codes(recording):
    return [note.code for note in recording.notes]


def largest_difference(result, other):
    """Of the residuals, as a share of the largest one."""
    return {
        variant: np.nanmax(np.abs(dynamics.residual - getattr(other, variant).residual))
        / np.nanmax(np.abs(dynamics.residual))
        for variant in ("measured", "compensated")
        if (dynamics := getattr(result, variant)) is not None
    }


@pytest.fixture(scope="module")
def right(walker):
    return process_recording(walker, PERSON, Settings())


@pytest.fixture(scope="module")
def pitched(walker):
    return lab.on_platform(walker, lab.pitching(12.0))


def test_a_calibration_that_changes_nothing_changes_no_bit_of_a_real_trial(shared_data):
    recording = read_c3d(shared_data / "plug_in_gait" / "Movement_trial.c3d")
    same = correction_of(recording, change=False)
    after = with_corrected_plates(recording, same).plates
    for plate, corrected in zip(recording.plates, after, strict=True):
        np.testing.assert_array_equal(corrected.wrench_in_plate, plate.wrench_in_plate)


def test_wrong_plates_corrected_give_the_residuals_of_right_ones(walker, right):
    laboratory = Laboratory(Treadmill(), plates=correction_of(walker))
    wrong = wrongly_measured(walker)
    corrected = process_recording(wrong, PERSON, Settings(), laboratory=laboratory)
    assert largest_difference(corrected, right)["measured"] < 1e-9
    uncorrected = process_recording(wrong, PERSON, Settings())
    assert largest_difference(uncorrected, right)["measured"] > 0.01
    assert "plates_corrected" in codes(corrected)


def test_on_a_moving_platform_too_where_its_calibration_is_of_plates_corrected_alike(
    pitched, empty, calibration
):
    """The plates move, their errors with them; correction comes before compensation."""
    right = process_recording(
        pitched,
        PERSON,
        Settings(),
        laboratory=Laboratory(TREADMILL, calibration),
    )
    correction = correction_of(pitched)
    of_wrong = fit_calibration(wrongly_measured(empty), TREADMILL, correction)
    corrected = process_recording(
        wrongly_measured(pitched),
        PERSON,
        Settings(),
        laboratory=Laboratory(TREADMILL, of_wrong, plates=correction),
    )
    assert max(largest_difference(corrected, right).values()) < 1e-9


def thesis_delays(motion, duration_s=20.0, seed=0, delays_s=(0.004, 0.002)):
    """As in the thesis, 4 ms on the left and 2 ms on the right; accelerometers are 5 ms late."""
    one, two = (
        lab.on_platform(
            lab.without_people(duration_s),
            motion,
            plate_delay_s=late,
            accelerometer_delay_s=0.005,
            seed=seed,
        )
        for late in delays_s
    )
    return replace(one, plates=(one.plates[0], two.plates[1]))


@pytest.fixture(scope="module")
def timed():
    """A recording of plates of two clocks, their delays, and the calibration that knows them."""
    recording = thesis_delays(lab.shaken(20.0))
    known = correction_of(recording, change=False, delays=(0.004, 0.002))
    return recording, known, fit_calibration(recording, TREADMILL, known)


def left_of_second_plate(calibration, correction):
    """Of another recording of the empty treadmill, below 6 Hz, RMS (6,)."""
    trial = thesis_delays(lab.shaken(20.0, seed=3), seed=3)
    laboratory = Laboratory(TREADMILL, calibration, plates=correction)
    trial = with_corrected_plates(trial, correction)
    ground = ground_of(trial, laboratory, trial.markers.time, None)
    slow = low_pass(ground.variants["compensated"][1], trial.markers.time, 6.0, "zero_phase")
    return np.sqrt(np.mean(slow[100:-100] ** 2, axis=0))


def test_a_calibration_is_fitted_to_plates_of_one_clock(timed):
    """No delay of a sensor would serve two plates that are timed differently."""
    recording, known, calibration = timed
    for sensor in calibration.sensors:
        assert sensor.delay_s == pytest.approx(0.001, abs=2.5 * sensor.delay_error_s)
    assert plates_timed_apart(recording, TREADMILL, calibration.sensors, known) == ()
    left = left_of_second_plate(calibration, known)

    unknown = correction_of(recording, change=False)
    unaware = fit_calibration(recording, TREADMILL, unknown)
    (note,) = plates_timed_apart(recording, TREADMILL, unaware.sensors, unknown)
    assert note.values["plate"] == 2
    assert note.values["delay_s"] == pytest.approx(-0.002, abs=note.values["interval_s"])
    assert left_of_second_plate(unaware, unknown)[:3].max() > 1.3 * left[:3].max()


def test_artefacts_are_of_the_plates_own_clocks(timed):
    """What copies of C3D files subtract from each plate as it was recorded."""
    recording, known, calibration = timed
    laboratory = Laboratory(TREADMILL, calibration, plates=known)
    artefacts, _ = plate_artefacts(bind(recording, laboratory))
    for artefact, plate in zip(artefacts, recording.plates, strict=True):
        late = estimate_delay(artefact, plate.wrench_in_plate, 1000.0)
        assert late.seconds == pytest.approx(0, abs=3e-4)


def test_loads_are_of_the_plates_own_clocks():
    """Of empty plates only their noise is left, of 0.5 N, however late one of them is."""
    delays_s = (0.004, 0.03)
    recording = thesis_delays(lab.shaken(20.0), delays_s=delays_s)
    known = correction_of(recording, change=False, delays=delays_s)
    calibration = fit_calibration(recording, TREADMILL, known)
    for load in plate_loads(bind(recording, Laboratory(TREADMILL, calibration, plates=known))):
        assert np.nanstd(load.force) < 0.6


@pytest.mark.parametrize(
    ("fitted_with", "used", "message"),
    [
        ("lab.json", None, "corrected by lab.json; name"),
        ("lab.json", "new.json", "by lab.json, .*new.json; "),
    ],
)
def test_a_calibration_of_otherwise_corrected_plates_is_refused(empty, fitted_with, used, message):
    of = {name: correction_of(empty, name=name) for name in ("lab.json", "new.json")}
    calibration = fit_calibration(empty, TREADMILL, of.get(fitted_with))
    with pytest.raises(ValueError, match=message):
        Laboratory(TREADMILL, calibration, plates=of.get(used))


def test_plates_that_the_calibration_does_not_have_stay_as_they_are_with_a_warning(walker):
    corrected = with_corrected_plates(walker, correction_of(walker, (1,), delays=(None,)))
    np.testing.assert_array_equal(
        corrected.plates[1].wrench_in_plate, walker.plates[1].wrench_in_plate
    )
    assert np.any(corrected.plates[0].wrench_in_plate != walker.plates[0].wrench_in_plate)
    (note,) = [note for note in corrected.notes if note.level == "warning"]
    assert note.code == "plates_not_corrected"
    assert note.values["plates"] == ("2",)


def test_plates_numbered_the_other_way_round_are_refused(walker):
    other_way = tuple(replace(plate, number=3 - plate.number) for plate in reversed(walker.plates))
    with pytest.raises(ValueError, match=r"plate 1 .*0\.50 m .*lab\.json"):
        with_corrected_plates(replace(walker, plates=other_way), correction_of(walker))


def test_plates_whose_place_is_unknown_are_corrected_about_their_calibrations_centre(walker):
    """As in D-Flow's files, whose wrenches are about the lab's origin."""
    about_origin = tuple(
        type(plate).at_origin(plate.number, plate.time, plate.wrench)
        for plate in wrongly_measured(walker).plates
    )
    corrected = with_corrected_plates(replace(walker, plates=about_origin), correction_of(walker))
    for plate, right in zip(corrected.plates, walker.plates, strict=True):
        np.testing.assert_allclose(plate.wrench, right.wrench, atol=1e-9)


def test_each_plate_has_its_own_delay(walker, right):
    """As in the thesis, 4 ms on the left and 2 ms on the right."""
    correction = correction_of(walker, change=False, delays=(0.004, 0.002))
    late = tuple(
        replace(plate, time=plate.time + delay)
        for plate, delay in zip(walker.plates, (0.004, 0.002), strict=True)
    )
    delayed = process_recording(
        replace(walker, plates=late),
        PERSON,
        Settings(),
        laboratory=Laboratory(Treadmill(), plates=correction),
    )
    assert largest_difference(delayed, right)["measured"] < 1e-9
    assert "plates_corrected" in codes(delayed)


def test_a_plate_whose_delay_was_not_measured_has_the_stated_one_or_none(walker):
    correction = correction_of(walker, delays=(0.004, None))
    assert plate_delays_s(walker.plates, correction, None) == [0.004, 0.0]
    assert plate_delays_s(walker.plates, correction, 0.004) == [0.004, 0.004]


def test_two_different_delays_of_a_plate_are_refused(walker):
    correction = correction_of(walker, delays=(0.004, 0.002))
    with pytest.raises(ValueError, match=r"4 ms, .*lab\.json .*2\.0 ms .*plate 2"):
        plate_delays_s(walker.plates, correction, 0.004)


def test_a_subject_is_weighed_by_corrected_plates(walker):
    """Offsets and gains of 4 % would be some kilograms."""
    laboratory = Laboratory(Treadmill(), plates=correction_of(walker))
    wrong = wrongly_measured(walker)
    weighed = process_recording(wrong, Subject(sex="male"), Settings(), laboratory=laboratory)
    assert weighed.body.mass == pytest.approx(74.6, abs=0.05)
