"""One live session: what is new is shown and said as it comes, and summed up at its end."""

import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.text import Text

from hbm.model import Body
from hbm.notes import Note
from hbm.spelling import listed
from pipeline.cli.options import require_folder
from pipeline.cli.stopping import SIGNAL_EXIT, recorded_requests, stoppable, terminable
from pipeline.cli.terminal import PlainConsole
from pipeline.config.schema import NOUNS
from pipeline.io.write import write_text
from pipeline.live.chain import LiveChain
from pipeline.live.light import Finding
from pipeline.live.lsl import LslSource
from pipeline.live.monitor import Monitor, senders
from pipeline.live.output import (
    RESULTS_FOLDER,
    STREAMS,
    SUMMARY,
    Recorder,
    describe_stream,
    require_new,
    result_columns,
    result_outlet,
)
from pipeline.live.preparation import PlacedPlates, PoseFinder, Preparation, place_plates
from pipeline.live.qualisys import PORT, QualisysSource
from pipeline.live.session import RECEIVE_S, Session
from pipeline.live.stream import Source
from pipeline.viewer.live import LiveScene, LiveView, Screen, ShownFrame

SEARCH_S: Final = 60.0
"""How long streams are searched for."""
ABSENT: Final = (
    "start the program that sends them, or write their names in [live] of study.toml; if another "
    "computer sends them, give the address of this one: --listen"
)


@dataclass(frozen=True, slots=True)
class Options:
    """How a session is run.

    Attributes
    ----------
    out
        New folder for the recording; by default live/ and the time.
    pose
        Whether the subject shows the calibration pose now.
    view, web
        Whether the body is shown in a window, or to a browser.
    qualisys
        Address of Qualisys Track Manager; else streams are those of LSL.
    listen
        Address of this computer at which they are searched for.
    senders
        Computers to receive from where several send streams of one name.
    cycles
        Gait cycles that the session is for.
    duration_s
        It ends after so long; by default it is stopped.
    """

    out: Path | None
    pose: bool
    view: bool
    web: bool
    qualisys: str | None
    listen: str
    senders: Sequence[str]
    cycles: int
    duration_s: float | None


def run_session(prepared: Preparation, console: PlainConsole, options: Options) -> int:
    """Receive, compute, record, send and show until it is stopped.

    Gives the exit code: 0; 1 where no frame came, the recording is not whole or the source failed;
    143 where it was terminated. A ValueError or OSError, of one line, as what is received, prepared
    and recorded raises them.
    """
    folder = options.out or Path("live") / time.strftime("%Y-%m-%d_%H-%M-%S")
    require_folder(folder)
    require_new(folder)
    body = None if options.pose else prepared.body()
    if body is not None and prepared.static is not None:
        console.say(f"calibration pose: {prepared.static.source.name}")
    news = deque[Finding]()
    with ExitStack() as ending, terminable(), ExitStack() as stack:
        with stoppable(lambda: "nothing was received, and nothing is recorded"):
            source = _source(prepared, options, console, news.append)
        stack.callback(source.close)
        console.say(f"receiving {senders(source.streams)}")
        placed = place_plates(source.plates, prepared.static, prepared.study.file.live)
        if body is None:
            body = _shown(prepared, placed, source, console)
        subject, notes = body
        console.say_notes((*prepared.notes, *placed.notes, *notes))
        plates, laboratory = placed.plates, prepared.laboratory
        settings = prepared.study.file.settings
        chain = LiveChain(subject, laboratory, settings, placed.live, source.streams, plates)
        described = [describe_stream(each, placed.live, plates) for each in source.streams]
        recorder = Recorder(folder, described, result_columns())
        stack.callback(recorder.close)
        outlet = None
        if options.qualisys is None:
            outlet = result_outlet(
                chain.stream.rate_hz,
                filter_delay_s=chain.filter_delay_s,
                resampling_delay_s=chain.wait_s,
                listen=options.listen,
            )
            stack.callback(outlet.close)
        session = Session(source, chain, recorder, outlet)
        view = None
        if options.view or options.web:
            screen: Screen = "browser" if options.web else "window"
            of_chain = chain.body, plates, chain.stream.labels, chain.ground.variants
            view = LiveView(LiveScene(*of_chain, screen, settings.contact_threshold_n))
            stack.callback(view.close)
        monitor = Monitor(chain, plates, lambda note: console.say_notes((note,)), options.cycles)
        console.say(
            f"recording to {folder}; delay {1000 * chain.filter_delay_s:.0f} ms of the filter and "
            f"{1000 * chain.wait_s:.0f} ms of resampling (stop with Ctrl-C)"
        )
        seconds = options.duration_s
        terminated = follow(
            session, source, monitor, recorder, view, console, seconds, ending, news
        )
        stack.close()
        lines = [*summary(chain, monitor, session, recorder, folder)]
        for text in lines:
            console.say(text)
        with suppress(OSError):  # of a full disk, which the recorder reports
            write_text("\n".join(lines) + "\n", folder / SUMMARY)
    if terminated:
        return SIGNAL_EXIT + signal.SIGTERM
    failed = session.fault is not None or recorder.fault is not None or not chain.received
    return int(failed)


