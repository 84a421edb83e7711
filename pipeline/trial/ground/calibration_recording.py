"""Calibration of the plates from a recording of the empty, moving treadmill."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from compensation import (
    Calibration,
    InertiaModel,
    Sensor,
    estimate_delay,
    find_sensors,
    fit_trials,
    refuse_unusable,
)
from compensation.delay import MODEL_ERROR_S
from compensation.inertia.choice import choose, weigh_beside
from compensation.inertia.fit import LAGS_S
from compensation.inertia.model_error import residual_correlation
from compensation.inertia.sensors import QUANTILE_95, noise_for_fit
from hbm.notes import Note
from hbm.signals.resampling import resample
from hbm.spatial import Array
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Treadmill
from pipeline.io.input_file import naming
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import accelerations, fastest_belt, mean_belt_speed
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.empty_plates import (
    BESIDE,
    empty_plates,
    plate_samples,
    samples_of,
    setup_of,
    wrenches_in_time,
)

PLATES_NAME: Final = "plate_calibration"
PLATES_SHA256: Final = "plate_calibration_sha256"
"""Keys of a calibration's provenance that name the correction of its plates."""
MODEL: Final = "inertia_model"
WEIGHT: Final = "weight_of_beside"
"""Keys that say which model compensates trials, and how recordings of people weigh, and why."""
BELTS_UNKNOWN: Final = "belts_unknown"
"""Key that names the recordings in which the speed of the belts is unknown."""
MIN_APART_S: Final = 0.0005
"""Between two plates: a tenth of a delay that matters, of 5 ms."""


def fit_calibration(
    recording: Recording,
    treadmill: Treadmill,
    plates: PlateCorrection | None = None,
    beside: Sequence[Recording] = (),
    checks: Sequence[Recording] = (),
) -> Calibration:
    """Fit what the empty plates of a moving treadmill measure to its accelerations.

    Parameters
    ----------
    recording
        The empty treadmill, moving.
    treadmill
        Names of its accelerometers' channels and the cut-off for the fit.
    plates
        The correction of its plates, which are corrected before the fit, and brought to the first
        one's clock where it states their delays.
    beside
        Recordings in which people are on the treadmill, but not on every plate. Plates that stay
        empty are fitted to them too.
    checks
        The same, by whose empty plates static and dynamic model are compared; they are not fitted.

    Returns
    -------
    Calibration
        One model per plate, named "plate 1", "plate 2", …, and dynamic ones where they are stated
        or chosen. Its sensors' delays are against the first plate. Its provenance names the
        correction, which plates were empty in what, and in which recordings the speed of the belts
        is unknown.

    Raises
    ------
    ValueError
        If there are no plates or accelerometers, the fit is not possible, or somebody was on a
        plate for a part of a recording, or on all plates.
    """
    if not recording.plates:
        raise ValueError(
            f"{recording.source.name}: the calibration needs plates: {recording.why_no_plates}"
        )
    _refuse_repeated(recording, *beside, *checks)
    recording = with_corrected_plates(recording, plates)
    setup = setup_of(recording, treadmill)
    sensors = _sensors(recording, treadmill, plates)
    k = 3 * len(treadmill.accelerometers)
    own = plate_samples(recording, treadmill, sensors, plates, LAGS_S)
    noises = {name: noise_for_fit(sensors, felt[:, :k]) for name, (felt, _) in own.items()}
    every = (recording, *beside)
    belts = [mean_belt_speed(fastest_belt(one, treadmill)) for one in every]
    static = {
        name: fit_trials([(felt[:, :k], wrench)], setup, noises[name], belts_mps=_known(belts[:1]))
        for name, (felt, wrench) in own.items()
    }
    refuse_unusable(static)
    provenance = {"recording": recording.source.name}

    def read(one: Recording) -> tuple[str, dict[str, tuple[Array, Array]]]:
        with naming(one.source):
            return one.source.name, empty_plates(one, treadmill, sensors, plates, static, LAGS_S)

    found, compared = ([read(one) for one in recordings] for recordings in (beside, checks))
    trials = [(recording.source.name, own), *found]
    weight, in_words = weigh_beside(trials, k, setup.rate_hz)
    if found:
        for name in own:
            of_plate = [
                (samples[name], speed)
                for (_, samples), speed in zip(trials, belts, strict=True)
                if name in samples
            ]
            readings = [(felt[:, :k], wrench) for (felt, wrench), _ in of_plate]
            speeds = _known([speed for _, speed in of_plate])
            static[name] = fit_trials(
                readings, setup, noises[name], belts_mps=speeds, beside_weight=weight
            )
        provenance[BESIDE] = "; ".join(
            f"{source}: {', '.join(empty)} empty" for source, empty in found
        )
        provenance[WEIGHT] = in_words
    if None in belts:
        provenance[BELTS_UNKNOWN] = ", ".join(
            one.source.name for one, speed in zip(every, belts, strict=True) if speed is None
        )
    provenance[MODEL], dynamic = choose(trials, static, compared, treadmill.inertia_model, weight)
    if plates is not None:
        provenance |= {PLATES_NAME: plates.name, PLATES_SHA256: plates.sha256}
    joint = _joint_correlation(recording, own, dynamic or static)
    return Calibration(static, provenance, sensors, joint, dynamic)


