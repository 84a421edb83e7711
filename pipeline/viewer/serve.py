"""Recordings in the viewer's window, or served to a browser on this machine only."""

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
MAX_START_S: Final = 30.0
"""A first start on a slow disk takes about ten seconds."""
MAX_STOP_S: Final = 5.0
"""After this, the viewer is killed."""
POLL_S: Final = 0.05
MAX_REASON: Final = 200
"""Characters of the viewer's own message about its failure."""
WITHOUT_SCREEN: Final = "serve to a browser (--web) or save a file (--save)"
"""What a person can do with recordings where there is no screen."""
SIGNAL_EXIT: Final = 128
"""A process ended by signal N exits with this plus N, as in a shell."""


@dataclass(frozen=True, slots=True)
class Served:
    """Recordings that are being served: the page to open, and the server."""

    address: str
    process: subprocess.Popen[bytes]


def view(
    paths: Sequence[Path], *, web: bool = False, announce: Callable[[str], object] = print
) -> None:
    """Show recordings until their window is closed, or until Ctrl-C if they are served.

    Parameters
    ----------
    paths
        Recordings, ``.rrd``.
    web
        Serve them to a browser on this machine instead of opening a window.
    announce
        Called with a sentence that says where they are served.

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

    Served recordings have no password. Pages of other sites may not read them: Rerun answers only
    pages of this machine (CORS). But Rerun 0.41 does not check the ``Host`` header and has no
    option for it, so a site that knows the port, which is another one each time, and lets its own
    name point to this machine (DNS rebinding) could read them while they are served.
    """
    before = signal.signal(signal.SIGTERM, _exit)
    try:
        if web:
            with web_viewer(paths) as served, suppress(KeyboardInterrupt):
                announce(f"serving {_count(paths)} at {served.address} (stop with Ctrl-C)")
                served.process.wait()
        else:
            _require_files(paths)
            with running_viewer(["--port", "auto", *map(str, paths)]) as process:
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
    _require_files(paths)
    data, page = free_ports(2)
    ports = ["--port", str(data), "--web-viewer-port", str(page)]
    with running_viewer(["--serve-web", *ports, *map(str, paths)], (data, page)) as process:
        yield Served(page_address(data, page), process)


def data_address(port: int) -> str:
    """Give the address at which a viewer, or its server, on this machine takes and gives data."""
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def page_address(data: int, page: int) -> str:
    """Give the page that shows in a browser what a port serves."""
    return f"http://{LOOPBACK}:{page}/?url={quote(data_address(data), safe='')}"


@contextmanager
def running_viewer(
    arguments: Sequence[str], ports: Sequence[int] = (), *, without_screen: str = WITHOUT_SCREEN
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer's own binary, since its wrapper would leave it running; stop it in the end.

    Parameters
    ----------
    arguments
        Of the command line.
    ports
        Which answer before it is said to run.
    without_screen
        What a person can do where there is no screen.

    Yields
    ------
    subprocess.Popen
        The running viewer.

    Raises
    ------
    OSError
        If it does not start, or has failed.
    """
    quiet = os.environ | {"RUST_LOG": "error", "NO_COLOR": "1"}
    quiet["CI"] = "1"  # the switch for no statistics
    with TemporaryFile() as output:
        process = subprocess.Popen(
            [viewer_binary(), "--bind", LOOPBACK, *arguments],
            env=quiet,
            stdout=output,
            stderr=output,
        )
        try:
            for port in ports:
                _wait_for(port, process)
            _refuse_failure(process, output, without_screen)
            yield process
            _refuse_failure(process, output, without_screen)
        finally:
            process.terminate()
            try:
                process.wait(MAX_STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _refuse_failure(
    process: subprocess.Popen[bytes], output: IO[bytes], without_screen: str
) -> None:
    if process.poll() in (None, 0, -signal.SIGINT, -signal.SIGTERM):
        return
    if process.returncode < 0:
        raise OSError(f"the viewer was ended by {signal.Signals(-process.returncode).name}")
    output.seek(0)
    lines = output.read().decode(errors="replace").strip().splitlines()
    reason = lines[-1][:MAX_REASON] if lines else process.returncode
    raise OSError(f"the viewer failed: {reason}; where there is no screen, {without_screen}")


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


def _require_files(paths: Sequence[Path]) -> None:
    if not paths:
        raise ValueError("no recordings to show; name some .rrd files")
    for path in paths:
        if not path.is_file():
            raise FileNotFoundError(f"no recording {path}; 'hbm view --save' writes one")


def _count(paths: Sequence[Path]) -> str:
    return "1 recording" if len(paths) == 1 else f"{len(paths)} recordings"


def free_ports(count: int) -> list[int]:
    """Give ports of this machine that nothing listens on."""
    sockets = [socket.create_server((LOOPBACK, 0)) for _ in range(count)]
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def _wait_for(port: int, process: subprocess.Popen[bytes]) -> None:
    """Wait until a port answers or the process has ended."""
    deadline = time.monotonic() + MAX_START_S
    while process.poll() is None:
        with suppress(OSError), socket.create_connection((LOOPBACK, port), timeout=1):
            return
        if time.monotonic() > deadline:
            raise TimeoutError(
                f"the viewer did not answer on port {port} within {MAX_START_S:.0f} s"
            )
        time.sleep(POLL_S)


def _exit(number: int, frame: object) -> None:
    raise SystemExit(SIGNAL_EXIT + number)
