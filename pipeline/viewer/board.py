"""The board of a live view: light, gait cycles and residuals, readable from three metres.

It is a picture, since texts of the viewer have one small size.
"""

from functools import cache
from pathlib import Path
from textwrap import wrap
from typing import Final

import matplotlib as mpl
import numpy as np
import rerun as rr
from PIL import Image, ImageDraw, ImageFont

from pipeline.figures.style import COLOURS
from pipeline.trial.residuals import AXES, DIRECTIONS, HEALTHY_RMS, UNITS
from pipeline.viewer.live import FULL_SCALE, Board, Colour

BOARD_SIZE: Final = np.array([1000.0, 1040.0])
WHITE, BLACK, GREY = "#FFFFFF", "#000000", "#E4E4E4"
LIGHTS: Final[dict[Colour, tuple[str, str]]] = {
    "good": ("#007A33", WHITE),
    "look": ("#FFC400", BLACK),
    "stop": ("#C4001A", WHITE),
}
"""Of the light and its text; their contrast is at least 5.6 to 1."""
SENT: Final = (750, 780)
"""Pixels that are sent, 1.8 MB a second: letters stay sharp."""
MARGIN: Final = 30
BARS: Final = (280, 780)
"""Where all bars begin and are full."""
ROW, FIRST_ROW = 66, 588


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    fonts = Path(mpl.get_data_path()) / "fonts/ttf"
    return ImageFont.truetype(fonts / "DejaVuSans-Bold.ttf", size)


def log_board(stream: rr.RecordingStream, board: Board) -> None:
    """Show a board in place of the last one; not encoded, which the viewer would decode late."""
    picture = draw_board(board).resize(SENT, Image.Resampling.BOX)
    stream.log("board", rr.Image(np.asarray(picture), magnification_filter="linear"), static=True)


def draw_board(board: Board) -> Image.Image:
    """Draw the light with its sentence, gait cycles, bars of residuals, and senders."""
    width, height = BOARD_SIZE.astype(int).tolist()
    band = 420  # height of the light with its sentence
    image = Image.new("RGB", (width, height), WHITE)
    draw = ImageDraw.Draw(image)
    colour, on_colour = LIGHTS[board.colour]
    draw.rectangle((0, 0, width, band), colour)
    draw.text((MARGIN, 8), board.colour.upper(), on_colour, _font(140))
    # the largest letters in which the sentence has room: their height, letters in a line, lines
    sizes = ((64, 24, 3), (48, 33, 4), (34, 46, 6))
    size, lines = next(
        (size, lines)
        for size, letters, most in sizes
        if (lines := wrap(board.sentence, letters, break_on_hyphens=False)[:most])
        and (size == sizes[-1][0] or " ".join(lines) == board.sentence)
    )
    draw.multiline_text((MARGIN, 185), "\n".join(lines), on_colour, _font(size))

    # 26 large letters have room
    draw.text((MARGIN, band + 14), board.done, BLACK, _font(56 if len(board.done) < 26 else 36))
    done = MARGIN + (width - 2 * MARGIN) * min(board.progress, 1.0)
    draw.rectangle((MARGIN, band + 90, width - MARGIN, band + 110), GREY)
    draw.rectangle((MARGIN, band + 90, done, band + 110), LIGHTS["good"][0])
    of_bars = "RMS of the last ten cycles (line: healthy)"
    draw.text((MARGIN, band + 124), of_bars, BLACK, _font(32))
    for k, axis in enumerate(AXES):
        _draw_bars(draw, board, k, axis)
    senders = wrap(board.senders, 78, max_lines=2, placeholder=" …")
    draw.multiline_text((MARGIN, height - 54), "\n".join(senders), BLACK, _font(20))
    return image


def _draw_bars(draw: ImageDraw.ImageDraw, board: Board, k: int, axis: str) -> None:
    """Draw the bars of an axis, that of the last variant above, with its line and its number."""
    top, (left, right) = FIRST_ROW + ROW * k, BARS
    draw.text((MARGIN, top + 2), axis, BLACK, _font(44))
    draw.text((MARGIN + 90, top + 16), DIRECTIONS[k % 3], BLACK, _font(28))
    draw.rectangle((left, top, right, top + 54), GREY)
    for row, (variant, rms) in enumerate(reversed([*board.rms.items()])):
        stop = left + (right - left) * min(float(rms[k]) / FULL_SCALE[k], 1.0)
        # plates as measured have a thin bar, below that of compensated ones
        below = top + 54 - 12 if row else top
        draw.rectangle((left, below, stop, top + 54), COLOURS[variant])
        if not row:
            draw.text((right + 14, top + 2), f"{rms[k]:.0f}", BLACK, _font(44))
    draw.text((right + 140, top + 18), UNITS[k], BLACK, _font(28))
    at = left + (right - left) * HEALTHY_RMS[k] / FULL_SCALE[k]
    draw.rectangle((at - 3, top - 6, at + 3, top + 60), BLACK)
