"""What markers do not determine, and by how much marker errors turn what they do."""

from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, N_Q, TREE
from hbm.ik.problem import POSTURE_PRECISION, covariance, marker_slopes, undetermined
from hbm.model import Body
from hbm.motion import Motion
from hbm.notes import Note
from hbm.spatial import Array, Indices

MAX_UNCERTAINTY_RAD: Final = np.radians(20.0)
"""An angle that marker errors of 10 mm turn by more is hardly observed."""
JUDGED_FRAMES: Final = 20
"""Frames in which that uncertainty is computed; it varies little over a trial."""
MIN_SHARE_NOTED: Final = 0.02
"""Share of the body's mass: both hands are 1.2 %, whose own motion hardly matters."""
ROTATES: Final = np.array([not c.translates for c in TREE])


def undetermined_notes(body: Body, motion: Motion) -> tuple[Note, ...]:
    """Name what a prior holds near neutral because the markers of a trial do not determine it.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it.

    Returns
    -------
    tuple of Note
        ``coordinates_locked``: those that no marker shows. ``coordinates_uncertain``: those that
        markers show, but more weakly than posture does. ``mass_not_shown``: the segments that
        therefore may be elsewhere, unless the body says so already.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> [note.code for note in undetermined_notes(body, hbm.solve_ik(body, static))]
    ['coordinates_locked']
    """
    if not motion.converged.any():
        return ()
    seen = np.flatnonzero(np.isfinite(motion.marker_error).any(axis=0))
    markers = [motion.markers[k] for k in seen]
    held, segments = undetermined(body, markers)
    observed = motion.observed.any(axis=0)
    locked = tuple(np.array(COORDINATES)[held & ~observed].tolist())
    weak = {
        COORDINATES[i]: np.degrees(POSTURE_PRECISION[i] ** -0.5)
        for i in np.flatnonzero(held & observed & ROTATES)
    }
    notes = [Note.of("coordinates_locked", coordinates=locked)] if locked else []
    if weak:
        notes.append(Note.of("coordinates_uncertain", deviation_deg=weak))
    return (*notes, *(n for n in mass_not_shown(body, segments) if n not in body.notes))


def mass_not_shown(body: Body, segments: tuple[str, ...]) -> tuple[Note, ...]:
    """Say what share of the body's mass these segments are, if it matters."""
    share = sum(body.segments[s].mass for s in segments) / body.mass
    noted = share >= MIN_SHARE_NOTED
    return (Note.of("mass_not_shown", segments=segments, share=share),) if noted else ()


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
    result = np.full((len(frames), N_Q), np.inf)
    for row, frame in enumerate(frames):
        visible = np.isfinite(motion.marker_error[frame]).astype(float)
        free = np.flatnonzero(motion.observed[frame])
        slope = marker_slopes(body, motion.q[frame])[free][:, own]
        result[row, free] = np.sqrt(np.diag(covariance(slope, visible)))
    return result
