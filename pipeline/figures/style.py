"""How every figure looks, and how it is written."""

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hbm.spatial import Array
from pipeline.io.write import whole_file

COLOURS: Final = {"measured": "#D55E00", "compensated": "#0072B2", "baseline": "#555555"}
"""Vermilion, blue and grey of the colour-blind safe palette of Okabe and Ito."""


STYLE: Final[Any] = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "font.size": 9,
    "axes.titlesize": 9,
    "svg.fonttype": "none",
    "svg.hashsalt": "hbm",
    "text.parse_math": False,
}


def draw_band(panel: Axes, x: Array, mean: Array, spread: Array, colour: str, **line: Any) -> None:
    """Draw a mean as a line and its spread on both sides as a band, none where it is NaN."""
    panel.plot(x, mean, color=colour, **({"lw": 1.5} | line))
    panel.fill_between(x, mean - spread, mean + spread, color=colour, alpha=0.2, lw=0)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG and SVG beside each other, each whole or not at all."""
    bare = path.with_suffix("") if path.suffix in (".png", ".svg") else path
    with mpl.rc_context(STYLE):
        for suffix, undated in ((".png", None), (".svg", {"Date": None})):
            with whole_file(Path(f"{bare}{suffix}")) as temporary:
                figure.savefig(temporary, format=suffix[1:], dpi=150, metadata=undated)
            figure.set_layout_engine("none")  # laid out once, alike in both
