"""Gauss–Newton on marker positions, as one writes it in NumPy around a kinematics library."""

import numpy as np
from scipy.linalg.lapack import dposv

TOLERANCE = 3e-5
MAX_STEPS = 50
REGULARISATION = 1e-9


def solve(linearise, measured, q):
    """Solve frame after frame, each from the solution before it.

    ``linearise(q)`` gives marker positions (K, 3) and their Jacobian (3K, N). A step reduces
    the error less than tenfold here, so a frame whose last step was below `TOLERANCE` is within
    1e-5 of its optimum. Extrapolating the start, or skipping the zeros in the products, takes
    longer. Coordinates that no marker observes keep their value.
    """
    out, regularisation = np.empty((len(measured), len(q))), REGULARISATION * np.eye(len(q))
    for t, target in enumerate(measured):
        for _ in range(MAX_STEPS):
            position, jacobian = linearise(q)
            gradient = jacobian.T @ (target - position).ravel()
            step = dposv(jacobian.T @ jacobian + regularisation, gradient, overwrite_a=True)[1]
            q = q + step
            if max(step.max(), -step.min()) < TOLERANCE:
                break
        out[t] = q
    return out
