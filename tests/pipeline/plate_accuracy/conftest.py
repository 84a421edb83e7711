"""Good plates under known weights, recorded once, and what a fault makes of the same recordings."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.spatial import GRAVITY_MPS2, shift_wrench
from pipeline.config.plate_study import read_plates_study
from pipeline.plate_accuracy.accuracy import check_plates, compare
from pipeline.virtual_lab.protocol.known_weights import FULL_SCALE_N, simulate_plates

DESIGN = {
    "speeds": (1.0,),
    "weights": (13.44, 22.56, 45.08),
    "positions": (0.15, 0.35),
    "supports": (True,),
}


@pytest.fixture(scope="session")
def good_plates(tmp_path_factory):
    folder = tmp_path_factory.mktemp("good_plates")
    simulate_plates(folder, seed=5, **DESIGN)
    return check_plates(read_plates_study(folder))


@pytest.fixture(scope="session")
def good_plate(good_plates):
    return chosen(good_plates, lambda weight: weight.belt == "left")


def again(found, trials, **stated):
    """The study with other trials, and other statements in plates.toml."""
    file = found.study.file.model_copy(update=stated)
    belts = {trial.weight.belt for trial in trials}
    parts = (found.alignments, found.delays)
    own = [{belt: one for belt, one in part.items() if belt in belts} for part in parts]
    return compare(replace(found.study, file=file), tuple(trials), *own)


def chosen(found, of_weight):
    return again(found, [trial for trial in found.trials if of_weight(trial.weight)])


def spoiled(
    found, cross_talk=None, *, curvature=0.0, rise=None, drift=0.0, belts=("left",), **stated
):
    """The study on plates with faults, which change what a plate reports about its centre.

    ``rise``: component -> by how much its gain rises until the load of 75 kg.
    """
    gain = np.eye(6)
    for (measured, true), share in (cross_talk or {}).items():
        gain[measured, true] += share

    def report(trial, wrench):
        wrong = wrench @ gain.T
        for component, until in (rise or {}).items():
            wrong[:, component] *= 1 + until * wrong[:, 2] / (75.0 * GRAVITY_MPS2)
        wrong[:, 2] += curvature / FULL_SCALE_N * wrong[:, 2] ** 2 + drift * trial.time
        return wrong

    trials = []
    for trial in found.trials:
        if trial.weight.belt in belts:
            about_center = report(trial, shift_wrench(trial.measured, trial.center))
            measured = shift_wrench(about_center, -trial.center)
            slow = report(trial, trial.slow_measured)
            trial = replace(trial, measured=measured, slow_measured=slow)
        trials.append(trial)
    return again(found, trials, **stated)


def with_masses(found, real_over_stated, **stated):
    """The study where all weights are heavier than stated by one factor."""
    trials = []
    for trial in found.trials:
        mass = trial.weight.mass_kg / real_over_stated
        trials.append(
            replace(
                trial,
                weight=trial.weight.model_copy(update={"mass_kg": mass}),
                truth=trial.truth / real_over_stated,
                slow_truth=trial.slow_truth / real_over_stated,
            )
        )
    return again(found, trials, **stated)
