"""The viewer's page: the viewer and one recording, served to browsers on this machine.

Rerun's own page posts usage statistics and asks three other hosts, and its servers answer whoever
knows their port. This server's policy lets the page request nothing but what is served here, and
requests that name another host are refused, so that no site can let its own name point to this
machine (DNS rebinding) and read a recording.
"""

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Final
from urllib.parse import urlsplit

LOOPBACK: Final = "127.0.0.1"
VIEWER_FILES: Final = {"/re_viewer.js": "text/javascript", "/re_viewer_bg.wasm": "application/wasm"}
"""Files of Rerun's page that this one needs, and their types."""
HEADERS: Final = {
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
PAGE: Final = b"""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>Residuals</title>
<link rel="icon" href="data:,">
<style>
  html, body, canvas { margin: 0; width: 100%; height: 100%; overflow: hidden; }
  p { position: absolute; margin: 2em; font-family: sans-serif; }
  canvas { position: absolute; }
</style>
<p id="state">Loading the viewer</p>
<canvas id="canvas"></canvas>
<script src="re_viewer.js"></script>
<script src="start.js"></script>
</html>
"""
START: Final = b"""
async function start() {
  await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
  window.viewer = new wasm_bindgen.WebHandle({
    url: [new URL("recording.rrd", location.origin).href],
    render_backend: new URLSearchParams(location.search).get("renderer"),
    hide_welcome_screen: true,
    check_for_updates_on_startup: false,
    persist: false,
  });
  await window.viewer.start(document.getElementById("canvas"));
}
start().catch((error) => {
  document.getElementById("canvas").remove();
  document.getElementById("state").textContent = `The viewer did not start: ${error}`;
});
"""
Content = Callable[[], Iterable[bytes]]
"""Gives what is served, in pieces, whenever it is asked for."""


class GrowingRecording:
    """A recording that is served while it grows: its start, and as much of its end as is kept.

    Parameters
    ----------
    limit_bytes
        Of what is kept for pages that open later; then the oldest pieces but the first are dropped.
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


@contextmanager
def page_server(viewer: Mapping[str, bytes], recording: Content) -> Iterator[str]:
    """Serve the viewer with a recording to browsers on this machine.

    Parameters
    ----------
    viewer
        Path -> content of `VIEWER_FILES`.
    recording
        Gives the recording. It may hold several, of which the viewer shows the last one first.

    Yields
    ------
    str
        Address of the page; it is served until the context is left.
    """
    files: dict[str, tuple[str, Content]] = {
        "/": ("text/html", [PAGE].__iter__),
        "/start.js": ("text/javascript", [START].__iter__),
        "/recording.rrd": ("application/octet-stream", recording),
    } | {path: (kind, [viewer[path]].__iter__) for path, kind in VIEWER_FILES.items()}
    with _Server(files) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://{LOOPBACK}:{server.port}/"
        finally:
            server.shutdown()


class _Server(ThreadingTCPServer):
    """Answers on the loopback address, each request in a thread of its own."""

    daemon_threads = True

    def __init__(self, files: Mapping[str, tuple[str, Content]]) -> None:
        super().__init__((LOOPBACK, 0), _Handler)
        self.files = files
        self.port = int(self.server_address[1])

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing where a browser has gone away."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def parse_request(self) -> bool:
        """Refuse what is not asked of this machine by its address, whatever the method and path."""
        if not super().parse_request():
            return False
        hosts = [[f"{name}:{self.server.port}"] for name in (LOOPBACK, "localhost")]
        if self.headers.get_all("Host") in hosts:
            return True
        self.send_error(403, "Only for pages of this machine")
        return False

    def do_GET(self) -> None:
        kind, content = self.server.files.get(urlsplit(self.path).path, ("", None))
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
