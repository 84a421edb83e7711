"""Computing time of live frames, from their last sample to the result.

``python -m tests.benchmarks.live [--seconds 60]``: a walker with 46 markers on a platform that
pitches, two plates and two accelerometers at 1000 Hz, compensated; cameras at 100 and 300 Hz. Other
programs that run meanwhile show in the time on the clock, not in that of the processor.
"""

import argparse
import time
from dataclasses import replace
from tempfile import TemporaryDirectory

import numpy as np

from hbm.markers import Markers
from hbm.signals.resampling import interpolate
from pipeline.config.schema import Platform, Settings, Subject, Treadmill
from pipeline.live.frames.chain import LiveChain
from pipeline.trial.ground.calibration_recording import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from tests.pipeline import lab
from tests.pipeline.live.playing import arrivals, chain_of

PERSON = Subject(sex="male", mass_kg=74.6)
REALTIME = Settings(filter="realtime")
PARTS = (50, 99, 99.9, 100)


def moving_walk(seconds):
    """Give a compensated laboratory and a walk in it, cameras at 100 Hz."""
    platform = Platform(markers=tuple(lab.PLATFORM_MARKERS_M))
    treadmill = Treadmill(accelerometers=lab.CHANNELS, platform=platform, inertia_model="static")
    empty = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0))
    laboratory = Laboratory(treadmill, fit_calibration(empty, treadmill))
    with TemporaryDirectory() as folder:
        walker = lab.walk(folder, duration_s=seconds)
    return laboratory, lab.on_platform(walker, lab.pitching(seconds))


def at_rate(recording, rate_hz):
    """Give the recording with cameras at another rate."""
    markers = recording.markers
    frames = np.arange(markers.time[0], markers.time[-1], 1 / rate_hz)
    position = interpolate(markers.time, markers.position, frames)
    return replace(recording, markers=Markers(frames, markers.names, position))


def measure(chain: LiveChain, samples):
    """Give per frame the time on the clock and of the processor [µs], and all of it per frame."""
    on_clock, of_processor, whole = [], [], time.thread_time()
    for each in samples:
        start, spent = time.perf_counter(), time.thread_time()
        frames = chain.push(each)
        if len(frames) == 1:
            of_processor.append(time.thread_time() - spent)
            on_clock.append(time.perf_counter() - start)
    whole = (time.thread_time() - whole) / chain.counts.received
    return 1e6 * np.array(on_clock), 1e6 * np.array(of_processor), 1e6 * whole


def row(name, values):
    return f"| {name} | " + " | ".join(f"{x:.0f}" for x in np.percentile(values, PARTS)) + " |"


def main(seconds: float) -> None:
    laboratory, recording = moving_walk(seconds)
    start = time.process_time()
    result = process_recording(recording, PERSON, REALTIME, laboratory=laboratory)
    offline = (time.process_time() - start) / len(result.motion.time)
    body = result.body
    print("| per frame [µs] | median | 99 % | 99.9 % | largest |\n|---|---:|---:|---:|---:|")
    shares = [f"the same trial by process_recording: {1e6 * offline:.0f} µs a frame"]
    for rate_hz in (100.0, 300.0):
        moving = at_rate(recording, rate_hz) if rate_hz != 100 else recording
        chain = chain_of(body, laboratory, REALTIME, moving)
        clock, processor, whole = measure(chain, arrivals(moving, chunk_s=1 / rate_hz))
        print(row(f"{rate_hz:g} Hz, clock", clock))
        print(row(f"{rate_hz:g} Hz, processor", processor))
        assert chain.counts.late == 0
        share = whole * rate_hz / 1e6
        shares.append(f"{rate_hz:g} Hz: {100 * share:.0f} % of one core, receiving included")
    print("\n".join(shares))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    main(parser.parse_args().seconds)
