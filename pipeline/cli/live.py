"""``hbm live``: its options, and replays."""

import time
from pathlib import Path
from typing import Annotated, Final

from typer import Option

from pipeline.cli.terminal import PlainConsole

SHOWN_S: Final = 0.02
"""Between looks whether a replay has ended."""
RECEIVERS_S: Final = 60.0


def live(
    study: Annotated[Path | None, Option(help="Folder of the study, with [live].")] = None,
    subject: Annotated[str | None, Option(help="Who walks; default: the only one.")] = None,
    static: Annotated[Path | None, Option(help="Calibration pose, and places of plates.")] = None,
    calibration: Annotated[Path | None, Option(help="In place of the study's.")] = None,
    pose: Annotated[bool, Option("--pose", help="Build the body from a pose shown now.")] = False,
    out: Annotated[Path | None, Option(help="New folder; default: live/TIME.")] = None,
    view: Annotated[bool, Option("--view", help="Show the body in a window.")] = False,
    web: Annotated[bool, Option("--web", help="Show the body to a browser here.")] = False,
    qualisys: Annotated[str | None, Option(help="ADDRESS[:PORT] of QTM; not LSL.")] = None,
    listen: Annotated[str | None, Option(help="This computer's address for streams.")] = None,
    sender: Annotated[
        list[str] | None, Option(help="Computer to receive from, of several; repeatable.")
    ] = None,
    cycles: Annotated[
        int | None, Option(min=1, help="Gait cycles to measure; default: the study's, else 25.")
    ] = None,
    duration_s: Annotated[float | None, Option(min=0.1, help="Default: until Ctrl-C.")] = None,
    replay: Annotated[Path | None, Option(help="Only play this recording as streams.")] = None,
    forces: Annotated[Path | None, Option(help="MOT file of a TRC file to replay.")] = None,
    record: Annotated[Path | None, Option(help="D-Flow record file to replay.")] = None,
    speed: Annotated[float, Option(min=0.01, max=20, help="Of --replay.")] = 1.0,
) -> int:
    """Streams are those of LSL or of Qualisys.

    A light says whether to go on (good), to look or to stop, and why. Everything is recorded;
    Ctrl-C ends with a summary. With --replay, play a recording as streams for another 'hbm live'.
    """
    console = PlainConsole()
    if replay is not None:
        return _replay(replay, forces, record, speed, listen, study, console)
    if forces is not None or record is not None:
        raise ValueError("--forces and --record go with --replay")
    from pipeline.cli.live_session import Options, run_session
    from pipeline.live.monitor import REQUIRED
    from pipeline.live.preparation import prepare

    prepared = prepare(study, subject, static, calibration)
    address = listen or prepared.study.file.live.listen
    wanted = cycles or prepared.cycles or REQUIRED
    options = Options(out, pose, view, web, qualisys, address, sender or [], wanted, duration_s)
    return run_session(prepared, console, options)


def _replay(
    path: Path,
    forces: Path | None,
    record: Path | None,
    speed: float,
    listen: str | None,
    study: Path | None,
    console: PlainConsole,
) -> int:
    from pipeline.config.live import Live
    from pipeline.config.study import read_study
    from pipeline.io.read import read_recording
    from pipeline.io.stated import Stated
    from pipeline.live.replay import Replay

    read = read_study(study, recordings=False) if study is not None else None
    stated = read.stated if read is not None else Stated()
    recording = read_recording(path, stated, forces, record=record)
    live = read.file.live if read is not None else Live()
    played = Replay(recording, speed=speed, listen=listen or live.listen)
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
