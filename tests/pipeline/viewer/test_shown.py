"""Recordings are shown to this machine alone, and without a fault in the viewer."""

import re
import signal
import subprocess
import sys
import time
import urllib.request
from contextlib import contextmanager
from dataclasses import replace
from http.client import HTTPConnection
from itertools import islice
from pathlib import Path
from urllib.parse import urlsplit

import psutil
import pytest
import rerun as rr
import rerun.blueprint as rrb
from rerun.experimental import ViewerClient

from pipeline.figures.style import COLOURS
from pipeline.report.trial_page import write_trial_page
from pipeline.run.store import write_trial
from pipeline.trial.residuals import worst_cycles
from pipeline.viewer.file import printable, recording_file
from pipeline.viewer.serve import GrowingRecording, free_port, viewer_binary
from pipeline.viewer.trial import write_recording
from tests.pipeline.browser import needs_chromium, open_browser
from tests.pipeline.viewer_pictures import (
    PAUSED,
    assert_no_fault,
    count_pixels,
    moments,
    needs_vulkan,
    picture_with,
    settled,
    settled_page,
    wait_for,
)
from tests.pipeline.viewer_trial import viewer_trial

FRAMES = 500
PATIENCE_S = 30
PIXELS = 50
WINDOW = (1000, 600)
PANELS = {
    *("Fx (N), forward", "Fy (N), right", "Fz (N), up"),
    *("Mx (N·m), about forward", "My (N·m), about right", "Mz (N·m), about up", "Body and forces"),
    *("hip flexion (N·m/kg)", "hip abduction (N·m/kg)", "hip internal rotation (N·m/kg)"),
    *("knee flexion (N·m/kg)", "ankle plantarflexion (N·m/kg)", "ankle pronation (N·m/kg)"),
    *("Gait phases", "Marker errors (mm)", "Summary", "Legend"),
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("viewer") / "trial.rrd"
    write_recording(viewer_trial(FRAMES), path)
    return path


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    path = tmp_path_factory.mktemp("viewer") / "broken.rrd"
    result = viewer_trial(FRAMES, compensated=False, moving=False, lost=slice(100, 200))
    write_recording(result, path)
    return path


@pytest.fixture
def home(tmp_path, monkeypatch):
    """An empty home, where a viewer would keep its usage statistics."""
    for name in ("CI", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


@contextmanager
def served(path):
    """Serve a recording in a process of its own; give it and the address of the page."""
    program = (
        "import sys; from pathlib import Path; from pipeline.viewer.serve import view; "
        "view(Path(sys.argv[1]), web=True, cursor=('time', 2_500_000_000), "
        "announce=lambda line: print(line, flush=True))"
    )
    with started([sys.executable, "-c", program, str(path)]) as served:
        yield served


@contextmanager
def started(command):
    """Run a command that serves; give its process and the address of the page."""
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[3],
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        try:
            yield process, re.search(r"http://\S+/", process.stdout.readline())[0]
        finally:
            process.terminate()


@pytest.mark.slow
@needs_chromium
def test_the_page_shows_the_trial_where_it_is_told_to_and_requests_only_what_is_served_here(
    recording, tmp_path
):
    with served(recording) as (_, address), open_browser() as browser:
        browser.resize(*WINDOW)
        browser.open(address)
        state = settled_page(browser, seconds=8.0)
        browser.screenshot(tmp_path / "page.png")
    assert state.active.startswith("Recording:hbm_residuals_trial:")
    assert (state.timeline, state.time, state.playing) == ("time", 2_500_000_000, PAUSED)
    assert state.views == PANELS
    for variant in ("measured", "compensated"):
        assert count_pixels((tmp_path / "page.png").read_bytes(), COLOURS[variant]) > PIXELS
    assert address + "recording.rrd" in browser.requests
    assert [one for one in browser.requests if not one.startswith(address)] == []
    assert [one for one in browser.complaints if "Content Security Policy" in one] == []


@pytest.mark.slow
@needs_chromium
def test_links_of_a_trial_s_page_open_its_worst_gait_cycles_where_the_viewer_serves_it(tmp_path):
    trials = tmp_path / "trials"
    for number, condition in enumerate(("level", "sway")):
        result = viewer_trial(FRAMES, moving=bool(number))
        result = replace(result, condition=condition, key="1")
        write_trial(result, trials / f"{result.name.stem}.parquet")
    page = write_trial_page(result, trials / "sub07_sway.html", study="../report.html")
    (tmp_path / "report.html").write_text("<link rel=icon href=data:,><body>the report")
    cycle = worst_cycles(result)[0]
    link = "document.querySelector('a[href^=\"/?\"]')"
    events = f"getComputedStyle({link}).pointerEvents"
    command = [sys.executable, "-m", "pipeline.cli", "view", str(tmp_path), "--web"]
    with started(command) as (_, address), open_browser() as browser:
        browser.open(page)
        assert browser.evaluate(events) == "none"
        browser.open(address + "report.html")
        assert browser.evaluate("document.body.innerText") == "the report"
        browser.open(f"{address}trials/{page.name}")
        assert browser.evaluate(events) == "auto"
        assert browser.complaints == []
        browser.evaluate(f"{link}.click()")
        state = settled_page(browser, seconds=4.0)
        assert f"{address}sub07_sway.rrd" in browser.requests
    assert state.time == round(1e9 * round(cycle.start_s, 2))


def test_the_page_is_served_on_this_machine_only_and_no_other_port_is_open(recording, home):
    with served(recording) as (process, address):
        program = psutil.Process(process.pid)
        assert program.children() == []
        (heard,) = [c.laddr for c in program.net_connections("inet") if c.status == "LISTEN"]
        assert heard.ip == "127.0.0.1"
        assert address == f"http://127.0.0.1:{heard.port}/"
        with urllib.request.urlopen(address + "recording.rrd", timeout=PATIENCE_S) as answer:
            assert answer.read(4) == b"RRF2"
        process.terminate()
        assert process.wait(PATIENCE_S) == 128 + signal.SIGTERM
    assert not [path for path in home.rglob("*") if path.is_file()], "it kept usage statistics"


def test_requests_that_name_another_host_are_refused_and_serving_ends_with_the_command(recording):
    """A site whose own name points to this machine (DNS rebinding) sends that name."""
    with served(recording) as (process, address):
        port = urlsplit(address).port
        foreign = (None, "", "evil.example", f"evil.example:{port}", "127.0.0.1", "localhost:1")
        for method in ("GET", "POST", "OPTIONS"):
            for path in ("/", "/re_viewer.js", "/re_viewer_bg.wasm", "/recording.rrd", "/none"):
                for host in (*foreign, f"127.0.0.1.evil.example:{port}"):
                    assert answered(port, method, path, host).status == 403, (path, host)
        for host in (f"127.0.0.1:{port}", f"localhost:{port}"):
            answer = answered(port, "GET", "/recording.rrd", host, "http://evil.example")
            assert (answer.status, answer.headers["Access-Control-Allow-Origin"]) == (200, None)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0


def answered(port, method, path, host, origin=None):
    connection = HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    connection.putrequest(method, path, skip_host=True)
    for name, value in (("Host", host), ("Origin", origin)):
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    connection.close()
    return answer


def test_a_page_that_opens_late_gets_the_start_and_the_end_of_a_live_recording():
    recording = GrowingRecording(limit_bytes=7)
    early = recording.pieces()
    for piece in (b"start", b"a", b"b", b"c", b"d"):
        recording.append(piece)
    late = recording.pieces()
    assert [*islice(late, 3)] == [b"start", b"c", b"d"]
    for piece in (b"e", b"f", b"g"):
        recording.append(piece)
    assert [*islice(late, 2)] == [b"f", b"g"]
    assert [*islice(early, 3)] == [b"start", b"f", b"g"]


@contextmanager
def headless(*paths):
    """Open recordings in a viewer without a screen, which draws with Mesa's software Vulkan."""
    port = free_port()
    viewer = ViewerClient.spawn(
        headless=True, port=port, hide_welcome_screen=True, executable_path=viewer_binary()
    )
    try:
        for path in paths:
            viewer.open(str(path))
        yield viewer
    finally:
        viewer.quit()


@needs_vulkan
def test_the_window_opens_where_it_is_told_to_and_every_view_is_without_fault(recording):
    port = free_port()
    program = (
        "import sys; from pathlib import Path; from pipeline.viewer import serve; "
        "run = serve.running_viewer; serve.free_port = lambda: int(sys.argv[1]); "
        "serve.running_viewer = lambda words, port: run(['--headless', *words], port); "
        "serve.view(Path(sys.argv[2]), cursor=('time', 2_500_000_000))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(port), str(recording)],
        cwd=Path(__file__).resolve().parents[3],
    ) as window:
        try:
            viewer = connected(port)
            views = {one.name for one in settled(viewer, 9, 0.0).views if one.visible}
            assert views <= PANELS
            wait_for(lambda: moments(viewer) == [("time", 2_500_000_000)])
            for second in (2.2, 4.9):
                viewer.set_time("time", duration=second, play_state="paused")
                picture_with(viewer, *COLOURS.values())
                assert_no_fault(viewer)
        finally:
            window.terminate()


def connected(port):
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            return ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        except Exception:
            assert time.monotonic() < deadline, "the viewer does not answer"
            time.sleep(0.2)


@needs_vulkan
def test_frames_without_solution_and_missing_layers_are_not_faults(broken):
    with headless(broken) as viewer:
        settled(viewer, 9, 0.0)
        for second in (0.5, 1.5):
            viewer.set_time("time", duration=second, play_state="paused")
            picture = picture_with(viewer, COLOURS["measured"])
            assert_no_fault(viewer)
        assert count_pixels(picture, COLOURS["compensated"]) < PIXELS


@needs_vulkan
def test_the_viewer_has_every_letter_that_counts_as_printable(tmp_path):
    every = "".join(map(chr, range(0x20, 0x3000))) + "漢😀"
    marks = str.maketrans("", "", "|`<>\\*_~[]#&")
    text = printable(every.translate(marks))
    path = tmp_path / "letters.rrd"
    layout = rrb.Blueprint(rrb.TextDocumentView(origin="text"), auto_views=False)
    with recording_file(path, "letters", text[:80], layout) as stream:
        stream.log("text", rr.TextDocument(text, media_type="text/markdown"), static=True)
    with headless(path) as viewer:
        settled(viewer, 1, 0.0)
        viewer.take_screenshot(max_size=400)
        assert_no_fault(viewer)
