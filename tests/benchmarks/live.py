"""Computing time of live frames, from their last sample to the result, beside the offline one.

A walker with 46 markers on a platform that pitches, two plates and two accelerometers at 1000 Hz,
compensated; cameras at 100 and 300 Hz. A frame's last sample is one of the plates where cameras are
fast, and the markers where they are slow. Other programs that run meanwhile show in the time on the
clock, not in that of the processor.
"""

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hbm.markers import Markers
from hbm.signals.resampling import interpolate
from pipeline.config.schema import Platform, Settings, Subject, Treadmill
from pipeline.live.chain import LiveChain
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality
from tests.benchmarks.live_loopback import sent_and_received
from tests.pipeline import lab
from tests.pipeline.live.playing import arrivals, chain_of

SECONDS = 60.0
SLOW_CAMERAS_S = 0.05
PERSON = Subject(sex="male", mass_kg=74.6)
REALTIME = Settings(filter="realtime")
CASES = (
    ("100 Hz, plates last", 100.0, 0.0),
    ("100 Hz, markers last", 100.0, SLOW_CAMERAS_S),
    ("300 Hz, plates last", 300.0, 0.0),
    ("300 Hz, markers last", 300.0, SLOW_CAMERAS_S),
)
Row = dict[str, Any]


def live_frames(folder: Path, seconds: float = SECONDS) -> Row:
    """Give the table of live frames, and what passes between three processes if LSL is there."""
    laboratory, recording = moving_walk(folder, seconds)
    start = time.process_time()
    result = process_recording(recording, PERSON, REALTIME, laboratory=laboratory)
    offline_us = 1e6 * (time.process_time() - start) / len(result.motion.time)
    rows = []
    for name, rate_hz, late_s in CASES:
        moving = at_rate(recording, rate_hz) if rate_hz != 100 else recording
        chain = chain_of(result.body, laboratory, REALTIME, moving)
        samples = arrivals(moving, chunk_s=1 / rate_hz, late_s={"Markers": late_s})
        rows.append({"name": name, **measure(chain, samples)})
        rows[-1]["core"] = rows[-1]["cpu_us"] * rate_hz / 1e6
    measured: Row = {"live": rows, "live_offline_us": offline_us}
    try:
        import pylsl  # noqa: F401
    except ImportError:
        return measured
    return measured | {"live_loopback": sent_and_received(folder / "loopback", seconds)}


def moving_walk(folder: Path, seconds: float):
    """Give a compensated laboratory and a walk in it, cameras at 100 Hz."""
    platform = Platform(markers=tuple(lab.PLATFORM_MARKERS_M))
    treadmill = Treadmill(accelerometers=lab.CHANNELS, platform=platform, inertia_model="static")
    empty = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0))
    laboratory = Laboratory(treadmill, fit_calibration(empty, treadmill))
    walker = lab.walk(folder, duration_s=seconds)
    return laboratory, lab.on_platform(walker, lab.pitching(seconds))


def at_rate(recording, rate_hz):
    """Give the recording with cameras at another rate."""
    markers = recording.markers
    frames = np.arange(markers.time[0], markers.time[-1], 1 / rate_hz)
    position = interpolate(markers.time, markers.position, frames)
    return replace(recording, markers=Markers(frames, markers.names, position))


def measure(chain: LiveChain, samples) -> Row:
    """Give the time on the clock from a frame's last sample [s], and of the processor in all."""
    on_clock, spent = [], time.thread_time()
    for each in samples:
        start = time.perf_counter()
        frames = chain.push(each)
        if len(frames) == 1:
            on_clock.append(time.perf_counter() - start)
        assert not any(frame.quality & Quality.LATE for frame in frames)
    cpu_us = 1e6 * (time.thread_time() - spent) / chain.received
    return percentiles(on_clock) | {"frames_timed": len(on_clock), "cpu_us": cpu_us}


def percentiles(times_s) -> Row:
    """Give parts of a distribution of times [s] in µs."""
    parts = {"median_us": 50, "p99_us": 99, "p999_us": 99.9, "largest_us": 100}
    return {name: 1e6 * float(np.percentile(times_s, part)) for name, part in parts.items()}
