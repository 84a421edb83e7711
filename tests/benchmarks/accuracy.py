"""Accuracy of a solution: its distance from the measured markers and from the optimum."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from hbm.spatial import Array
from tests.benchmarks.pinocchio_peer import Pinocchio, load_model
from tests.benchmarks.trial import Trial
from tests.benchmarks.walker import TRANSLATIONS

INNER = slice(25, -25)
"""Frames that are compared: programs treat the ends of a filtered or differentiated signal each in
their own way, and at 100 Hz a quarter of a second is beyond their reach."""


@dataclass(frozen=True)
class KinematicError:
    """RMS distance of the markers; distance of rotations and translations from the optimum."""

    marker_rms_m: float
    angle_max_rad: float
    angle_rms_rad: float
    translation_max_m: float


def kinematic_error(trial: Trial, q: Array) -> KinematicError:
    error = trial.from_optimum(q)
    angles, translations = error[:, ~TRANSLATIONS], error[:, TRANSLATIONS]
    return KinematicError(
        trial.marker_rms(q),
        float(np.nanmax(angles)),
        float(np.sqrt(np.nanmean(angles**2))),
        float(np.nanmax(translations)),
    )


def force_error(trial: Trial, tau: Array) -> float:
    """Largest RMS difference of a generalized force [N or N·m], without the ends."""
    return float(np.sqrt(np.mean((tau - trial.tau)[INNER] ** 2, axis=0)).max())


@dataclass(frozen=True)
class OptimumCheck:
    """Our optimum on Pinocchio's model [rad or m]: distance of SciPy's solution, and the next step.

    SciPy stops when the cost no longer changes, some 1e-8 from the optimum.
    """

    scipy_distance: float
    gauss_newton_step: float


def check_optimum(trial: Trial, frames: int = 10) -> OptimumCheck:
    """Solve some frames, spread over the trial, again from the solution of the frame before."""
    model = Pinocchio(load_model(trial.folder), dict(np.load(trial.folder / "trial.npz")))
    ours, observed = trial.optimum.q[:, model.order], trial.optimum.observed[:, model.order]
    distance, step = [], []
    for t in np.linspace(1, len(ours) - 1, frames).astype(int):
        free, measured = observed[t], trial.markers.position[t]
        start = np.where(free, ours[t - 1], ours[t])
        found = _scipy_optimum(model, start, free, measured)
        distance.append(np.abs(found - ours[t]).max())
        points, jacobian = model.linearise(ours[t])
        error = (points - measured).ravel()
        step.append(np.abs(np.linalg.lstsq(jacobian[:, free], error)[0]).max())
    return OptimumCheck(float(max(distance)), float(max(step)))


def _scipy_optimum(model: Pinocchio, start: Array, free: Array, measured: Array) -> Array:
    def full(x):
        q = start.copy()
        q[free] = x
        return q

    found = least_squares(
        lambda x: (model.linearise(full(x))[0] - measured).ravel(),
        start[free],
        lambda x: model.linearise(full(x))[1][:, free],
        method="lm",
        ftol=1e-15,
        xtol=1e-15,
        gtol=1e-15,
    )
    return full(found.x)
