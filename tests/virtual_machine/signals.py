"""Which calibration signal leaves least of an empty plate that people shake, in many laboratories.

``python -m tests.virtual_machine.signals SEED …`` prints, for each kind of signal, what it leaves
by what plain random motion of the same duration and belt speed leaves, and for each belt speed by
what belts at rest leave: geometric means over the thesis' four validation trials and six
components, with 95 % intervals over the laboratories, and the mean place of the advised signal.
"""

import sys
from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import t as student_t

from compensation import fit_inertia
from compensation.signals.protocol import ADVISED_PLATFORM_SIGNAL, PLATFORM_KINDS
from hbm.spatial import Array
from pipeline.calibration_ranking.trials import RankingSettings, platform_trial
from pipeline.virtual_lab.protocol import ranking_study

RATE_HZ: Final = 200.0
FOLDERS: Final = ("calibration", "validation")


def left_by_signal(seed: int) -> dict[str, Array]:
    """Give what every calibration of a laboratory leaves: signal -> RMS, (24,) [N, N·m]."""
    trials = {folder: [] for folder in FOLDERS}
    for folder, recording in ranking_study.recordings(seed, rate_hz=RATE_HZ):
        if folder in trials:
            trials[folder].append(platform_trial(recording, RankingSettings()))
    left = {}
    for one in trials["calibration"]:
        model = fit_inertia(one.accelerations, one.wrench, one.setup)
        errors = [v.wrench - model.predict(v.accelerations) for v in trials["validation"]]
        left[one.name] = np.concatenate([np.sqrt(np.mean(e**2, axis=0)) for e in errors])
    return left


def ratios(left: Mapping[str, Array], part: int, reference: str) -> dict[str, float]:
    """Give the ratios of signals that differ in one part of their name from those of a reference.

    ``part`` is that of the name without the kind, from its end: 0 the kind, -1 the belt speed.
    """
    found: dict[str, list[float]] = {}
    for name, rms in left.items():
        parts = name.rsplit("_", 2)
        own = parts[part]
        parts[part] = reference
        found.setdefault(own, []).append(float(np.mean(np.log(rms / left["_".join(parts)]))))
    return {own: float(np.exp(np.mean(logs))) for own, logs in found.items()}


def place(left: Mapping[str, Array]) -> float:
    """Give the place of the advised signal by the mean of its ranks in all columns."""
    ranks = pd.DataFrame(left).rank(axis=1).mean().rank()
    return float(ranks[ADVISED_PLATFORM_SIGNAL])


def interval(values: Array) -> str:
    """Give mean and 95 % interval of the mean."""
    half = student_t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():.2f} ({values.mean() - half:.2f} to {values.mean() + half:.2f})"


def main(seeds: list[int]) -> None:
    """Print the table."""
    every = [left_by_signal(seed) for seed in seeds]
    kinds = pd.DataFrame([ratios(left, 0, "random") for left in every])
    for kind in PLATFORM_KINDS[1:]:
        print(f"{kind}, by random: {interval(kinds[kind].to_numpy())}")
    speeds = pd.DataFrame([ratios(left, -1, "0mps") for left in every])
    print(f"belts at 3 m/s, by at rest: {interval(speeds['3mps'].to_numpy())}")
    places = np.array([place(left) for left in every])
    print(f"place of {ADVISED_PLATFORM_SIGNAL}: {interval(places)} of {len(every[0])}")


if __name__ == "__main__":
    main([int(seed) for seed in sys.argv[1:]])
