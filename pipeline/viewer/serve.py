"""The viewer: in its own window, or as a page for browsers on this machine.

Rerun's own page posts usage statistics and asks three other hosts, and its servers answer whoever
knows their port. Its page has no switch for statistics: this one hands it a `fetch` that reaches
nothing but this server, and its policy allows nothing else. Requests that name another host are
refused, so that no site can let its own name point to this machine (DNS rebinding) and read a
recording.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from http.server import BaseHTTPRequestHandler
from importlib.resources import files
from mimetypes import guess_type
from pathlib import Path
from socketserver import ThreadingTCPServer
from tempfile import TemporaryFile
from typing import Final
from urllib.parse import unquote, urlsplit
from urllib.request import ProxyHandler, build_opener

import numpy as np
import rerun_cli  # type: ignore[import-untyped]
from pydantic_core import to_json

from pipeline.trial.residuals import AXES, HEALTHY_RMS, UNITS
from pipeline.viewer.live import FULL_SCALE, Board

LOOPBACK: Final = "127.0.0.1"
VIEWER_FILES: Final = {"/re_viewer.js": "text/javascript", "/re_viewer_bg.wasm": "application/wasm"}
"""Files of Rerun's page that this one needs, and their types."""
HEADERS: Final = {
    "Content-Security-Policy": "frame-ancestors 'self'",  # pages state what they may load
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
HTML: Final = "text/html"
STREAM: Final = "application/octet-stream"
LIGHT: Final = "/light"
Cursor = tuple[str, int]
"""Timeline and value on it: nanoseconds of "time", else a whole number."""
Content = Callable[[], Iterable[bytes]]
"""Gives what is served, in pieces, whenever it is asked for."""
Contents = dict[str, tuple[str, Content]]
"""Path -> type and content."""
Page = AbstractContextManager[str]
"""A page that is served, and its address."""
MAX_START_S: Final = 30.0
"""A first start on a slow disk takes about ten seconds."""
POLL_S: Final = 0.05
WITHOUT_SCREEN: Final = "serve to a browser (--web) or save a file (--save)"
"""What a person can do with recordings where there is no screen."""


def view(
    path: Path,
    *,
    web: bool = False,
    cursor: Cursor | None = None,
    others: Contents | None = None,
    announce: Callable[[str], object] = print,
) -> None:
    """Show a recording, ``.rrd``, from a cursor on; until Ctrl-C if it is served (``web``).

    A window is open until it is closed. What is served, with others, is announced in a sentence.
    The cursor is set in the running viewer, since Rerun 0.41 has no place for it in a file.

    Notes
    -----
    Nothing here sends usage statistics, and all listens on the loopback address alone, without a
    password. A window asks api.github.com for a newer version, and has a port at which Rerun 0.41
    answers whatever the ``Host`` header names; no option switches these off. It ends with this
    process, unless that is killed outright.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no recording {path}; 'hbm view --save' writes one")
    # as in a shell, a process ended by signal N exits with 128 + N
    before = signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        if web:
            page = page_server(viewer_files(), lambda: [path.read_bytes()], cursor, others)
            with page as address, suppress(KeyboardInterrupt):
                report = f", the report at {address}report.html" * (
                    "/report.html" in (others or {})
                )
                announce(f"serving {path.name} at {address}{report} (stop with Ctrl-C)")
                while True:
                    time.sleep(1)
        else:
            port = free_port()
            with running_viewer(["--port", str(port), str(path)], port) as process:
                if cursor is not None:
                    _move_cursor(cursor, port, process)
                process.wait()
    finally:
        signal.signal(signal.SIGTERM, before)


def _move_cursor(cursor: Cursor, port: int, process: subprocess.Popen[bytes]) -> None:
    """Move the cursor of a window as soon as it has the recording, unless it is closed before."""
    from rerun.experimental import ViewerClient  # takes long; live sessions do without

    deadline = time.monotonic() + MAX_START_S
    while process.poll() is None and time.monotonic() < deadline:
        with suppress(RuntimeError, ConnectionError):
            viewer = ViewerClient.connect(data_address(port))
            viewer.set_time(cursor[0], sequence=cursor[1], play_state="paused")
            return
        time.sleep(POLL_S)


def data_address(port: int) -> str:
    """Give the address at which a viewer, or its server, on this machine takes and gives data."""
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


@contextmanager
def running_viewer(
    arguments: Sequence[str], port: int | None = None, *, without_screen: str = WITHOUT_SCREEN
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer's own binary, since its wrapper would leave it running; stop it in the end.

    A port answers before it is said to run. An OSError says that it does not start or has failed,
    and what a person can do where there is no screen.
    """

    def refuse_failure() -> None:
        if process.poll() in (None, 0, -signal.SIGINT, -signal.SIGTERM):
            return
        if process.returncode < 0:
            raise OSError(f"the viewer was ended by {signal.Signals(-process.returncode).name}")
        output.seek(0)
        lines = output.read().decode(errors="replace").strip().splitlines()
        reason = lines[-1][:200] if lines else process.returncode
        raise OSError(f"the viewer failed: {reason}; where there is no screen, {without_screen}")

    quiet = os.environ | {"RUST_LOG": "error", "NO_COLOR": "1", "CI": "1"}  # CI: no statistics
    with TemporaryFile() as output:
        process = subprocess.Popen(
            [viewer_binary(), "--bind", LOOPBACK, *arguments],
            env=quiet,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )
        try:
            if port is not None:
                _wait_for(port, process)
            refuse_failure()
            yield process
            refuse_failure()
        finally:
            process.terminate()
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def viewer_binary() -> str:
    """Give the path of the viewer's own binary, which comes with its Python package."""
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
    """
    port = free_port()
    address = f"http://{LOOPBACK}:{port}"
    arguments = ["--serve-web", "--web-viewer-port", str(port), f"{address}/none.rrd"]
    opener = build_opener(ProxyHandler({}))
    contents = {}
    with running_viewer(arguments, port):
        for path in VIEWER_FILES:
            with opener.open(f"{address}{path}", timeout=MAX_START_S) as answer:
                contents[path] = answer.read()
    return contents


def free_port() -> int:
    """Give a port of this machine that nothing listens on."""
    with socket.create_server((LOOPBACK, 0)) as unused:
        return int(unused.getsockname()[1])


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


class GrowingRecording:
    """A recording that is served while it grows: its start, and as much of its end as is kept.

    More than the limit is not kept for pages that open later: the oldest pieces but the first go.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit, self._size, self._dropped = limit_bytes, 0, 0
        self._pieces: list[bytes] = []
        self._news = threading.Condition()

    def append(self, piece: bytes) -> None:
        """Add a piece that can be read without those before it, but for the first one."""
        with self._news:
            self._pieces.append(piece)
            self._size += len(piece)
            while self._size > self._limit and len(self._pieces) > 2:
                self._size -= len(self._pieces.pop(1))
                self._dropped += 1
            self._news.notify_all()

    def pieces(self) -> Iterator[bytes]:
        """Give the pieces as they come, without end; a slow reader misses those dropped."""
        number = 0
        while True:
            with self._news:
                while number >= self._dropped + len(self._pieces):
                    self._news.wait()
                number = number and max(number, self._dropped + 1)
                piece = self._pieces[number and number - self._dropped]
            yield piece
            number += 1


def results_contents(result: Path, recorded: Callable[[Path], Path]) -> Contents:
    """Give the page of a result; of a study's all pages, tables and, recorded when asked, trials.

    Pages show their links to the viewer.
    """
    page = result.with_suffix(".html")
    if result.parent.name != "trials":
        return {f"/{page.name}": _file(page)} if page.is_file() else {}
    folder = result.parent.parent
    files = [*folder.glob("*.*"), *result.parent.glob("*.html")]
    contents = {f"/{file.relative_to(folder).as_posix()}": _file(file) for file in files}
    for trial in result.parent.glob("*.parquet"):
        contents[f"/{trial.stem}.rrd"] = STREAM, partial(_recording, recorded, trial)
    return contents


def _file(file: Path) -> tuple[str, Content]:
    """Give the type of a file, and what reads it; pages are marked as those of the viewer."""
    if file.suffix == ".html":
        return HTML, lambda: [file.read_bytes().replace(b"<body>", b"<body data-viewer>")]
    return guess_type(file)[0] or STREAM, lambda: [file.read_bytes()]


def _recording(recorded: Callable[[Path], Path], result: Path) -> list[bytes]:
    """Record the trial of a result, and give the content of the file."""
    return [recorded(result).read_bytes()]


def page_server(
    viewer: Mapping[str, bytes],
    recording: Content,
    cursor: Cursor | None = None,
    others: Contents | None = None,
) -> Page:
    """Serve the viewer's files, by path, with a recording; give the address of the page."""
    of_viewer = {path: (kind, [viewer[path]].__iter__) for path, kind in VIEWER_FILES.items()}
    data: Contents = {"/recording.rrd": (STREAM, recording)}
    others = others or {}
    page = _page_files("viewer", "/", CURSOR=cursor, LIGHT=LIGHT in others)
    return serve(others | page | of_viewer | data)


def light_server(board: Callable[[], Board], host: str) -> Page:
    """Serve a page with the light, for a phone or a wall."""
    contents = light_contents(board)
    return serve(contents | {"/": contents[LIGHT]}, host)


def light_contents(board: Callable[[], Board]) -> Contents:
    """Give the page with the light, and the board that it asks for."""
    bars = {"axes": AXES, "units": UNITS, "limits": HEALTHY_RMS, "full": FULL_SCALE}

    def content() -> list[bytes]:
        return [to_json(bars | {"board": board()}, fallback=np.ndarray.tolist)]

    return _page_files("light", LIGHT) | {"/board.json": ("application/json", content)}


def _page_files(name: str, path: str, **values: object) -> Contents:
    """Give a page of the program, at a path, and its script, in which names become values."""
    folder = files("pipeline.viewer") / "pages"
    script = (folder / f"{name}.js").read_bytes()
    for key, value in values.items():
        script = script.replace(key.encode(), json.dumps(value).encode())
    return {
        path: (HTML, [(folder / f"{name}.html").read_bytes()].__iter__),
        f"/{name}.js": ("text/javascript", [script].__iter__),
    }


@contextmanager
def serve(contents: Contents, host: str = LOOPBACK) -> Iterator[str]:
    """Serve contents, by path, at an address of this computer; give the address of the page."""
    try:
        listening = _Server(contents, host)
    except OSError as error:
        raise ValueError(f"{host} is no address of this computer ({error.strerror})") from error
    with listening as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://{host}:{server.port}/"
        finally:
            server.shutdown()


class _Server(ThreadingTCPServer):
    """Answers at one address, each request in a thread of its own."""

    daemon_threads = True

    def __init__(self, contents: Contents, host: str) -> None:
        super().__init__((host, 0), _Handler)
        self.contents, self.port = contents, int(self.server_address[1])
        names = (host, "localhost") if host == LOOPBACK else (host,)
        self.hosts = [[f"{name}:{self.port}"] for name in names]

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing where a browser has gone away."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def parse_request(self) -> bool:
        """Refuse what is not asked of this server by its address, whatever the method and path."""
        if not super().parse_request():
            return False
        if self.headers.get_all("Host") in self.server.hosts:
            return True
        self.send_error(403, "Only for pages of this machine")
        return False

    def do_GET(self) -> None:
        kind, content = self.server.contents.get(unquote(urlsplit(self.path).path), ("", None))
        if content is None:
            self.send_error(404)
            return
        self.send_response(200)
        for name, value in {**HEADERS, "Content-Type": kind}.items():
            self.send_header(name, value)
        self.end_headers()
        with suppress(ConnectionError):
            for piece in content():
                self.wfile.write(piece)

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing of requests."""
