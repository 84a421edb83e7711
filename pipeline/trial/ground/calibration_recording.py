"""Calibration of the plates from a recording of the empty, moving treadmill."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from compensation import (
    Calibration,
    InertiaModel,
    Sensor,
    estimate_delay,
    find_sensors,
    fit_trials,
    from_json,
    refuse_unusable,
)
from compensation.alignment.sensor_delay import MODEL_ERROR_S
from compensation.inertia.choice import choose
from compensation.inertia.dynamic import LAGS_S
from compensation.inertia.residual import residual_correlation
from compensation.inertia.sensors import QUANTILE_95, noise_for_fit
from hbm.notes import Note
from hbm.signals.resampling import resample
from hbm.spatial import Array
from pipeline.config.plate_correction import SAME_DELAY_S, PlateCorrection
from pipeline.config.schema import Treadmill
from pipeline.io.input_file import naming, read_text
from pipeline.io.read import read_as_stated
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated, as_stated
from pipeline.trial.ground.accelerometers import accelerations
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.empty_plates import (
    BESIDE,
    empty_plates,
    plate_samples,
    setup_of,
    wrenches_in_time,
)
from pipeline.trial.ground.instruments import fastest_belt

PLATES_NAME: Final = "plate_calibration"
PLATES_SHA256: Final = "plate_calibration_sha256"
"""Keys of a calibration's provenance that name the correction of its plates."""
AXES_BY_VERTICAL: Final = ("forward,left,up", "forward,up,right", "up,forward,left")
"""One choice with each of the file's axes as the vertical one."""
MIN_APART_S: Final = 0.0005
"""Between two plates: a tenth of a delay that matters, of 5 ms."""
MIN_COSINE_LEVEL: Final = 0.7
"""Of the angle between a level plate's normal and the vertical, about 45°."""


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
        correction, and which plates were empty in what.

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
    belts = [_belts_mps(one, treadmill) for one in (recording, *beside)]
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
    if found:
        for name in own:
            of_plate = [
                (samples[name], speed)
                for (_, samples), speed in zip(trials, belts, strict=True)
                if name in samples
            ]
            readings = [(felt[:, :k], wrench) for (felt, wrench), _ in of_plate]
            speeds = _known([speed for _, speed in of_plate])
            static[name] = fit_trials(readings, setup, noises[name], belts_mps=speeds)
        refuse_unusable(static)
        provenance[BESIDE] = "; ".join(
            f"{source}: {', '.join(empty)} empty" for source, empty in found
        )
    choice, dynamic = choose(trials, static, compared, treadmill.inertia_model)
    if plates is not None:
        provenance |= {PLATES_NAME: plates.name, PLATES_SHA256: plates.sha256}
    joint = _joint_correlation(recording, own, dynamic or static)
    return Calibration(static, provenance, sensors, joint, dynamic, choice)


def _belts_mps(recording: Recording, treadmill: Treadmill) -> float | None:
    """Give the constant belt speed whose fourth power is a recording's mean; None if unknown."""
    found = fastest_belt(recording, treadmill)
    return None if found is None else float(np.nanmean(found[1] ** 4) ** 0.25)


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
    return residual_correlation(left - left.mean(axis=0), next(iter(models.values())).setup)


def require_same_plates(calibration: Calibration, plates: PlateCorrection | None) -> None:
    """Refuse a calibration that was fitted to plates corrected otherwise than those of trials.

    Raises
    ------
    ValueError
        The correction of the one is not that of the others; the message says what to do.
    """
    known = calibration.provenance
    fitted, wanted = known.get(PLATES_SHA256, ""), plates.sha256 if plates is not None else ""
    if fitted == wanted:
        return
    used = f"to plates corrected by {known.get(PLATES_NAME)}" if fitted else "to uncorrected plates"
    if plates is None:
        advice = "name that file (plates.calibration in study.toml, --plate-calibration)"
    else:
        used += f", not by this {plates.name}" if fitted else f", but trials are by {plates.name}"
        advice = "fit it again with 'hbm calibration fit --plate-calibration'"
    raise ValueError(f"the treadmill's calibration was fitted {used}; {advice}")


def _sensors(
    recording: Recording, treadmill: Treadmill, correction: PlateCorrection | None
) -> tuple[Sensor, ...]:
    """Find the sensors' delays against the plates, their gains and their noise."""
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
    known = np.isfinite(both).all(axis=1)
    complete = readings[np.isfinite(readings).all(axis=1)]
    rate_hz = (len(clock) - 1) / float(clock[-1] - clock[0])
    found = find_sensors(
        felt[known],
        both[known][:, felt.shape[1] :],
        complete,
        setup,
        rate_hz,
    )
    if stated is None:
        return found
    return tuple(replace(sensor, delay_s=stated, delay_error_s=0.0) for sensor in found)


