"""What a trial's residuals are made of: stacked shares of their mean square."""

from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from pipeline.budgets.words import group_name
from pipeline.explain.budget import Budget, GroupShare
from pipeline.figures.style import STYLE
from pipeline.trial.residuals import AXES, UNITS

COLOURS: Final = (
    *("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442"),
    *("#332288", "#882255", "#44AA99", "#117733"),
)
"""The colour-blind safe palettes of Okabe and Ito and of Tol."""
UNEXPLAINED: Final = "#DDDDDD"


def budget_figure(budget: Budget) -> Figure:
    """Draw the share of each group of causes in the mean square of each residual.

    Parameters
    ----------
    budget
        Of a trial.

    Returns
    -------
    matplotlib.figure.Figure
        A bar per residual, over which its RMS and 95 % interval stand. Shares below zero hang
        below the axis: without that cause the residual would be larger.
    """
    shares = [(group_name(g.groups), colour, 100 * g.share) for g, colour in _coloured(budget)]
    shares.append(("not explained", UNEXPLAINED, 100 * budget.unexplained))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 5), layout="constrained")
        panel = figure.subplots()
        above, below = np.zeros(len(AXES)), np.zeros(len(AXES))
        for name, colour, share in shares:
            base = np.where(share >= 0, above, below)
            panel.bar(AXES, share, 0.7, bottom=base, color=colour, label=name)
            above, below = above + np.maximum(share, 0), below + np.minimum(share, 0)
        for k, (rms, low, high) in enumerate(zip(budget.rms, budget.low, budget.high, strict=True)):
            text = f"{rms:.1f} {UNITS[k]}\n[{low:.1f}–{high:.1f}]"
            panel.text(k, above[k] + 2, text, ha="center", va="bottom", fontsize=8)
        panel.set_ylim(min(below.min() * 1.1, 0), above.max() * 1.15)
        panel.axhline(0, color="black", lw=0.5)
        panel.set_ylabel("share of the mean square (%)")
        figure.suptitle(
            f"{budget.source.name}: what the pelvis residuals are made of, RMS [95 % interval]",
            fontsize=10,
        )
        figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def _coloured(budget: Budget) -> list[tuple[GroupShare, str]]:
    return [(g, COLOURS[k % len(COLOURS)]) for k, g in enumerate(budget.groups)]
