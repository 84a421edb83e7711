"""The viewer's own process, and recordings in its window or in a browser on this machine."""

import os
import signal
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Final
from urllib.request import ProxyHandler, build_opener

import rerun_cli  # type: ignore[import-untyped]

from pipeline.viewer.page import LOOPBACK, VIEWER_FILES, page_server

MAX_START_S: Final = 30.0
"""A first start on a slow disk takes about ten seconds."""
MAX_STOP_S: Final = 5.0
"""After this, the viewer is killed."""
POLL_S: Final = 0.05
FILE_HEADER_BYTES: Final = 12
"""Of a Rerun recording: its format, version and options."""
MESSAGE_HEADER: Final = struct.Struct("<QQ")
"""Of each message in it: its kind, and the bytes that follow."""
ENDS_FILE, OPENS_RECORDING = 0, 1
"""Kinds of message; the others hold data."""
MAX_REASON: Final = 200
"""Characters of the viewer's own message about its failure."""
WITHOUT_SCREEN: Final = "serve to a browser (--web) or save a file (--save)"
"""What a person can do with recordings where there is no screen."""
SIGNAL_EXIT: Final = 128
"""A process ended by signal N exits with this plus N, as in a shell."""


def view(
    paths: Sequence[Path], *, web: bool = False, announce: Callable[[str], object] = print
) -> None:
    """Show recordings until their window is closed, or until Ctrl-C if they are served.

    Parameters
    ----------
    paths
        Recordings, ``.rrd``; the first one is shown first.
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
    The viewer shows the recording that was opened last. Given several files or addresses, it reads
    them at once, and any may be the last; so it receives all as one stream, which opens the first
    recording last, before any data.

    Nothing here sends usage statistics, and all listens on the loopback address alone. A page is
    served as `pipeline.viewer.page` says, without a password. A window asks api.github.com for a
    newer version, and has a port at which Rerun 0.41 answers whatever the ``Host`` header names; no
    option switches these off. It ends with this process, unless that is killed outright.
    """
    _require_files(paths)
    before = signal.signal(signal.SIGTERM, _exit)
    try:
        if web:
            page = page_server(viewer_files(), lambda: _contents(paths))
            with page as address, suppress(KeyboardInterrupt):
                announce(f"serving {_count(paths)} at {address} (stop with Ctrl-C)")
                while True:
                    time.sleep(1)
        else:
            with running_viewer(["--port", "auto", "-"]) as process:
                assert process.stdin is not None
                with suppress(BrokenPipeError), process.stdin as pipe:
                    for piece in _contents(paths):
                        pipe.write(piece)
                process.wait()
    finally:
        signal.signal(signal.SIGTERM, before)


def data_address(port: int) -> str:
    """Give the address at which a viewer, or its server, on this machine takes and gives data."""
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


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
            stdin=subprocess.PIPE,
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


def viewer_files() -> dict[str, bytes]:
    """Get the files of the viewer's page from its server, since its binary alone holds them.

    Started with the address of a recording, the server opens no port for others.

    Raises
    ------
    OSError
        If the server does not start, or does not give them.
    """
    (port,) = free_ports(1)
    address = f"http://{LOOPBACK}:{port}"
    arguments = ["--serve-web", "--web-viewer-port", str(port), f"{address}/none.rrd"]
    opener = build_opener(ProxyHandler({}))
    files = {}
    with running_viewer(arguments, (port,)):
        for path in VIEWER_FILES:
            with opener.open(f"{address}{path}", timeout=MAX_START_S) as answer:
                files[path] = answer.read()
    return files


def _require_files(paths: Sequence[Path]) -> None:
    if not paths:
        raise ValueError("no recordings to show; name some .rrd files")
    for path in paths:
        if not path.is_file():
            raise FileNotFoundError(f"no recording {path}; 'hbm view --save' writes one")


def _contents(paths: Sequence[Path]) -> Iterator[bytes]:
    """Give recordings as one: what opens them in reverse order, then their data in order."""
    with paths[0].open("rb") as file:
        yield file.read(FILE_HEADER_BYTES)
    for path in reversed(paths):
        yield from (message for kind, message in _messages(path) if kind == OPENS_RECORDING)
    for path in paths:
        yield from (message for kind, message in _messages(path) if kind != OPENS_RECORDING)


def _messages(path: Path) -> Iterator[tuple[int, bytes]]:
    """Give the messages of a recording with their kinds."""
    with path.open("rb") as file:
        file.seek(FILE_HEADER_BYTES)
        while header := file.read(MESSAGE_HEADER.size):
            kind, size = MESSAGE_HEADER.unpack(header)
            if kind == ENDS_FILE:
                return
            yield kind, header + file.read(size)


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
