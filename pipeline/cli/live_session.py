"""One live session: what is new is shown and said as it comes, and summed up at its end."""

import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from rich.status import Status
from rich.text import Text

from hbm.model import Body
from hbm.notes import Note
from hbm.spelling import listed
from pipeline.cli.options import require_folder
from pipeline.cli.request import LiveRequest
from pipeline.cli.stopping import SIGNAL_EXIT, stoppable, terminable
from pipeline.cli.terminal import PlainConsole
from pipeline.config.schema import NOUNS
from pipeline.io.write import write_text
from pipeline.live import output
from pipeline.live.chain import LiveChain
from pipeline.live.light import Finding
from pipeline.live.lsl import LslSource
from pipeline.live.monitor import LIMITS, Monitor, senders
from pipeline.live.preparation import (
    PlacedPlates,
    PoseFinder,
    Preparation,
    place_plates,
    prepare,
)
from pipeline.live.qualisys import PORT, QualisysSource
from pipeline.live.session import RECEIVE_S, Session
from pipeline.live.stream import Source
from pipeline.run.processes import recorded_requests
from pipeline.viewer.live import STARTING, LiveScene, LiveView, Screen, ShownFrame
from pipeline.viewer.serve import light_server


def run_session(request: LiveRequest, console: PlainConsole) -> int:
    """Receive, compute, record, send and show until it is stopped.

    Gives the exit code: 0; 1 where no frame came, the recording is not whole or the source failed;
    143 where it was terminated. A ValueError or OSError, of one line, as what is received, prepared
    and recorded raises them.
    """
    prepared = prepare(request.study, request.subject, request.static, request.calibration)
    folder = request.out or Path("live") / time.strftime("%Y-%m-%d_%H-%M-%S")
    require_folder(folder)
    output.require_new(folder)
    body = None if request.pose else prepared.body()
    if body is not None and prepared.static is not None:
        console.say(f"calibration pose: {prepared.static.source.name}")
    live = prepared.study.file.live
    required = request.cycles or prepared.cycles or LIMITS.required_cycles
    news, listen = deque[Finding](), request.listen or live.listen
    with ExitStack() as ending, terminable(), ExitStack() as stack:
        stack.enter_context(line := LightLine(console, required))
        page = stack.enter_context(light_server(lambda: line.board, request.page_host))
        console.say(f"light for a phone or wall: {page} (--page-host opens it to a network)")
        with stoppable(lambda: "nothing was received, and nothing is recorded"):
            if request.qualisys is not None:
                source: Source = _qualisys(request.qualisys, prepared, line, news.append)
            else:
                source = _lsl(prepared, listen, request.sender, line)
        stack.callback(source.close)
        console.say(f"receiving {senders(source.streams)}")
        placed = place_plates(source.plates, prepared.static, live)
        subject, notes = body or _shown(prepared, placed, source, line)
        console.say_notes((*prepared.notes, *placed.notes, *notes))
        plates, laboratory = placed.plates, prepared.laboratory
        settings = prepared.study.file.settings
        chain = LiveChain(subject, laboratory, settings, placed.live, source.streams, plates)
        described = [output.describe_stream(s, placed.live, plates) for s in source.streams]
        recorder = output.Recorder(folder, described, output.result_columns())
        stack.callback(recorder.close)
        outlet = None
        if request.qualisys is None:
            outlet = output.result_outlet(
                chain.stream.rate_hz,
                filter_delay_s=chain.filter_delay_s,
                resampling_delay_s=chain.wait_s,
                listen=listen,
            )
            stack.callback(outlet.close)
        session = Session(source, chain, recorder, outlet)
        view = None
        if request.view or request.web:
            screen: Screen = "browser" if request.web else "window"
            of_chain = chain.body, plates, chain.stream.labels, chain.ground.variants
            view = LiveView(LiveScene(*of_chain, screen, settings.contact_threshold_n))
            stack.callback(view.close)
        monitor = Monitor(chain, plates, lambda note: console.say_notes((note,)), required)
        console.say(
            f"recording to {folder}; delay {1000 * chain.filter_delay_s:.0f} ms of the filter and "
            f"{1000 * chain.wait_s:.0f} ms of resampling (stop with Ctrl-C)"
        )
        requests = ending.enter_context(recorded_requests())
        began = time.monotonic()

        def goes_on() -> bool:
            in_time = not request.duration_s or time.monotonic() - began < request.duration_s
            return session.runs and not requests and in_time

        follow(session, source, monitor, recorder, view, line, goes_on, news)
        stack.close()
        lines = [*summary(chain, monitor, session, recorder, folder)]
        for text in lines:
            console.say(text)
        with suppress(OSError):  # of a full disk, which the recorder reports
            write_text("\n".join(lines) + "\n", folder / output.SUMMARY)
    if signal.SIGTERM in requests[:1]:
        return SIGNAL_EXIT + signal.SIGTERM
    failed = session.fault is not None or recorder.fault is not None or not chain.received
    return int(failed)


