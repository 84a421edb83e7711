"""Misstated weights that look like a fault of the plate."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.spatial import GRAVITY_MPS2
from pipeline.plate_accuracy.accuracy import PlateAccuracy
from pipeline.plate_accuracy.faults import FaultEstimate
from pipeline.plate_accuracy.response import MIN_MASSES
from pipeline.plate_accuracy.trials import WeightTrial

POWERS: Final = {"gain of Fz": 1, "curvature": 2}
"""Fault -> power of the load with which it grows."""
GAIN: Final = "gain of "
"""With which the names begin of faults that a common misstatement of all masses causes alike."""


def shared_gain(faults: Sequence[FaultEstimate], most: float) -> float:
    """Find the part of all gains that one misstatement of all masses would explain.

    Parameters
    ----------
    faults
        Of all plates on which the same masses were recorded.
    most
        By which share all masses may be misstated at most.

    Returns
    -------
    float
        The mean gain less 1, weighted by precision, but not beyond the 95 % interval of any gain:
        where a plate or a component is right, or gains differ in sign, next to nothing is shared.
    """
    gains = [fault for fault in faults if fault.fault.startswith(GAIN)]
    if not gains:
        return 0.0
    value, half = np.array([(one.value, one.uncertainty) for one in gains]).T
    half = np.maximum(half, np.finfo(float).eps)
    mean = float(np.average(value, weights=half**-2))
    side = np.sign(mean)
    return float(side * max(min(side * mean, np.min(side * value + half), most), 0.0))


def with_heavier_masses(found: PlateAccuracy, share: float) -> PlateAccuracy:
    """Give the gains, responses and linearities as if all masses were heavier by a share."""
    real = 1 + share
    responses = {}
    for belt, response in found.responses.items():
        matrix = response.matrix.copy()
        matrix[:, :, response.examined] /= real
        responses[belt] = replace(response, matrix=matrix, curvature=response.curvature / real**2)
    return replace(
        found,
        responses=responses,
        linearities={b: replace(x, slope=x.slope / real) for b, x in found.linearities.items()},
        faults=tuple(
            replace(one, value=(1 + one.value) / real - 1) if one.fault.startswith(GAIN) else one
            for one in found.faults
        ),
    )


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
