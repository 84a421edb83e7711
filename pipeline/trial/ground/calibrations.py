"""Calibrations of a laboratory: fitted to recordings of its empty treadmill, read, and checked.

That of the moving platform, that of accelerating belts, and the check of the first on another day.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np

from compensation import Calibration, InertiaModel, Sensor, Setup, estimate_delay, from_json
from compensation.delay import MODEL_ERROR_S
from compensation.inertia.choice import Samples, choose, weigh_beside
from compensation.inertia.fit import LAGS_S, fit_trials
from compensation.inertia.model_error import residual_correlation
from compensation.inertia.quality import MIN_LOAD_N, DayCheck, check_another_day, refuse_unusable
from compensation.inertia.sensors import QUANTILE_95, faulty_sensors, find_sensors, noise_for_fit
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.resampling import resample
from hbm.signals.samples import mean_rate_hz
from hbm.spatial import Array
from pipeline.config.plate_correction import SAME_DELAY_S, PlateCorrection
from pipeline.config.schema import Platform, Treadmill
from pipeline.io.input_file import FileFault, naming, read_text
from pipeline.io.read import read_recording
from pipeline.io.read_options import ReadOptions, as_stated
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import (
    accelerations,
    at_plate_times,
    fastest_belt,
    mean_belt_speed,
    sensor_delays_s,
    setup_of,
    without_gaps,
)
from pipeline.trial.ground.laboratory import (
    BELTS_UNKNOWN,
    BESIDE,
    PLATES_NAME,
    PLATES_SHA256,
    Laboratory,
    bind,
    channels_of,
    relative_delays_s,
    require_same_plates,
    with_corrected_plates,
)
from pipeline.trial.ground.wrenches import plate_artefacts, sensor_notes

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "calibrations")


def read_empty(path: Path, options: ReadOptions, *, any_forward: bool = True) -> Recording:
    """Read a recording of the empty treadmill, of any format.

    Marker set and label prefix are those of a subject and do not count. Without stated axes any
    directions are taken in which the plates lie level: nothing shows which way is forward, and a
    calibration in the plates' own axes does not need it. A correction of its plates is in the lab's
    axes and does (`any_forward`). A ValueError or OSError where the file cannot be read, or what is
    to be calibrated is subtracted from its plates.
    """
    read = _read_with_any_axes if any_forward else read_recording
    recording = read(path, replace(options, marker_set=None, label_prefix=None))
    if recording.compensation is not None:
        raise ValueError(
            f"{path.name}: its plates are compensated, by {recording.compensation.software}; a "
            "calibration needs the original recording"
        )
    return recording


def _read_with_any_axes(path: Path, options: ReadOptions) -> Recording:
    try:
        return read_recording(path, options)
    except ValueError as first:
        # one choice with each of the file's axes as the vertical one
        choices = "forward,left,up", "forward,up,right", "up,forward,left"
        for axes in choices if options.axes is None else ():
            try:
                recording = read_recording(path, replace(options, axes=axes, axes_by=""))
            except ValueError:
                continue
            if all(abs(plate.rotation[2, 2]) > np.sqrt(0.5) for plate in recording.plates):
                return replace(recording, options=options, axes=())  # nobody stated these axes
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
    times = [plate.time for plate in plates]
    every = at_plate_times(clock, filtered, filtered, times, delays_s, lags_s)
    wrenches, samples = wrenches_in_time(recording, setup, correction), {}
    for plate, measured, wrench in zip(plates, every, wrenches, strict=True):
        both = without_gaps(measured, wrench)
        if not len(both[0]):
            raise ValueError(
                f"{recording.source.name}: plate {plate.number} has no samples at which the "
                "accelerometers are known"
            )
        samples[f"plate {plate.number}"] = both[0], both[1]
    return samples


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
    setup = setup_of(recording, treadmill)
    recording, empty = with_corrected_plates(recording, correction), {}
    every = plate_samples(recording, treadmill, sensors, correction, LAGS_S)
    for name, (measured, wrench) in every.items():
        if (model := models.get(name)) is None:
            continue
        model.require(setup)
        # vertical force that the platform's motion does not explain
        force = model.compensate(measured[:, : len(model.acceleration_mean)], wrench)[:, 2]
        if len(force) < LIMITS.shortest_beside * setup.rate_hz:
            raise ValueError(
                f"{len(force) / setup.rate_hz:.1f} s are too short, expected "
                f"{LIMITS.shortest_beside:g} s or more; record a minute"
            )
        # a plate that somebody is on all the time is not fitted
        if (np.abs(_means(force, setup, LIMITS.load_span)) > MIN_LOAD_N).all():
            continue
        # short loads on a plate that is empty else
        steps = _means(force, setup, LIMITS.step_span)
        highest = float(np.abs(steps - np.median(steps)).max())
        if highest > LIMITS.largest_step:
            raise ValueError(
                f"somebody was on {name} for a part of the time ({highest:.0f} N over "
                f"{LIMITS.step_span:g} s, expected {LIMITS.largest_step:g} N at most of an empty "
                "plate); record people who stay on the other plate or on the boards all the time"
            )
        empty[name] = measured, wrench
    if not empty:
        raise ValueError(
            "somebody was on every plate; a recording beside the empty plate leaves one plate empty"
        )
    return empty


def _means(force: Array, setup: Setup, length_s: float) -> Array:
    """Give the means of parts of about a length, (parts,)."""
    parts = max(len(force) // round(length_s * setup.rate_hz), 1)
    return np.array([part.mean() for part in np.array_split(force, parts)])


def wrenches_in_time(
    recording: Recording, setup: Setup, correction: PlateCorrection | None
) -> list[Array]:
    """Give the low-passed plates (N, 6), each read ahead by how much later it is than the first."""
    return [
        resample(plate.time, setup.low_pass(plate.wrench_in_plate, plate.time), plate.time + late_s)
        for plate, late_s in zip(
            recording.plates, relative_delays_s(recording.plates, correction), strict=True
        )
    ]


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
    setup, k = setup_of(recording, treadmill), 3 * len(treadmill.accelerometers)
    every = recording, *beside
    _refuse_repeated(*every, *checks)
    source, recording = recording.source.name, with_corrected_plates(recording, plates)
    sensors = _sensors(recording, treadmill, plates)
    samples = plate_samples(recording, treadmill, sensors, plates, LAGS_S)
    # noise of the accelerometers makes gains too small, unless the fit knows it
    noises = {
        name: noise_for_fit(sensors, measured[:, :k]) for name, (measured, _) in samples.items()
    }
    belts = [mean_belt_speed(fastest_belt(one, treadmill)) for one in every]

    def fitted(trials: Sequence[tuple[str, Samples]], weight: float) -> dict[str, InertiaModel]:
        models = {}
        for name, noise in noises.items():
            rows = [n for n, (_, plates_empty) in enumerate(trials) if name in plates_empty]
            of_plate = [trials[n][1][name] for n in rows]
            speeds = [speed for n in rows if (speed := belts[n]) is not None]
            models[name] = fit_trials(
                [(measured[:, :k], wrench) for measured, wrench in of_plate],
                setup,
                noise,
                belts_mps=speeds if len(speeds) == len(rows) else (),
                beside_weight=weight,
            )
        return models

    def read(one: Recording) -> tuple[str, Samples]:
        with naming(one.source):
            return one.source.name, empty_plates(one, treadmill, sensors, plates, static)

    # the moving empty treadmill alone tells who is on a plate in the others
    trials, weight, provenance = [(source, samples)], 1.0, {"recording": source}
    static = fitted(trials, weight)
    refuse_unusable(static)
    if beside:
        trials += map(read, beside)
        weight, provenance["weight_of_beside"] = weigh_beside(trials, setup)
        provenance[BESIDE] = "; ".join(
            f"{name}: {', '.join(empty)} empty" for name, empty in trials[1:]
        )
        static = fitted(trials, weight)
    if unknown := [one.source.name for one, mps in zip(every, belts, strict=True) if mps is None]:
        provenance[BELTS_UNKNOWN] = ", ".join(unknown)
    compared = [read(one) for one in checks]
    provenance["inertia_model"], dynamic = choose(
        trials, static, compared, treadmill.inertia_model, weight
    )
    if plates is not None:
        provenance |= {PLATES_NAME: plates.name, PLATES_SHA256: plates.sha256}
    joint = _joint_correlation(recording, samples, dynamic or static, setup.rate_hz)
    return Calibration(static, provenance, sensors, joint, dynamic)


def _refuse_repeated(*recordings: Recording) -> None:
    """Refuse a recording that is given twice: it would seem to confirm itself."""
    for other, one in combinations(recordings, 2):
        plates = zip(one.plates, other.plates, strict=False)
        same = [
            np.array_equal(plate.wrench_in_plate, twin.wrench_in_plate, equal_nan=True)
            for plate, twin in plates
        ]
        if len(one.plates) == len(other.plates) and all(same):
            raise FileFault(
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
    rate_hz = setup_of(recording, treadmill).rate_hz
    samples = plate_samples(recording, treadmill, sensors, plates)
    try:
        first, *others = (estimate_delay(*of_plate, rate_hz) for of_plate in samples.values())
    except ValueError:
        return ()
    notes = []
    for plate, late in zip(recording.plates[1:], others, strict=True):
        apart_s = late.seconds - first.seconds
        # each estimate has its error of noise, and one of the model
        errors_s = late.standard_error, first.standard_error, MODEL_ERROR_S, MODEL_ERROR_S
        interval_s = QUANTILE_95 * float(np.linalg.norm(errors_s))
        if abs(apart_s) > max(interval_s, LIMITS.least_apart):
            values = {"plate": plate.number, "delay_s": apart_s, "interval_s": interval_s}
            notes.append(Note.of("plates_timed_apart", **values))
    return tuple(notes)


def _joint_correlation(
    recording: Recording, samples: Samples, models: Mapping[str, InertiaModel], rate_hz: float
) -> Array | None:
    """Give the correlation of what is left of all plates; None where their clocks differ."""
    # by the static channels, which come first
    rest = [
        models[name].compensate(measured[:, : len(models[name].gain) - 1], wrench)
        for name, (measured, wrench) in samples.items()
    ]
    # residuals go together only where they are sampled together
    clocks = {plate.time.tobytes() for plate in recording.plates}
    if len(clocks) > 1 or len({*map(len, rest)}) > 1:
        return None
    both = np.hstack(rest)
    return residual_correlation(both - both.mean(axis=0), rate_hz)


def _sensors(
    recording: Recording, treadmill: Treadmill, correction: PlateCorrection | None
) -> tuple[Sensor, ...]:
    """Find the sensors' delays against the plates, and their noise."""
    clock, readings = accelerations(recording, treadmill)
    setup, first = setup_of(recording, treadmill), recording.plates[0].time
    filtered, stated_s = setup.low_pass(readings, clock), sensor_delays_s(treadmill, ())
    (measured,) = at_plate_times(clock, filtered, filtered, [first], stated_s)
    wrenches = wrenches_in_time(recording, setup, correction)
    # delays are fitted to all plates that are sampled at the same times
    same_clock = [
        wrench
        for plate, wrench in zip(recording.plates, wrenches, strict=True)
        if np.array_equal(plate.time, first)
    ]
    (complete,), (measured, *same_clock) = (
        without_gaps(readings),
        without_gaps(measured, *same_clock),
    )
    sensors = find_sensors(measured, np.hstack(same_clock), complete, setup, mean_rate_hz(clock))
    if (delay_s := treadmill.accelerometer_delay_s) is None:
        return sensors
    return tuple(replace(sensor, delay_s=delay_s, delay_error_s=0.0) for sensor in sensors)


