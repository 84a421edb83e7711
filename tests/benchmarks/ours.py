"""This package's inverse kinematics and dynamics."""

from pathlib import Path

import numpy as np

from hbm.dynamics import filter_motion, inverse_dynamics_variants
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from hbm.motion import Motion
from tests.synthetic import synthetic_body


def tasks(folder: Path):
    body, given = synthetic_body(), dict(np.load(folder / "trial.npz"))
    time, names = given["time"], tuple(map(str, given["markers"]))
    markers = Markers(time, names, given["position"])
    raw, motion = (motion_of(time, *given[name]) for name in ("raw", "motion"))
    feet = {foot: given[foot] for foot in ("left_foot", "right_foot")}
    compensated = {foot: 0.9 * wrench for foot, wrench in feet.items()}

    def forces(motion):
        """Forces and residuals for two variants of the plates, as in every compensated trial."""
        measured, _ = inverse_dynamics_variants(body, motion, [feet, compensated])
        return measured.tau

    return {
        "ik": lambda: solve_ik(body, markers).q,
        "id": lambda: forces(filter_motion(raw)),
        "id from rates": lambda: forces(motion),
    }


def motion_of(time, q, v, a) -> Motion:
    observed = np.ones(q.shape, bool)
    return Motion(time, q, v, a, (), np.zeros((len(time), 0)), np.ones(len(time), bool), observed)
