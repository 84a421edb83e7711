"""How uncertain compensated wrenches are, in the lab, about any point.

It is that of the compensation alone: noise of plates and accelerometers as left over in the
calibration, and the uncertainty of its gains at the trial's accelerations. What the linear model
lacks is not in it, nor are body, markers and belts: it is named "without model error".
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from compensation import InertiaModel, PlatformPose
from compensation.inertia.model import SLOW_HZ
from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.io.recording import Plate

FORCE: Final = slice(0, 3)
MOMENT: Final = slice(3, 6)


def wrench_spread(
    model: InertiaModel,
    acceleration: Array,
    plate: Plate,
    pose: PlatformPose | None,
    cutoff_hz: float,
) -> Array:
    """Give what one standard deviation of each component of a plate is in the lab.

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

    Returns
    -------
    Array
        One column per component of the plate's compensated wrench, in lab axes about the lab
        origin, (T, 6, 6) [N, N·m]; NaN where the acceleration or the pose is unknown.
    """
    known = np.isfinite(acceleration).all(axis=1)
    sd = np.full((len(acceleration), 6), np.nan)
    if known.any():
        sd[known] = model.uncertainty(acceleration[known], slow=cutoff_hz <= SLOW_HZ)
    rotation = plate.rotation[None] if pose is None else pose.rotation @ plate.rotation
    center = plate.center[None] if pose is None else pose.to_lab(plate.center)
    return np.asarray(_change(rotation, center) * sd[:, None, :])


def sum_covariance(spreads: Sequence[Array], correlation: Array) -> Array:
    """Give the covariance of the sum of some plates' wrenches.

    Parameters
    ----------
    spreads
        Of each plate, as `wrench_spread` gives them, (T, 6, 6).
    correlation
        Between all of their components, (6 P, 6 P).

    Returns
    -------
    Array
        In lab axes about the lab origin, (T, 6, 6) [N², N²·m, N²·m²].
    """
    all_plates = np.concatenate(spreads, axis=2)
    return np.asarray(all_plates @ correlation @ np.swapaxes(all_plates, 1, 2))


def moved(covariance: Array, rotation: Array, point: Array) -> Array:
    """Bring covariances of wrenches to other axes and another point of reference.

    Parameters
    ----------
    covariance
        (T, 6, 6).
    rotation
        From the old axes to the new ones, (T, 3, 3) or (1, 3, 3).
    point
        The old point of reference from the new one, in the new axes, (T, 3) or (1, 3) [m].

    Returns
    -------
    Array
        (T, 6, 6).
    """
    change = _change(rotation, point)
    return np.asarray(change @ covariance @ np.swapaxes(change, 1, 2))


def standard_deviation(covariance: Array, point: Array) -> Array:
    """Give one standard deviation of a wrench about a point.

    Parameters
    ----------
    covariance
        Of the wrench in lab axes about the lab origin, (T, 6, 6).
    point
        In the lab, (T, 3) or (1, 3) [m].

    Returns
    -------
    Array
        (T, 6) [N, N·m].
    """
    there = moved(covariance, np.eye(3)[None], -point)
    return np.asarray(np.sqrt(np.diagonal(there, axis1=1, axis2=2)))


def uncertainty_notes(residual_sd: Array) -> tuple[Note, ...]:
    """Say how uncertain residuals are due to the compensation, (T, 6); nothing for no frames."""
    if not len(residual_sd):
        return ()
    rms = dict(zip(WRENCH_COMPONENTS, np.sqrt(np.mean(residual_sd**2, axis=0)), strict=True))
    force, moment = ({c: rms[c] for c in WRENCH_COMPONENTS[part]} for part in (FORCE, MOMENT))
    return (Note.of("compensation_uncertainty", force_n=force, moment_nm=moment),)


def _change(rotation: Array, point: Array) -> Array:
    """Give what brings wrenches to other axes and another point of reference, (T, 6, 6)."""
    change = np.zeros((max(len(rotation), len(point)), 6, 6))
    change[:, :3, :3] = change[:, 3:, 3:] = rotation
    change[:, 3:, :3] = np.cross(point[:, :, None], rotation, axis=1)
    return change
