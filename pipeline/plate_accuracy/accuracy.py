"""Experiment 1: errors of force plates under known weights, and how they depend on conditions."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation import Delay
from compensation.accuracy import Linearity, PlateAlignment, linearity
from hbm.numbers import read_numbers
from hbm.spatial import Array
from pipeline.config.plate_study import BeltSide, PlatesStudy
from pipeline.plate_accuracy.response import (
    FaultEstimate,
    PlateResponse,
    estimate_faults,
    fit_response,
)
from pipeline.plate_accuracy.trials import (
    UNALIGNED,
    WeightTrial,
    align,
    read_hammer_delay,
    read_weight,
    static_places,
)

LIMITS: Final = read_numbers("pipeline.plate_accuracy", "thresholds.toml", "linearity")


@dataclass(frozen=True, slots=True)
class PlateAccuracy:
    """The results of experiment 1.

    Attributes
    ----------
    study
        As stated.
    trials, trials_in_use
        The recordings of weights: all, and of every plate those with supports, or all where none
        has supports.
    alignments, delays, linearities, responses
        Belt -> result, where there are recordings for it.
    faults
        Single faults with their uncertainty.
    """

    study: PlatesStudy
    trials: tuple[WeightTrial, ...]
    trials_in_use: tuple[WeightTrial, ...]
    alignments: dict[BeltSide, PlateAlignment]
    delays: dict[BeltSide, Delay]
    linearities: dict[BeltSide, Linearity]
    responses: dict[BeltSide, PlateResponse]
    faults: tuple[FaultEstimate, ...]


def check_plates(study: PlatesStudy) -> PlateAccuracy:
    """Compare plates with known weights; an error names the recording that cannot be used.

    Notes
    -----
    Source: van de Loosdrecht (2018), II.A and D.1–D.2: static calibration after Goldberg et al.
    (2009), RMSE by difference and by total least squares, linearity, delay by impacts of a hammer.
    """
    file = study.file
    belts: list[BeltSide] = [b for b in ("left", "right") if any(w.belt == b for w in file.weights)]
    places = {belt: static_places(study, belt) for belt in belts}
    alignments = {belt: align(*pair) for belt, pair in places.items() if pair is not None}
    trials = tuple(
        read_weight(study, weight, alignments.get(weight.belt, UNALIGNED))
        for weight in file.weights
    )
    delays = {impacts.belt: read_hammer_delay(study, impacts) for impacts in file.hammer}
    return compare(study, trials, alignments, delays)


def compare(
    study: PlatesStudy,
    trials: tuple[WeightTrial, ...],
    alignments: dict[BeltSide, PlateAlignment],
    delays: dict[BeltSide, Delay],
) -> PlateAccuracy:
    """Compare plates with known weights, given what was read of all recordings."""
    file = study.file
    # where there are recordings with supports, the verdict is for use with them
    supported = {trial.weight.belt for trial in trials if trial.weight.supports}
    in_use = tuple(t for t in trials if t.weight.supports == (t.weight.belt in supported))
    linearities, responses = {}, {}
    for belt in dict.fromkeys(trial.weight.belt for trial in trials):
        of_belt = [trial for trial in in_use if trial.weight.belt == belt]
        loads, measured = mean_loads(of_belt, belt)
        masses = {trial.weight.mass_kg for trial in of_belt}
        if len(masses) >= LIMITS.fewest_masses and len(loads) >= LIMITS.fewest_recordings:
            linearities[belt] = linearity(loads, measured)
        response = fit_response(of_belt, alignments.get(belt, UNALIGNED), file)
        if response is not None:
            responses[belt] = response
    faults = estimate_faults(
        trials, responses, alignments, delays, height_stated=file.height_stated
    )
    return PlateAccuracy(study, trials, in_use, alignments, delays, linearities, responses, faults)


def mean_loads(trials: Sequence[WeightTrial], belt: BeltSide) -> tuple[Array, Array]:
    """Give the mean known and measured vertical force of a belt's recordings, (n,) [N] each."""
    of_belt = [t for t in trials if t.weight.belt == belt]
    loads = np.array([t.truth[t.used, 2].mean() for t in of_belt])
    measured = np.array([t.measured[t.used, 2].mean() for t in of_belt])
    return loads, measured
