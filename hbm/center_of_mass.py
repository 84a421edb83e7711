"""Centre of mass of the whole body."""

import numpy as np

from hbm.coordinates import SEGMENTS, SEGMENTS_WITH_MASS
from hbm.model import Body
from hbm.poses import segment_frames
from hbm.spatial import Array


def center_of_mass(body: Body, q: Array, *, jobs: int = 1) -> Array:
    """Find the centre of mass of the whole body.

    Parameters
    ----------
    body
        The subject.
    q
        Coordinates, (T, 46) [m and rad].
    jobs
        Threads.

    Returns
    -------
    Array
        Positions in the lab, (T, 3) [m].
    """
    with_mass = [SEGMENTS.index(segment) for segment in SEGMENTS_WITH_MASS]
    rotation, origin = (frames[:, with_mass] for frames in segment_frames(body, q, jobs=jobs))
    parts = [body.inertias[segment] for segment in SEGMENTS_WITH_MASS]
    local = np.array([part.center for part in parts])
    centers = origin + np.einsum("tsij,sj->tsi", rotation, local)
    return np.asarray(np.average(centers, axis=1, weights=[part.mass for part in parts]))