def _source(
    prepared: Preparation, options: Options, console: PlainConsole, say: Callable[[Finding], object]
) -> Source:
    if options.qualisys is not None:
        console.say(f"connecting to Qualisys Track Manager at {options.qualisys}")
        host, colon, port = options.qualisys.partition(":")
        if colon and not port.isdecimal():
            raise ValueError(f"--qualisys {options.qualisys}: expected ADDRESS or ADDRESS:PORT")
        return QualisysSource(host, port=int(port or PORT), stated=prepared.study.stated, say=say)
    markers, analog = prepared.streams
    console.say(f"searching at {options.listen} for {', '.join((markers, *analog))}")
    try:
        with console.status("searching") as line:
            return LslSource(
                markers,
                analog,
                stated=prepared.study.stated,
                listen=options.listen,
                timeout_s=SEARCH_S,
                searching=lambda absent, there: line.update(
                    Text(f"missing: {listed(absent)}; there: {listed(sorted(there))}")
                ),
                senders=options.senders,
            )
    except ConnectionError as absent:
        absent.add_note(ABSENT)
        raise


def _shown(
    prepared: Preparation, placed: PlacedPlates, source: Source, console: PlainConsole
) -> tuple[Body, tuple[Note, ...]]:
    """Wait until the subject shows the calibration pose, and build the body from it."""
    console.say("stand still on the plates, arms out to the sides (stop with Ctrl-C)")
    finder = PoseFinder(placed.live, source.streams, placed.plates)
    with console.status("no body yet") as line:
        while True:
            for samples in source.receive(RECEIVE_S):
                pose = finder.add(samples)
                if pose is None:
                    continue
                try:
                    return prepared.body(pose)
                except ValueError as error:
                    finder.why_not = str(error)
            line.update(Text(f"no body yet: {finder.why_not}"))


SHOWN_S: Final = 0.02
"""Between looks at what is new."""
STATUS_S: Final = 0.5
STYLES: Final = {
    "GOOD": "bold white on green",
    "LOOK": "bold black on yellow",
    "STOP": "bold white on red",
}
"""Of the light."""
SWITCH_S: Final = 5e-4
"""After which another thread gets its turn: Python's own 5 ms would make frames late."""