def read_calibration(
    path: Path,
    treadmill: Treadmill,
    stated: Stated | str | None = None,
    plates: PlateCorrection | None = None,
    beside: tuple[Path, ...] = (),
) -> Calibration:
    """Read a fitted calibration (JSON), or fit one to a recording of the empty treadmill (C3D).

    Parameters
    ----------
    path
        ``.json`` or ``.c3d``.
    treadmill
        Names of the accelerometers' channels.
    stated
        How a recording is to be read, as for `read_empty`; a text states its axes alone.
    plates
        The correction of the plates of trials: those of a recording are corrected alike.
    beside
        Recordings of people beside an empty plate, fitted together with a recording.

    Returns
    -------
    Calibration
        One model per plate. A recording is fitted once in a process, however often it is asked for.

    Raises
    ------
    ValueError, OSError
        If the file cannot be read or used, or is a calibration of otherwise corrected plates.

    Examples
    --------
    >>> import compensation, pipeline
    >>> felt = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = felt @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> setup = compensation.Setup(("rear",), rate_hz=1000.0, cutoff_hz=20.0)
    >>> fitted = Calibration({"plate 1": compensation.fit_inertia(felt, wrench, setup)})
    >>> _ = Path("lab.json").write_text(compensation.to_json(fitted))
    >>> rear = pipeline.Treadmill(accelerometers={"rear": ("Acc1.X", "Acc1.Y", "Acc1.Z")})
    >>> list(pipeline.read_calibration(Path("lab.json"), rear).plates)
    ['plate 1']
    """
    if path.suffix.lower() == ".json":
        try:
            calibration = from_json(read_text(path))
            _require_same_channels(calibration, treadmill)
            _require_same_delay(calibration, treadmill)
            _require_stated_model(calibration, treadmill)
            require_same_plates(calibration, plates)
        except ValueError as error:
            raise ValueError(f"{path.name}: {error}") from error
        return calibration
    channels = treadmill.model_dump_json(exclude={"platform"})
    files = path, *beside
    versions = tuple((file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    return _fitted(files, versions, channels, as_stated(stated), plates)


def _require_same_channels(calibration: Calibration, treadmill: Treadmill) -> None:
    """Refuse a channel stated as another axis or sensor than it was in the calibration."""
    try:
        known = _axis_of_channel(json.loads(calibration.provenance.get("channels", "{}")))
    except (AttributeError, TypeError, ValueError) as error:
        raise ValueError("the calibration's channels are damaged; fit it again") from error
    for channel, axis in _axis_of_channel(treadmill.accelerometers).items():
        if known.get(channel, axis) != axis:
            raise ValueError(
                f"the calibration was made with channel {channel!r} as {known[channel]}, "
                f"but treadmill.accelerometers has it as {axis}"
            )


def _require_same_delay(calibration: Calibration, treadmill: Treadmill) -> None:
    """Refuse a stated delay that is not the one with which the calibration was fitted."""
    stated = treadmill.accelerometer_delay_s
    for sensor in calibration.sensors:
        if stated is not None and abs(sensor.correction_s - stated) > SAME_DELAY_S:
            raise ValueError(
                f"the calibration was fitted with a delay of {1000 * sensor.correction_s:.2f} ms "
                f"of accelerometer {sensor.name}, but treadmill.accelerometer_delay_s is "
                f"{1000 * stated:.2f} ms; leave it out, or fit again"
            )


def _require_stated_model(calibration: Calibration, treadmill: Treadmill) -> None:
    """Refuse a stated model that is not the one of the calibration."""
    fitted, stated = "dynamic" if calibration.dynamic else "static", treadmill.inertia_model
    if stated not in ("auto", fitted):
        raise ValueError(
            f"the calibration is of a {fitted} model, but treadmill.inertia_model is {stated!r}; "
            f"leave it out, or fit it again with --model {stated}"
        )


def _axis_of_channel(sensors: Mapping[str, Sequence[str]]) -> dict[str, str]:
    return {
        channel: f"{axis} of {sensor}"
        for sensor, channels in sensors.items()
        for axis, channel in zip("xyz", channels, strict=True)
    }


@lru_cache(maxsize=2)
def _fitted(
    files: tuple[Path, ...],
    versions: tuple[tuple[int, int], ...],
    treadmill_json: str,
    stated: Stated,
    plates: PlateCorrection | None,
) -> Calibration:
    """Fit what every trial of a study needs; files of other ``versions`` are fitted anew."""
    path, *_ = files
    recording, *beside = (read_empty(file, stated, any_forward=plates is None) for file in files)
    treadmill = Treadmill.model_validate_json(treadmill_json)
    try:
        return fit_calibration(recording, treadmill, plates, beside)
    except ValueError as error:
        text = str(error)
        known = any(file.name in text for file in files)
        raise ValueError(text if known else f"{path.name}: {text}") from error


def read_empty(path: Path, stated: Stated, *, any_forward: bool = True) -> Recording:
    """Read a recording of the empty treadmill.

    Parameters
    ----------
    path
        The file, of any format that is read.
    stated
        How it is to be read; marker set and label prefix are those of a subject and do not count.
        Without axes, any directions are taken in which the plates lie level: nothing shows which
        way is forward, and a calibration in the plates' own axes does not need it.
    any_forward
        Whether that is so; a correction of its plates is in the lab's axes and does need it.

    Returns
    -------
    Recording
        The trial.

    Raises
    ------
    ValueError, OSError
        If the file cannot be read, or what is to be calibrated is subtracted from its plates.
    """
    read = _read_with_any_axes if any_forward else read_as_stated
    recording = read(path, replace(stated, marker_set=None, label_prefix=None))
    if recording.compensation is not None:
        raise ValueError(
            f"{path.name}: its plates are compensated, by {recording.compensation.software}; a "
            "calibration needs the original recording"
        )
    return recording


def _read_with_any_axes(path: Path, stated: Stated) -> Recording:
    try:
        return read_as_stated(path, stated)
    except ValueError as first:
        for axes in AXES_BY_VERTICAL if stated.axes is None else ():
            try:
                recording = read_as_stated(path, replace(stated, axes=axes))
            except ValueError:
                continue
            if all(abs(plate.rotation[2, 2]) > MIN_COSINE_LEVEL for plate in recording.plates):
                return recording
        raise first