def _known(speeds: Sequence[float | None]) -> tuple[float, ...]:
    """Give the speeds of all recordings, or none where one of them is unknown."""
    known = tuple(speed for speed in speeds if speed is not None)
    return known if len(known) == len(speeds) else ()


def _refuse_repeated(*recordings: Recording) -> None:
    """Refuse a recording that is given twice: it would seem to confirm itself."""
    for number, one in enumerate(recordings):
        for other in recordings[:number]:
            if len(one.plates) == len(other.plates) and all(
                np.array_equal(a.wrench_in_plate, b.wrench_in_plate, equal_nan=True)
                for a, b in zip(one.plates, other.plates, strict=True)
            ):
                raise ValueError(
                    f"{one.source.name}: is the same recording as {other.source.name}; give each "
                    "recording once"
                )


def plates_timed_apart(
    recording: Recording,
    treadmill: Treadmill,
    sensors: tuple[Sensor, ...],
    plates: PlateCorrection | None = None,
) -> tuple[Note, ...]:
    """Warn of plates that are later or earlier than the first, as the accelerometers show.

    Parameters are those of `fit_calibration`, and the sensors that it found; what the correction
    states of the plates' delays is taken into account.
    """
    recording = with_corrected_plates(recording, plates)
    late, rate_hz = [], setup_of(recording, treadmill).rate_hz
    for felt, wrench in plate_samples(recording, treadmill, sensors, plates).values():
        try:
            late.append(estimate_delay(felt, wrench, rate_hz))
        except ValueError:
            return ()
    notes = []
    for plate, one in zip(recording.plates[1:], late[1:], strict=True):
        apart_s = one.seconds - late[0].seconds
        errors_s = (one.standard_error, late[0].standard_error, MODEL_ERROR_S, MODEL_ERROR_S)
        interval_s = QUANTILE_95 * float(np.linalg.norm(errors_s))
        if abs(apart_s) > max(interval_s, MIN_APART_S):
            notes.append(
                Note.of(
                    "plates_timed_apart", plate=plate.number, delay_s=apart_s, interval_s=interval_s
                )
            )
    return tuple(notes)


def _joint_correlation(
    recording: Recording,
    samples: Mapping[str, tuple[Array, Array]],
    models: Mapping[str, InertiaModel],
) -> Array | None:
    """Give the correlation of what is left of all plates; None where their clocks differ."""
    first, *others = recording.plates
    if not all(np.array_equal(plate.time, first.time) for plate in others):
        return None
    if len({len(wrench) for _, wrench in samples.values()}) > 1:
        return None
    left = np.hstack(
        [models[n].compensate(a[:, : len(models[n].gain) - 1], w) for n, (a, w) in samples.items()]
    )
    setup = next(iter(models.values())).setup
    return residual_correlation(left - left.mean(axis=0), None if setup is None else setup.rate_hz)


def _sensors(
    recording: Recording, treadmill: Treadmill, correction: PlateCorrection | None
) -> tuple[Sensor, ...]:
    """Find the sensors' delays against the plates, and their noise."""
    clock, readings = accelerations(recording, treadmill)
    setup = setup_of(recording, treadmill)
    filtered = setup.low_pass(readings, clock)
    wrenches = wrenches_in_time(recording, setup, correction)
    first, *_ = recording.plates
    same_clock = [
        wrench
        for plate, wrench in zip(recording.plates, wrenches, strict=True)
        if np.array_equal(plate.time, first.time)
    ]
    stated = treadmill.accelerometer_delay_s
    felt = resample(clock, filtered, first.time + (stated or 0.0))
    both = np.hstack([felt, *same_clock])
    both = samples_of(both, np.isfinite(both).all(axis=1))
    complete = samples_of(readings, np.isfinite(readings).all(axis=1))
    rate_hz = (len(clock) - 1) / float(clock[-1] - clock[0])
    felt, wrench = np.split(both, [felt.shape[1]], axis=1)
    found = find_sensors(felt, wrench, complete, setup, rate_hz)
    if stated is None:
        return found
    return tuple(replace(sensor, delay_s=stated, delay_error_s=0.0) for sensor in found)