def read_calibration(
    path: str | Path,
    treadmill: Treadmill,
    options: ReadOptions | str | None = None,
    plates: PlateCorrection | None = None,
    beside: Sequence[str | Path] = (),
) -> Calibration:
    """Read a fitted calibration (JSON), or fit one to a recording of the empty treadmill (C3D).

    Parameters
    ----------
    path
        ``.json`` or ``.c3d``.
    treadmill
        Names of the accelerometers' channels.
    options
        How a recording is to be read, as for `read_empty`; a text states its axes alone.
    plates
        The correction of the plates of trials: those of a recording are corrected alike.
    beside
        Recordings of people beside an empty plate, fitted together with a recording.

    Returns
    -------
    Calibration
        One model per plate.

    Raises
    ------
    ValueError, OSError
        If the file cannot be read or used, or is a calibration of otherwise corrected plates.

    Examples
    --------
    >>> import compensation, pipeline
    >>> import numpy as np
    >>> measured = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = measured @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> setup = compensation.Setup(("rear",), rate_hz=1000.0, cutoff_hz=20.0)
    >>> fitted = Calibration({"plate 1": compensation.fit_inertia(measured, wrench, setup)})
    >>> _ = Path("lab.json").write_text(compensation.to_json(fitted))
    >>> rear = pipeline.Treadmill(accelerometers={"rear": ("Acc1.X", "Acc1.Y", "Acc1.Z")})
    >>> list(pipeline.read_calibration("lab.json", rear).plates)
    ['plate 1']
    """
    path, forward = Path(path), plates is None
    with naming(path):
        if path.suffix.lower() == ".json":
            calibration = from_json(read_text(path))
            channels_of(calibration)  # refuses damaged ones
            _require_as_stated(calibration, treadmill)
            require_same_plates(calibration, plates)
            return calibration
        recording, *others = (
            read_empty(Path(file), as_stated(options), any_forward=forward)
            for file in (path, *beside)
        )
        return fit_calibration(recording, treadmill, plates, others)


