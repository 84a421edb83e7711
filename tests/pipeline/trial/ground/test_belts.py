"""Belt compensation takes away what empty belts add, and nothing of what a person adds."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from compensation import Signal, belt_signals, pitch_and_sway_signals, validation_signals
from hbm.signals.filtering import low_pass
from pipeline.config.schema import Belt, Treadmill
from pipeline.io.c3d.read import read_c3d
from pipeline.trial.ground.belts import belt_axes, belt_wrenches, fit_belts
from pipeline.trial.ground.calibrations import belts_alone, fit_calibration
from pipeline.trial.ground.laboratory import Laboratory, bind
from pipeline.trial.ground.wrenches import plate_artefacts
from pipeline.virtual_lab.faults import BeltFaults, Faults, MachineFaults
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.machine.instrumented_treadmill import SENSOR_NAMES
from pipeline.virtual_lab.protocol import calibration_trial
from pipeline.virtual_lab.protocol.calibration_trial import sample_times
from tests.pipeline.trial.ground.grounds import ground_of

RATE = 500.0
FAULTS = Faults(
    machine=MachineFaults(flexibility=4.0),
    belts=BeltFaults(drive="linear", unbalance_kg_per_m=0.2),
)
"""A machine that people shake, with belts of the family that is fitted."""
BELT = Belt(calibration="belts.c3d", speed_channels=("BeltSpeed",))
SENSORS = {name: tuple(f"{name}.{axis}" for axis in "XYZ") for name in SENSOR_NAMES[:2]}
TREADMILL = Treadmill(accelerometers=SENSORS, belt=BELT)
VALIDATION = validation_signals()[4]
AFTER_RANDOM = slice(6100, None)
PULSES = Signal(
    "pulses",
    VALIDATION.rate_hz,
    *(x[AFTER_RANDOM] for x in (VALIDATION.sway, VALIDATION.pitch, VALIDATION.belt_speed)),
)


record_signal_trial = partial(calibration_trial.record_signal_trial, rate_hz=RATE, faults=FAULTS)


@pytest.fixture(scope="module")
def pulses():
    """Belt pulses of the empty treadmill."""
    return record_signal_trial(PULSES, seed=3)


@pytest.fixture(scope="module")
def models():
    return fit_belts(record_signal_trial(belt_signals(1, 1.0)[0], seed=1), BELT)


@pytest.fixture(scope="module")
def calibration():
    return fit_calibration(
        record_signal_trial(pitch_and_sway_signals(1, 0.0)[6], seed=2), TREADMILL
    )


def left_over(recording, models, calibration=None):
    """RMS of the empty plate's pitch moment below 6 Hz, as measured and compensated [N·m]."""
    time = recording.markers.time[100:-100]
    ground = ground_of(recording, Laboratory(TREADMILL, calibration, models), time, 0.0)
    about = [
        low_pass(plates[0][:, 4], 100.0, 6.0, "zero_phase") for plates in ground.variants.values()
    ]
    return [float(np.std(moment)) for moment in about]


def person():
    return calibration_trial.walking(sample_times(PULSES, RATE), np.random.default_rng(3))


@pytest.fixture(scope="module")
def walked():
    """The same pulses under a person."""
    return record_signal_trial(PULSES, seed=3, load=person())


def test_compensation_leaves_a_twentieth_of_the_pitch_moment_of_belt_pulses(models, pulses):
    raw, left = left_over(pulses, models)
    assert raw > 5
    assert left < 0.05 * raw


def test_at_the_plates_own_samples_the_same_is_subtracted_and_the_end_is_held(models, pulses):
    """The model's last whole interval ends 9 ms before the plates do."""
    recording = pulses
    laboratory = Laboratory(TREADMILL, None, models)
    artefacts, notes = plate_artefacts(bind(recording, laboratory))
    times = recording.plates[0].time
    for artefact, wrench in zip(
        artefacts, belt_wrenches(recording, models, BELT, [times] * len(models)), strict=True
    ):
        known = np.isfinite(wrench).all(axis=1)
        assert times[~known].min() > times[-1] - 0.01
        np.testing.assert_array_equal(artefact[known], wrench[known])
        np.testing.assert_array_equal(artefact[-1], wrench[known][-1])
        assert np.abs(artefact).max() > 5
    assert notes == ()


