"""Where the whole body's centre of mass is."""

import numpy as np

from hbm.coordinates import MOVING, SEGMENTS
from hbm.model import Body
from hbm.native import kernels
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
    poses = kernels().segment_poses(q, body.geometry, jobs=jobs)[0]
    poses = poses.reshape(len(q), len(SEGMENTS), 4, 3)[:, [SEGMENTS.index(s) for s in MOVING]]
    parts = [body.inertias[s] for s in MOVING]
    mass = np.array([part.mass for part in parts])
    local = np.array([[*part.center, 1.0] for part in parts])
    return np.asarray(np.einsum("tsai,sa,s->ti", poses, local, mass) / mass.sum())
