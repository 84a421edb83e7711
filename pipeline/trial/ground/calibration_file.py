"""The calibration of a moving treadmill as a study names it: a fitted one, or a recording."""

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

from compensation import Calibration, from_json
from pipeline.config.plate_correction import SAME_DELAY_S, PlateCorrection
from pipeline.config.schema import Treadmill
from pipeline.io.input_file import last_written, read_text
from pipeline.io.stated import Stated, as_stated
from pipeline.trial.ground.calibration_recording import (
    PLATES_NAME,
    PLATES_SHA256,
    fit_calibration,
)
from pipeline.trial.ground.empty_plates import read_empty


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
    >>> import numpy as np
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
    versions = tuple(map(last_written, files))
    return _fitted(files, versions, channels, as_stated(stated), plates)


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
