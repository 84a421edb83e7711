"""Which signal calibrates best: experiment 2 repeated with everything random drawn again.

``python -m tests.campaign.calibration_signals [--seeds N …]``; without seeds it takes the reserved
ones and writes validation/calibration_signals.md.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import t as student

from compensation.protocol import ADVISED_PLATFORM_SIGNAL
from pipeline.calibration_ranking.ranking import Ranking, rank_platform
from pipeline.calibration_ranking.trials import RankingSettings, factors, platform_trial
from pipeline.virtual_lab.protocol.calibration_trial import recordings
from tests.campaign.pages import renew
from tests.tables import markdown

SEEDS: Final = range(9100, 9110)
"""Reserved for the page: never used while anything was developed."""
RATE_HZ: Final = 200.0
PLAIN: Final = "random_60s_3mps"
"""Plain random motion, as long and at the same belt speed as the advised signal."""
CELL: Final = ["validation", "component"]
FACTORS: Final = {"kind": "random", "speed_mps": 0.0, "duration_s": 60.0}
"""Property of a signal -> the level that others are compared with."""


def experiment(seed: int) -> Ranking:
    """Simulate the calibration and validation of the platform, and rank its 28 signals."""
    trials: dict[str, list] = {"calibration": [], "validation": []}
    for folder, recording in recordings(seed, rate_hz=RATE_HZ):
        if folder in trials:
            trial = platform_trial(recording, RankingSettings())
            trials[folder].append(replace(trial, name=Path(recording.source).stem))
    return rank_platform(trials["calibration"], trials["validation"], seed=seed)


def logarithms(rankings: Sequence[Ranking]) -> pd.DataFrame:
    """Give the logarithm of what every signal leaves in every cell of every experiment."""
    parts = [each.scores.assign(experiment=k) for k, each in enumerate(rankings)]
    table = pd.concat(parts, ignore_index=True)
    named = pd.DataFrame([{"trial": name, **factors(name)} for name in table["trial"].unique()])
    return table.merge(named, on="trial").assign(log=np.log(table["rms_after"]))


def ratios(table: pd.DataFrame, factor: str) -> pd.DataFrame:
    """Give what each level leaves, by what the level in `FACTORS` leaves: mean and 95 % interval.

    Geometric means over cells and the other properties; the interval is that of experiments.
    """
    levels = table.groupby(["experiment", factor, *CELL])["log"].mean().unstack(factor)
    by_level = levels.sub(levels[FACTORS[factor]], axis=0).groupby("experiment").mean()
    count = len(by_level)
    half = student.ppf(0.975, count - 1) * by_level.std(ddof=1) / np.sqrt(count)
    mean = by_level.mean()
    found = pd.DataFrame({"ratio": mean, "low": mean - half, "high": mean + half})
    return np.exp(found.drop(index=FACTORS[factor])).sort_values("ratio")


def left(table: pd.DataFrame, signal: str) -> pd.Series:
    """Give the RMS that a signal leaves of every component, over cells and experiments."""
    own = table[table["trial"] == signal]
    return np.sqrt(own.groupby("component")["rms_after"].agg(lambda rms: np.mean(rms**2)))


def winners_found_again(rankings: Sequence[Ranking]) -> float:
    """Share of the winners that another experiment counts as possibly the best."""
    pairs = permutations(rankings, 2)
    return float(np.mean([one.winner in other.possibly_best for one, other in pairs]))


def orders_found_again(rankings: Sequence[Ranking]) -> float:
    """Share of the orders of two signals, certain by the resamples, that others have as well."""
    held = []
    for one, other in permutations([each.table.set_index("trial") for each in rankings], 2):
        for better, worse in permutations(one.index, 2):
            if one["rank_high"][better] < one["rank_low"][worse]:
                held.append(other["mean_rank"][better] < other["mean_rank"][worse])
    return float(np.mean(held)) if held else np.nan


def places(rankings: Sequence[Ranking]) -> pd.Series:
    """Give the mean place of every signal, best first."""
    own = [each.table["trial"].reset_index().set_index("trial")["index"] + 1 for each in rankings]
    return pd.concat(own, axis=1).mean(axis=1).sort_values()


def report(rankings: Sequence[Ranking], seeds: Sequence[int]) -> str:
    """Give the tables of the page, and how far laboratories agree."""
    table, mean_place = logarithms(rankings), places(rankings)
    by_level = pd.concat({factor: ratios(table, factor) for factor in FACTORS})
    advised = pd.DataFrame({name: left(table, name) for name in (ADVISED_PLATFORM_SIGNAL, PLAIN)})
    best = ", ".join(f"`{name}` ({place:.1f})" for name, place in mean_place.head(3).items())
    again = 100 * winners_found_again(rankings), 100 * orders_found_again(rankings)
    lines = [
        f"{len(rankings)} laboratories (seeds {seeds[0]} to {seeds[-1]}). What is left (RMS, "
        "geometric mean), by that after plain random motion, belts at rest, and 60 s, with 95 % "
        "intervals:",
        markdown(by_level.reset_index(names=["property", "level"])),
        "What the advised signal leaves beside plain random motion [N, N·m]:",
        markdown(advised.reset_index()),
        f"Best mean places of 28: {best}; `{ADVISED_PLATFORM_SIGNAL}` has "
        f"{mean_place[ADVISED_PLATFORM_SIGNAL]:.1f}. Found again in another laboratory: "
        f"{again[0]:.0f} % of the winners among the possibly best, {again[1]:.0f} % of the orders "
        "of two signals that one is certain of.",
    ]
    return "\n\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.calibration_signals", description=__doc__
    )
    parser.add_argument("--seeds", type=int, nargs="+", help="others, without a page")
    given = parser.parse_args()
    seeds = given.seeds or list(SEEDS)
    rankings = []
    for seed in seeds:
        rankings.append(experiment(seed))
        print(f"{seed}: {rankings[-1].winner}", flush=True)
    if given.seeds is None:
        renew("calibration_signals.md", "signals", report(rankings, seeds))
    else:
        print(report(rankings, seeds))
    return 0


if __name__ == "__main__":
    sys.exit(main())
