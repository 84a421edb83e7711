"""How heavily each plate is loaded, at the plates' own samples: what gait events are timed by."""

from dataclasses import dataclass, field

import numpy as np

from compensation import InertiaModel
from hbm.spatial import Array, read_only
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import at_times_of_plates
from pipeline.trial.ground.corrected_plates import plate_delays_s
from pipeline.trial.ground.laboratory import Laboratory, plate_models


@dataclass(frozen=True, slots=True)
class PlateLoad:
    """The load on one plate.

    Attributes
    ----------
    number
        The plate's number in the file.
    time
        Of its samples, on the markers' clock, (N,) [s].
    force
        Normal to its surface, on the subject, (N,) [N]; NaN where unknown.
    step_s
        Median time from one sample to the next.
    """

    number: int
    time: Array
    force: Array
    step_s: float = field(init=False)

    def __post_init__(self) -> None:
        for name in ("time", "force"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if self.time.shape != self.force.shape or self.time.ndim != 1:
            raise ValueError(
                f"plate {self.number}: force {self.force.shape} does not fit the times "
                f"{self.time.shape}"
            )
        object.__setattr__(self, "step_s", float(np.median(np.diff(self.time))))


def plate_loads(
    recording: Recording,
    laboratory: Laboratory,
    plate_delay_s: float | None,
    accelerations: tuple[Array, Array] | None,
) -> tuple[PlateLoad, ...]:
    """Give the load on every plate, without what the platform's motion adds where that is known.

    Parameters
    ----------
    recording
        The trial, its plates corrected.
    laboratory
        The treadmill with its calibration, if any.
    plate_delay_s
        How much later the plates are than the markers [s]; None as their calibration states it.
    accelerations
        Times (N,) [s] and low-passed readings (N, k) [m/s²] of the accelerometers, as
        `pipeline.trial.ground.wrenches.Ground` has them; None without a calibration.

    Returns
    -------
    tuple of PlateLoad
        The plates' samples stay unfiltered: a low-pass would begin contact early. The prediction
        that is subtracted from them is of accelerations that pass the calibration's low-pass.
        Accelerating belts add moments only.

    Raises
    ------
    ValueError
        If the calibration does not fit the trial.
    """
    plates, treadmill = recording.plates, laboratory.treadmill
    forces = [plate.wrench_in_plate[:, :3] @ plate.rotation[2] for plate in plates]
    if laboratory.calibration is not None and accelerations is not None:
        clock, readings = accelerations
        models = plate_models(recording, laboratory)
        times, sensors = [plate.time for plate in plates], laboratory.calibration.sensors
        felt = at_times_of_plates(clock, readings, times, treadmill, sensors, models[0].lags_s)
        forces = [
            force - _predicted(model, one, plate.rotation[2])
            for force, model, one, plate in zip(forces, models, felt, plates, strict=True)
        ]
    delays = plate_delays_s(plates, laboratory.plates, plate_delay_s)
    return tuple(
        PlateLoad(plate.number, plate.time - delay, force)
        for plate, delay, force in zip(plates, delays, forces, strict=True)
    )


def _predicted(model: InertiaModel, acceleration: Array, normal: Array) -> Array:
    """Predict the force along a direction of the plate, (N,); NaN where the acceleration is."""
    gain = model.gain[:, :3] @ normal
    return np.asarray(acceleration @ gain[:-1] + gain[-1])
