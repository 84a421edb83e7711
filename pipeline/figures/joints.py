"""Joint angles, moments and powers over the gait cycle: a row each, a column per joint motion."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.figure import Figure

from hbm.spatial import Array
from pipeline.config.schema import Figures
from pipeline.figures.residuals import legend_below, panel_grid
from pipeline.figures.style import (
    COLOURS,
    LINES,
    PAGE,
    add_title,
    draw_band,
    draw_differences,
    in_style,
    make_room_above,
)
from pipeline.trial.joints import CURVES, JOINT_MOTIONS, JointMotion

if TYPE_CHECKING:
    from pipeline.statistics.curves import CurveDifference

LEG: Final = tuple(m for m in JOINT_MOTIONS if m.joint in ("hip", "knee", "ankle"))
UPPER_BODY: Final = tuple(m for m in JOINT_MOTIONS if m not in LEG)
GAPS: Final = "; gaps: load of the foot, or pose, unknown in most gait cycles"
"""Moments are unknown where it is uncertain whose foot is on a plate, or none carries it."""

Curve = tuple[str, str, Any, Array, Array]
"""Label, colour and line style of a curve; mean and standard deviation, (101, 13, 3)."""


def healthy_bands() -> dict[tuple[str, str], list[Array]]:
    """Give mean and SD of healthy adults over 0–100 %, (101,): joint motion and curve -> both."""
    text = Path(__file__).with_name("healthy.csv").read_text(encoding="utf-8")
    _, *lines = (line for line in text.splitlines() if line[0] != "#")
    bands = dict[tuple[str, str], list[Array]]()
    for motion, curve, _, *coefficients in (line.split(",") for line in lines):
        # cosine and sine of each harmonic: a Fourier series
        angle = np.outer(np.linspace(0, 2 * np.pi, 101), np.arange(len(coefficients) // 2))
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(101, -1)
        bands.setdefault((motion, curve), []).append(waves @ np.array(coefficients, float))
    return bands


def joint_figure(
    curves: Iterable[Curve],
    title: str,
    motions: tuple[JointMotion, ...] = LEG,
    differing: "Mapping[tuple[str, str], Sequence[CurveDifference]]" = MappingProxyType({}),
    healthy: Mapping[tuple[str, str], Sequence[Array]] = MappingProxyType({}),
    shown: Sequence[str] = (*CURVES,),
    gaps: str = GAPS,
    look: Figures = PAGE,
) -> Figure:
    """Draw means over the gait cycle with one standard deviation as a band.

    ``differing`` are parts that differ, drawn as bars: name of a joint motion and curve -> parts.
    ``healthy`` is as of `healthy_bands`, drawn behind; ``shown`` are some of `CURVES`; ``gaps``
    says in the title why parts are unknown.
    """
    columns = [JOINT_MOTIONS.index(motion) for motion in motions]
    # which of each curve is positive
    positive = {"angle": "", "moment": "internal ", "power": "generated "}
    quantities = [f"{positive[name]}{name} ({CURVES[name]})" for name in shown]
    places = [[*CURVES].index(name) for name in shown]
    # "+": that direction is positive
    heads = [f"{motion.joint} {motion.direction}\N{NO-BREAK SPACE}+" for motion in motions]
    turned = look.width_mm is not None
    percent = np.linspace(0, 100, 101)
    any_p = any(differing.values())  # in a line of its own, below the heads
    with in_style(look):
        any_gap = False
        figure, panels = panel_grid(len(shown), len(motions), (2.2, 1.7), look, turned=turned)
        panels[0, 0].set_xlim(0, 100)  # of all: each curve would find it anew from all panels
        for label, colour, linestyle, mean, spread in curves:
            any_gap |= bool(np.isnan(mean[:, columns][..., places]).any())
            for (row, column), panel in np.ndenumerate(panels):
                values = (
                    mean[:, columns[column], places[row]],
                    spread[:, columns[column], places[row]],
                )
                draw_band(panel, percent, *values, colour, label=label, ls=linestyle)
        for (row, column), panel in np.ndenumerate(panels):
            above, beside = heads[column], quantities[row].replace(" ", "\n", 1)
            below = "gait\N{NO-BREAK SPACE}cycle (%)"
            if turned:  # a panel may be as wide as a word
                above, beside, below = (t.replace(" ", "\n") for t in (above, beside, below))
            above += "\n" * any_p
            if panel.get_subplotspec().is_first_row():
                panel.set_title(above, loc="left")
            if panel.get_subplotspec().is_first_col():
                panel.set_ylabel(beside)
            else:  # the place of an empty label would be found from the ticks
                panel.yaxis.set_label_coords(0, 0)
            panel.set_xlabel(below)
            panel.axhline(0, color="black", lw=0.5)
            curve = motions[column].name, shown[row]
            draw_differences(panel, differing.get(curve, ()))
            if curve in healthy:
                usual, sd = healthy[curve]
                look_of_band: Any = {"color": "#D5DAE0", "lw": 0, "zorder": 0}
                ends = usual - sd, usual + sd
                panel.fill_between(percent, *ends, label="healthy ± SD", **look_of_band)
        legend_below(figure, panels[0, 0])
        make_room_above(figure, any_p)
        add_title(figure, title + gaps * any_gap, look)
    return figure


def trial_figure(means: Mapping[str, Sequence[Array]]) -> Figure:
    """Draw mean and SD of one trial by variant; of all trials it is one figure, laid out once."""
    any_gap = any(np.isnan(mean[:, : len(LEG)]).any() for mean, _ in means.values())
    figure = _trial_panels((*means,), GAPS * any_gap)
    for panel, (curve, motion) in zip(figure.axes, np.ndindex(len(CURVES), len(LEG)), strict=True):
        drawn: Any = panel.lines, panel.collections
        for line, band, of_joints in zip(*drawn, means.values(), strict=False):
            mean, spread = (values[:, motion, curve] for values in of_joints)
            line.set_ydata(mean)
            band.set_data(line.get_xdata(), *np.ma.masked_invalid([mean - spread, mean + spread]))
        outlines = [path.vertices[:, 1] for band in drawn[1] for path in band.get_paths()]
        heights = np.concatenate([*(line.get_ydata() for line in drawn[0]), *outlines])
        panel.dataLim.intervaly = np.nanmin(heights), np.nanmax(heights)
        panel.autoscale_view(scalex=False)
    return figure


@cache
def _trial_panels(variants: tuple[str, ...], gaps: str) -> Figure:
    unknown = np.full((101, len(JOINT_MOTIONS), len(CURVES)), np.nan)
    lines = LINES if len(variants) > 1 else dict.fromkeys(variants, "-")
    curves = [(name, COLOURS[name], lines[name], unknown, unknown) for name in variants]
    return joint_figure(curves, "Joints of the legs, mean ± SD", healthy=healthy_bands(), gaps=gaps)
