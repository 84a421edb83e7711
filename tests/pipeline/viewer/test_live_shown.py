"""A live view survives a viewer that is stopped, killed or missing."""

import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import contextmanager
from dataclasses import replace
from itertools import count, cycle, islice
from pathlib import Path

import numpy as np
import psutil
import pytest
from rerun.experimental import ViewerClient

from pipeline.figures.style import COLOURS
from pipeline.viewer.live import MAX_WAITING, Board, LiveScene, LiveView
from pipeline.viewer.plots import panel_name
from pipeline.viewer.scene import MODELLED_COLOUR
from tests.pipeline.browser import needs_chromium, open_browser
from tests.pipeline.viewer_frames import shown_frames
from tests.pipeline.viewer_pictures import (
    FOLLOWING,
    PATIENCE_S,
    assert_no_fault,
    count_pixels,
    needs_vulkan,
    page_state,
    settled,
    settled_page,
)
from tests.pipeline.viewer_trial import viewer_trial

FRAMES = 100
RATE_HZ = 100
PIXELS = 50
MEGABYTE = 1e6
BOARD = Board("good", "12 of 25 gait cycles used", 0.48, "12 / 25 gait cycles", {})
SIGSTOP = getattr(signal, "SIGSTOP", None)

needs_signals = pytest.mark.skipif(SIGSTOP is None, reason="no SIGSTOP on this system")


@pytest.fixture(scope="module")
def trial():
    return viewer_trial(FRAMES)


@pytest.fixture(scope="module")
def frames(trial):
    return shown_frames(trial)


@contextmanager
def live_view(trial, screen):
    names, variants = trial.markers.names, list(trial.ground)
    view = LiveView(LiveScene(trial.body, trial.plates, names, variants, screen))
    try:
        assert view.wait(PATIENCE_S), view.fault
        yield view
    finally:
        view.close()


def family(view):
    """The drawing process and the viewer."""
    drawing = psutil.Process(view.process_id)
    (viewer,) = drawing.children()
    return drawing, viewer


def ended(process):
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


def wait_for(condition):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.05)


def walk(view, frames, count, first=0):
    """Show frames at their rate."""
    start = time.monotonic()
    for k in range(count):
        view.show(replace(frames[k % len(frames)], time=(first + k) / RATE_HZ))
        time.sleep(max(0.0, start + k / RATE_HZ - time.monotonic()))
    wait_for(lambda: view.shown + view.left_out == first + count)


def assert_it_ends(view, frames, fault):
    """The view says why while frames come, and the rest goes on."""
    first = view.shown + view.left_out
    number = count(first)

    def noticed_while_frames_come():
        k = next(number)
        view.show(replace(frames[k % len(frames)], time=k / RATE_HZ))
        return view.fault is not None

    wait_for(noticed_while_frames_come)
    assert view.fault == fault
    view.show_board(BOARD)
    view.show(frames[0])
    shown = next(number) + 1
    wait_for(lambda: view.shown + view.left_out == shown)


@needs_vulkan
def test_body_and_residuals_are_seen_until_the_drawing_process_is_killed(trial, frames):
    with live_view(trial, "none") as view:
        view.show_board(BOARD)
        walk(view, frames, FRAMES)
        viewer = ViewerClient.connect(view.address)
        (shown,) = settled(viewer, 9).recordings
        assert (shown.current_timeline, shown.current_time) == ("time", (FRAMES - 1) * 10_000_000)
        assert_no_fault(viewer)
        picture = viewer.take_screenshot(max_size=1920)
        for variant in ("measured", "compensated"):
            assert count_pixels(picture, COLOURS[variant]) > PIXELS
        seen = count_pixels(picture, MODELLED_COLOUR)
        assert seen > PIXELS
        assert (view.shown, view.left_out, view.fault) == (FRAMES, 0, None)
        unknown = replace(frames[0], q=np.full(46, np.nan), time=FRAMES / RATE_HZ)
        view.show(unknown)
        wait_for(lambda: view.shown == FRAMES + 1)
        time.sleep(1)
        hidden = count_pixels(viewer.take_screenshot(max_size=1920), MODELLED_COLOUR)
        assert hidden < 0.1 * seen, (hidden, seen)
        processes = family(view)
        processes[0].kill()
        assert_it_ends(view, frames, "the process that draws the live view has ended")
    wait_for(lambda: all(map(ended, processes)))


@pytest.mark.slow
@needs_chromium
def test_a_page_shows_what_comes_and_requests_only_what_is_served_here(trial, frames, tmp_path):
    with live_view(trial, "browser") as view, open_browser() as browser:
        walk(view, frames, FRAMES)
        browser.resize(800, 600)
        browser.open(view.address)
        wait_for(lambda: getattr(page_state(browser), "time", 0) == (FRAMES - 1) * 10_000_000)
        state = settled_page(browser)
        assert state.active.startswith("Recording:hbm_residuals_live:")
        assert (state.timeline, state.playing) == ("time", FOLLOWING)
        assert {"Legend", panel_name(0), panel_name(5)} <= state.views
        view.show_board(BOARD)
        light = "document.getElementById('light').contentDocument.body.innerText"
        wait_for(lambda: BOARD.sentence in browser.evaluate(light))  # however late the viewer is
        walk(view, frames, 50, first=FRAMES)
        wait_for(lambda: page_state(browser).time == (FRAMES + 49) * 10_000_000)
        browser.screenshot(tmp_path / "page.png")
        assert count_pixels((tmp_path / "page.png").read_bytes(), COLOURS["measured"]) > PIXELS
        assert view.address + "recording.rrd" in browser.requests
        assert [one for one in browser.requests if not one.startswith(view.address)] == []
        assert [one for one in browser.complaints if "Content Security Policy" in one] == []


