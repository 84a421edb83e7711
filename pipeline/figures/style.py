"""The style of all figures, and how they are written."""

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager

from hbm.spatial import Array
from pipeline.io.write import whole_file
from pipeline.statistics.curves import CurveDifference

COLOURS: Final = {"measured": "#D55E00", "compensated": "#0072B2", "baseline": "#555555"}
"""Vermilion, blue and grey of the colour-blind safe palette of Okabe and Ito."""
LINE_WIDTH_PT: Final = 1.5
BAND_OPACITY: Final = 0.2
"""Two bands and their overlap can be distinguished."""
BAR: Final = 0.02
"""Height of a bar over a part of the gait cycle, as a share of the panel's."""
DPI: Final = 150
"""Resolution of PNG files: 1400 pixels for a figure across a page."""

FONTS: Final = ("DejaVu Sans", "Arial Unicode MS", "Noto Sans CJK JP", "Hiragino Sans", "Yu Gothic")
"""Of these, the ones that are installed: the first that has a letter draws it."""
STYLE: Final[Any] = {
    "font.family": [font for font in FONTS if font in fontManager.get_font_names()],
    "axes.spines.top": False,
    "axes.spines.right": False,
    "font.size": 9,
    "axes.titlesize": 9,
    "svg.fonttype": "none",
    "svg.hashsalt": "hbm",
    "text.parse_math": False,
}


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
    linestyle: str = "-",
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


def draw_differences(panel: Axes, parts: Iterable[CurveDifference]) -> None:
    """Draw bars below curves over the parts of the gait cycle that differ; p of the longest."""
    parts = sorted(parts, key=lambda part: part.stop - part.start)
    for part in parts:
        panel.axvspan(part.start, part.stop, ymin=0, ymax=BAR, color="black", lw=0)
    for part in parts[-1:]:
        text = "p < 0.001" if part.p < 0.001 else f"p = {part.p:.3f}"
        place = (part.start + part.stop) / 2, 1.5 * BAR
        panel.text(*place, text, fontsize=6, ha="center", transform=panel.get_xaxis_transform())


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG and SVG, each completely or not at all."""
    bare = path.with_suffix("") if path.suffix in (".png", ".svg") else path
    figure.dpi = DPI
    raster: Any = FigureCanvasAgg(figure)
    with in_style():  # savefig() would draw each format twice, once for its layout
        with whole_file(Path(f"{bare}.png")) as temporary:
            raster.print_png(temporary)
        figure.set_layout_engine("none")  # the same layout in both files
        vector: Any = FigureCanvasSVG(figure)
        with whole_file(Path(f"{bare}.svg")) as temporary:
            vector.print_svg(temporary, metadata={"Date": None})
