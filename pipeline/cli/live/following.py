"""What is new in a live session is shown and said as it comes."""

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final

from rich.console import Console

from pipeline.cli.stopping import Terminated, uninterrupted
from pipeline.cli.terminal import note_line
from pipeline.live.cycles import LiveCycle
from pipeline.live.frames.chain import LiveFrame
from pipeline.live.monitor import Monitor
from pipeline.live.recording import Recorder
from pipeline.live.session import Session
from pipeline.viewer.live import ShownFrame

if TYPE_CHECKING:
    from pipeline.viewer.live import LiveView

SHOWN_S: Final = 0.02
"""Between looks at what is new."""
STATUS_S: Final = 0.5
SWITCH_S: Final = 5e-4
"""After which another thread gets its turn: Python's own 5 ms would make frames late."""


def follow(
    session: Session,
    monitor: Monitor,
    recorder: Recorder,
    view: "LiveView | None",
    console: Console,
    duration_s: float | None,
    ending: ExitStack,
) -> bool:
    """Show what is new until it is stopped, by Ctrl-C, after a time, or by a fault.

    From then on until ``ending`` is closed nothing interrupts. Gives whether it was terminated.
    """
    terminated = False
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    began = shown_s = time.monotonic()
    told, address, recorded = 0, "", True
    session.start()
    try:
        with console.status("waiting for frames") as line:
            while session.runs and (duration_s is None or time.monotonic() - began < duration_s):
                time.sleep(SHOWN_S)
                fault = take_new(session, monitor, view)
                if view is not None and (fault := fault or view.fault or ""):
                    console.print(
                        f"nothing is shown any more: {fault}; all else goes on", soft_wrap=True
                    )
                    view = None
                if recorded and recorder.fault is not None:
                    recorded = False
                    console.print(f"{recorder.fault}; all else goes on", soft_wrap=True)
                monitor.look_for_silence()
                told = _tell(monitor, told, console)
                if time.monotonic() - shown_s < STATUS_S:
                    continue
                shown_s = time.monotonic()
                line.update(monitor.status())
                if view is not None:
                    view.show_status(monitor.page())
                    if view.address and not address:
                        address = view.address
                        console.print(
                            f"open {address} in a browser on this machine", soft_wrap=True
                        )
    except KeyboardInterrupt as request:
        terminated = isinstance(request, Terminated)
    finally:
        ending.enter_context(uninterrupted())
        session.stop()
        sys.setswitchinterval(before)
    take_new(session, monitor)
    _tell(monitor, told, console)
    return terminated


def take_new(session: Session, monitor: Monitor, view: "LiveView | None" = None) -> str:
    """Bring what is new in a session to its monitor and its view; give why it cannot be shown."""
    fault = ""
    while session.samples:
        monitor.samples(session.samples.popleft())
    while session.frames:
        frame, latency_s = session.frames.popleft()
        cycles = monitor.frame(frame, latency_s)
        if view is not None and not fault:
            try:
                _show(view, frame, cycles)
            except (ValueError, OSError) as error:
                fault = str(error)
    return fault


def _show(view: "LiveView", frame: LiveFrame, cycles: Sequence[LiveCycle]) -> None:
    """Show a frame and the gait cycles that it ends."""
    view.show(
        ShownFrame(
            frame.time,
            frame.q,
            frame.markers,
            frame.residual,
            frame.by_foot,
            frame.platform,
            frame.quality.counts,
        )
    )
    for cycle in cycles:
        view.show_cycle(cycle.side, cycle.curve)


def _tell(monitor: Monitor, told: int, console: Console) -> int:
    """Print the notes that are new; give how many there are now."""
    for timed in list(monitor.notes)[len(monitor.notes) - (monitor.noted - told) :]:
        console.print(note_line(timed.note), soft_wrap=True)
    return monitor.noted
