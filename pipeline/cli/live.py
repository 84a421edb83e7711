"""``hbm live``: its options, and replays."""

import time
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field

from pipeline.cli.options import takes
from pipeline.cli.terminal import PlainConsole
from pipeline.config.input_model import InputModel

SHOWN_S: Final = 0.02
"""Between looks whether a replay has ended."""
RECEIVERS_S: Final = 60.0


class LiveRequest(InputModel):
    """How a session is run, or a recording replayed, as typed."""

    study: Path | None = None
    """Folder of the study, with [live]."""
    subject: str | None = None
    """Who walks; default: the only one."""
    static: Path | None = None
    """Calibration pose, and places of plates."""
    calibration: Path | None = None
    """In place of the study's."""
    pose: bool = False
    """Build the body from a pose shown now."""
    out: Path | None = None
    """New folder; default: live/TIME."""
    view: bool = False
    """Show the body in a window."""
    web: bool = False
    """Show the body to a browser here."""
    qualisys: str | None = None
    """ADDRESS[:PORT] of QTM; not LSL."""
    listen: str | None = None
    """This computer's address for streams; default: the study's."""
    sender: tuple[str, ...] = ()
    """Computer to receive from, of several; repeatable."""
    cycles: Annotated[int, Field(ge=1)] | None = None
    """Gait cycles to measure; default: the study's, else 25."""
    duration_s: Annotated[float, Field(ge=0.1)] | None = None
    """Default: until Ctrl-C."""
    replay: Path | None = None
    """Only play this recording as streams."""
    forces: Path | None = None
    """MOT file of a TRC file to replay."""
    record: Path | None = None
    """D-Flow record file to replay."""
    speed: Annotated[float, Field(ge=0.01, le=20)] = 1.0
    """Of --replay."""


@takes(LiveRequest)
def live(request: LiveRequest) -> int:
    """Streams are those of LSL or of Qualisys.

    A light says whether to go on (good), to look or to stop, and why. Everything is recorded;
    Ctrl-C ends with a summary. With --replay, play a recording as streams for another 'hbm live'.
    """
    if request.replay is not None:
        return _replay(request, request.replay, PlainConsole())
    if request.forces is not None or request.record is not None:
        raise ValueError("--forces and --record go with --replay")
    from pipeline.cli.live_session import run_session

    return run_session(request, PlainConsole())


def _replay(request: LiveRequest, path: Path, console: PlainConsole) -> int:
    from pipeline.config.live import Live
    from pipeline.config.study import read_study
    from pipeline.io.read import read_recording
    from pipeline.io.stated import Stated
    from pipeline.live.replay import Replay

    study = read_study(request.study, recordings=False) if request.study else None
    stated, live = (study.stated, study.file.live) if study else (Stated(), Live())
    recording = read_recording(path, stated, request.forces, record=request.record)
    played = Replay(recording, speed=request.speed, listen=request.listen or live.listen)
    console.say(
        f"playing {path.name} as {', '.join(played.names)}, once they are received or "
        f"{RECEIVERS_S:g} s have passed (stop with Ctrl-C)"
    )
    try:
        if not played.start(RECEIVERS_S):
            absent = ", ".join(played.without_receiver)
            console.say(f"begun; nobody receives {absent}")
        while not played.ended:
            time.sleep(SHOWN_S)
        console.say("the recording has ended; end the other 'hbm live' with Ctrl-C")
    except KeyboardInterrupt:
        console.print("stopped")
    finally:
        played.close()
    return 0
