"""The loop that receives, computes and sends, on a thread of its own that waits for nobody."""

import threading
from collections import deque
from time import perf_counter
from typing import Final

import numpy as np

from hbm.model import Body
from pipeline.config.live import Live
from pipeline.config.schema import Settings, Treadmill
from pipeline.io.recording import Recording
from pipeline.live.chain import LiveChain, LiveFrame
from pipeline.live.monitor import LIMITS, Monitor
from pipeline.live.output import Outlet, Recorder, result_row
from pipeline.live.replay import RecordedSource
from pipeline.live.stream import Arrivals, Samples, Source
from pipeline.trial.ground.laboratory import Laboratory

RECEIVE_S: Final = 0.02
"""Longest wait for samples, after which it is looked whether to stop."""
WAITING: Final = 12_000
"""Frames, and chunks of samples, that are kept for whoever shows them: a minute or so."""


class Session:
    """Receives samples and computes frames until it is stopped.

    Parameters
    ----------
    source
        Where samples come from.
    chain
        What computes frames.
    recorder, outlet
        Where samples and results go, if anywhere; neither makes the loop wait.

    Attributes
    ----------
    arrivals
        What never came of each stream, and what came late or twice.
    frames, samples
        What is new for whoever shows it; the oldest is dropped where nobody takes it.
    fault
        Why it ended by itself; None as long as it runs, or after `stop`.
    """

    def __init__(
        self,
        source: Source,
        chain: LiveChain,
        recorder: Recorder | None = None,
        outlet: Outlet | None = None,
    ) -> None:
        self._source, self._chain, self._recorder, self._outlet = source, chain, recorder, outlet
        self.arrivals = Arrivals(source.streams)
        self.frames = deque[tuple[LiveFrame, float]](maxlen=WAITING)
        self.samples = deque[Samples](maxlen=WAITING)
        self.fault: Exception | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="live", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, after the frames that wait for samples."""
        self._stop.set()
        self._thread.join()

    @property
    def runs(self) -> bool:
        """Whether it has not ended."""
        return self._thread.is_alive()

    def _run(self) -> None:
        markers = self._chain.stream.name
        try:
            while not self._stop.is_set():
                received, arrived = self._source.receive(RECEIVE_S), perf_counter()
                # markers last: after a pause all streams have much to send, and none of it is late
                for samples in sorted(received, key=lambda sent: sent.stream == markers):
                    self._take(samples, arrived)
        except (ValueError, OSError) as error:
            self.fault = error
        for frame in self._chain.finish():
            self._give(frame, perf_counter())

    def _take(self, samples: Samples, arrived: float) -> None:
        samples = self.arrivals.take(samples, arrived)
        self.samples.append(samples)
        if not len(samples.time):
            return  # none has a sure time
        for frame in self._chain.push(samples):
            self._give(frame, arrived)
        if self._recorder is not None:
            self._recorder.take(samples)

    def _give(self, frame: LiveFrame, arrived: float) -> None:
        row = result_row(frame)
        if self._outlet is not None:
            self._outlet.push(np.array([frame.time]), row[None])
        latency_s = perf_counter() - arrived
        if self._recorder is not None:
            self._recorder.take(np.concatenate([[frame.time], row]))
        self.frames.append((frame, latency_s))


def rehearse(
    recording: Recording,
    body: Body,
    settings: Settings,
    laboratory: Laboratory | None = None,
    required: int = LIMITS.required_cycles,
) -> tuple[list[LiveFrame], Monitor]:
    """Replay a recording through the chain of a session, without network or clock.

    Parameters
    ----------
    recording
        Markers and plates, as `pipeline.io.read.read_recording` gives them.
    body
        Of the subject, such as that of a processed trial, ``result.body``.
    settings
        With ``filter = "realtime"``; numbers are then those of the processed trial.
    laboratory
        The treadmill and its calibration; by default one that does not move.
    required
        Gait cycles of one foot that the session is for.

    Returns
    -------
    frames
        In their order: coordinates [rad, m], residuals about mid-hip [N, N·m] and the wrench under
        each foot about the lab origin.
    monitor
        What a laboratory sees of them: residuals so far, gait cycles, notes.

    Raises
    ------
    ValueError
        If channels or platform markers that the laboratory names are not in the recording.

    Notes
    -----
    Chain and monitor are those of `hbm live`; notebooks/08_live.py is an example.
    """
    source, laboratory = RecordedSource(recording), laboratory or Laboratory(Treadmill())
    chain = LiveChain(body, laboratory, settings, Live(), source.streams, recording.plates)
    monitor, frames = Monitor(chain, recording.plates, required=required), list[LiveFrame]()
    while not source.ended:
        for samples in source.receive(0.0):
            monitor.samples(samples)
            for frame in chain.push(samples):
                monitor.frame(frame, frame.computing_s)
                frames.append(frame)
    return frames, monitor
