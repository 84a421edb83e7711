"""What a crop of a recording does to the gait cycles that are left."""

import numpy as np

LIMIT = np.array([1, 1, 1, 0.5, 0.5, 0.5])
"""Of a change that counts as none [N, N·m]."""


def cycle_change(part, whole, first):
    """Change of each cycle's RMS over the frames that count in both, (C, 6), in either variant.

    ``first`` is the frame of the whole recording with which the part begins.
    """
    kept = slice(first, first + len(part.motion.time))
    both = part.counts & whole.counts[kept]
    changes = []
    for start, stop in np.concatenate([*part.cycles.values()]):
        inside = both & (part.motion.time >= start) & (part.motion.time < stop)
        for variant in ("measured", "compensated"):
            if getattr(part, variant) is None:
                continue
            parts = getattr(part, variant).residual, getattr(whole, variant).residual[kept]
            rms = [np.sqrt(np.mean(residual[inside] ** 2, axis=0)) for residual in parts]
            changes.append(np.abs(rms[0] - rms[1]))
    return np.reshape(changes, (-1, 6))
