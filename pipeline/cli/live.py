"""The same numbers while the subject walks, on the command line."""

import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rich.console import Console

    from pipeline.io.recording import Plate
    from pipeline.live.frames.chain import LiveChain
    from pipeline.live.frames.frame import LiveFrame
    from pipeline.live.places import PlacedPlates
    from pipeline.live.preparation import Preparation, PreparedBody
    from pipeline.live.recorder.recorder import Recorder
    from pipeline.live.session import Session
    from pipeline.live.stream import Source
    from pipeline.live.watch.cycles import LiveCycle
    from pipeline.live.watch.monitor import Monitor
    from pipeline.viewer.live import LiveView
    from pipeline.viewer.live_frames import Screen

SHOWN_S: Final = 0.02
"""Between looks at what is new."""
STATUS_S: Final = 0.5
TOLD_S: Final = 3.0
"""Between lines that say why there is no body yet."""
RECEIVERS_S: Final = 60.0
SEARCH_S: Final = 60.0
"""How long streams are searched for."""
MISSING_S: Final = 5.0
"""After it, it is said which streams are missing."""
ABSENT: Final = (
    "start what sends them, or state other names in [live] of study.toml; where they come from "
    "another computer, state the address of this one: --listen"
)
SWITCH_S: Final = 5e-4
"""After which another thread gets its turn: Python's own 5 ms would make frames late."""


