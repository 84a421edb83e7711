"""A laboratory's treadmill: as stated, with its calibration."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from compensation import BeltModel, Calibration, InertiaModel
from hbm.notes import Note
from hbm.signals.filtering import Method
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Platform, Settings, Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.calibration_file import read_calibration, require_same_plates
from pipeline.trial.ground.empty_plates import FILTER, setup_of


@dataclass(frozen=True, slots=True)
class Laboratory:
    """The treadmill as stated, its calibration and its plates' belt models where there are any.

    Attributes
    ----------
    treadmill
        As stated.
    calibration
        Of the moving platform.
    belts
        One model per plate.
    plates
        The correction of its plates, by which those of the calibration were corrected too.
    notes
        What a recording of another day says about the calibration.

    Examples
    --------
    >>> still = Laboratory(Treadmill())
    >>> moving = Laboratory(Treadmill(platform=Platform(markers=("PLAT1", "PLAT2", "PLAT3"))))
    >>> moving.calibration is still.calibration is None
    True
    """

    treadmill: Treadmill
    calibration: Calibration | None = None
    belts: tuple[BeltModel, ...] = ()
    plates: PlateCorrection | None = None
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        if self.calibration is not None:
            require_same_plates(self.calibration, self.plates)

    def filters(self, settings: Settings) -> tuple[tuple[Method, float], ...]:
        """Give method and cut-off [Hz] of every low-pass between a recording and its residuals."""
        found = [(settings.filter, settings.cutoff_hz)]
        if self.calibration is not None:
            found.append((FILTER, self.treadmill.cutoff_hz))
        if self.treadmill.belt is not None:
            found.append((FILTER, self.treadmill.belt.cutoff_hz))
        return tuple(found)


def plate_models(recording: Recording, laboratory: Laboratory) -> list[InertiaModel]:
    """Give the inertia model that compensates each plate of a trial.

    Parameters
    ----------
    recording
        The trial.
    laboratory
        The treadmill and its calibration.

    Returns
    -------
    list of InertiaModel
        In order of the plates; empty without a calibration.

    Raises
    ------
    ValueError
        If the calibration was made for other plates, sensors, rates or units.
    """
    if laboratory.calibration is None:
        return []
    known, name = laboratory.calibration.in_use, recording.source.name
    wanted = [f"plate {plate.number}" for plate in recording.plates]
    if unknown := [plate for plate in wanted if plate not in known]:
        raise ValueError(f"{name}: the calibration has no {unknown[0]}; it has {', '.join(known)}")
    _require_same_channels(recording, laboratory)
    setup = setup_of(recording, laboratory.treadmill)
    for plate in wanted:
        try:
            known[plate].require(setup)
        except ValueError as error:
            raise ValueError(f"{name}: {plate}: {error}") from error
    return [known[plate] for plate in wanted]


def _require_same_channels(recording: Recording, laboratory: Laboratory) -> None:
    """Refuse other channels than the calibration's where the recording has those."""
    assert laboratory.calibration is not None
    fitted = json.loads(laboratory.calibration.provenance.get("channels", "{}"))
    present = recording.analog.names if recording.analog is not None else ()
    for sensor, channels in laboratory.treadmill.accelerometers.items():
        then = tuple(fitted.get(sensor, channels))
        if then != channels and set(then) <= set(present):
            raise ValueError(
                f"{recording.source.name}: accelerometer {sensor} was {', '.join(then)} in the "
                f"calibration, which this recording has too, but {', '.join(channels)} is stated; "
                "recording and calibration need the same channels"
            )


def require_uncompensated(recording: Recording, laboratory: Laboratory) -> None:
    """Refuse to subtract a second time what is already subtracted from a file's plates.

    Parameters
    ----------
    recording
        The trial.
    laboratory
        The treadmill and its calibrations.

    Raises
    ------
    ValueError
        If the file's plates are compensated and the laboratory has a calibration, or if they are in
        the lab and the laboratory has a moving platform.
    """
    done, file = recording.compensation, recording.source.name
    if done is None:
        return
    if laboratory.calibration is not None or laboratory.treadmill.belt is not None:
        raise ValueError(
            f"{file}: its plates are compensated already, by {done.software}; leave the "
            "calibration out, or give the original recording"
        )
    if done.frame != "recorded" and laboratory.treadmill.platform is not None:
        raise ValueError(
            f"{file}: {done.software} has brought its plates to the lab (--frame {done.frame}); "
            "leave the platform's markers or channels out, or give the original recording"
        )


def read_laboratory(
    file: Path,
    platform_markers: tuple[str, ...],
    accelerometers: Mapping[str, tuple[str, str, str]] | None = None,
    plates: PlateCorrection | None = None,
) -> Laboratory:
    """Give the laboratory that a calibration file describes.

    Parameters
    ----------
    file
        JSON that `fit` wrote.
    platform_markers
        Markers on the platform; none for a treadmill that stands still.
    accelerometers
        Sensor -> its channels in the trials, where these are called otherwise than in the
        calibration; by default as the calibration names them.
    plates
        The correction of its plates.

    Returns
    -------
    Laboratory
        With the accelerometers' channels.

    Raises
    ------
    ValueError
        If the file is not such a calibration, or is one of otherwise corrected plates.
    """
    if file.suffix.lower() != ".json":
        raise ValueError(
            f"{file.name}: --calibration takes a fitted calibration; make one with "
            f"'hbm calibration fit {file.name} -o lab.json'"
        )
    calibration = read_calibration(file, Treadmill(), plates=plates)
    try:
        channels = json.loads(calibration.provenance["channels"])
    except (KeyError, ValueError) as error:
        raise ValueError(
            f"{file.name}: the calibration does not name its channels; fit it again with "
            "'hbm calibration fit'"
        ) from error
    if accelerometers and set(accelerometers) != set(channels):
        raise ValueError(
            f"{file.name}: the calibration has the accelerometers {', '.join(channels)}, "
            f"--accelerometer names {', '.join(accelerometers)}; name all of them and no others"
        )
    cutoff_hz = next(iter(calibration.plates.values())).setup.cutoff_hz  # type: ignore[union-attr]
    platform = Platform(markers=platform_markers) if platform_markers else None
    treadmill = Treadmill(
        accelerometers={s: (accelerometers or channels)[s] for s in channels},
        accelerometer_unit=calibration.provenance.get("accelerometer_unit") or None,
        cutoff_hz=cutoff_hz or 20.0,
        platform=platform,
    )
    return Laboratory(treadmill, calibration, plates=plates)
