"""The page with the light shows on a phone and a wall how a replayed walk goes."""

import json
import time
import urllib.error
import urllib.request

import numpy as np
import pytest

from pipeline.config.live import Live
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.live.chain import LiveChain
from pipeline.live.light import Finding, Kind, light
from pipeline.live.monitor import Monitor
from pipeline.live.replay import RecordedSource
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.residuals import AXES, HEALTHY_RMS
from pipeline.viewer.live import FULL_SCALE, Board
from pipeline.viewer.serve import LOOPBACK, light_server
from tests.pipeline.browser import needs_chromium, open_browser
from tests.pipeline.live.playing import body_of

PATIENCE_S = 20
SHOWN = "JSON.stringify(Object.fromEntries(['colour', 'sentence', 'done'].map((id) => "
SHOWN += "[id, document.getElementById(id).textContent])))"
WIDTHS = "[...document.querySelectorAll('.size')].map((each) => parseFloat(each.style.width))"
LINES = "[...document.querySelectorAll('.limit')].map((each) => parseFloat(each.style.left))"
FASTER = 5
CLOCK = f"""{{
  const now = Date.now, later = setTimeout, within = AbortSignal.timeout.bind(AbortSignal);
  Date.now = () => {FASTER} * now();
  window.setTimeout = (call, ms) => later(call, ms / {FASTER});
  AbortSignal.timeout = (ms) => within(ms / {FASTER});
}}"""
"""Makes the clock of a page run faster."""


@pytest.fixture(scope="module")
def boards(walker):
    """Boards of a replayed walk, one a second, and the monitor at its end."""
    body = body_of(walker, Subject())
    source, still = RecordedSource(walker), Laboratory(Treadmill())
    chain = LiveChain(body, still, Settings(), Live(), source.streams, walker.plates)
    monitor, found, next_s = Monitor(chain, walker.plates), [], 1.0
    while not source.ended:
        for samples in source.receive(0.0):
            monitor.samples(samples)
            for frame in chain.push(samples):
                monitor.frame(frame, 0.0)
                if frame.time > next_s:
                    found.append(monitor.board(source.streams))
                    next_s += 1.0
    return [*found, monitor.board(source.streams)], monitor


def asked(address, path="board.json", **headers):
    request = urllib.request.Request(address + path, headers=headers)
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
        return answer.read()


def test_the_board_that_a_page_asks_for_is_that_of_the_session(boards):
    replayed, monitor = boards
    now = [replayed[0]]
    with light_server(lambda: now[0], LOOPBACK) as address:
        first = json.loads(asked(address))
        assert (first["board"]["colour"], first["board"]["rms"]) == ("look", {})
        assert first["board"]["sentence"].startswith("Starting")
        now[0] = replayed[-1]
        last = json.loads(asked(address))
    assert last["board"]["colour"] == "good"
    assert last["board"]["sentence"].startswith(f"{monitor.condition.used} of 25 ")
    assert last["axes"] == [*AXES]
    ten = np.concatenate([each.residual["measured"] for each in monitor.condition.recent])
    rms = np.sqrt(np.mean(ten**2, axis=0))
    np.testing.assert_allclose(last["board"]["rms"]["measured"], rms, rtol=1e-12)
    assert last["limits"] == [*HEALTHY_RMS]


def test_the_page_is_for_this_computer_unless_its_own_address_is_asked(boards):
    with light_server(lambda: boards[0][0], LOOPBACK) as address:
        assert address.startswith("http://127.0.0.1:")
        with pytest.raises(urllib.error.HTTPError, match="403"):
            asked(address, Host="evil.example")
    with light_server(lambda: boards[0][0], "127.0.0.2") as address:
        assert b"light.js" in asked(address, "")
        with pytest.raises(urllib.error.HTTPError, match="403"):
            asked(address, Host=address[7:-1].replace("127.0.0.2", "localhost"))


def wait_for(browser, colour):
    deadline = time.monotonic() + PATIENCE_S
    while (shown := json.loads(browser.evaluate(SHOWN)))["colour"] != colour:
        assert time.monotonic() < deadline, shown
        time.sleep(0.1)
    return shown


@needs_chromium
def test_a_phone_and_a_wall_show_light_sentence_cycles_and_bars_of_a_replay(boards, tmp_path):
    """And stop where the session does not answer any more: no light is older than that."""
    replayed, now = boards[0], [boards[0][0]]
    with open_browser() as browser:
        with light_server(lambda: now[0], LOOPBACK) as address:
            browser.resize(390, 844)
            browser.open(address)
            assert wait_for(browser, "look")["sentence"].startswith("Starting")
            for now[0] in replayed[1:]:
                time.sleep(0.02)
            board = replayed[-1]
            shown = wait_for(browser, "good")
            assert (shown["sentence"], shown["done"]) == (board.sentence, board.done)
            widths = 100 * board.rms["measured"] / FULL_SCALE
            np.testing.assert_allclose(list(browser_list(browser, WIDTHS)), widths, atol=0.01)
            lines = 100 * np.array(HEALTHY_RMS) / FULL_SCALE
            np.testing.assert_allclose(list(browser_list(browser, LINES)), lines, atol=0.01)
            for width, height, least_px in ((390, 844, 60), (1920, 1080, 120)):
                browser.resize(width, height)
                assert browser.evaluate("document.documentElement.scrollWidth") <= width
                assert browser.evaluate("document.documentElement.scrollHeight") <= height
                letters = "parseFloat(getComputedStyle(document.getElementById('colour')).fontSize)"
                assert browser.evaluate(letters) > least_px
                browser.screenshot(tmp_path / f"{width}.png")
            high = Finding(Kind.RESIDUALS_HIGH, values={"axes": AXES})
            _, longest = light([high], {}, "")
            now[0] = Board("look", longest, 0.1, "9 / 25", {"measured": np.full(6, 1e3)}, "Markers")
            assert wait_for(browser, "look")["sentence"] == longest
            assert browser.evaluate("document.documentElement.scrollHeight") <= 1080
            assert browser_list(browser, WIDTHS) == [100] * 6  # beyond its end a bar is full
            assert browser.evaluate("document.querySelectorAll('.beyond').length") == 6
            assert {each for each in browser.requests if address not in each} <= {"data:,"}
            assert browser.complaints == []
        ended = wait_for(browser, "stop")
        assert ended["sentence"].startswith("No connection")
        assert ended["done"] == "9 / 25"  # counts and bars of the session stay
        assert browser_list(browser, WIDTHS) == [100] * 6


@needs_chromium
def test_a_page_whose_answer_is_late_says_so_and_never_shows_an_old_light():
    good, waits_s = Board("good", "12 of 25", 0.5, "12 / 25", {}), [0.0]

    def board():
        time.sleep(waits_s[0])
        return good

    with light_server(board, LOOPBACK) as address, open_browser() as browser:
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=CLOCK)
        browser.open(address)
        wait_for(browser, "good")
        waits_s[0] = 4.0 / FASTER
        assert wait_for(browser, "look")["sentence"].endswith("s late")
        wait_for(browser, "stop")
        waits_s[0] = 0.0
        wait_for(browser, "good")


def browser_list(browser, expression):
    return json.loads(browser.evaluate(f"JSON.stringify({expression})"))
