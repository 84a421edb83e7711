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
from hbm.spatial import WRENCH_COMPONENTS, Array, transform_wrench
from pipeline.io.recording import Plate
from pipeline.trial.ground.calibration_recording import BELTS_UNKNOWN, BESIDE

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


def wrench_spread(
    model: InertiaModel,
    acceleration: Array,
    plate: Plate,
    pose: PlatformPose | None,
    cutoff_hz: float,
    rate_hz: float,
    belts_mps: Array | None = None,
) -> Spread:
    """Give what the compensation of a plate makes uncertain at the frames.

    From what its accelerometers felt, (T, k) [m/s²], and the speed of the belts, (T,) [m/s] or None
    where it is unknown. `cutoff_hz` is that of the filter that the wrench passes next: up to 6 Hz,
    the noise is that below 6 Hz, else all that passed the calibration's filter, which is more than
    what is left.
    """
    slow = cutoff_hz <= SLOW_HZ
    return Spread(
        sd=model.uncertainty(acceleration, slow, rate_hz, zero=False, belts_mps=belts_mps),
        zero=np.zeros(6) if model.model_error is None else model.model_error.zero,
        rotation=plate.rotation[None] if pose is None else pose.rotation @ plate.rotation,
        center=plate.center[None] if pose is None else pose.to_lab(plate.center),
    )


def sum_deviation(spreads: Sequence[Spread], correlation: Array, point: Array) -> Array:
    """Give one standard deviation of the sum of some plates' wrenches, in lab axes, (T, 6).

    The correlation is between all of their components but the zeros, which are independent,
    (6 P, 6 P); moments are about a point in the lab, (T, 3) or (3,) [m]. NaN where an acceleration,
    the pose or the point is unknown.
    """
    changes = [
        transform_wrench(np.eye(6), s.rotation[:, None], (s.center - point)[:, None]).T
        for s in spreads
    ]
    variance = np.empty((6, len(spreads[0].sd)))
    for row, of_row in enumerate(variance):
        both = [(change[row], spread) for change, spread in zip(changes, spreads, strict=True)]
        moving = np.concatenate([factors * spread.sd.T for factors, spread in both])
        of_row[:] = (moving * (correlation @ moving)).sum(axis=0)
        of_row += sum(spread.zero**2 @ factors**2 for factors, spread in both)
    return np.sqrt(variance).T


def uncertainty_limits(speed: float | None, calibration: Calibration) -> tuple[Note, ...]:
    """Say where a calibration does not know what people, or belts as fast as a trial's, leave.

    The speed [m/s] is that of `mean_belt_speed`. Models of earlier versions, which know of noise
    alone, do not count.
    """
    models, made = calibration.in_use.values(), calibration.provenance
    known = [m.model_error.fastest_mps for m in models if m.model_error is not None]
    if not known:
        return ()
    speeds, left_out = [each for each in known if each is not None], []
    if BESIDE not in made:
        left_out.append("what people shake (no recording of people beside an empty plate)")
    if len(speeds) < len(known):
        recordings = made.get(BELTS_UNKNOWN, made.get("recording", "its recording"))
        left_out.append(f"belts faster than in {recordings}, whose speed is unknown")
    elif speed is None:
        left_out.append(f"belts faster than {min(speeds):.3g} m/s (no channel with their speed)")
    if calibration.correlation is None and len(calibration.plates) > 1:
        left_out.append("how the plates' errors go together (they were sampled at other times)")
    notes = [Note.of("uncertainty_limited", left_out=left_out)] if left_out else []
    fastest = min(speeds, default=np.inf)
    if speed is not None and speed > max(MAX_FASTER * fastest, RUNNING_MPS):
        values = {"speed_mps": speed, "calibrated_mps": fastest}
        notes.append(Note.of("uncertainty_belts_faster", **values))
    return tuple(notes)


def uncertainty_notes(residual_sd: Array) -> tuple[Note, ...]:
    """Say how uncertain residuals are due to the compensation, (T, 6); nothing for no frames."""
    if not len(residual_sd):
        return ()
    rms = dict(zip(WRENCH_COMPONENTS, np.sqrt(np.mean(residual_sd**2, axis=0)), strict=True))
    force, moment = ({c: rms[c] for c in WRENCH_COMPONENTS[part]} for part in (FORCE, MOMENT))
    return (Note.of("compensation_uncertainty", force_n=force, moment_nm=moment),)
