"""The style of all figures, and how they are written."""

import warnings
from base64 import b64encode
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike

from hbm.spatial import Array
from pipeline.io.write import whole_file

if TYPE_CHECKING:
    from pipeline.statistics.curves import CurveDifference

COLOURS: Final = {"measured": "#D55E00", "compensated": "#0072B2"}
"""Vermilion and blue mean plates as measured and compensated, in every figure and in the viewer."""
PALETTE: Final = ("#000000", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""All others of the colour-blind safe palette of Okabe and Ito but yellow: conditions, plates …"""
LINE_STYLES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
"""Of conditions, so that no two differ by colour alone."""
MEDIA_TYPES: Final = {".svg": "image/svg+xml", ".png": "image/png"}
LINE_WIDTH_PT: Final = 1.5
BAND_OPACITY: Final = 0.2
"""Two bands and their overlap can be distinguished."""
BAR: Final = (1.01, 1.035)
"""Lower and upper edge of a bar over a part of the gait cycle, as shares of the panel's height."""
MIN_RATIO: Final = 10.0
"""Of the ends of a logarithmic axis: what hardly differs looks so, and there are three ticks."""
DPI: Final = 150
"""Resolution of PNG files: 1400 pixels for a figure across a page."""

FAST: Final = 1
"""Compression of PNG files: default ones are 7 % smaller, and take three times as long."""

FONTS: Final = ("DejaVu Sans", "Arial Unicode MS", "Noto Sans CJK JP", "Hiragino Sans", "Yu Gothic")
"""Of these, the ones that are installed: the first that has a letter draws it."""
STYLE: Final[Any] = {
    "axes.prop_cycle": cycler(color=PALETTE),
    "font.family": [font for font in FONTS if font in fontManager.get_font_names()],
    "axes.spines.top": False,
    "axes.spines.right": False,
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titlepad": 9,
    "axes.titley": 1.0,  # no panel has ticks above it, which each drawing would measure
    "svg.fonttype": "none",
    "svg.hashsalt": "hbm",
    "text.parse_math": False,
}


def condition_style(k: int) -> tuple[str, Any]:
    """Give colour and line style of a study's kth condition, distinct for the first 25."""
    return PALETTE[k % len(PALETTE)], LINE_STYLES[(k + k // len(PALETTE)) % len(LINE_STYLES)]


@contextmanager
def in_style() -> Iterator[None]:
    """Draw in the style; in PNG, a letter that no font has is a box, of which nothing is said."""
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        yield


def draw_band(
    panel: Axes,
    x: Array,
    mean: Array,
    spread: Array,
    colour: str,
    *,
    label: str | None = None,
    linestyle: Any = "-",
    linewidth: float = LINE_WIDTH_PT,
) -> None:
    """Draw a mean as a line and its spread on both sides as a band.

    Parameters
    ----------
    panel
        Where.
    x, mean, spread
        (N,) each; no band where `spread` is NaN.
    colour
        Of line and band.
    label, linestyle, linewidth
        Of the line; its width in points.
    """
    panel.plot(x, mean, color=colour, label=label, ls=linestyle, lw=linewidth)
    panel.fill_between(x, mean - spread, mean + spread, color=colour, alpha=BAND_OPACITY, lw=0)


def draw_differences(panel: Axes, parts: "Iterable[CurveDifference]") -> None:
    """Draw bars above a panel over the parts of the gait cycle that differ, and the smallest p.

    Each percent of the cycle is as wide in the bars as in the curves, so that a single one is seen.
    """
    smallest = 1.0
    for part in parts:
        start, stop = max(part.start - 0.5, 0.0), min(part.stop + 0.5, 100.0)
        panel.axvspan(start, stop, *BAR, color="black", lw=0, clip_on=False)
        smallest = min(smallest, part.p)
    if smallest < 1.0:
        text = "p < 0.001" if smallest < 0.001 else f"p = {smallest:.3f}"
        panel.set_title(text, loc="right", fontsize=7)


def draw_logarithmic(panel: Axes, values: ArrayLike) -> None:
    """Give a panel a logarithmic axis upward that holds values, with plain numbers at its ticks."""
    logarithms = np.log([value for value in np.ravel(values) if value > 0] or [1.0])
    middle, half = (logarithms.max() + logarithms.min()) / 2, 0.55 * np.ptp(logarithms)
    half = max(half, np.log(MIN_RATIO) / 2)
    panel.set_yscale("log", nonpositive="clip")
    panel.set_ylim(*np.exp([middle - half, middle + half]))
    panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    panel.yaxis.set_major_formatter("{x:g}")
    panel.yaxis.set_minor_formatter("")


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG and SVG, each completely or not at all; give the SVG."""
    bare = path.with_suffix("") if path.suffix in (".png", ".svg") else path
    for suffix in (".png", ".svg"):
        with whole_file(Path(f"{bare}{suffix}")) as temporary:
            _print(figure, suffix, temporary)
        figure.set_layout_engine("none")  # the same layout in both files
    return Path(f"{bare}.svg")


def drawing(figure: Figure, suffix: str = ".svg") -> str:
    """Give a figure as a source inside the page, without a file; .png where lines are many."""
    target = BytesIO()
    _print(figure, suffix, target)
    return _source(target.getvalue(), suffix)


def picture(path: Path) -> str:
    """Give a figure's file as a source inside the page."""
    return _source(path.read_bytes(), path.suffix)


def _print(figure: Figure, suffix: str, target: Path | BytesIO) -> None:
    """Draw a figure into a file; savefig() would draw it twice, once for its layout."""
    figure.dpi = DPI
    canvas: Any
    with in_style():
        if suffix == ".png":
            canvas = FigureCanvasAgg(figure)
            canvas.print_png(target, pil_kwargs={"compress_level": FAST})
        else:
            canvas = FigureCanvasSVG(figure)
            canvas.print_svg(target, metadata={"Date": None})


def _source(content: bytes, suffix: str) -> str:
    return f"data:{MEDIA_TYPES[suffix]};base64,{b64encode(content).decode()}"
