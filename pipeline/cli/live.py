"""``hbm live``: its options, and replays."""

import time
from pathlib import Path
from typing import Annotated, Final

import typer

from pipeline.cli.terminal import PlainConsole

SHOWN_S: Final = 0.02
"""Between looks whether a replay has ended."""
RECEIVERS_S: Final = 60.0


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
    console = PlainConsole()
    if replay is not None:
        return _replay(replay, forces, record, speed, listen, study, console)
    if forces is not None or record is not None:
        raise ValueError("--forces and --record go with --replay")
    from pipeline.cli.live_session import run_session
    from pipeline.live.preparation import prepare

    prepared = prepare(study, subject, static, calibration)
    listen = listen or prepared.live.listen
    return run_session(prepared, console, out, pose, view, web, qualisys, listen, duration_s)


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
    except KeyboardInterrupt:
        console.print("stopped")
    finally:
        played.close()
    return 0
