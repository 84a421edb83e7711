"""Recordings as they are shown: served to this machine alone, and without a fault in the viewer."""

import os
import signal
import subprocess
import sys
import time
import urllib.request
from contextlib import contextmanager
from ctypes.util import find_library
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import psutil
import pytest
import rerun as rr
import rerun.blueprint as rrb
from rerun.experimental import ViewerClient

from pipeline.figures.style import COLOURS
from pipeline.viewer.file import printable, recording_file
from pipeline.viewer.serve import view, viewer_binary, web_viewer
from pipeline.viewer.trial import write_cycles, write_recording
from tests.pipeline.viewer_pictures import assert_no_fault, count_pixels, settled
from tests.pipeline.viewer_trial import viewer_trial

FRAMES = 500
PATIENCE_S = 30
PIXELS = 50


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("viewer")
    result = viewer_trial(FRAMES)
    paths = folder / "trial.rrd", folder / "cycles.rrd"
    write_recording(result, paths[0])
    write_cycles(result, paths[1])
    return paths


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


def test_web_viewer_listens_on_this_machine_only_and_stops(recordings, home):
    with web_viewer(recordings) as served:
        process = psutil.Process(served.process.pid)
        heard = [c.laddr for c in process.net_connections("inet") if c.status == "LISTEN"]
        assert len(heard) == 2
        assert {address.ip for address in heard} == {"127.0.0.1"}
        page = urlsplit(served.address)
        assert page.hostname == "127.0.0.1"
        source = parse_qs(page.query)["url"][0]
        assert {page.port, urlsplit(source).port} == {address.port for address in heard}
        with urllib.request.urlopen(served.address, timeout=PATIENCE_S) as answer:
            assert b"re_viewer" in answer.read()
    assert not psutil.pid_exists(served.process.pid)
    assert not [path for path in home.rglob("*") if path.is_file()], "it kept usage statistics"


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1.evil.example", "null"])
def test_pages_of_other_sites_may_not_read_what_is_served(recordings, origin):
    """Rerun refuses them by CORS; a page of this machine may read it, else this shows nothing."""
    with web_viewer(recordings) as served:
        page = f"http://{urlsplit(served.address).netloc}"
        data = parse_qs(urlsplit(served.address).query)["url"][0].removeprefix("rerun+")
        assert allowed_origin(data, page) == page
        assert allowed_origin(data, origin) is None


def allowed_origin(address, origin):
    """The origin that the answer to a browser's request before the request allows."""
    request = urllib.request.Request(address, method="OPTIONS")
    request.add_header("Origin", origin)
    request.add_header("Access-Control-Request-Method", "POST")
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
        return answer.headers["Access-Control-Allow-Origin"]


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_serving_ends_with_the_command_and_leaves_no_process(recordings, sent, code):
    program = (
        "import sys; from pathlib import Path; from pipeline.viewer.serve import view; "
        "view([Path(sys.argv[1])], web=True, announce=lambda line: print(line, flush=True))"
    )
    command = [sys.executable, "-c", program, str(recordings[0])]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[3],
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as shown:
        assert "http://127.0.0.1:" in shown.stdout.readline()
        (server,) = psutil.Process(shown.pid).children()
        shown.send_signal(sent)
        assert shown.wait(PATIENCE_S) == code
    assert not server.is_running()


def test_what_cannot_be_shown_is_reported_in_one_line(recordings, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="no recordings to show"):
        view([])
    with pytest.raises(FileNotFoundError, match=r"missing\.rrd"):
        view([tmp_path / "missing.rrd"], web=True)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform == "linux":
        with pytest.raises(OSError, match=r"the viewer failed.*--web") as error:
            view(recordings)
        assert "\n" not in str(error.value)


@contextmanager
def headless(*paths):
    """Open recordings in a viewer without a screen, which draws with Mesa's software Vulkan."""
    drivers = [*Path("/usr/share/vulkan/icd.d").glob("*.json")]
    if not (find_library("vulkan") and drivers):
        pytest.skip("no Vulkan driver (apt-get install mesa-vulkan-drivers libvulkan1)")
    port = 20000 + os.getpid() % 20000
    viewer = ViewerClient.spawn(
        headless=True, port=port, hide_welcome_screen=True, executable_path=viewer_binary()
    )
    try:
        for path in paths:
            viewer.open(str(path))
        yield viewer
    finally:
        viewer.quit()


def test_trial_opens_paused_at_its_start_and_every_view_is_without_fault(recordings):
    with headless(recordings[0]) as viewer:
        state = settled(viewer, 9)
        (shown,) = state.recordings
        assert (shown.current_timeline, shown.current_time) == ("time", 0)
        for second in (0.0, 2.2, 4.9):
            viewer.set_time("time", duration=second, play_state="paused")
            time.sleep(1)
            assert_no_fault(viewer)
        picture = viewer.take_screenshot(max_size=1600)
        for variant in ("measured", "compensated"):
            assert count_pixels(picture, COLOURS[variant]) > PIXELS


def test_mean_cycle_opens_on_its_own_timeline_without_fault(recordings):
    with headless(recordings[1]) as viewer:
        (shown,) = settled(viewer, 7).recordings
        assert shown.current_timeline == "gait_cycle_percent"
        viewer.set_time("gait_cycle_percent", sequence=60, play_state="paused")
        time.sleep(1)
        assert_no_fault(viewer)
        picture = viewer.take_screenshot(max_size=1600)
        assert count_pixels(picture, COLOURS["measured"]) > PIXELS


def test_frames_without_solution_and_missing_layers_are_not_faults(broken):
    with headless(broken) as viewer:
        settled(viewer, 9)
        for second in (0.5, 1.5, 3.0):
            viewer.set_time("time", duration=second, play_state="paused")
            time.sleep(1)
            assert_no_fault(viewer)
        picture = viewer.take_screenshot(max_size=1600)
        assert count_pixels(picture, COLOURS["measured"]) > PIXELS
        assert count_pixels(picture, COLOURS["compensated"]) < PIXELS


def test_the_viewer_has_every_letter_that_counts_as_printable(tmp_path):
    every = "".join(map(chr, range(0x20, 0x3000))) + "漢😀"
    marks = str.maketrans("", "", "|`<>\\*_~[]#&")
    text = printable(every.translate(marks))
    path = tmp_path / "letters.rrd"
    layout = rrb.Blueprint(rrb.TextDocumentView(origin="text"), auto_views=False)
    with recording_file(path, "letters", text[:80], layout) as stream:
        stream.log("text", rr.TextDocument(text, media_type="text/markdown"), static=True)
    with headless(path) as viewer:
        settled(viewer, 1)
        viewer.take_screenshot(max_size=400)
        assert_no_fault(viewer)
