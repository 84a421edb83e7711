"""Legs that reach their feet: the pelvis and the soles are given, the joints follow."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.body import Body
from hbm.coordinates import INDEX, N_Q, SEGMENTS
from hbm.kernels.native import kernels
from hbm.kernels.skeleton import N_SUMS
from hbm.spatial import Array
from pipeline.virtual_lab.person.sole import Sole

CHUNK: Final = 4000
FIXED: Final = 1e3
PULL: Final = {  # towards the reference, m²/rad² per unit weight of a sole's points
    "HipFlexion": 3e-4,
    "HipAbduction": 3e-4,
    "HipInternalRotation": 1e-3,
    "KneeFlexion": 1e-3,  # firm, for a leg that is nearly straight bends by jerks
    "AnklePlantarFlexion": 1e-4,
    "FootPronation": 1e-4,
}
DAMPING: Final = 1e-6
LONGEST_STEP: Final = 0.2
TOLERANCE: Final = 1e-5
MAX_ITERATIONS: Final = 12


def reach(
    body: Body,
    reference: Array,
    soles: Mapping[str, Sole],
    rotation: Mapping[str, Array],
    position: Mapping[str, Array],
    firmness: Mapping[str, Array],
    start: Array,
    height_pull: float,
    jobs: int = 1,
) -> Array:
    """Bend the legs so that the soles are where they should be.

    Parameters
    ----------
    body
        The person's body.
    reference
        Wanted coordinates, (T, 46); pelvis, trunk, head and arms are kept, the legs' are
        approached where the feet leave a choice or cannot be reached.
    soles
        Side -> sole.
    rotation, position
        Side -> pose of the sole in the lab, (T, 3, 3) and (T, 3) [m].
    firmness
        Side -> weights of the sole's heel, ball inside and outside, and ankle, (T, 4).
    start
        Where to begin, (T, 46).
    height_pull
        How firmly the pelvis is kept at its height: m² per m² of the soles' points.
    jobs
        Threads.

    Returns
    -------
    Array
        Coordinates, (T, 46).

    Notes
    -----
    Least squares over four points of each sole by Gauss–Newton, with the inverse kinematics'
    kernel.
    """
    pull = np.full(N_Q, FIXED)
    pull[INDEX["PelvisZ"]] = height_pull
    for name, value in PULL.items():
        for side in "RL":
            pull[INDEX[side + name]] = value
    parts = [
        _reach(
            body,
            reference[part],
            {s: (soles[s], rotation[s][part], position[s][part], firmness[s][part]) for s in soles},
            start[part],
            pull,
            jobs,
        )
        for part in (slice(k, k + CHUNK) for k in range(0, len(reference), CHUNK))
    ]
    return np.concatenate(parts)


def _reach(
    body: Body,
    reference: Array,
    targets: Mapping[str, tuple[Sole, Array, Array, Array]],
    start: Array,
    pull: Array,
    jobs: int,
) -> Array:
    frames = len(reference)
    sums = np.zeros((frames, len(SEGMENTS), N_SUMS))
    for sole, rotation, position, weight in targets.values():
        R, o = sole.foot_pose(rotation, position)
        flat = np.array(
            [[sole.heel, 0, 0], [sole.ball, 0.04, 0], [sole.ball, -0.04, 0], [0, 0, 0.08]]
        )
        p = (flat - sole.origin) @ sole.rotation
        m = np.einsum("tij,kj->tki", R, p) + o[:, None]
        own = sums[:, SEGMENTS.index(sole.segment)]
        (x, y, z), ones = p.T, np.ones(len(p))
        plain = np.stack([ones, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], axis=1)
        weighted = weight[:, :, None] * m
        own[:, :10] = weight @ plain
        own[:, 10:13] = weighted.sum(axis=1)
        own[:, 13:22] = np.einsum("tki,ka->tai", weighted, p).reshape(frames, 9)
        own[:, 22] = np.sum(weighted * m, axis=(1, 2))
    flat_sums = sums.reshape(frames, -1)
    prior = np.tile(pull, (frames, 1))
    damping, curvature = np.full((frames, 1), DAMPING), np.zeros((frames, 1))
    q = start.copy()
    for _ in range(MAX_ITERATIONS):
        step, _ = kernels().newton_step(
            q, flat_sums, prior, reference, damping, curvature, body.geometry, jobs=jobs
        )
        q += np.clip(step, -LONGEST_STEP, LONGEST_STEP)
        if np.abs(step).max() < TOLERANCE:
            break
    return q
