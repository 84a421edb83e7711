"""Recordings of empty plates, and the calibration of a moving treadmill that is fitted to them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation import (
    Calibration,
    InertiaModel,
    Sensor,
    Setup,
    estimate_delay,
    find_sensors,
    fit_trials,
    refuse_unusable,
)
from compensation.delay import MODEL_ERROR_S
from compensation.inertia.choice import Samples, choose, weigh_beside
from compensation.inertia.fit import LAGS_S
from compensation.inertia.model_error import residual_correlation
from compensation.inertia.quality import MIN_LOAD_N
from compensation.inertia.sensors import QUANTILE_95, noise_for_fit
from hbm.notes import Note
from hbm.signals.filtering import Method
from hbm.signals.resampling import resample
from hbm.spatial import Array
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Treadmill
from pipeline.io.input_file import naming
from pipeline.io.read import read_recording
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.trial.ground.accelerometers import (
    accelerations,
    at_plate_times,
    fastest_belt,
    mean_belt_speed,
    sensor_delays_s,
)
from pipeline.trial.ground.corrected_plates import relative_delays_s, with_corrected_plates

FILTER: Final[Method] = "zero_phase"
"""A delay of what is subtracted would leave an artefact wherever platform or belt accelerate."""
BESIDE: Final = "beside"
"""Key of a calibration's provenance that names the recordings of people beside empty plates."""
LOAD_S: Final = 2.0
"""Over which the vertical force of a plate is averaged to see whether somebody is on it: longer
than a stride, so that steps count as well as standing."""
STEP_S: Final = 0.2
MAX_STEP_N: Final = 50.0
"""A step on a plate is longer and heavier; vibration and drift of an empty one are less."""
MIN_BESIDE_S: Final = 10.0
"""Some strides: less says little of how people shake the platform."""
AXES_BY_VERTICAL: Final = ("forward,left,up", "forward,up,right", "up,forward,left")
"""One choice with each of the file's axes as the vertical one."""
MIN_COSINE_LEVEL: Final = 0.7
"""Of the angle between a level plate's normal and the vertical, about 45°."""


def read_empty(path: Path, stated: Stated, *, any_forward: bool = True) -> Recording:
    """Read a recording of the empty treadmill, of any format.

    Marker set and label prefix are those of a subject and do not count. Without stated axes any
    directions are taken in which the plates lie level: nothing shows which way is forward, and a
    calibration in the plates' own axes does not need it. A correction of its plates is in the lab's
    axes and does (`any_forward`). A ValueError or OSError where the file cannot be read, or what is
    to be calibrated is subtracted from its plates.
    """
    read = _read_with_any_axes if any_forward else read_recording
    recording = read(path, replace(stated, marker_set=None, label_prefix=None))
    if recording.compensation is not None:
        raise ValueError(
            f"{path.name}: its plates are compensated, by {recording.compensation.software}; a "
            "calibration needs the original recording"
        )
    return recording


def _read_with_any_axes(path: Path, stated: Stated) -> Recording:
    try:
        return read_recording(path, stated)
    except ValueError as first:
        for axes in AXES_BY_VERTICAL if stated.axes is None else ():
            try:
                recording = read_recording(path, replace(stated, axes=axes, axes_by=""))
            except ValueError:
                continue
            if all(abs(plate.rotation[2, 2]) > MIN_COSINE_LEVEL for plate in recording.plates):
                return replace(recording, stated=stated, axes=())  # nobody stated these axes
        raise first


