"""Misstated weights that look like a fault of the plate."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.spatial import GRAVITY_MPS2
from pipeline.plate_accuracy.faults import FaultEstimate
from pipeline.plate_accuracy.response import MIN_MASSES
from pipeline.plate_accuracy.trials import WeightTrial

POWERS: Final = {"gain of Fz": 1, "curvature": 2}
"""Fault -> power of the load with which it grows."""


def second_causes(
    faults: Sequence[FaultEstimate], trials: Sequence[WeightTrial], full_scale_n: float
) -> dict[str, str]:
    """Find which misstatement of the weights would look the same as a fault.

    Parameters
    ----------
    faults
        Of one plate.
    trials
        Its recordings, from which the faults were estimated.
    full_scale_n
        Load at which the curvature is stated [N].

    Returns
    -------
    dict[str, str]
        Fault -> misstatement; of a single mass, the smallest. Only faults that have one.
    """
    alike = {}
    for fault in faults:
        if fault.fault == "Fx in My":
            alike[fault.fault] = f"center_height_m wrong by {1000 * abs(fault.value):.2g} mm"
        elif fault.fault in POWERS:
            mass, wrong = _misstated_mass(POWERS[fault.fault], fault.value, trials, full_scale_n)
            alike[fault.fault] = f"{mass:g} kg misstated by {wrong:.2g} kg"
            if fault.fault == "gain of Fz":
                every = f"all masses misstated by {100 * abs(fault.value):.2g} %"
                alike[fault.fault] = f"{every}, or {alike[fault.fault]},"
    return alike


def _misstated_mass(
    power: int, value: float, trials: Sequence[WeightTrial], full_scale_n: float
) -> tuple[float, float]:
    """Give the mass whose smallest misstatement has the coefficient, and that one [kg]."""
    masses = np.array([trial.weight.mass_kg for trial in trials])
    share = masses * GRAVITY_MPS2 / full_scale_n
    highest = 2 if len(set(masses)) >= MIN_MASSES else 1
    effect = np.linalg.pinv(np.vander(share, highest + 1, increasing=True))[power]
    error = value * (full_scale_n if power == 1 else 1.0) / GRAVITY_MPS2
    wrong = {mass: abs(error / effect[masses == mass].sum()) for mass in sorted(set(masses))}
    smallest = min(wrong, key=lambda each: wrong[each])
    return float(smallest), float(wrong[smallest])
