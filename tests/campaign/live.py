"""Random faults of live streams: ``python -m tests.campaign.live [MINUTES] [--seed 0]``.

A compensated walk on a moving platform is played again and again, as fast as it goes, each time
with other faults: chunks lost, doubled, delayed and exchanged, streams gone for a while, time
stamps that jitter, drift and jump, numbers that are none. Nothing may raise, warn, lose a frame or
let memory grow.
"""

import argparse
import resource
import warnings
from dataclasses import dataclass
from tempfile import TemporaryDirectory

import numpy as np

from hbm.model import Body
from pipeline.config.schema import Platform, Settings, Subject, Treadmill
from pipeline.io.recording import Recording
from pipeline.live.chain import LiveChain
from pipeline.live.cycles import LiveCycles
from pipeline.live.frame import Quality
from pipeline.live.stream import Samples
from pipeline.trial.ground.calibration_recording import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from tests.pipeline import lab
from tests.pipeline.live.playing import arrivals, chain_of

REALTIME = Settings(filter="realtime")
SECONDS = 6.0
MAX_GROWTH_MB = 20.0


@dataclass(frozen=True)
class Walk:
    """What is played."""

    recording: Recording
    laboratory: Laboratory
    body: Body


def walk_on_platform() -> Walk:
    platform = Platform(markers=tuple(lab.PLATFORM_MARKERS_M))
    treadmill = Treadmill(accelerometers=lab.CHANNELS, platform=platform, inertia_model="static")
    empty = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0))
    laboratory = Laboratory(treadmill, fit_calibration(empty, treadmill))
    with TemporaryDirectory() as folder:
        walker = lab.walk(folder, duration_s=SECONDS)
    recording = lab.on_platform(walker, lab.pitching(SECONDS))
    person = Subject(sex="male", mass_kg=74.6)
    body = process_recording(recording, person, REALTIME, laboratory=laboratory).body
    return Walk(recording, laboratory, body)


def with_faults(samples: list[Samples], random: np.random.Generator) -> list[Samples]:
    """Give what arrives of samples where several things go wrong at once."""
    share, found = random.choice([0.0, 0.01, 0.1]), []
    gone = {name: random.uniform(0, 2 * SECONDS, 2) for name in ("Markers", "Plates", "Analog")}
    drift = {name: 1 + random.choice([0.0, 1e-5, 1e-4]) * random.normal() for name in gone}
    jitter_s = random.choice([0.0, 1e-4, 2e-3])
    for each in samples:
        start_s, lasts_s = gone[each.stream]
        if start_s < each.time[0] < start_s + 0.3 * lasts_s or random.random() < share:
            continue
        time, values = each.time * drift[each.stream], each.values.copy()
        time = time + jitter_s * random.normal(size=len(time))
        if random.random() < share:
            time[random.integers(len(time))] = random.choice([np.nan, np.inf, -np.inf, -1.0])
        if random.random() < share:
            values[:, random.integers(values.shape[1])] = random.choice([np.nan, np.inf, 1e300, 0])
        found += [Samples(each.stream, time, values)] * (1 + (random.random() < share))
    late = np.arange(len(found)) + random.choice([0, 3, 30]) * random.random(len(found))
    return [found[k] for k in np.argsort(late)]


def play_with_faults(walk: Walk, seed: int) -> LiveChain:
    """Play the walk once; an AssertionError where a frame is not accounted for."""
    random = np.random.default_rng(seed)
    chain = chain_of(walk.body, walk.laboratory, REALTIME, walk.recording)
    cycles, received = LiveCycles(walk.body, 0.5), 0
    chunk_s = random.choice([0.001, 0.01, 0.05], 3)
    arriving = with_faults(arrivals(walk.recording, chunk_s), random)
    for number, each in enumerate([*arriving, None]):
        frames = chain.finish() if each is None else chain.push(each)
        for frame in frames:
            assert frame.number == received, f"seed {seed}: frame {frame.number} at {number}"
            received += 1
            cycles.step(frame)
            if frame.quality.counts:
                assert all(np.isfinite(r).all() for r in frame.residual.values()), f"seed {seed}"
            assert not (frame.quality & Quality.LATE and frame.quality.counts)
    counts = chain.counts
    assert received == counts.received == counts.solved + counts.marked, f"seed {seed}"
    return chain


def main(minutes: float, seed: int) -> None:
    walk, rounds = walk_on_platform(), max(1, round(60 * minutes / SECONDS))
    solved, marked, late, memory = 0, 0, 0, 0.0
    for number in range(rounds):
        counts = play_with_faults(walk, seed + number).counts
        solved, marked = solved + counts.solved, marked + counts.marked
        late += counts.late
        used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
        if number == rounds // 10:
            memory = used
    growth = used - memory
    print(
        f"{rounds * SECONDS / 60:g} minutes: {solved + marked} frames received, {solved} solved, "
        f"{marked} marked, of these {late} late; memory grew by {growth:.1f} MB after a tenth"
    )
    assert growth < MAX_GROWTH_MB


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("minutes", type=float, nargs="?", default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("error")
    main(given.minutes, given.seed)