def plate_samples(
    recording: Recording,
    treadmill: Treadmill,
    sensors: Sequence[Sensor],
    correction: PlateCorrection | None,
    lags_s: Sequence[float] = (),
) -> Samples:
    """Give the specific force of all accelerometers and the wrench of every plate, both filtered.

    Parameters
    ----------
    recording
        Its plates are corrected already.
    treadmill
        Channels of the accelerometers, and the cut-off of the filter.
    sensors
        Of a calibration; their delays are undone.
    correction
        Of the plates, whose delays are undone; None without one.
    lags_s
        Of a dynamic model [s]: differences over them follow the readings.

    Returns
    -------
    dict
        "plate N" -> specific force along the sensors' axes, (T, 3 S) [m/s²], and the wrench about
        the plate's centre in its own axes, (T, 6) [N, N·m], at its samples where both are known.

    Raises
    ------
    ValueError
        If a channel is missing, or its unit is unknown.

    Notes
    -----
    notebooks/02_what_the_platform_does_to_your_plates.py is an example.
    """
    clock, readings = accelerations(recording, treadmill)
    setup, plates = setup_of(recording, treadmill), recording.plates
    filtered, delays_s = setup.low_pass(readings, clock), sensor_delays_s(treadmill, sensors)
    every = at_plate_times(clock, filtered, [p.time for p in plates], delays_s, lags_s)
    wrenches, found = wrenches_in_time(recording, setup, correction), {}
    for plate, felt, wrench in zip(plates, every, wrenches, strict=True):
        known = np.isfinite(felt).all(axis=1) & np.isfinite(wrench).all(axis=1)
        if not known.any():
            raise ValueError(
                f"{recording.source.name}: plate {plate.number} has no samples at which the "
                "accelerometers are known"
            )
        found[f"plate {plate.number}"] = samples_of(felt, known), samples_of(wrench, known)
    return found


def empty_plates(
    recording: Recording,
    treadmill: Treadmill,
    sensors: Sequence[Sensor],
    correction: PlateCorrection | None,
    models: Mapping[str, InertiaModel],
) -> Samples:
    """Give the samples of those plates that nobody was on, with the lags of a dynamic model.

    The recording is as it was read; a load is seen by the static models of a calibration. A
    ValueError where it was recorded otherwise than the calibration, is short, or somebody was on a
    plate for a while, or on every plate.
    """
    source = recording.source.name
    if not recording.plates:
        raise ValueError(
            f"{source}: a recording beside an empty plate needs plates: {recording.why_no_plates}"
        )
    setup = setup_of(recording, treadmill)
    recording, empty = with_corrected_plates(recording, correction), {}
    every = plate_samples(recording, treadmill, sensors, correction, LAGS_S)
    for name, (felt, wrench) in every.items():
        if name not in models:
            continue
        model = models[name]
        try:
            model.require(setup)
        except ValueError as error:
            raise ValueError(f"{source}: {error}") from error
        force = model.compensate(felt[:, : len(model.acceleration_mean)], wrench)[:, 2]
        if len(force) < MIN_BESIDE_S * setup.rate_hz:
            raise ValueError(
                f"{source}: {len(force) / setup.rate_hz:.1f} s are too short, expected "
                f"{MIN_BESIDE_S:g} s or more; record a minute"
            )
        if (np.abs(_means(force, setup, LOAD_S)) > MIN_LOAD_N).all():
            continue
        steps = _means(force, setup, STEP_S)
        highest = float(np.abs(steps - np.median(steps)).max())
        if highest > MAX_STEP_N:
            raise ValueError(
                f"{source}: somebody was on {name} for a part of the time ({highest:.0f} N over "
                f"{STEP_S:g} s, expected {MAX_STEP_N:g} N at most of an empty plate); record "
                "people who stay on the other plate or on the boards all the time"
            )
        empty[name] = felt, wrench
    if not empty:
        raise ValueError(
            f"{source}: somebody was on every plate; a recording beside the empty plate leaves one "
            "plate empty"
        )
    return empty