def test_a_page_of_a_live_view_is_served_on_this_machine_only_and_ends_with_it(trial, frames):
    with live_view(trial, "browser") as view:
        drawing = psutil.Process(view.process_id)
        assert drawing.children() == []
        (heard,) = [c.laddr for c in drawing.net_connections("inet") if c.status == "LISTEN"]
        assert heard.ip == "127.0.0.1"
        assert view.address == f"http://127.0.0.1:{heard.port}/"
        foreign = urllib.request.Request(view.address + "recording.rrd")
        foreign.add_header("Host", f"evil.example:{heard.port}")
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(foreign, timeout=PATIENCE_S)
        walk(view, frames, 20)
    assert ended(drawing)
    view.close()  # once more does nothing
    view.show(frames[0])
    assert (view.shown, view.left_out, view.fault) == (20, 1, None)


@pytest.mark.slow
@needs_signals
@needs_vulkan
def test_where_the_viewer_is_stopped_frames_are_left_out_and_memory_stays(trial, frames):
    """The frames of 33 minutes, as fast as they can be shown."""
    filled, count = 100 * MAX_WAITING, 200_000
    with live_view(trial, "none") as view:
        walk(view, frames, 50)
        drawing, viewer = family(view)
        viewer.suspend()
        me = psutil.Process()
        coming = cycle(frames)
        for k in range(50, 50 + filled):
            view.show(replace(next(coming), time=k / RATE_HZ))
        time.sleep(1)
        before = me.memory_info().rss, drawing.memory_info().rss
        for k in range(50 + filled, 50 + filled + count):
            view.show(replace(next(coming), time=k / RATE_HZ))
        after = me.memory_info().rss, drawing.memory_info().rss
        assert max(np.subtract(after, before)) < 2 * MEGABYTE
        assert view.left_out > 0.9 * count
        assert view.fault is None
        start = time.monotonic()
        view.close()
        assert time.monotonic() - start < 10
    assert view.shown + view.left_out == 50 + filled + count
    assert ended(drawing)
    assert ended(viewer)


@needs_signals
@needs_vulkan
def test_a_viewer_that_goes_on_shows_the_latest_frames_until_it_is_killed(trial, frames):
    with live_view(trial, "none") as view:
        drawing, viewer = family(view)
        viewer.suspend()
        for k in range(4 * MAX_WAITING):
            view.show(replace(frames[k % FRAMES], time=k / RATE_HZ))
        viewer.resume()
        wait_for(lambda: view.shown + view.left_out == 4 * MAX_WAITING)
        assert view.left_out > 0
        assert view.shown >= MAX_WAITING
        walk(view, frames, 20, first=4 * MAX_WAITING)
        assert view.fault is None
        viewer.kill()
        assert_it_ends(view, frames, "the viewer was ended by SIGKILL")
    wait_for(lambda: ended(drawing) and ended(viewer))


@pytest.mark.slow
@needs_signals
@needs_vulkan
def test_a_drawing_process_that_is_stopped_hinders_nobody_and_is_killed(trial, frames):
    with live_view(trial, "none") as view:
        drawing, viewer = family(view)
        drawing.suspend()
        for frame in islice(cycle(frames), 3 * MAX_WAITING):
            view.show(frame)
        time.sleep(0.5)
        start = time.monotonic()
        view.close()
        assert time.monotonic() - start < 10
    assert view.shown + view.left_out == 3 * MAX_WAITING
    wait_for(lambda: ended(drawing) and ended(viewer))


@needs_vulkan
def test_the_viewer_ends_with_a_program_that_is_killed(tmp_path):
    program = (
        "import time; from tests.pipeline.viewer_trial import viewer_trial; "
        "from pipeline.viewer.live import LiveScene, LiveView; trial = viewer_trial(20); "
        "names, variants = trial.markers.names, list(trial.ground); "
        "scene = LiveScene(trial.body, trial.plates, names, variants, 'none'); "
        "view = LiveView(scene); view.wait(30); print(view.process_id, flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[3],
    ) as shown:
        drawing = psutil.Process(int(shown.stdout.readline()))
        (viewer,) = drawing.children()
        shown.kill()
        wait_for(lambda: ended(drawing) and ended(viewer))


def test_without_a_screen_the_view_says_so_in_one_line(trial, frames, monkeypatch):
    if sys.platform != "linux":
        pytest.skip("a screen is always there")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    names, variants = trial.markers.names, list(trial.ground)
    view = LiveView(LiveScene(trial.body, trial.plates, names, variants))
    try:
        view.show(frames[0])
        assert not view.wait(PATIENCE_S)
        assert re.match(r"there is no screen; .*--web", view.fault)
        assert "--save" not in view.fault
        assert "\n" not in view.fault
        view.show(frames[1])
        assert view.left_out == 2
        assert view.address is None
    finally:
        view.close()
