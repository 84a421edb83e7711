"""A browser shows the light of a session as it is."""

import time

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from pipeline.figures.style import COLOURS
from pipeline.viewer.board import BARS, BOARD_SIZE, FIRST_ROW, LIGHTS, ROW, draw_board
from pipeline.viewer.live import FULL_SCALE, Board, LiveScene, LiveView
from tests.pipeline.browser import needs_chromium, open_browser
from tests.pipeline.viewer_frames import shown_frames
from tests.pipeline.viewer_pictures import PATIENCE_S, count_pixels, settled_page
from tests.pipeline.viewer_trial import viewer_trial

SCREEN = (960, 600)
LAST = 60


def board(colour="good", sentence="12 of 25 gait cycles used", rms=None):
    return Board(colour, sentence, 0.5, "12 / 25 gait cycles", rms or {}, "Markers")


def seen_on(browser, path, expected):
    """The colours that fill much of the screen, once the expected one does."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        browser.screenshot(path)
        picture = path.read_bytes()
        least = 0.06 * SCREEN[0] * SCREEN[1]
        found = {name for name, (of, _) in LIGHTS.items() if count_pixels(picture, of) > least}
        if found == {expected} or time.monotonic() > deadline:
            return found
        time.sleep(0.5)


@pytest.mark.slow
@needs_chromium
def test_each_colour_of_the_light_is_on_the_screen_as_soon_as_it_is_shown(tmp_path):
    """On one screen, beside body and residuals."""
    trial = viewer_trial(LAST)
    names, variants = trial.markers.names, list(trial.ground)
    view = LiveView(LiveScene(trial.body, trial.plates, names, variants, "browser"))
    try:
        assert view.wait(PATIENCE_S), view.fault
        for frame in shown_frames(trial):
            view.show(frame)
        with open_browser() as browser:
            browser.resize(*SCREEN)
            browser.open(view.address)
            settled_page(browser)
            for colour in LIGHTS:
                view.show_board(board(colour))
                assert seen_on(browser, tmp_path / f"{colour}.png", colour) == {colour}
    finally:
        view.close()


def luminance(colour):
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def test_the_text_of_every_light_has_the_contrast_that_web_pages_must_have():
    for background, text in LIGHTS.values():
        darker, lighter = sorted(map(luminance, (background, text)))
        assert (lighter + 0.05) / (darker + 0.05) > 4.5


def test_bars_have_one_scale_whatever_the_residuals_are():
    """Twice the residual is twice the bar; beyond its end it is full; the limit stays in place."""

    def length(size):
        picture = np.asarray(draw_board(board(rms={"measured": np.full(6, size)})), float)
        coloured = np.abs(picture - 255 * np.array(to_rgb(COLOURS["measured"]))).max(axis=2) < 2
        row = coloured[FIRST_ROW + 1 + 3 * ROW]
        return int(np.flatnonzero(row)[-1]) - BARS[0]

    lengths = [length(FULL_SCALE[3] * part) for part in (0.1, 0.2, 0.4, 1.0, 3.0)]
    assert lengths[1:3] == pytest.approx([2 * lengths[0], 4 * lengths[0]], abs=2)
    assert lengths[3] == lengths[4] == BARS[1] - BARS[0]


def test_the_longest_sentence_has_room_and_an_endless_one_stops_nothing():
    for sentence in ("W" * 40, " ".join(["hidden"] * 200)):
        assert draw_board(board("stop", sentence)).size == tuple(BOARD_SIZE.astype(int))