def _means(force: Array, setup: Setup, length_s: float) -> Array:
    """Give the means of parts of about a length, (parts,)."""
    parts = max(len(force) // round(length_s * setup.rate_hz), 1)
    return np.array([part.mean() for part in np.array_split(force, parts)])


def samples_of(channels: Array, known: ArrayLike) -> Array:
    """Give the known ones, (M, K), of some samples, (N, K), every channel in one piece of memory.

    Fits sum over samples again and again, which then takes a tenth of the time.
    """
    return channels.T.compress(np.asarray(known), axis=1).T


def setup_of(recording: Recording, treadmill: Treadmill) -> Setup:
    """Give how a recording's plates and accelerometers were recorded and are to be filtered."""
    rate = float(1 / np.median(np.diff(recording.plates[0].time)))
    return Setup(
        tuple(treadmill.accelerometers), round(rate, 6), treadmill.cutoff_hz, filter_method=FILTER
    )


def wrenches_in_time(
    recording: Recording, setup: Setup, correction: PlateCorrection | None
) -> list[Array]:
    """Give the low-passed plates (N, 6), each read ahead by how much later it is than the first."""
    late = relative_delays_s(recording.plates, correction)
    wrenches = [setup.low_pass(plate.wrench_in_plate, plate.time) for plate in recording.plates]
    return [
        wrench if late_s == 0 else resample(plate.time, wrench, plate.time + late_s)
        for plate, wrench, late_s in zip(recording.plates, wrenches, late, strict=True)
    ]


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
    setup, k = setup_of(recording, treadmill), 3 * len(treadmill.accelerometers)
    sensors = _sensors(recording, treadmill, plates)
    own = plate_samples(recording, treadmill, sensors, plates, LAGS_S)
    noises = {name: noise_for_fit(sensors, felt[:, :k]) for name, (felt, _) in own.items()}
    every = (recording, *beside)
    belts = [mean_belt_speed(fastest_belt(one, treadmill)) for one in every]

    def fitted(trials: Sequence[tuple[str, Samples]], weight: float) -> dict[str, InertiaModel]:
        models = {}
        for name in own:
            rows = [n for n, (_, samples) in enumerate(trials) if name in samples]
            of_plate = [trials[n][1][name] for n in rows]
            speeds = [speed for n in rows if (speed := belts[n]) is not None]
            models[name] = fit_trials(
                [(felt[:, :k], wrench) for felt, wrench in of_plate],
                setup,
                noises[name],
                belts_mps=speeds if len(speeds) == len(rows) else (),
                beside_weight=weight,
            )
        return models

    def read(one: Recording) -> tuple[str, Samples]:
        with naming(one.source):
            return one.source.name, empty_plates(one, treadmill, sensors, plates, static)

    trials = [(recording.source.name, own)]
    static, provenance = fitted(trials, 1.0), {"recording": recording.source.name}
    refuse_unusable(static)
    if beside:
        trials += map(read, beside)
        weight, provenance[WEIGHT] = weigh_beside(trials, k, setup.rate_hz)
        provenance[BESIDE] = "; ".join(
            f"{source}: {', '.join(empty)} empty" for source, empty in trials[1:]
        )
        static = fitted(trials, weight)
    else:
        weight = 1.0
    if None in belts:
        provenance[BELTS_UNKNOWN] = ", ".join(
            one.source.name for one, speed in zip(every, belts, strict=True) if speed is None
        )
    compared = [read(one) for one in checks]
    provenance[MODEL], dynamic = choose(trials, static, compared, treadmill.inertia_model, weight)
    if plates is not None:
        provenance |= {PLATES_NAME: plates.name, PLATES_SHA256: plates.sha256}
    joint = _joint_correlation(recording, own, dynamic or static)
    return Calibration(static, provenance, sensors, joint, dynamic)


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
            values = {"plate": plate.number, "delay_s": apart_s, "interval_s": interval_s}
            notes.append(Note.of("plates_timed_apart", **values))
    return tuple(notes)


def _joint_correlation(
    recording: Recording, samples: Samples, models: Mapping[str, InertiaModel]
) -> Array | None:
    """Give the correlation of what is left of all plates; None where their clocks differ."""
    first, *others = recording.plates
    alike = all(np.array_equal(plate.time, first.time) for plate in others)
    if not alike or len({len(wrench) for _, wrench in samples.values()}) > 1:
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
