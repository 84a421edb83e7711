"""What compensation subtracts from the plates of a trial, and by which models."""

from dataclasses import dataclass

import numpy as np

from compensation import BeltModel, InertiaModel, Sensor
from hbm.spatial import Array
from pipeline.trial.ground.laboratory import BoundLaboratory
from pipeline.trial.ground.wrenches import Ground


@dataclass(frozen=True, slots=True, eq=False)
class Subtracted:
    """What platform and belts add to the plates of a trial, as it was predicted and subtracted.

    Attributes
    ----------
    models
        Inertia model of each plate; empty without a calibration of the platform, as the next three.
    felt
        Per plate what its model takes of the accelerometers, T frames, (T, K) [m/s²].
    sensors
        The accelerometers as the calibration found them.
    correlation
        Between the components of all plates of what the models leave, (6 P, 6 P).
    belt_models
        Belt model of each plate; empty without a calibration of the belts, as `belts`.
    belts
        Per plate the wrench of its accelerating belt in its own axes, (T, 6) [N, N·m].
    """

    models: tuple[InertiaModel, ...]
    felt: tuple[Array, ...]
    sensors: tuple[Sensor, ...]
    correlation: Array
    belt_models: tuple[BeltModel, ...]
    belts: tuple[Array, ...]

    @property
    def sensors_apart_s(self) -> float:
        """By how much the accelerometers' delays differ, one standard deviation [s].

        Accelerometers on one converter are equally late: where a platform bends, the calibration
        takes bending for delay.
        """
        delays = [sensor.correction_s for sensor in self.sensors]
        return float(np.std(delays, ddof=1)) if len(delays) > 1 else 0.0


def subtracted_from(lab: BoundLaboratory, ground: Ground, frames: slice) -> Subtracted | None:
    """Give what was subtracted from the plates at some frames of a trial; None if nothing was."""
    if not (ground.felt or ground.belts):
        return None
    return Subtracted(
        models=lab.models,
        felt=tuple(each[frames] for each in ground.felt),
        sensors=lab.sensors,
        correlation=lab.correlation,
        belt_models=lab.laboratory.belts,
        belts=tuple(each[frames] for each in ground.belts),
    )