def _require_as_stated(calibration: Calibration, treadmill: Treadmill) -> None:
    """Refuse a stated delay or model that is not the one with which the calibration was fitted."""
    stated_s = treadmill.accelerometer_delay_s
    for sensor in calibration.sensors:
        if stated_s is not None and abs(sensor.correction_s - stated_s) > SAME_DELAY_S:
            raise ValueError(
                f"the calibration was fitted with a delay of {1000 * sensor.correction_s:.2f} ms "
                f"of accelerometer {sensor.name}, but treadmill.accelerometer_delay_s is "
                f"{1000 * stated_s:.2f} ms; leave it out, or fit again"
            )
    fitted, wanted = "dynamic" if calibration.dynamic else "static", treadmill.inertia_model
    if wanted not in ("auto", fitted):
        raise ValueError(
            f"the calibration is of a {fitted} model, but treadmill.inertia_model is {wanted!r}; "
            f"leave it out, or fit it again with --model {wanted}"
        )


def read_laboratory(
    file: Path,
    platform_markers: tuple[str, ...],
    accelerometers: Mapping[str, tuple[str, str, str]] | None = None,
    plates: PlateCorrection | None = None,
) -> Laboratory:
    """Give the laboratory that a calibration file (JSON, as `hbm calibration fit` wrote) describes.

    Accelerometers are sensor -> its channels in the trials, where these are called otherwise than
    in the calibration. Without platform markers the treadmill stands still. A ValueError where the
    file is no such calibration, or one of otherwise corrected plates.
    """
    if file.suffix.lower() != ".json":
        raise ValueError(
            f"{file.name}: --calibration takes a fitted calibration; make one with "
            f"'hbm calibration fit {file.name} -o lab.json'"
        )
    calibration = read_calibration(file, Treadmill(), plates=plates)
    channels, setup = channels_of(calibration), next(iter(calibration.plates.values())).setup
    if not channels:
        raise ValueError(
            f"{file.name}: the calibration does not name its channels; fit it again with "
            "'hbm calibration fit'"
        )
    if accelerometers and set(accelerometers) != set(channels):
        raise ValueError(
            f"{file.name}: the calibration has the accelerometers {', '.join(channels)}, "
            f"--accelerometer names {', '.join(accelerometers)}; name all of them and no others"
        )
    treadmill = Treadmill(
        accelerometers={sensor: (accelerometers or channels)[sensor] for sensor in channels},
        accelerometer_unit=calibration.provenance.get("accelerometer_unit") or None,
        cutoff_hz=(setup and setup.cutoff_hz) or 20.0,
        platform=Platform(markers=platform_markers) if platform_markers else None,
    )
    return Laboratory(treadmill, calibration, plates=plates)


