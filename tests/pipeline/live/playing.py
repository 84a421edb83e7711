"""Recordings played into a live chain, sample by sample, without network or clock."""

from itertools import pairwise

import numpy as np

from pipeline.config.live import COMPONENTS, Live
from pipeline.live.frames.chain import LiveChain
from pipeline.live.stream import Samples, StreamDescription


def streams_of(recording):
    """Give each stream of a recording: description, times and values."""
    markers, plates, analog = recording.markers, recording.plates, recording.analog
    names = markers.names
    described = StreamDescription("Markers", "markers", names, ("m",) * len(names), markers.rate_hz)
    streams = [(described, markers.time, markers.position.reshape(len(markers.time), -1))]
    labels = tuple(f"FP{plate.number}.{c}" for plate in plates for c in COMPONENTS)
    units = ("N", "N", "N", "Nm", "Nm", "Nm") * len(plates)
    described = StreamDescription("Plates", "analog", labels, units, plates[0].rate_hz)
    values = np.hstack([plate.wrench_in_plate for plate in plates])
    streams.append((described, plates[0].time, values))
    if analog is not None:
        described = StreamDescription("Analog", "analog", analog.names, analog.units, 1000.0)
        streams.append((described, analog.time, analog.values))
    return streams


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
