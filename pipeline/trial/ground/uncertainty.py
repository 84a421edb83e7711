"""How uncertain compensated wrenches are, in the lab, about any point.

It is that of the compensation alone: noise of plates and accelerometers, what the calibration's
model does not explain of motion and belt speed like the trial's, the uncertainty of its gains, and
the zero of the plates. Body, markers, the platform's pose and accelerating belts are not in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation import Calibration, InertiaModel, PlatformPose
from compensation.inertia.model_error import RUNNING_MPS, SLOW_HZ
from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.io.recording import Plate
from pipeline.trial.ground.calibration_recording import BELTS_UNKNOWN

FORCE: Final = slice(0, 3)
MOMENT: Final = slice(3, 6)
MAX_FASTER: Final = 1.05
"""Factor by which belts may run faster than in the calibration: their vibration then has 1.2 times
the variance that is expected."""


@dataclass(frozen=True, slots=True)
class Spread:
    """One standard deviation of a plate's compensated wrench, due to the compensation alone.

    Attributes
    ----------
    sd
        Of its components without the plate's zero, in the plate's axes about its centre, (T, 6)
        [N, N·m]; NaN where the acceleration is unknown.
    zero
        Of its zero, the same in all frames, (6,) [N, N·m].
    rotation, center
        Orientation and place of the plate in the lab, (T, 3, 3) and (T, 3) [m], or (1, 3, 3) and
        (1, 3) where it stands still.
    """

    sd: Array
    zero: Array
    rotation: Array
    center: Array

    def to_lab(self, point: Array) -> Array:
        """Give what brings wrenches of the plate to the lab, about a point there, (T, 6, 6).

        The point is (T, 3) or (3,) [m]; every entry of the result is in one piece of memory.
        """
        return _change(self.rotation, self.center - point)


def wrench_spread(
    model: InertiaModel,
    acceleration: Array,
    plate: Plate,
    pose: PlatformPose | None,
    cutoff_hz: float,
    rate_hz: float,
    belts_mps: Array | None = None,
) -> Spread:
    """Give what the compensation of a plate makes uncertain.

    Parameters
    ----------
    model
        Of the plate.
    acceleration
        What the accelerometers felt at the frames, (T, k) [m/s²]; NaN where unknown.
    plate
        The plate.
    pose
        The platform's pose at the frames; None where it stands still.
    cutoff_hz
        Of the filter that the wrench passes next: up to 6 Hz, the noise is that below 6 Hz, else
        all that passed the calibration's filter, which is more than what is left [Hz].
    rate_hz
        Of the frames [Hz].
    belts_mps
        Speed of the belts at the frames, (T,) [m/s]; None where it is unknown.

    Returns
    -------
    Spread
        At the frames.
    """
    slow = cutoff_hz <= SLOW_HZ
    return Spread(
        sd=model.uncertainty(acceleration, slow, rate_hz, zero=False, belts_mps=belts_mps),
        zero=np.zeros(6) if model.model_error is None else model.model_error.zero,
        rotation=plate.rotation[None] if pose is None else pose.rotation @ plate.rotation,
        center=plate.center[None] if pose is None else pose.to_lab(plate.center),
    )


def sum_deviation(spreads: Sequence[Spread], correlation: Array, point: Array) -> Array:
    """Give one standard deviation of the sum of some plates' wrenches.

    Parameters
    ----------
    spreads
        Of each plate.
    correlation
        Between all of their components but the zeros, which are independent, (6 P, 6 P).
    point
        About which moments are wanted, in the lab, (T, 3) or (3,) [m].

    Returns
    -------
    Array
        In lab axes, (T, 6) [N, N·m]; NaN where an acceleration or the pose is unknown, moments also
        where the point is.
    """
    changes = [np.moveaxis(spread.to_lab(point), 0, -1) for spread in spreads]
    variance = np.empty((6, len(spreads[0].sd)))
    for row, of_row in enumerate(variance):
        both = [(change[row], spread) for change, spread in zip(changes, spreads, strict=True)]
        moving = np.concatenate([factors * spread.sd.T for factors, spread in both])
        of_row[:] = (moving * (correlation @ moving)).sum(axis=0)
        of_row += sum(spread.zero**2 @ factors**2 for factors, spread in both)
    return np.sqrt(variance).T


def belt_speed_notes(speed: float | None, calibration: Calibration) -> tuple[Note, ...]:
    """Say where a calibration does not know what belts as fast as a trial's leave; one at most.

    The speed [m/s] is that of `mean_belt_speed`. Models of earlier versions, which know of noise
    alone, do not count.
    """
    models, made = calibration.in_use.values(), calibration.provenance
    known = [m.model_error.fastest_mps for m in models if m.model_error is not None]
    speeds = [each for each in known if each is not None]
    if len(speeds) < len(known):
        recordings = made.get(BELTS_UNKNOWN, made.get("recording", "its recording"))
        return (Note.of("uncertainty_calibration_belts_unknown", recordings=recordings),)
    if not speeds:
        return ()
    calibrated = min(speeds)
    if speed is None:
        return (Note.of("uncertainty_belts_unknown", calibrated_mps=calibrated),)
    if speed <= max(MAX_FASTER * calibrated, RUNNING_MPS):
        return ()
    return (Note.of("uncertainty_belts_faster", speed_mps=speed, calibrated_mps=calibrated),)


def uncertainty_notes(residual_sd: Array) -> tuple[Note, ...]:
    """Say how uncertain residuals are due to the compensation, (T, 6); nothing for no frames."""
    if not len(residual_sd):
        return ()
    rms = dict(zip(WRENCH_COMPONENTS, np.sqrt(np.mean(residual_sd**2, axis=0)), strict=True))
    force, moment = ({c: rms[c] for c in WRENCH_COMPONENTS[part]} for part in (FORCE, MOMENT))
    return (Note.of("compensation_uncertainty", force_n=force, moment_nm=moment),)


def _change(rotation: Array, point: Array) -> Array:
    """Give what brings wrenches to other axes and another point of reference, (T, 6, 6).

    Every entry is in one piece of memory.
    """
    rows, p = np.moveaxis(rotation, 0, -1), point.T
    change = np.zeros((6, 6, max(len(rotation), len(point))))
    change[:3, :3] = change[3:, 3:] = rows
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        change[3 + i, :3] = p[j] * rows[k] - p[k] * rows[j]
    return np.moveaxis(change, -1, 0)