def test_what_a_person_on_the_belt_adds_is_not_compensated(models, pulses, walked):
    _, empty = left_over(pulses, models)
    _, left = left_over(walked, models)
    unmoved = replace(PULSES, belt_speed=0 * PULSES.belt_speed)
    person_alone, _ = left_over(record_signal_trial(unmoved, seed=3, load=person()), models)
    assert left > 3 * empty
    assert np.sqrt(left**2 - empty**2) > 0.9 * person_alone


def test_accelerometers_compensate_what_a_person_adds_through_the_platform(
    models, calibration, pulses, walked
):
    _, empty = left_over(pulses, models)
    _, by_belts = left_over(walked, models)
    _, empty_by_both = left_over(pulses, models, calibration)
    _, by_both = left_over(walked, models, calibration)
    assert by_both < 0.7 * by_belts
    assert by_both**2 - empty_by_both**2 < 0.1 * (by_belts**2 - empty**2)


def test_the_pitch_axis_of_a_plate_does_not_depend_on_the_lab_axes(pulses, tmp_path):
    path = tmp_path / "belt.c3d"
    write_c3d(path, pulses.markers, pulses.plates, analog=pulses.analog)
    axes = [belt_axes(read_c3d(path, a).plates[0]) for a in ("left,back,up", "right,forward,up")]
    np.testing.assert_allclose(*axes, atol=1e-6)
    plate = read_c3d(path, "left,back,up").plates[0]
    assert abs((plate.rotation @ belt_axes(plate))[1, 1]) == pytest.approx(1)


@pytest.fixture(scope="module")
def flexible():
    """A soft treadmill with motors: its belts' recording, its platform's calibration, a trial."""
    soft = Faults(machine=MachineFaults(flexibility=4.0))
    record = partial(calibration_trial.record_signal_trial, rate_hz=200.0, faults=soft)
    signals = belt_signals(1, 1.0)[0], pitch_and_sway_signals(1, 3.0)[6], VALIDATION
    belts, platform, trial = (record(signal, seed=k) for k, signal in enumerate(signals))
    return belts, fit_calibration(platform, TREADMILL), trial


def test_belts_and_accelerometers_together_leave_no_more_than_the_better_one_alone(flexible):
    """What belts shake the platform by is subtracted by the accelerometers, and only by them."""
    belts, platform, trial = flexible
    alone, notes = belts_alone(belts, Laboratory(TREADMILL, platform))
    assert notes == ()
    raw, by_belts = left_over(trial, fit_belts(belts, BELT))
    _, by_platform = left_over(trial, (), platform)
    _, together = left_over(trial, fit_belts(alone, BELT), platform)
    _, twice = left_over(trial, fit_belts(belts, BELT), platform)
    assert together < min(by_belts, by_platform) < 0.5 * raw
    assert together < 0.8 * twice


def test_a_dead_accelerometer_in_the_belts_recording_is_refused(flexible):
    belts, platform, _ = flexible
    values = belts.analog.values.copy()
    values[:, :3] = 0
    dead = replace(belts, analog=replace(belts.analog, values=values))
    with pytest.raises(ValueError, match=rf"^{belts.source.name}: .*dead"):
        belts_alone(dead, Laboratory(TREADMILL, platform))


def test_in_real_time_as_little_of_belt_pulses_is_left(models, pulses):
    """The model was fitted without delay; the real-time filter afterwards delays both alike."""
    laboratory, time = Laboratory(TREADMILL, None, models), pulses.markers.time
    ground = ground_of(pulses, laboratory, time, cutoff_hz=6.0, method="realtime")
    about = {
        name: low_pass(plates[0][:, 4], 100.0, 6.0, "realtime")[100:-100].std()
        for name, plates in ground.variants.items()
    }
    assert about["measured"] > 5
    assert about["compensated"] < 0.05 * about["measured"]
