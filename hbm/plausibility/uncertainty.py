"""Coordinates that markers hardly show: by how much marker errors turn them."""

from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, N_Q, TREE
from hbm.model import Body
from hbm.motion import Motion
from hbm.notes import Note
from hbm.poses import marker_positions
from hbm.spatial import Array, Indices, Mask

MARKER_ERROR_M: Final = 0.01
"""Error of a marker on its segment, from skin and from the calibration pose."""
MAX_UNCERTAINTY_RAD: Final = np.radians(20.0)
"""An angle that such errors of the markers turn by more is hardly observed."""
JUDGED_FRAMES: Final = 20
"""Frames in which that uncertainty is computed; it varies little over a trial."""
STEP: Final = 1e-6
"""Of each coordinate, for the slopes of the markers' positions [rad or m]."""
ROTATES: Final = np.array([not c.translates for c in TREE])


def uncertain_coordinates(body: Body, motion: Motion) -> tuple[Note, ...]:
    """Name the angles that markers hardly show.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it.

    Returns
    -------
    tuple of Note
        One ``coordinates_uncertain``: the angles that marker errors of 10 mm turn by more than 20°
        (standard deviation, median over up to 20 frames in which they are observed).

    Notes
    -----
    Such angles are not held: the solution is the least-squares optimum, and of poses that fit the
    markers equally well the one nearest to neutral. What they describe hardly moves any mass, or
    markers would show it.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> uncertain_coordinates(body, hbm.solve_ik(body, static))
    ()
    """
    uncertain: dict[str, float] = {}
    some = spread_over(np.flatnonzero(motion.converged))
    if not len(some):
        return ()
    deviation = np.where(motion.observed[some], angle_uncertainty(body, motion, some), np.nan)
    for i in np.flatnonzero(ROTATES & motion.observed[some].any(axis=0)):
        typical = float(np.nanmedian(deviation[:, i]))
        if typical > MAX_UNCERTAINTY_RAD:
            uncertain[COORDINATES[i]] = np.degrees(typical)
    return (Note.of("coordinates_uncertain", deviation_deg=uncertain),) if uncertain else ()


def spread_over(frames: Indices) -> Indices:
    """Give up to 20 frames of some, evenly spaced."""
    rows = np.unique(np.linspace(0, len(frames) - 1, JUDGED_FRAMES).astype(int))
    return np.asarray(frames[rows] if len(frames) else frames)


def angle_uncertainty(body: Body, motion: Motion, frames: Indices) -> Array:
    """Give by how much marker errors change each coordinate in some frames.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it.
    frames
        Frame numbers, (F,).

    Returns
    -------
    Array
        Standard deviations of a least-squares fit to the markers that are visible, by the slopes
        of the markers' positions, (F, 46) [rad or m]; half a turn at most, and infinite for
        coordinates that are not observed.
    """
    own = [body.markers.index(name) for name in motion.markers]
    step = STEP * np.eye(N_Q)
    result = np.full((len(frames), N_Q), np.inf)
    for row, frame in enumerate(frames):
        visible: Mask = np.isfinite(motion.marker_error[frame])
        free = np.flatnonzero(motion.observed[frame])
        moved = marker_positions(
            body, np.concatenate([motion.q[frame] + step, motion.q[frame] - step])
        )
        slope = (moved[:N_Q] - moved[N_Q:])[:, own][free][:, visible] / (2 * STEP)
        slope = slope.reshape(len(free), -1) / MARKER_ERROR_M
        information = slope @ slope.T + np.eye(len(free)) / np.pi**2
        result[row, free] = np.sqrt(np.diag(np.linalg.inv(information)))
    return result
