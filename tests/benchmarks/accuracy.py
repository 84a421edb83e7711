"""What everyone's answers are worth: how near to the measured markers and to the optimum."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from hbm.spatial import Array
from tests.benchmarks.pinocchio_peer import Pinocchio, load_model
from tests.benchmarks.trial import Trial
from tests.benchmarks.walker import SLIDES

INNER = slice(25, -25)


@dataclass(frozen=True)
class KinematicError:
    """RMS distance of the markers; distance of angles and slides from the optimum."""

    marker_rms_m: float
    angle_max_rad: float
    angle_rms_rad: float
    slide_max_m: float


def kinematic_error(trial: Trial, q: Array) -> KinematicError:
    away = trial.from_optimum(q)
    angles, slides = away[:, ~SLIDES], away[:, SLIDES]
    return KinematicError(
        trial.marker_rms(q),
        float(np.nanmax(angles)),
        float(np.sqrt(np.nanmean(angles**2))),
        float(np.nanmax(slides)),
    )


def force_error(trial: Trial, tau: Array) -> float:
    """Largest RMS difference of a generalized force [N or N·m], without the ends of the trial."""
    return float(np.sqrt(np.mean((tau - trial.tau)[INNER] ** 2, axis=0)).max())


def check_optimum(trial: Trial, frames: int = 10) -> float:
    """Give the largest distance [rad or m] of our optimum from SciPy's on Pinocchio's model."""
    given = dict(np.load(trial.folder / "trial.npz"))
    peer = Pinocchio(load_model(trial.folder), given)
    worst = 0.0
    for t in np.linspace(0, len(trial.markers.time) - 1, frames).astype(int):
        free = trial.optimum.observed[t, peer.order]
        q = np.where(free, 0, trial.optimum.q[t, peer.order])
        q[free] = trial.optimum.q[t - 1, peer.order][free]
        found = _scipy_optimum(peer, q, free, trial.markers.position[t])
        worst = max(worst, float(np.abs(found - trial.optimum.q[t, peer.order])[free].max()))
    return worst


def _scipy_optimum(peer, q, free, measured):
    def full(x):
        out = q.copy()
        out[free] = x
        return out

    result = least_squares(
        lambda x: (peer.linearise(full(x))[0] - measured).ravel(),
        q[free],
        lambda x: peer.linearise(full(x))[1][:, free],
        method="lm",
        ftol=1e-15,
        xtol=1e-15,
        gtol=1e-15,
    )
    return full(result.x)
