"""The style of all figures, and how they are written."""

import re
import textwrap
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
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import ArrayLike
from PIL import Image

from hbm.spatial import Array
from hbm.spelling import p_equation
from pipeline.config.schema import FIGURE_FORMATS, FigureFormat, Figures
from pipeline.io.write import whole_file

if TYPE_CHECKING:
    from pipeline.statistics.curves import CurveDifference

COLOURS: Final = {"measured": "#D55E00", "compensated": "#0072B2"}
"""Vermilion and blue mean plates as measured and compensated, in every figure and in the viewer."""
LINES: Final = {"measured": "--", "compensated": "-"}
"""Of both where they are drawn together, so that they differ without colours."""
PALETTE: Final = ("#000000", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""All others of the colour-blind safe palette of Okabe and Ito but yellow: conditions, plates …"""
LINE_STYLES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
"""Of conditions, so that no two differ by colour alone."""
LINE_INCH: Final = 0.2
"""Height of a line of a legend or a title."""
BAND_OPACITY: Final = 0.2
"""Two bands and their overlap can be distinguished."""
PAGE: Final = Figures()
"""Figures on the pages of a report; all others where nothing is stated of them."""
PRINTERS: Final[Any] = {
    "pdf": {"metadata": {"CreationDate": None}},
    "svg": {"metadata": {"Date": None}},
    # default compression makes files 7 % smaller, and takes three times as long
    "png": {"pil_kwargs": {"compress_level": 1}},
    "tiff": {},
}

FONTS: Final = ("DejaVu Sans", "Arial Unicode MS", "Noto Sans CJK JP", "Hiragino Sans", "Yu Gothic")
"""Of these, the ones that are installed: the first that has a letter draws it."""
STYLE: Final[Any] = {
    "axes.prop_cycle": cycler(color=PALETTE),
    "font.family": [font for font in FONTS if font in fontManager.get_font_names()],
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": "medium",
    "axes.titlepad": 9,
    "axes.titley": 1.0,  # no panel has ticks above it, which each drawing would measure
    "figure.titlesize": "large",
    "pdf.fonttype": 42,  # letters that can be edited, as journals ask
    "svg.fonttype": "none",
    "svg.hashsalt": "hbm",
    "text.parse_math": False,
}


def condition_style(k: int) -> tuple[str, Any]:
    """Give colour and line style of a study's kth condition, distinct for the first 25."""
    return PALETTE[k % len(PALETTE)], LINE_STYLES[(k + k // len(PALETTE)) % len(LINE_STYLES)]


@contextmanager
def in_style(look: Figures = PAGE) -> Iterator[None]:
    """Draw in the style; but in SVG, a letter that no font has is a box, of which nothing is said.

    Letters are as large as stated or, in a journal, as fit between its columns.
    """
    size = look.font_pt or (9 if look.width_mm is None else 7 if look.of_one_column else 8)
    in_journal: Any = {"figure.titlesize": "medium", "lines.linewidth": 1.0}
    smaller = {} if look.width_mm is None else in_journal
    with mpl.rc_context({**STYLE, **smaller, "font.size": size}), warnings.catch_warnings():
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
    **style: Any,
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
    label, style
        Of the line.
    """
    panel.plot(x, mean, color=colour, label=label, **style)
    panel.fill_between(x, mean - spread, mean + spread, color=colour, alpha=BAND_OPACITY, lw=0)


def draw_differences(panel: Axes, parts: "Iterable[CurveDifference]") -> None:
    """Draw bars above a panel over the parts of the gait cycle that differ, and the smallest p.

    Each percent of the cycle is as wide in the bars as in the curves, so that a single one is seen.
    """
    smallest = 1.0
    for part in parts:
        start, stop = max(part.start - 0.5, 0.0), min(part.stop + 0.5, 100.0)
        # just above the panel, whose height is 1
        panel.axvspan(start, stop, 1.01, 1.035, color="black", lw=0, clip_on=False)
        smallest = min(smallest, part.p)
    if smallest < 1.0:
        panel.set_title(p_equation(smallest), loc="right", fontsize="small")


def draw_logarithmic(panel: Axes, values: ArrayLike) -> None:
    """Give a panel a logarithmic axis upward that holds values, with plain numbers at its ticks."""
    logarithms = np.log([value for value in np.ravel(values) if value > 0] or [1.0])
    middle, half = (logarithms.max() + logarithms.min()) / 2, 0.55 * np.ptp(logarithms)
    # a decade at least: what hardly differs looks so, and there are three ticks
    half = max(half, np.log(10.0) / 2)
    panel.set_yscale("log", nonpositive="clip")
    panel.set_ylim(*np.exp([middle - half, middle + half]))
    panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    panel.yaxis.set_major_formatter("{x:g}")
    panel.yaxis.set_minor_locator(NullLocator())


def letters_in(inch: float) -> int:
    """Say how many letters of the style fit in a width."""
    return int(inch * 72 / (0.58 * mpl.rcParams["font.size"]))  # mean width of a letter


def add_title(figure: Figure, title: str, look: Figures = PAGE) -> None:
    """Put a title above all panels, in as many lines as it needs.

    In a figure for a journal, which has it in the caption, it is the label of the figure alone.
    """
    figure.set_label(title)
    if look.width_mm is None:
        lines = textwrap.wrap(title, letters_in(figure.get_figwidth() / 1.2))
        figure.suptitle("\n".join(lines))
        make_room_above(figure, len(lines) - 1)


def make_room_above(figure: Figure, lines: int) -> None:
    """Lower the upper edge of panels whose places are fixed, by lines of text."""
    if figure.get_layout_engine() is None and lines > 0:
        room = lines * LINE_INCH / figure.get_figheight()
        figure.subplots_adjust(top=figure.subplotpars.top - room)


def save_figure(figure: Figure, path: Path, look: Figures = PAGE) -> str:
    """Write a figure in the stated formats, each completely or not at all, path without suffix.

    Files of other formats, which would be of another time, go. Gives its source inside a page.
    """
    if look.decimals == "comma":
        _write_commas(figure)
    svg = _printed(figure, "svg", look)
    for kind in FIGURE_FORMATS:
        file = path.with_name(f"{path.name}.{kind}")
        if kind in look.formats:
            with whole_file(file) as temporary:
                temporary.write_bytes(svg if kind == "svg" else _printed(figure, kind, look))
        else:
            file.unlink(missing_ok=True)
    return _source(svg, "svg+xml")


def _write_commas(figure: Figure) -> None:
    """Write numbers at ticks, and p, with a comma; names of conditions keep their points."""
    for panel in figure.axes:
        panel.yaxis.set_major_formatter(lambda y, _: f"{y:g}".replace(".", ",").replace("-", "−"))
    for text in figure.findobj(Text):
        text.set_text(re.sub(r"\b(p [=<] ?)0?\.(?=\d)", r"\g<1>0,", text.get_text()))


def drawing(figure: Figure, kind: FigureFormat = "svg") -> str:
    """Give a figure as a source inside the page, without a file; png where lines are many."""
    return _source(_printed(figure, kind, PAGE), {"svg": "svg+xml"}.get(kind, kind))


def _printed(figure: Figure, kind: FigureFormat, look: Figures) -> bytes:
    """Draw a figure as a file; savefig() would draw it twice, once for its layout."""
    # on a page 1400 pixels across it, else the least that journals take
    figure.dpi = look.dpi or (150 if look == PAGE else 300)
    target = BytesIO()
    # loaded where it is used: that of PDF takes a sixth of a second
    canvas = get_registered_canvas_class(kind)(figure)
    with in_style(look):
        getattr(canvas, f"print_{kind}")(target, **PRINTERS[kind])
    figure.set_layout_engine("none")  # the same layout in all files
    if kind == "tiff":  # as journals ask: without transparency
        image, target = Image.open(target), BytesIO()
        dpi = figure.dpi, figure.dpi
        image.convert("RGB").save(target, "TIFF", compression="tiff_lzw", dpi=dpi)
    return target.getvalue()


def _source(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{b64encode(content).decode()}"
