"""Recordings shown: in a window, or served to a browser on this machine only."""

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Final
from urllib.parse import quote

import rerun_cli  # type: ignore[import-untyped]

LOOPBACK: Final = "127.0.0.1"
START_S: Final = 30.0
STOP_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Served:
    """Recordings that are being served: the page to open, and the server."""

    address: str
    process: subprocess.Popen[bytes]


def view(
    paths: Sequence[Path], *, web: bool = False, tell: Callable[[str], object] = print
) -> None:
    """Show recordings until their window is closed, or until Ctrl-C if they are served.

    Parameters
    ----------
    paths
        Recordings, ``.rrd``.
    web
        Serve them to a browser on this machine instead of opening a window.
    tell
        Takes the sentence that says where they are served.

    Raises
    ------
    ValueError
        If there is nothing to show.
    OSError
        If a recording is missing, or the viewer does not start or fails.

    Notes
    -----
    The viewer listens on the loopback address alone, which Rerun's Python server cannot, and sends
    no usage statistics. It ends with this process, unless that is killed outright.
    """
    before = signal.signal(signal.SIGTERM, _leave)
    try:
        if web:
            with web_viewer(paths) as served, suppress(KeyboardInterrupt):
                tell(f"serving {_count(paths)} at {served.address} (stop with Ctrl-C)")
                served.process.wait()
        else:
            _check(paths)
            with _viewer(["--port", "auto", *map(str, paths)]) as process:
                process.wait()
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def web_viewer(paths: Sequence[Path]) -> Iterator[Served]:
    """Serve recordings and the viewer itself to browsers on this machine.

    Parameters
    ----------
    paths
        Recordings, ``.rrd``.

    Yields
    ------
    Served
        Once both ports answer; the server is stopped on leaving.

    Raises
    ------
    ValueError
        If there is nothing to show.
    OSError
        If a recording is missing, or the server does not start or fails.
    """
    _check(paths)
    data, page = _free_ports(2)
    ports = ["--port", str(data), "--web-viewer-port", str(page)]
    with _viewer(["--serve-web", *ports, *map(str, paths)], (data, page)) as process:
        source = quote(f"rerun+http://{LOOPBACK}:{data}/proxy", safe="")
        yield Served(f"http://{LOOPBACK}:{page}/?url={source}", process)


@contextmanager
def _viewer(
    arguments: Sequence[str], ports: Sequence[int] = ()
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer's own binary, for its wrapper would leave it running; stop it in the end."""
    quiet = os.environ | {"CI": "1", "RUST_LOG": "error"}  # CI: the switch for no statistics
    with TemporaryFile() as said:
        process = subprocess.Popen(
            [viewer_binary(), "--bind", LOOPBACK, *arguments], env=quiet, stdout=said, stderr=said
        )
        try:
            for port in ports:
                _wait_for(port, process)
            _refuse_failure(process, said)
            yield process
            _refuse_failure(process, said)
        finally:
            process.terminate()
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _refuse_failure(process: subprocess.Popen[bytes], said: IO[bytes]) -> None:
    if process.poll() in (None, 0, -signal.SIGINT, -signal.SIGTERM):
        return
    said.seek(0)
    lines = said.read().decode(errors="replace").strip().splitlines()
    raise OSError(
        f"the viewer failed: {lines[-1] if lines else process.returncode}; where there is no "
        "screen, serve to a browser (--web) or save a file (--save)"
    )


def viewer_binary() -> str:
    """Give the path of the viewer's own binary, which comes with its Python package.

    Raises
    ------
    FileNotFoundError
        If it is not there.
    """
    folder = Path(rerun_cli.__file__).parent
    names = ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun")
    for name in names:
        if (folder / name).is_file():
            return str(folder / name)
    raise FileNotFoundError(
        f"no viewer in {folder}: expected one of {', '.join(names)}; install rerun-sdk again"
    )


def _check(paths: Sequence[Path]) -> None:
    if not paths:
        raise ValueError("no recordings to show; `hbm run` writes them to results/viewer")
    for path in paths:
        if not path.is_file():
            raise FileNotFoundError(f"no recording {path}; `hbm run` writes it")


def _count(paths: Sequence[Path]) -> str:
    return "1 recording" if len(paths) == 1 else f"{len(paths)} recordings"


def _free_ports(count: int) -> list[int]:
    sockets = [socket.create_server((LOOPBACK, 0)) for _ in range(count)]
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def _wait_for(port: int, process: subprocess.Popen[bytes]) -> None:
    """Wait until a port answers or the process has ended."""
    deadline = time.monotonic() + START_S
    while process.poll() is None:
        with suppress(OSError), socket.create_connection((LOOPBACK, port), timeout=1):
            return
        if time.monotonic() > deadline:
            raise TimeoutError(f"the viewer did not answer on port {port} within {START_S:.0f} s")
        time.sleep(0.05)


def _leave(number: int, frame: object) -> None:
    raise SystemExit(128 + number)
