"""One live session, from the search for its streams to its summary."""

import signal
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.console import Console

from hbm.spelling import listed
from pipeline.cli.live.following import follow
from pipeline.cli.live.summary import summary
from pipeline.cli.options import require_folder
from pipeline.cli.stopping import SIGNAL_EXIT, stoppable, terminable
from pipeline.cli.terminal import note_line
from pipeline.io.recording import Plate
from pipeline.live.frames.chain import LiveChain
from pipeline.live.monitor import Monitor
from pipeline.live.outlet import result_columns, result_outlet
from pipeline.live.preparation import PlacedPlates, PoseFinder, Preparation, PreparedBody
from pipeline.live.recording import Recorder, described_streams, require_new
from pipeline.live.session import RECEIVE_S, Session
from pipeline.live.sources.lsl import LslSource
from pipeline.live.sources.qualisys import QualisysSource
from pipeline.live.stream import Source
from pipeline.trial.result import PlateSurface

if TYPE_CHECKING:
    from pipeline.viewer.live import LiveView, Screen

TOLD_S: Final = 3.0
"""Between lines that say why there is no body yet."""
SEARCH_S: Final = 60.0
"""How long streams are searched for."""
MISSING_S: Final = 5.0
"""After it, it is said which streams are missing."""
ABSENT: Final = (
    "start what sends them, or state other names in [live] of study.toml; where they come from "
    "another computer, state the address of this one: --listen"
)


def run_session(
    prepared: Preparation,
    console: Console,
    out: Path | None,
    pose: bool,
    shown: bool,
    web: bool,
    qualisys: str | None,
    listen: str,
    duration_s: float | None,
) -> int:
    """Receive, compute, record, send and show until it is stopped.

    Parameters
    ----------
    prepared
        What is stated of the session.
    console
        For all that is said.
    out
        New folder for the recording; by default live/ and the time.
    pose
        Whether the subject shows the calibration pose now.
    shown, web
        Whether the body is shown in a window, or to a browser.
    qualisys
        Address of Qualisys Track Manager; else streams are those of LSL.
    listen
        Address of this computer at which they are searched for.
    duration_s
        It ends after so long; by default it is stopped.

    Returns
    -------
    int
        Exit code: 0; 1 where no frame came, the recording is not whole or the source failed; 143
        where it was terminated.

    Raises
    ------
    ValueError, OSError
        As what is received, prepared and recorded raises them. One line.
    """
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
        terminated = follow(session, monitor, recorder, view, console, duration_s, ending)
        stack.close()
        for text in summary(chain, monitor, session, recorder, folder):
            console.print(text, soft_wrap=True)
    if terminated:
        return SIGNAL_EXIT + signal.SIGTERM
    failed = session.fault is not None or recorder.fault is not None or not chain.counts.received
    return int(failed)


def _source(prepared: Preparation, qualisys: str | None, listen: str, console: Console) -> Source:
    if qualisys is not None:
        console.print(f"connecting to Qualisys Track Manager at {qualisys}", soft_wrap=True)
        return QualisysSource(qualisys, stated=prepared.stated)
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


def missing_teller(console: Console) -> Callable[[Sequence[str], Sequence[str]], None]:
    """Give what says which streams are missing, after a few seconds and when that changes."""
    began_s, told = time.monotonic(), ""

    def tell(absent: Sequence[str], there: Sequence[str]) -> None:
        nonlocal told
        missing = f"missing: {listed(absent)}; there: {listed(sorted(there))}"
        if missing != told and time.monotonic() - began_s > MISSING_S:
            told = missing
            console.print(
                f"{missing}; searching for {SEARCH_S:g} s (stop with Ctrl-C)", soft_wrap=True
            )

    return tell


def _shown(
    prepared: Preparation, placed: PlacedPlates, source: Source, console: Console
) -> PreparedBody:
    """Wait until the subject shows the calibration pose, and build the body from it."""
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


def _view(chain: LiveChain, plates: Sequence[Plate], screen: "Screen") -> "LiveView":
    """Open the viewer."""
    from pipeline.viewer.live import LiveView

    return LiveView(
        chain.body,
        [PlateSurface(plate.number, plate.center, plate.corners) for plate in plates],
        chain.stream.labels,
        chain.ground.variants,
        screen=screen,
        contact_threshold_n=chain.settings.contact_threshold_n,
    )
