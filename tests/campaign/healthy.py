"""How healthy walks differ from what plates are judged by: ``python -m tests.campaign.healthy``.

    python -m tests.campaign.healthy [--data ../shared/data] [--virtual 10]

Prints of real walks, then of virtual ones, what `pipeline/trial/thresholds.toml` has as numbers of
``[evidence]``, ``[judge]``, ``[plate_units]``, ``[raw]``: RMS residuals by body weight and body
weight × stature, over walks; the RMS difference of load and need by their mean; how much later than
the motion plates seem; where pressure lies in the middle half of stances of single feet; how the
velocity of the ball of standing and of swinging feet varies; how far pressure and feet are from
each other on plates, by the RMS over samples under load, and how their distances from the centre
compare; the range of loads by their change between samples; and what channels show under load, by
their noise without.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from hbm.spatial import Array, shift_wrench
from pipeline.io.recording import Plate
from pipeline.trial.findings.evidence import LIMITS, find_stances, pressure
from pipeline.trial.plate_units import _feet, _pressure_and_feet, _rms
from tests.campaign.walks import Base, opencap, real, virtual
from tests.tables import command


def shown_by_channels(plate: Plate) -> Array:
    """What channels show of a load on the others, by their noise without, where there is both."""
    channels = shift_wrench(plate.wrench_in_plate, plate.transducer)
    load = np.abs(channels[:, 2])
    loaded, empty = load > 0.5 * load.max(), load < 0.05 * load.max()
    if not (np.ptp(load) > 200 and loaded.sum() > 50 and empty.sum() > 50):
        return np.zeros(0)
    noise = channels[empty].std(axis=0)
    change = np.abs(np.median(channels[loaded], axis=0) - np.median(channels[empty], axis=0))
    shown = np.maximum(channels[loaded].std(axis=0), change)
    return shown[noise > 0] / noise[noise > 0]


def report(walks: Iterable[Base]) -> str:
    """The measures of some walks in words."""
    residuals, differences, off, stands, swings = [], [], [], [], []
    delays_ms, distances, ratios, ranges, shown = [], [], [], [], []
    for walk in walks:
        chain = walk.chain()
        evidence = chain.evidence
        size = evidence.weight_n * np.repeat([1.0, chain.body.height_m], 3)
        left = evidence.needed - shift_wrench(evidence.wrenches.sum(axis=0), evidence.pelvis)
        use = evidence.carried & evidence.walking
        residuals.append(np.mean((left[use] / size) ** 2, axis=0))
        load, need = evidence.wrenches[..., 2].sum(axis=0)[use], evidence.needed[use, 2]
        apart = load - load.sum() / need.sum() * need
        delays_ms.append(1000 * chain.delay.seconds)
        differences.append(np.sqrt(np.mean(apart**2)) / load.mean())
        for plate in chain.trial.plates:
            shown += shown_by_channels(plate).tolist()
            stored, lever, foot = _pressure_and_feet(plate, _feet(chain.trial), chain.time)
            if len(foot) < 10:
                continue
            distances.append(_rms(stored + lever - foot))
            ratios.append(_rms(foot - lever) / _rms(stored))
            load = np.abs(plate.wrench_in_plate[:, 2])
            change = np.abs(np.diff(load))
            ranges.append(np.percentile(load, 98) / np.median(change[change > 0]))
        velocity = np.gradient(evidence.ball, evidence.time, axis=0)
        for stance in find_stances(evidence):
            wrench = evidence.wrenches[stance.plate, stance.rows]
            away = pressure(wrench, stance.expected[:, 2]) - stance.expected
            axes = (np.vecdot(away, axis) for axis in (stance.along, stance.left))
            along, across = (np.average(one, weights=wrench[:, 2]) for one in axes)
            off.append((along / evidence.foot_m[stance.foot], along, across))
            spread = velocity[stance.rows].std(axis=0).sum(axis=-1)
            stands.append(spread[stance.foot])
            swings.append(spread[1 - stance.foot])
    rms = ", ".join(f"{one:.4f}" for one in np.sqrt(np.mean(residuals, axis=0)))
    fraction, *_ = np.median(off, axis=0)
    _, along_m, across_m = np.sqrt(np.mean(np.square(off), axis=0))
    return (
        f"{len(residuals)} walks: RMS residuals {rms}; load and need differ by "
        f"{min(differences):.3f} to {max(differences):.3f}\n{len(off)} stances: pressure at "
        f"{LIMITS.pressure_along + fraction:.2f} of the foot, RMS {along_m:.3f} m along and "
        f"{across_m:.3f} m across from its place; spread of velocity {max(stands):.2f} m/s at most "
        f"of standing, {min(swings):.2f} m/s at least of swinging feet\nplates seem "
        f"{np.nanmin(delays_ms):.0f} to {np.nanmax(delays_ms):.0f} ms late; {len(distances)} "
        f"plates: pressure {min(distances):.3f} to {max(distances):.3f} m from the feet, distances "
        f"from the centre {min(ratios):.2f} to {max(ratios):.2f} times those of the pressure, "
        f"range of load {min(ranges):.0f} median changes and more; channels show {min(shown):.1f} "
        "times their noise and more"
    )


def main() -> None:
    parser = command("tests.campaign.healthy", __doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--virtual", type=int, default=10, help="virtual walks")
    given = parser.parse_args()
    print(f"real, {report([*real(given.data), opencap(given.data)])}")
    print(f"virtual, {report(virtual(given.virtual))}")


if __name__ == "__main__":
    main()
