"""Which calibration signal leaves least of an empty plate that people shake, in many laboratories.

``python -m tests.virtual_machine.signals SEED …`` prints, for each kind of signal, what it leaves
by what plain random motion of the same duration and belt speed leaves, and for each belt speed by
what belts at rest leave: geometric means over the thesis' four validation trials and six
components, with 95 % intervals over the laboratories; the mean place of the advised signal; and how
often the winner of a laboratory is among those that another one calls possibly the best.
"""

import sys
from collections.abc import Mapping
from itertools import permutations
from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import t as student_t

from compensation import InertiaModel
from compensation.signals.protocol import ADVISED_PLATFORM_SIGNAL, PLATFORM_KINDS
from hbm.spatial import Array
from pipeline.calibration_ranking.ranking import MIN_WINS, Ranking, rank_platform
from pipeline.calibration_ranking.trials import RankingSettings, platform_trial
from pipeline.virtual_lab.protocol import ranking_study

RATE_HZ: Final = 200.0
FOLDERS: Final = ("calibration", "validation")


def experiment(seed: int) -> Ranking[InertiaModel]:
    """Rank the calibrations of a laboratory."""
    trials = {folder: [] for folder in FOLDERS}
    for folder, recording in ranking_study.recordings(seed, rate_hz=RATE_HZ):
        if folder in trials:
            trials[folder].append(platform_trial(recording, RankingSettings()))
    return rank_platform(*trials.values())


def left_by_signal(ranking: Ranking[InertiaModel]) -> dict[str, Array]:
    """Give what every calibration leaves: signal -> RMS, (24,) [N, N·m]."""
    own = ranking.scores.groupby("trial", sort=False)["rms_after"]
    return {str(name): rms.to_numpy() for name, rms in own}


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


def place(ranking: Ranking[InertiaModel]) -> float:
    """Give the place of the advised signal by its mean rank."""
    places = ranking.table.set_index("trial")["mean_rank"].rank()
    return float(places[ADVISED_PLATFORM_SIGNAL])


def possible(one: Ranking[InertiaModel], other: Ranking[InertiaModel], share: float) -> bool:
    """Whether the winner of one laboratory wins a share of the resamples of the other."""
    wins = other.table.set_index("trial")["wins"]
    return one.winner == other.winner or bool(wins[one.winner] >= share)


def interval(values: Array) -> str:
    """Give mean and 95 % interval of the mean."""
    half = student_t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():.2f} ({values.mean() - half:.2f} to {values.mean() + half:.2f})"


def main(seeds: list[int]) -> None:
    """Print the table."""
    every = [experiment(seed) for seed in seeds]
    left = [left_by_signal(ranking) for ranking in every]
    kinds = pd.DataFrame([ratios(own, 0, "random") for own in left])
    for kind in PLATFORM_KINDS[1:]:
        print(f"{kind}, by random: {interval(kinds[kind].to_numpy())}")
    speeds = pd.DataFrame([ratios(own, -1, "0mps") for own in left])
    print(f"belts at 3 m/s, by at rest: {interval(speeds['3mps'].to_numpy())}")
    places = np.array([place(ranking) for ranking in every])
    print(f"place of {ADVISED_PLATFORM_SIGNAL}: {interval(places)} of {len(left[0])}")
    for share in (MIN_WINS, 0.05):
        found = np.mean([possible(one, other, share) for one, other in permutations(every, 2)])
        print(f"winners of another that are possibly the best by {share:g}: {100 * found:.0f} %")


if __name__ == "__main__":
    main([int(seed) for seed in sys.argv[1:]])