def live(
    study: Annotated[
        Path | None, typer.Option(help="Folder of the study, whose study.toml has [live].")
    ] = None,
    subject: Annotated[str | None, typer.Option(help="Who walks; default: the only one.")] = None,
    static: Annotated[
        Path | None, typer.Option(help="Calibration pose, and places of the plates.")
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="Of the moving treadmill, in place of the study's.")
    ] = None,
    pose: Annotated[
        bool, typer.Option("--pose", help="Build the body from a pose that the subject shows now.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="New folder for streams and results; default: live/TIME.")
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Show the body in a window.")] = False,
    web: Annotated[bool, typer.Option("--web", help="Show the body to a browser here.")] = False,
    qualisys: Annotated[
        str | None, typer.Option(help="Address of Qualisys Track Manager, in place of LSL.")
    ] = None,
    listen: Annotated[
        str | None,
        typer.Option(help="This computer's address, to search streams at; default: the study's."),
    ] = None,
    duration_s: Annotated[
        float | None, typer.Option(min=0.1, help="Ends after so long; default: with Ctrl-C.")
    ] = None,
    replay: Annotated[
        Path | None, typer.Option(help="Play this recording as streams, and nothing else.")
    ] = None,
    forces: Annotated[
        Path | None, typer.Option(help="MOT file that goes with a TRC file of --replay.")
    ] = None,
    record: Annotated[
        Path | None, typer.Option(help="D-Flow record file that goes with --replay.")
    ] = None,
    speed: Annotated[float, typer.Option(min=0.01, max=20, help="Of --replay.")] = 1.0,
) -> int:
    """Compute residuals while the subject walks, from streams of LSL or of Qualisys.

    Everything is recorded; Ctrl-C ends with a summary. With --replay, play a recording as streams
    for another 'hbm live' to receive.
    """
    from pipeline.cli.terminal import plain_console

    console = plain_console()
    if replay is not None:
        return _replay(replay, forces, record, speed, listen, study, console)
    if forces is not None or record is not None:
        raise ValueError("--forces and --record go with --replay")
    from pipeline.live.preparation import prepare

    prepared = prepare(study, subject, static, calibration)
    listen = listen or prepared.live.listen
    return _run(prepared, console, out, pose, view, web, qualisys, listen, duration_s)


def _replay(
    path: Path,
    forces: Path | None,
    record: Path | None,
    speed: float,
    listen: str | None,
    study: Path | None,
    console: "Console",
) -> int:
    from pipeline.config.live import Live
    from pipeline.config.study import read_study
    from pipeline.io.read import read_as_stated
    from pipeline.io.stated import Stated
    from pipeline.live.replay import Replay

    read = read_study(study, recordings=False) if study is not None else None
    stated = read.stated if read is not None else Stated()
    recording = read_as_stated(path, stated, forces, record=record)
    live = read.file.live if read is not None else Live()
    played = Replay(recording, speed=speed, listen=listen or live.listen)
    console.print(
        f"playing {path.name} as {', '.join(played.names)}, once they are received or "
        f"{RECEIVERS_S:g} s have passed (stop with Ctrl-C)",
        soft_wrap=True,
    )
    try:
        if not played.start(RECEIVERS_S):
            absent = ", ".join(played.without_receiver)
            console.print(f"begun; nobody receives {absent}", soft_wrap=True)
        while not played.ended:
            time.sleep(SHOWN_S)
    except KeyboardInterrupt:
        console.print("stopped")
    finally:
        played.close()
    return 0


def _run(
    prepared: "Preparation",
    console: "Console",
    out: Path | None,
    pose: bool,
    shown: bool,
    web: bool,
    qualisys: str | None,
    listen: str,
    duration_s: float | None,
) -> int:
    from pipeline.cli.options import require_folder
    from pipeline.cli.stopping import SIGNAL_EXIT, stoppable, terminable
    from pipeline.cli.terminal import note_line
    from pipeline.live.frames.chain import LiveChain
    from pipeline.live.outlet import result_outlet
    from pipeline.live.recorder.descriptions import described_streams
    from pipeline.live.recorder.recorder import Recorder, require_new
    from pipeline.live.result_row import result_columns
    from pipeline.live.session import Session
    from pipeline.live.watch.monitor import Monitor

    folder = out or Path("live") / time.strftime("%Y-%m-%d_%H-%M-%S")
    require_folder(folder)
    require_new(folder)
    body = None if pose else prepared.body()
    with ExitStack() as ending, terminable(), ExitStack() as stack:
        with stoppable(lambda: "nothing was received, and nothing is recorded"):
            source = _source(prepared, qualisys, listen, console)
        stack.callback(source.close)
        names = ", ".join(f"{s.name} ({s.rate_hz:g} Hz)" for s in source.streams)
        console.print(f"receiving {names}", soft_wrap=True)
        placed = prepared.placed(source.plates)
        if body is None:
            body = _shown(prepared, placed, source, console)
        for note in (*prepared.notes, *placed.notes, *body.notes):
            console.print(note_line(note), soft_wrap=True)
        plates, laboratory, settings = placed.plates, prepared.laboratory, prepared.settings
        chain = LiveChain(body.body, laboratory, settings, placed.live, source.streams, plates)
        described = described_streams(source.streams, placed.live, plates)
        recorder = Recorder(folder, described, result_columns())
        stack.callback(recorder.close)
        outlet = None
        if qualisys is None:
            outlet = result_outlet(
                chain.stream.rate_hz,
                filter_delay_s=chain.filter_delay_s,
                resampling_delay_s=chain.wait_s,
                listen=listen,
            )
            stack.callback(outlet.close)
        session = Session(source, chain, recorder, outlet)
        view = _view(chain, plates, "browser" if web else "window") if shown or web else None
        if view is not None:
            stack.callback(view.close)
        monitor = Monitor(chain, plates)
        console.print(
            f"recording to {folder}; values are {1000 * chain.filter_delay_s:.0f} ms late by the "
            f"filter and {1000 * chain.wait_s:.0f} ms by resampling (stop with Ctrl-C)",
            soft_wrap=True,
        )
        terminated = _follow(session, monitor, recorder, view, console, duration_s, ending)
        stack.close()
        _summarise(chain, monitor, session, recorder, folder, console)
    if terminated:
        return SIGNAL_EXIT + signal.SIGTERM
    failed = session.fault is not None or recorder.fault is not None or not chain.counts.received
    return int(failed)


def _source(
    prepared: "Preparation", qualisys: str | None, listen: str, console: "Console"
) -> "Source":
    if qualisys is not None:
        from pipeline.live.sources.qualisys import QualisysSource

        console.print(f"connecting to Qualisys Track Manager at {qualisys}", soft_wrap=True)
        return QualisysSource(qualisys, stated=prepared.stated)
    from pipeline.live.sources.lsl import LslSource

    markers, analog = prepared.streams
    console.print(f"searching at {listen} for {', '.join((markers, *analog))}", soft_wrap=True)
    try:
        return LslSource(
            markers,
            analog,
            stated=prepared.stated,
            listen=listen,
            timeout_s=SEARCH_S,
            searching=missing_teller(console),
        )
    except ConnectionError as absent:
        absent.add_note(ABSENT)
        raise


def missing_teller(console: "Console") -> "Callable[[Sequence[str], Sequence[str]], None]":
    """Give what says which streams are missing, after a few seconds and when that changes."""
    from hbm.spelling import listed

    began_s, told = time.monotonic(), ""

    def tell(absent: "Sequence[str]", there: "Sequence[str]") -> None:
        nonlocal told
        missing = f"missing: {listed(absent)}; there: {listed(sorted(there))}"
        if missing != told and time.monotonic() - began_s > MISSING_S:
            told = missing
            console.print(
                f"{missing}; searching for {SEARCH_S:g} s (stop with Ctrl-C)", soft_wrap=True
            )

    return tell


def _shown(
    prepared: "Preparation", placed: "PlacedPlates", source: "Source", console: "Console"
) -> "PreparedBody":
    """Wait until the subject shows the calibration pose, and build the body from it."""
    from pipeline.live.pose import PoseFinder
    from pipeline.live.session import RECEIVE_S

    console.print(
        "stand still on the plates, arms out to the sides (stop with Ctrl-C)", soft_wrap=True
    )
    finder, told = PoseFinder(placed.live, source.streams, placed.plates), ""
    told_s = time.monotonic()
    while True:
        for samples in source.receive(RECEIVE_S):
            pose = finder.add(samples)
            if pose is None:
                continue
            try:
                return prepared.body(pose)
            except ValueError as error:
                finder.why_not = str(error)
        if finder.why_not != told and time.monotonic() - told_s > TOLD_S:
            told, told_s = finder.why_not, time.monotonic()
            console.print(f"no body yet: {told}", soft_wrap=True)


def _view(chain: "LiveChain", plates: "Sequence[Plate]", screen: "Screen") -> "LiveView":
    """Open the viewer."""
    from pipeline.trial.result import PlateSurface
    from pipeline.viewer.live import LiveView

    return LiveView(
        chain.body,
        [PlateSurface(plate.number, plate.center, plate.corners) for plate in plates],
        chain.stream.labels,
        chain.ground.variants,
        screen=screen,
        contact_threshold_n=chain.settings.contact_threshold_n,
    )


def _follow(
    session: "Session",
    monitor: "Monitor",
    recorder: "Recorder",
    view: "LiveView | None",
    console: "Console",
    duration_s: float | None,
    ending: ExitStack,
) -> bool:
    """Show what is new until it is stopped, by Ctrl-C, after a time, or by a fault.

    From then on until ``ending`` is closed nothing interrupts. Gives whether it was terminated.
    """
    from pipeline.cli.stopping import Terminated, uninterrupted

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


def take_new(session: "Session", monitor: "Monitor", view: "LiveView | None" = None) -> str:
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


def _show(view: "LiveView", frame: "LiveFrame", cycles: "Sequence[LiveCycle]") -> None:
    """Show a frame and the gait cycles that it ends."""
    from pipeline.viewer.live_frames import ShownFrame

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


def _tell(monitor: "Monitor", told: int, console: "Console") -> int:
    """Print the notes that are new; give how many there are now."""
    from pipeline.cli.terminal import note_line

    for timed in list(monitor.notes)[len(monitor.notes) - (monitor.noted - told) :]:
        console.print(note_line(timed.note), soft_wrap=True)
    return monitor.noted


def _summarise(
    chain: "LiveChain",
    monitor: "Monitor",
    session: "Session",
    recorder: "Recorder",
    folder: Path,
    console: "Console",
) -> None:
    """Say what was received, what came of it, and where it is."""
    from pipeline.live.recorder.recorder import RESULTS, STREAMS
    from pipeline.live.watch.monitor import in_words

    counts = chain.counts
    why = ", ".join(f"{count} {words(name)}" for name, count in monitor.reasons.most_common())
    lines = [
        f"{counts.received} frames received: {counts.solved} count, {counts.marked} do not"
        f"{f' ({why})' if why else ''}",
        f"{counts.late} frames late, {counts.doubled} samples doubled, {counts.out_of_order} out "
        "of order",
        *(f"{lost} samples of stream {name} never arrived" for name, lost in monitor.lost.items()),
    ]
    for variant, rms in monitor.condition.rms.items():
        limits = monitor.limits[variant]
        lines.append(
            f"residuals {variant}, {monitor.condition.cycles} gait cycles: RMS {in_words(rms)}; "
            f"peaks {limits.force_n:.0f} N (published limit {limits.max_force_n:.0f} N) and "
            f"{limits.moment_nm:.0f} N·m ({limits.max_moment_nm:.0f} N·m)"
        )
    if beside := monitor.condition.not_carried:
        lines.append(f"{beside} gait cycles left out: the plates did not carry the subject in them")
    if counts.received and not monitor.condition.cycles:
        lines.append("no gait cycle counts, so that no residuals are summed up")
    if not counts.received:
        lines.append(f"stream {chain.stream.name} has sent no frame: does its program measure?")
    else:
        lines.append(
            f"from arrival to results: median {monitor.latency_ms(50):.2f} ms, 99 % within "
            f"{monitor.latency_ms(99):.2f} ms"
        )
    if session.fault is not None:
        lines.append(f"ended by itself: {session.fault}")
    if recorder.fault is not None:
        lines.append(f"{recorder.fault}; {recorder.lost} entries are missing")
    lines.append(f"recorded: {folder / STREAMS} (any command reads it), {folder / RESULTS}")
    for text in lines:
        console.print(text, soft_wrap=True)


def words(reason: str) -> str:
    """Put a reason why frames do not count into words.

    Examples
    --------
    >>> words("FORCES_UNKNOWN")
    'forces unknown'
    """
    return reason.lower().replace("_", " ")
