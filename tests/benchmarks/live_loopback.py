"""From a sample that is sent to the result that it completes, between three processes.

One process sends a walk of 46 markers at 100 Hz, two plates and two accelerometers at 1000 Hz by
Lab Streaming Layer; ``hbm live`` compensates, computes, records and sends; this one receives. Also
how long after its start ``hbm live`` has a first frame. Other programs that run meanwhile show.
"""

import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.config.live import Live
from pipeline.io.read import read_recording
from pipeline.live.output import RESULTS, RESULTS_FOLDER, Outlet, describe_stream, load_lsl
from pipeline.live.replay import recorded_streams
from tests.pipeline import lab

WALK_S = 12.0
PATIENCE_S = 30.0
ROUNDING_S = 1e-4


def send(walk, sent):
    """Send a walk over and over, once it is received: frames with what was sampled before them.

    Appends to a file the time of each frame and when it and its samples were sent, on LSL's clock.
    """
    streams = recorded_streams(read_recording(walk))
    outlets = [
        Outlet(describe_stream(stream.description, Live(), stream.plates)) for stream in streams
    ]
    clock, frames = load_lsl().local_clock, streams[0].time
    with Path(sent).open("w", buffering=1) as file:
        while not all(outlet.has_receivers for outlet in outlets):
            time.sleep(0.001)
        start_s = clock()
        while True:
            begin = [0] * len(streams)
            for frame in frames:
                end = [np.searchsorted(stream.time, frame, "right") for stream in streams]
                time.sleep(max(0.0, start_s + frame - clock()))
                for stream, outlet, *since in zip(streams, outlets, begin, end, strict=True):
                    outlet.push(start_s + stream.time[slice(*since)], stream.values[slice(*since)])
                print(start_s + frame, clock(), file=file)
                begin = end
            start_s += frames[-1] + frames[1]


def receive(inlet, seconds):
    """Give the times of frames, (N,), and when their results arrived, (N,) [s]."""
    clock, found = load_lsl().local_clock, []
    end_s = clock() + seconds
    while clock() < end_s:
        values, frame_s = inlet.pull_sample(1.0)
        if values is not None:
            found.append((frame_s, clock()))
    return np.array(found).T


def sent_and_received(folder, seconds):
    """Give the times from sending to receiving [ms], and that of the first frame [s]."""
    lab.write_study(folder, people=lab.PEOPLE[:1], duration_s=WALK_S)
    person = lab.PEOPLE[0].name
    walk, pose, sent = (
        folder / f for f in (f"{person}_pitch.c3d", f"{person}_baseline.c3d", "sent")
    )
    sending = [sys.executable, "-m", "tests.benchmarks.live_loopback", walk, sent]
    command = [sys.executable, "-m", "pipeline.cli", "live", "--study", folder]
    command += ["--static", pose, "--out", folder / "out"]
    lsl = load_lsl()
    with ExitStack() as processes:
        processes.enter_context(sender := subprocess.Popen(sending))
        processes.callback(sender.kill)  # it sends until then, whatever happens here
        while not sent.exists():
            time.sleep(0.1)
        began_s = lsl.local_clock()
        processes.enter_context(live := subprocess.Popen(command, stdout=subprocess.DEVNULL))
        processes.callback(live.kill)
        (info,) = lsl.resolve_byprop("name", RESULTS, timeout=PATIENCE_S)
        inlet = lsl.StreamInlet(info)
        wait_s = float(inlet.info(PATIENCE_S).desc().child_value("resampling_delay_s"))
        frame_s, arrived_s = receive(inlet, seconds)
        live.send_signal(signal.SIGINT)
        if code := live.wait(PATIENCE_S):
            raise RuntimeError(f"hbm live ended with {code}")
    batch_s, sent_s = np.loadtxt(sent).T
    last = np.searchsorted(batch_s, frame_s + wait_s - ROUNDING_S)
    latency_ms = 1000 * (arrived_s - sent_s[last])
    computed = pd.read_parquet(folder / "out" / RESULTS_FOLDER)
    parts = {"median_ms": 50, "p99_ms": 99, "p999_ms": 99.9, "largest_ms": 100}
    return {name: float(np.percentile(latency_ms, part)) for name, part in parts.items()} | {
        "frames_received": len(latency_ms),
        "first_frame_s": float(computed["time_s"].iloc[0]) + wait_s - began_s,
    }


if __name__ == "__main__":
    send(*sys.argv[1:3])