def follow(
    session: Session,
    source: Source,
    monitor: Monitor,
    recorder: Recorder,
    view: LiveView | None,
    console: PlainConsole,
    duration_s: float | None,
    ending: ExitStack,
    news: deque[Finding],
) -> bool:
    """Show what is new until it is stopped, by Ctrl-C, after a time, or by a fault.

    The news are the source's. Nothing interrupts before ``ending`` is closed: requests to stop
    are recorded. Gives whether it was terminated.
    """
    requests = ending.enter_context(recorded_requests())
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    began = shown_s = time.monotonic()
    address, recorded = "", True
    session.start()
    try:
        with console.status("waiting for frames") as line:
            while session.runs and not requests:
                if duration_s is not None and time.monotonic() - began >= duration_s:
                    break
                time.sleep(SHOWN_S)
                take_new(session, monitor, view)
                while news:
                    monitor.hear(news.popleft())
                if view is not None and view.fault is not None:
                    console.say(f"nothing is shown any more: {view.fault}; all else goes on")
                    view = None
                if recorded and recorder.fault is not None:
                    recorded = False
                    console.say(f"{recorder.fault}; all else goes on")
                monitor.look_for_silence()
                if time.monotonic() - shown_s < STATUS_S:
                    continue
                shown_s = time.monotonic()
                line.update(_coloured(monitor.status()))
                if view is not None:
                    view.show_board(monitor.board(source.streams))
                    if view.address and not address:
                        address = view.address
                        console.say(f"open {address} in a browser on this machine")
    finally:
        session.stop()
        sys.setswitchinterval(before)
    take_new(session, monitor)
    return signal.SIGTERM in requests[:1]


def _coloured(status: str) -> Text:
    """Colour the light, which is the first word."""
    word, rest = status.split(":", 1)
    return Text.assemble((f" {word} ", STYLES[word]), rest)


def take_new(session: Session, monitor: Monitor, view: LiveView | None = None) -> None:
    """Bring what is new in a session to its monitor and its view."""
    while session.samples:
        monitor.samples(session.samples.popleft())
    while session.frames:
        frame, latency_s = session.frames.popleft()
        monitor.frame(frame, latency_s)
        if view is not None:
            loads = frame.residual, frame.by_foot, frame.platform
            view.show(ShownFrame(frame.time, frame.q, frame.markers, *loads, frame.quality.counts))


def summary(
    chain: LiveChain, monitor: Monitor, session: Session, recorder: Recorder, folder: Path
) -> Iterator[str]:
    """Say what was received, what came of it, and where it is, line by line."""
    condition = monitor.condition
    why = ", ".join(
        f"{count} {name.lower().replace('_', ' ')}" for name, count in monitor.reasons.most_common()
    )
    yield (
        f"{chain.received} frames received: {chain.solved} used, {chain.marked} not used"
        f"{f' ({why})' if why else ''}"
    )
    for name, clock in session.arrivals.of.items():
        if clock.missing:
            yield f"stream {name}: {clock.missing} samples not received"
        if clock.unused:
            yield f"stream {name}: {clock.unused} samples not used: late, repeated, or untimed"
    unit = f"{NOUNS[condition.unit]}s"
    yield f"{condition.cycles} {unit} of both feet used, {condition.used} of one foot"
    yield from monitor.residuals()
    if monitor.during_stop:
        yield f"{monitor.during_stop} {unit} not used: measured while the light showed stop"
    for reason, count in condition.left_out.most_common():
        yield f"{count} {unit} not used: {reason}"
    if not chain.received:
        yield f"stream {chain.stream.name}: no frame received; does its program measure?"
    else:
        yield (
            f"from arrival to results: median {monitor.latency_ms(50):.2f} ms, 99 % within "
            f"{monitor.latency_ms(99):.2f} ms"
        )
    for note, times in monitor.raised.values():
        yield f"warning, {times} times: {note}" if times > 1 else f"warning: {note}"
    if session.fault is not None:
        yield f"ended by itself: {session.fault}"
    if recorder.fault is not None:
        yield f"{recorder.fault}; {recorder.lost} entries are missing"
    yield f"recorded: {folder / STREAMS} (any command reads it), {folder / RESULTS_FOLDER}"