def belts_alone(recording: Recording, laboratory: Laboratory) -> tuple[Recording, tuple[Note, ...]]:
    """Correct the plates of a belt calibration as those of trials are, but for the belts.

    Belts accelerate at random, nobody is on them, and the platform is at rest. What the
    accelerometers explain is subtracted: accelerating belts shake the platform too, and of a trial
    that is subtracted before the belts' part is. A note says where the recording lacks their
    channels, so that what the belts shake is still in its plates, or where its accelerations are
    doubtful. A ValueError where an accelerometer is faulty, and as of `plate_artefacts`.
    """
    recording = with_corrected_plates(recording, laboratory.plates)
    file, analog = recording.source.name, recording.analog
    if laboratory.calibration is None:
        return recording, ()
    channels = {name for names in laboratory.treadmill.accelerometers.values() for name in names}
    if analog is None or not channels <= {*analog.names}:
        return recording, (Note.of("belts_without_accelerometers", recording=file),)
    with naming(recording.source):
        lab = bind(recording, laboratory)
        if faults := sensor_notes(lab, faulty_sensors):
            raise ValueError(f"the belts' calibration needs its accelerometers: {faults[0]}")
        artefacts, _ = plate_artefacts(lab)
    plates = tuple(
        replace(plate, wrench_in_plate=plate.wrench_in_plate - artefact)
        for plate, artefact in zip(recording.plates, artefacts, strict=True)
    )
    doubts = tuple(map(str, sensor_notes(lab)))
    notes = (Note.of("belts_recording_doubtful", recording=file, doubts=doubts),) if doubts else ()
    return replace(recording, plates=plates), notes


