"""The figure of what each fault adds to each residual."""

from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from pipeline.figures.style import STYLE

MIN_SHADE, MAX_SHADE = 0.1, 300.0
"""Range of the logarithmic colour scale [N or N·m]: from nothing to no compensation."""
DARK: Final = 12.0
"""Above this value [N or N·m] a cell is so dark that its number is white."""
WHOLE: Final = 9.95
"""From this value on numbers are shown without a decimal."""
CAPTION: Final = (
    "RMS of the difference from the same walks in a perfect laboratory, {people}; filters: from "
    "a 30 Hz filter.\nOnly the fault named is present; body, platform pose and the treadmill's own "
    "wrench are known exactly unless named. Sway: gait cycles of the perturbations."
)


def ablation_figure(table: pd.DataFrame, subjects: int) -> Figure:
    """Draw what each fault adds to each residual, a panel per condition.

    Parameters
    ----------
    table
        As `pipeline.virtual_lab.analysis.ablation.ablation` gives it.
    subjects
        Number of simulated subjects.

    Returns
    -------
    matplotlib.figure.Figure
        Rows are faults by group, columns residuals; numbers are the RMS added, in N and N·m, shaded
        by size on a logarithmic scale.
    """
    rows: list[str] = []
    headings = []
    for group, own in table.groupby("group", sort=False):
        headings.append(len(rows))
        rows += [str(group).capitalize(), *dict.fromkeys(own["case"])]
    conditions = list(dict.fromkeys(table["condition"]))
    with mpl.rc_context(STYLE):
        size = 2.4 + 2.6 * len(conditions), 1.4 + 0.21 * len(rows)
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(1, len(conditions), sharey=True, squeeze=False)[0]
        for panel, condition in zip(panels, conditions, strict=True):
            _draw(panel, table[table["condition"] == condition], rows)
            panel.set_title(condition, fontweight="bold")
        for at in headings:
            panels[0].get_yticklabels()[at].set_fontweight("bold")
        figure.suptitle("What each fault alone adds to the pelvis residuals", fontsize=11)
        people = f"{subjects} simulated {'subject' if subjects == 1 else 'subjects'}"
        figure.supxlabel(CAPTION.format(people=people), fontsize=7.5)
    return figure


def _draw(panel: Axes, table: pd.DataFrame, rows: list[str]) -> None:
    axes = table[["axis", "unit"]].drop_duplicates()
    added = table.pivot(index="case", columns="axis", values="added").reindex(rows)[axes["axis"]]
    values = added.to_numpy()
    panel.imshow(
        np.ma.masked_invalid(np.clip(values, MIN_SHADE, MAX_SHADE)),
        norm=LogNorm(MIN_SHADE, MAX_SHADE),
        cmap="Blues",
        aspect="auto",
    )
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            text = f"{value:.0f}" if value >= WHOLE else f"{value:.1f}"
            colour = "white" if value > DARK else "black"
            panel.text(column, row, text, ha="center", va="center", color=colour, size=7)
    panel.set_xticks(
        range(len(axes)), [f"{axis}\n{unit}" for axis, unit in axes.itertuples(index=False)]
    )
    panel.set_yticks(range(len(rows)), rows)
    panel.tick_params(length=0, top=False)
    for spine in panel.spines.values():
        spine.set_visible(False)
