"""``hbm live``: its options, and replays."""

import time
from pathlib import Path
from typing import Final

from pipeline.cli.options import takes
from pipeline.cli.request import LiveRequest
from pipeline.cli.terminal import PlainConsole

RECEIVERS_S: Final = 60.0


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
    from pipeline.io.read_options import ReadOptions
    from pipeline.live.replay import Replay

    study = read_study(request.study, recordings=False) if request.study else None
    options, live = (study.options, study.file.live) if study else (ReadOptions(), Live())
    recording = read_recording(path, options, request.forces, record=request.record)
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
            time.sleep(0.02)
        console.say("the recording has ended; end the other 'hbm live' with Ctrl-C")
    except KeyboardInterrupt:
        console.print("stopped")
    finally:
        played.close()
    return 0
