"""Attack live sessions: ``python -m tests.campaign.live [--minutes N] [--seed S] [--jobs J]``.

Walks on a moving platform are replayed as fast as they are computed, with faults that change every
twenty seconds: samples that are lost, doubled, out of order or late, clocks that drift and are set
anew, streams that go away, markers that are gone for seconds, plates that are saturated, values
that are no numbers. Every frame has to be accounted for, and memory must not grow.
"""

import argparse
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from multiprocessing import Pool
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.spatial import Array
from pipeline.config.schema import Settings, Subject
from pipeline.config.study import read_study
from pipeline.io.recording import Recording
from pipeline.live.chain import LiveChain
from pipeline.live.monitor import Monitor
from pipeline.live.replay import RecordedSource
from pipeline.live.stream import Arrivals, Samples
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality
from pipeline.trial.study_files import read_study_file, read_study_laboratory
from tests.pipeline import lab
from tests.pipeline.live.perturbed import Faults, PerturbedSource

BLOCK_S: Final = 20.0
REALTIME: Final = Settings(filter="realtime")
KINDS: Final = (
    "none",
    "drop",
    "duplicate",
    "reorder",
    "late",
    "drift",
    "jitter",
    "stream away",
    "clock set anew",
    "markers gone",
    "plates saturated",
    "no numbers",
    "no times",
    "long chunks",
)


@dataclass(slots=True)
class Tally:
    """What became of some minutes."""

    minutes: float = 0.0
    received: int = 0
    solved: int = 0
    marked: int = 0
    late: int = 0
    unaccounted: int = 0
    finite: bool = True
    computing_s: list[float] = field(default_factory=list)
    memory_mb: list[float] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


def attacked(seed: int, minutes: float) -> Tally:
    """Run one session for so many minutes of streams."""
    rng, tally = np.random.default_rng((seed, 19)), Tally()
    with tempfile.TemporaryDirectory() as folder:
        study = read_study(lab.write_study(Path(folder) / "study"))
        laboratory, walk = read_study_laboratory(study), read_study_file(study, "sub01_pitch.c3d")
    whole = process_recording(walk, Subject(sex="male"), REALTIME, laboratory=laboratory)
    source = RecordedSource(walk)
    live = study.file.live.model_copy(
        update={"analog": tuple(stream.name for stream in source.streams[1:])}
    )
    chain = LiveChain(whole.body, laboratory, REALTIME, live, source.streams, walk.plates)
    monitor = Monitor(chain, walk.plates)
    arrivals = Arrivals(source.streams)
    start_s, sent_frames, given, late = 0.0, 0, 0, 0
    while tally.minutes < minutes:
        kinds = rng.choice(KINDS, size=int(rng.integers(1, 4)), replace=False).tolist()
        try:
            for samples in sent(walk, kinds, start_s, rng):
                samples = arrivals.take(samples, time.monotonic())
                if not len(samples.time):
                    continue
                monitor.samples(samples)
                sent_frames += len(samples.time) * (samples.stream == chain.stream.name)
                for frame in chain.push(samples):
                    given, late = given + 1, late + bool(frame.quality & Quality.LATE)
                    monitor.frame(frame, frame.computing_s)
                    tally.computing_s.append(frame.computing_s)
                    if frame.quality.counts:
                        known = all(np.isfinite(r).all() for r in frame.residual.values())
                        tally.finite &= bool(known and np.isfinite(frame.q).all())
        except Exception as error:  # whatever it is, it is what is looked for
            tally.faults.append(f"seed {seed}, {kinds}: {type(error).__name__}: {error}")
            break
        start_s += float(walk.markers.time[-1]) + 0.01
        tally.minutes = start_s / 60
        tally.memory_mb.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        tally.computing_s = tally.computing_s[-100_000:]
    rest = chain.finish()
    given, late = given + len(rest), late + len(rest)
    tally.received, tally.solved, tally.marked = chain.received, chain.solved, chain.marked
    tally.late, tally.unaccounted = late, sent_frames - given
    return tally


