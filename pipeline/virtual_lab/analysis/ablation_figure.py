"""The table of what each fault adds, as a picture."""

from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from pipeline.figures.style import STYLE

LEAST, MOST = 0.1, 300.0
NOTE: Final = (
    "RMS of the difference from the same walks in a perfect laboratory, {people}; filters: from "
    "one that passes all of walking.\nOnly the fault named is on; body, pose and the treadmill's "
    "own wrench are known unless named. Sway: gait cycles of the perturbations."
)


def ablation_figure(table: pd.DataFrame, subjects: int) -> Figure:
    """Draw what each fault adds to each residual, a panel per condition.

    Parameters
    ----------
    table
        As `pipeline.virtual_lab.analysis.ablation.ablation` gives it.
    subjects
        How many people walked.

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
        people = f"{subjects} virtual {'person' if subjects == 1 else 'people'}"
        figure.supxlabel(NOTE.format(people=people), fontsize=7.5)
    return figure


def _draw(panel: Axes, table: pd.DataFrame, rows: list[str]) -> None:
    axes = table[["axis", "unit"]].drop_duplicates()
    added = table.pivot(index="case", columns="axis", values="added").reindex(rows)[axes["axis"]]
    values = added.to_numpy()
    panel.imshow(
        np.ma.masked_invalid(np.clip(values, LEAST, MOST)),
        norm=LogNorm(LEAST, MOST),
        cmap="Blues",
        aspect="auto",
    )
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            text = f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"
            colour = "white" if value > 12 else "black"
            panel.text(column, row, text, ha="center", va="center", color=colour, size=7)
    panel.set_xticks(
        range(len(axes)), [f"{axis}\n{unit}" for axis, unit in axes.itertuples(index=False)]
    )
    panel.set_yticks(range(len(rows)), rows)
    panel.tick_params(length=0, top=False)
    for spine in panel.spines.values():
        spine.set_visible(False)
