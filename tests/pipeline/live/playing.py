"""Recordings played into a live chain, sample by sample, without network or clock."""

from itertools import pairwise

import numpy as np

from pipeline.config.live import Live
from pipeline.config.schema import Settings
from pipeline.live.chain import LiveChain, LiveFrame
from pipeline.live.replay import recorded_streams
from pipeline.live.stream import Samples
from pipeline.trial.chain import Chain
from pipeline.trial.inputs import Inputs
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import reported


def streams_of(recording):
    """Give each stream of a recording: description, times and values."""
    return [(each.description, each.time, each.values) for each in recorded_streams(recording)]


def body_of(recording, subject, **given):
    """Give the body as a trial has it, without what else is computed of the trial."""
    inputs = Inputs(recording=recording, subject=subject, **given)
    return Chain(inputs, Settings()).body


def chain_of(body, laboratory, settings, recording, wait_s=0.2):
    """Give a chain for the streams of a recording."""
    described = [stream for stream, _, _ in streams_of(recording)]
    plates = recording.plates
    return LiveChain(body, laboratory, settings, Live(wait_s=wait_s), described, plates)


def arrivals(recording, chunk_s=0.01, late_s=None, start_s=0.0):
    """Give the samples in the order in which they arrive.

    ``chunk_s`` is one number or one per stream; ``late_s`` is by how much later a stream arrives.
    """
    streams = streams_of(recording)
    chunks = np.broadcast_to(chunk_s, len(streams))
    late = late_s or {}
    found = []
    for (described, time, values), step_s in zip(streams, chunks, strict=True):
        ends = np.arange(time[0] + step_s, time[-1] + step_s, step_s)
        borders = np.unique([0, *np.searchsorted(time, ends), len(time)])
        for a, b in pairwise(borders):
            samples = Samples(described.name, time[a:b] + start_s, values[a:b])
            found.append((time[b - 1] + late.get(described.name, 0.0), samples))
    return [samples for _, samples in sorted(found, key=lambda each: each[0])]


def play(chain, samples):
    """Push samples into a chain; gives all frames."""
    return [frame for each in samples for frame in chain.push(each)] + chain.finish()


def frames_of(result, gain=lambda time: np.ones(2)):
    """A trial's frames as they would be known live, with plates under the feet of such gains."""
    residual = reported(result.measured.residual)
    ground = np.stack([result.ground["measured"][f"{s}_foot"] for s in ("left", "right")], 1)
    for k, time in enumerate(result.motion.time):
        by_foot = ground[k] * np.reshape(gain(time), (2, 1))
        yield LiveFrame(
            time=float(time),
            q=result.motion.q[k],
            tau={"measured": result.measured.tau[k]},
            residual={"measured": residual[k]},
            by_foot={"measured": by_foot},
            contact=by_foot[:, 2] > result.settings.contact_threshold_n,
            marker_error=result.motion.marker_error[k],
            quality=Quality(0) if result.counts[k] else Quality.SETTLING,
            computing_s=1e-4,
        )