def sent(
    walk: Recording, kinds: list[str], start_s: float, rng: np.random.Generator
) -> Iterator[Samples]:
    """Give the samples of a walk that begins at a time, with faults of some kinds."""
    one_in_fifty = 0.02
    faults = Faults(
        drop=one_in_fifty * ("drop" in kinds),
        duplicate=one_in_fifty * ("duplicate" in kinds),
        reorder=one_in_fifty * ("reorder" in kinds),
        delay_s={"Plates": float(rng.uniform(0, 0.4))} if "late" in kinds else {},
        jitter_s=2e-4 * ("jitter" in kinds),
        drift={"Plates": float(rng.normal(0, 1e-6))} if "drift" in kinds else {},
        absent_s=_absent(walk, rng) if "stream away" in kinds else {},
    )
    played = _spoilt(walk, kinds, rng)
    chunk_s = float(rng.uniform(0.1, 1.0)) if "long chunks" in kinds else 0.01
    source = PerturbedSource(RecordedSource(played, chunk_s), faults, int(rng.integers(1 << 30)))
    set_s = float(rng.uniform(0, BLOCK_S)) if "clock set anew" in kinds else np.inf
    by_s = float(rng.choice([-3600.0, -2.0, 60.0]))
    while not source.ended:
        for samples in source.receive(0.0):
            time = samples.time + start_s + by_s * (samples.time >= set_s)
            if "no times" in kinds and rng.uniform() < 0.01:
                time[rng.integers(len(time))] = rng.choice([np.nan, np.inf, -np.inf, -1.0])
            yield replace(samples, time=time)


def _absent(walk: Recording, rng: np.random.Generator) -> dict[str, tuple[float, float]]:
    start = float(rng.uniform(0, walk.markers.time[-1]))
    stream = str(rng.choice(["Markers", "Plates", "Analog"]))
    return {stream: (start, start + float(rng.uniform(0.05, 5)))}


def _spoilt(walk: Recording, kinds: list[str], rng: np.random.Generator) -> Recording:
    """Give a walk with what is wrong with its samples themselves."""
    if "markers gone" in kinds or "no numbers" in kinds:
        position: Array = walk.markers.position.copy()
        frames, markers = position.shape[:2]
        for _ in range(int(rng.integers(1, 12))):
            first = int(rng.integers(frames))
            gone = slice(first, first + int(rng.integers(1, 400)))
            position[gone, rng.integers(markers)] = np.nan
        if "no numbers" in kinds:
            spoilt = rng.integers(frames, size=20), rng.integers(markers, size=20)
            position[spoilt] = rng.choice([np.nan, np.inf, 1e9, 0.0], size=(20, 3))
        walk = replace(walk, markers=Markers(walk.markers.time, walk.markers.names, position))
    plates = list(walk.plates)
    if "plates saturated" in kinds:
        limit = float(rng.uniform(50, 600))
        plates[0] = replace(
            plates[0], wrench_in_plate=plates[0].wrench_in_plate.clip(-limit, limit)
        )
    if "no numbers" in kinds:
        wrench = plates[1].wrench_in_plate.copy()
        wrench[rng.integers(len(wrench), size=10)] = rng.choice([np.nan, np.inf, 1e30])
        plates[1] = replace(plates[1], wrench_in_plate=wrench)
    return replace(walk, plates=tuple(plates))


def summary(tallies: list[Tally]) -> str:
    """Give the outcome of all sessions as text."""
    received = sum(tally.received for tally in tallies)
    lines = [
        f"{sum(tally.minutes for tally in tallies):.0f} minutes in {len(tallies)} sessions, "
        f"{received} frames received: {sum(t.solved for t in tallies)} count, "
        f"{sum(t.marked for t in tallies)} are marked ({sum(t.late for t in tallies)} late), "
        f"{sum(t.unaccounted for t in tallies)} unaccounted for",
        f"sessions with frames that count without a number: {sum(not t.finite for t in tallies)}",
    ]
    lines += [f"memory {t.memory_mb[0]:.0f} to {t.memory_mb[-1]:.0f} MB" for t in tallies]
    computing = 1000 * np.concatenate([tally.computing_s for tally in tallies])
    lines.append(
        f"computing per frame: median {np.median(computing):.2f}, longest {computing.max():.1f} ms"
    )
    lines += [fault for tally in tallies for fault in tally.faults] or ["no crash"]
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.live", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1000.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    warnings.simplefilter("error")
    began = time.monotonic()
    each = given.minutes / given.jobs
    with Pool(given.jobs) as pool:
        tallies = pool.starmap(attacked, [(given.seed + k, each) for k in range(given.jobs)])
    print(summary(tallies))
    print(f"{time.monotonic() - began:.0f} s")
    survived = all(not t.faults and not t.unaccounted and t.finite for t in tallies)
    return 0 if survived else 1


if __name__ == "__main__":
    sys.exit(main())
