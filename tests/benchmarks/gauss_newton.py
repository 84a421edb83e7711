"""Gauss–Newton on marker positions, as one writes it in NumPy around a kinematics library."""

import numpy as np
from scipy.linalg.lapack import dposv

TOLERANCE = 3e-5
MOST_STEPS = 50
FLOOR = 1e-9


def solve(linearise, measured, q):
    """Solve frame after frame, each from the solution before it.

    ``linearise(q)`` gives marker positions (K, 3) and their Jacobian (3K, N). A step gains less
    than a digit here, so a frame whose last step was below `TOLERANCE` is within 1e-5 of its
    optimum. Extrapolating the start, or products that spare the zeros, take longer. Coordinates
    that no marker shows keep their value.
    """
    out, floor = np.empty((len(measured), len(q))), FLOOR * np.eye(len(q))
    for t, target in enumerate(measured):
        for _ in range(MOST_STEPS):
            position, jacobian = linearise(q)
            gradient = jacobian.T @ (target - position).ravel()
            step = dposv(jacobian.T @ jacobian + floor, gradient, overwrite_a=True)[1]
            q = q + step
            if max(step.max(), -step.min()) < TOLERANCE:
                break
        out[t] = q
    return out
