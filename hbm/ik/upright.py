"""How a trunk stands that no marker shows: upright in the lab, not in line with the pelvis.

While people walk, the pelvis tilts, rolls and turns under a trunk that stays upright. Marked trunks
lean and bend by 1° about their mean, and twist by 3° about the slow heading (SD, seven walks).
"""

from typing import Final

import numpy as np
import scipy

from hbm.coordinates import BACK, FIRST_Q, INDEX, LAST_Q, LEFT, UP
from hbm.ik.start import three_angles
from hbm.spatial import Array, rotation_about

TRUNK: Final = slice(FIRST_Q["thorax"], LAST_Q["thorax"] + 1)
"""Its coordinates."""
YAW, PITCH, ROLL = (INDEX[f"Pelvis{name}"] for name in ("Yaw", "ForwardPitch", "RightRoll"))
HEADING_CUTOFF_HZ: Final = 0.5
"""The trunk faces where the pelvis faces below it: strides, at about 1 Hz, turn the pelvis only."""
HEADING_SD_S: Final = float(np.sqrt(np.log(2) / 2) / np.pi / HEADING_CUTOFF_HZ)
"""Width of the Gaussian that halves an oscillation of that frequency."""


def slow_heading(time: Array, yaw: Array) -> Array:
    """Give the heading of a trunk, (T,) [rad], from the yaw of the pelvis, NaN where unknown.

    The line through all samples is kept, so that somebody who turns has no lag at the ends.
    """
    finite = np.isfinite(yaw)
    if np.count_nonzero(finite) < 2:
        return yaw
    unwrapped = np.interp(time, time[finite], np.unwrap(yaw[finite]))
    # a turn is mostly its line; of what is left, little is lost where the filter ends
    line = np.polyval(np.polyfit(time - time[0], unwrapped, 1), time - time[0])
    # standard deviation of the Gaussian in samples
    width = HEADING_SD_S * (len(time) - 1) / (time[-1] - time[0])
    return np.where(finite, line + scipy.ndimage.gaussian_filter1d(unwrapped - line, width), np.nan)


def upright_trunk(q: Array, heading: Array) -> Array:
    """Give the trunk's angles, (F, 3) [rad], with which it stands upright in the lab.

    ``q`` are coordinates of whole poses, (F, 46), ``heading`` where the trunk faces, (F,) [rad].
    """
    # pelvis in the lab = yaw · pitch · roll, so trunk in the pelvis = roll⁻¹ · pitch⁻¹ · turn
    roll, pitch = rotation_about(BACK, q[:, ROLL]), rotation_about(-np.array(LEFT), q[:, PITCH])
    turn = rotation_about(UP, heading - q[:, YAW])
    return three_angles(roll @ pitch @ turn, TRUNK.start)


def standing_trunk(time: Array, q: Array) -> Array:
    """Give the angles of an upright trunk, (F, 3) [rad], from all poses of a trial, (F, 46)."""
    return upright_trunk(q, slow_heading(time, q[:, YAW]))
