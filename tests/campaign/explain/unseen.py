"""Does a band of residuals hold where markers are on pelvis and legs alone?

    python -m tests.campaign.explain.unseen [--virtual 50] [--calm] [--data ../shared/data]

Walks with all markers are processed again without those of trunk, head and arms. Without errors of
measurement a residual is zero: prints in how many frames the band of 95 % contains that, in how
many walks the interval of the RMS contains the RMS with all markers, and what the missing markers
change, in % of body weight (x stature), by the causes and truly.

Trunks and arms of virtual people follow a published pattern with a joint in the spine that no model
has. Five to eight times a cycle they move by three times as much as real ones, because the pattern
was fitted to the equations of motion; ``--calm`` lets them follow its first four harmonics only.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from compensation.inertia.sensors import QUANTILE_95
from hbm.coordinates import INDEX, TREE
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS, Array
from pipeline.config.schema import Settings, Treadmill
from pipeline.explain.causes.markers import BELOW_TRUNK, marker_causes
from pipeline.explain.linearise import CYCLE_S, explained_part, result_chain, rms
from pipeline.explain.uncertainty import measured_uncertainty, noise_of_samples
from pipeline.trial.chain import Chain
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.virtual_lab.person import gait
from tests.campaign.walks import Base, known_with_legs_alone, real, virtual, with_legs_alone
from tests.tables import markdown

STILL: Final = Laboratory(Treadmill())
HARMONICS: Final = 4
"""Of a calm upper body."""
ANGLES: Final = {
    "TrunkFlexion": "PelvisForwardPitch",
    "TrunkRightBend": "PelvisRightRoll",
    "TrunkLeftTwist": "PelvisYaw",
}
"""Angle of the trunk in the pelvis -> that of the pelvis, to which it adds."""


def calm_upper_body() -> None:
    """Let trunk, head and arms of virtual people follow their first harmonics only."""
    _, pattern = gait._table()
    for name, (_, coefficients) in pattern.items():
        if name in INDEX and TREE[INDEX[name]].segment not in BELOW_TRUNK:
            high = pattern[ANGLES[name]][1] if name in ANGLES else np.zeros_like(coefficients)
            coefficients[:, HARMONICS + 1 :] = -high[:, HARMONICS + 1 :]


def changed_by_causes(less: Chain, more: Chain, cycles: Array) -> Array:
    """What marker causes make the residuals of two chains of one walk differ by, (T, 6)."""
    effects = [
        {own.name: own.prior.size * own.effect(chain) for own in marker_causes(chain, cycles)}
        for chain in (less, more)
    ]
    nothing = np.zeros((len(less.time), 6))
    names = effects[0].keys() | effects[1].keys()
    differences = [effects[0].get(n, nothing) - effects[1].get(n, nothing) for n in names]
    return np.asarray(np.sqrt(np.sum(np.square(differences), axis=0)))


def row(base: Base) -> dict[str, Array]:
    """What is found of a walk, by axis: whether it held, and the squares of what changes."""
    whole = process_recording(base.recording, settings=Settings(), **base.known)
    legs = with_legs_alone(base.recording, whole.body)
    known = known_with_legs_alone(base.known, whole.body)
    result = process_recording(legs, settings=Settings(), **known)
    part = explained_part(legs, STILL, result)
    chain, frames = part.chain, np.concatenate(part.series.frames)
    noise = noise_of_samples(chain)
    effects = np.nan_to_num([cause.effect(chain) for cause in part.causes])
    (interval, *_), _, bands = measured_uncertainty(part, effects, noise, result)
    first = int(np.searchsorted(result.motion.time, chain.time[0]))
    part = slice(first, first + len(chain.time))
    more = result_chain(base.recording, STILL, whole).of_frames(part)
    cycles = np.reshape(max(result.cycles.values(), key=len, default=()), (-1, 2))
    cycles = cycles if len(cycles) else chain.time[0] + np.array([[0.0, CYCLE_S]])
    weight = whole.body.mass * GRAVITY_MPS2
    unit = np.repeat([100 / weight, 100 / (weight * whole.body.height_m)], 3)
    residual, marked = chain.residual[frames], more.residual[frames]
    seen = np.isfinite(marked).all(axis=1)
    by_causes = changed_by_causes(chain, more, cycles)[frames][seen]
    within = np.abs(rms(marked[seen]) - interval.rms) <= QUANTILE_95 * interval.deviation
    return {
        "frames whose band holds, %": 100
        * (np.abs(residual) <= QUANTILE_95 * bands.deviation).mean(axis=0),
        "walks whose RMS holds, %": 100.0 * within,
        "changed, by the causes": (unit * rms(np.nan_to_num(by_causes))) ** 2,
        "changed, truly": (unit * rms(residual[seen] - marked[seen])) ** 2,
    }


def rows(bases: Iterator[Base]) -> Iterator[dict[str, Array]]:
    """What is found of all walks that can be explained."""
    for base in bases:
        try:
            yield row(base)
        except ValueError as error:
            print(f"{base.name}: {error}", file=sys.stderr)


def table(found: list[dict[str, Array]]) -> pd.DataFrame:
    """Means over walks; of squares, their roots."""
    means = {name: np.mean([own[name] for own in found], axis=0) for name in found[0]}
    shown = {name: v**0.5 if name.startswith("changed") else v for name, v in means.items()}
    return pd.DataFrame(shown, index=WRENCH_COMPONENTS).T.round(2).rename_axis("").reset_index()


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.explain.unseen", description=__doc__
    )
    parser.add_argument("--virtual", type=int, default=50)
    parser.add_argument("--calm", action="store_true")
    parser.add_argument("--data", type=Path)
    given = parser.parse_args()
    if given.calm:
        calm_upper_body()
    sources = {"virtual": virtual(given.virtual)} if given.virtual else {}
    if given.data is not None:
        sources["real"] = real(given.data)
    for name, bases in sources.items():
        found = list(rows(bases))
        print(f"{len(found)} {name} walks\n\n{markdown(table(found))}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
