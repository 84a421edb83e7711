"""What residuals lose without markers on trunk, head and arms.

    python -m tests.campaign.legs_alone [--data ../shared/data] [--virtual 24]

Every recording is processed with all its markers and with those of pelvis and legs alone; mass and
stature are the same. Prints the RMS of both, in % of body weight and of body weight × stature, the
SD of their difference, and the SD that the trial's table expects.
"""

import argparse
from pathlib import Path

import numpy as np

from hbm.plausibility.motion import unseen_covariance
from hbm.spatial import GRAVITY_MPS2
from pipeline.trial.process import result_of
from pipeline.trial.result import TrialResult
from tests.campaign.walks import Base, opencap, real, virtual


def percent(result: TrialResult, values: np.ndarray) -> np.ndarray:
    """Give values by body weight and, of moments, stature [%]."""
    weight_n = result.body.mass * GRAVITY_MPS2
    return 100 * values / (weight_n * np.repeat([1.0, result.body.height_m], 3))


def compared(base: Base) -> np.ndarray:
    """RMS with all markers and with the legs alone, SD of the difference, SD expected, (4, 6)."""
    full, legs = (result_of(each.chain()) for each in (base, base.with_legs_alone()))
    frames = full.counted & legs.counted
    every, fewer = (r.measured.residual[frames] for r in (full, legs))
    expected = unseen_covariance(legs.body, legs.motion, legs.counted)
    sizes = [np.sqrt(np.mean(x**2, axis=0)) for x in (every, fewer, fewer - every)]
    return np.array([percent(full, x) for x in (*sizes, np.sqrt(np.diag(expected)))])


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.legs_alone", description=__doc__
    )
    parser.add_argument("--data", type=Path, help="folder of real recordings")
    parser.add_argument("--virtual", type=int, default=24)
    chosen = parser.parse_args()
    kinds = {"virtual": [*virtual(chosen.virtual)]}
    if chosen.data:
        kinds["real"] = [*real(chosen.data), opencap(chosen.data)]
    for kind, bases in kinds.items():
        found = []
        for base in bases:
            try:
                found.append(compared(base))
                print(f"{base.name}: {np.round(found[-1], 2).tolist()}", flush=True)
            except ValueError as refused:
                print(f"{base.name}: {refused}", flush=True)
        means = np.sqrt(np.nanmean(np.square(found), axis=0))
        for what, row in zip(("all", "legs alone", "difference", "expected"), means, strict=True):
            print(f"{kind} | {what} | {' | '.join(f'{value:.2f}' for value in row)}")


if __name__ == "__main__":
    main()