@dataclass(frozen=True, slots=True)
class CalibrationCheck:
    """Whether a calibration is still valid, in words, and the numbers of every plate."""

    valid: bool
    notes: tuple[Note, ...]
    plates: Mapping[str, DayCheck] = field(default_factory=dict)


def check_recording(recording: Recording, laboratory: Laboratory) -> CalibrationCheck:
    """Compare a calibration with an empty recording of another day.

    Raises
    ------
    ValueError
        If it was recorded with other plates, sensors or rates than the calibration, or shows
        nothing: a platform at rest, somebody on the boards.
    """
    file, calibration = recording.source.name, laboratory.calibration
    assert calibration is not None
    recording = with_corrected_plates(recording, laboratory.plates)
    lab = bind(recording, laboratory)
    if faults := sensor_notes(lab, faulty_sensors):
        return CalibrationCheck(False, faults)
    belts_mps, checked = mean_belt_speed(lab.belts), {}
    samples = plate_samples(recording, laboratory.treadmill, lab.sensors, laboratory.plates)
    for name, (measured, wrench) in samples.items():
        with naming(recording.source):
            checked[name] = check_another_day(calibration.plates[name], measured, wrench, belts_mps)
    faulty = [f"{name}: {', '.join(one.faults)}" for name, one in checked.items() if one.faults]
    if faulty:
        note = Note.of("calibration_outdated", recording=file, faults=faulty)
        return CalibrationCheck(False, (note,), checked)
    # the largest force and moment of any plate: by the calibration, and by a new fit
    sizes = [
        np.linalg.norm(np.reshape([one.left, one.left_by_new_fit], (2, 2, 3)), axis=2)
        for one in checked.values()
    ]
    (force_n, moment_nm), (new_force_n, new_moment_nm) = np.max(sizes, axis=0)
    values = {"force_n": force_n, "moment_nm": moment_nm}
    values |= {"new_force_n": new_force_n, "new_moment_nm": new_moment_nm}
    note = Note.of("calibration_still_valid", recording=file, **values)
    return CalibrationCheck(True, (note,), checked)