def _qualisys(
    address: str, prepared: Preparation, line: "LightLine", say: Callable[[Finding], object]
) -> Source:
    """Connect to Qualisys Track Manager."""
    line.wait(f"Connecting to Qualisys Track Manager at {address}")
    host, colon, port = address.partition(":")
    if colon and not port.isdecimal():
        raise ValueError(f"--qualisys {address}: expected ADDRESS or ADDRESS:PORT")
    return QualisysSource(host, port=int(port or PORT), options=prepared.study.options, say=say)


def _lsl(prepared: Preparation, listen: str, senders: Sequence[str], line: "LightLine") -> Source:
    """Search for streams, of the wanted senders where several send them."""
    markers, analog = prepared.streams
    line.say(f"searching at {listen} for {', '.join((markers, *analog))}")
    line.wait_for_streams((markers, *analog), ())
    try:
        return LslSource(
            markers,
            analog,
            options=prepared.study.options,
            listen=listen,
            timeout_s=60.0,
            searching=line.wait_for_streams,
            senders=senders,
        )
    except ConnectionError as absent:
        absent.add_note(
            "start the program that sends them, or write their names in [live] of study.toml; if "
            "another computer sends them, give the address of this one: --listen"
        )
        raise


def _shown(
    prepared: Preparation, placed: PlacedPlates, source: Source, line: "LightLine"
) -> tuple[Body, tuple[Note, ...]]:
    """Wait until the subject shows the calibration pose, and build the body from it."""
    line.say("stand still on the plates, arms out to the sides (stop with Ctrl-C)")
    finder = PoseFinder(placed.live, source.streams, placed.plates)
    while True:
        for samples in source.receive(RECEIVE_S):
            pose = finder.add(samples)
            if pose is None:
                continue
            try:
                return prepared.body(pose)
            except ValueError as error:
                finder.why_not = str(error)
        line.wait(f"No body yet: {finder.why_not}")


STATUS_S: Final = 0.5
STYLES: Final = {
    "GOOD": "bold white on green",
    "LOOK": "bold black on yellow",
    "STOP": "bold white on red",
}
"""Of the light."""
LINES_S: Final = 5.0
"""Between lines of one light where no terminal updates them."""


class LightLine(Status):
    """Light and sentence in one line; without a terminal, lines now and then."""

    def __init__(self, console: PlainConsole, required: int) -> None:
        super().__init__("", console=console)
        self.say, self._light, self._said_s = console.say, "", -LINES_S
        self.board = replace(STARTING, done=f"0 / {required} gait cycles")

    def wait(self, sentence: str) -> None:
        """Say what is awaited before the first frame."""
        self.board = replace(self.board, sentence=sentence)
        self.show(f"LOOK: {sentence} · {self.board.done}")

    def wait_for_streams(self, absent: Sequence[str], there: Sequence[str]) -> None:
        """Say which streams are awaited, and which others there are."""
        others = f"; there: {listed(sorted(there))}" * bool(there)
        self.wait(f"Waiting for stream{'s' * (len(absent) > 1)} {listed(absent)}{others}")

    def show(self, status: str) -> None:
        """Show a status; the light is what stands before its colon."""
        light, sentence = status.split(":", 1)
        self.update(Text.assemble((f" {light} ", STYLES[light]), sentence))
        due = light != self._light or time.monotonic() - self._said_s > LINES_S
        if due and not self.console.is_interactive:
            self.say(status)
            self._light, self._said_s = light, time.monotonic()


def follow(
    session: Session,
    source: Source,
    monitor: Monitor,
    recorder: output.Recorder,
    view: LiveView | None,
    line: LightLine,
    goes_on: Callable[[], bool],
    news: deque[Finding],
) -> None:
    """Show what is new, of frames and the source, until it does not go on."""
    before = sys.getswitchinterval()
    # other threads get their turn sooner than after Python's 5 ms, which would make frames late
    sys.setswitchinterval(5e-4)
    shown_s = time.monotonic()
    address, recorded = "", True
    session.start()
    try:
        while goes_on():
            time.sleep(0.02)
            take_new(session, monitor, view)
            while news:
                monitor.hear(news.popleft())
            if view is not None and view.fault is not None:
                line.say(f"nothing is shown any more: {view.fault}; all else goes on")
                view = None
            if recorded and recorder.fault is not None:
                recorded = False
                line.say(f"{recorder.fault}; all else goes on")
            monitor.look_for_silence()
            if time.monotonic() - shown_s < STATUS_S:
                continue
            shown_s = time.monotonic()
            late_s = view.late_s if view is not None else 0.0
            late = f" · picture {late_s:.1f} s late" * (late_s > 0.5)
            line.show(monitor.status() + late)
            line.board = monitor.board(source.streams)
            if view is not None:
                view.show_board(line.board)
                if view.address and not address:
                    address = view.address
                    line.say(f"open {address} in a browser on this machine")
    finally:
        session.stop()
        sys.setswitchinterval(before)
    take_new(session, monitor)


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
    chain: LiveChain, monitor: Monitor, session: Session, recorder: output.Recorder, folder: Path
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
    streams, results = folder / output.STREAMS, folder / output.RESULTS_FOLDER
    yield f"recorded: {streams} (any command reads it), {results}"
