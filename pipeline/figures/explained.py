"""What a trial's residuals are made of, and how sure they are over the gait cycle."""

from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from hbm.spatial import Array
from pipeline.budgets.words import group_name
from pipeline.explain.budget import NORMAL_95, Bands, Budget
from pipeline.figures.residuals import label_panels, legend_below, six_panels
from pipeline.figures.style import BAND_OPACITY, PALETTE, STYLE
from pipeline.trial.gait.cycles import mean_and_sd, normalise
from pipeline.trial.residuals import AXES, UNITS

GROUP_COLOURS: Final = (
    *(*PALETTE[1:], "#F0E442", "#332288", "#882255", "#44AA99", "#117733", "#999933", "#AA4499"),
)
"""Of the colour-blind safe palettes of Okabe and Ito and of Tol, those without a meaning."""
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
    shares = [
        (group_name(group.groups), GROUP_COLOURS[k % len(GROUP_COLOURS)], 100 * group.share)
        for k, group in enumerate(budget.groups)
    ]
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
        panel.set_ylabel("percentage of the mean square (%)")
        figure.suptitle(
            f"{budget.source.name}: causes of the pelvis residuals, RMS [95 % interval]",
            fontsize=10,
        )
        figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def bands_figure(bands: Bands, name: str) -> Figure:
    """Draw the mean gait cycle of each residual, with two bands.

    Parameters
    ----------
    bands
        Of a trial.
    name
        Of the trial.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels over the gait cycle; forces above, moments below. The wide band is the 95 %
        interval of measurement: what causes of usual size change the residual by. It is much the
        same in all cycles. The narrow one is one standard deviation between cycles.
    """
    spans = _spans(bands)
    mean, between = mean_and_sd(normalise(bands.time, bands.residual, spans))
    variance = normalise(bands.time, bands.deviation**2, spans)
    half = NORMAL_95 * np.sqrt(np.nanmean(variance, axis=0))
    percent = np.linspace(0, 100, len(mean))
    with mpl.rc_context(STYLE):
        figure, panels = six_panels()
        for k, panel in enumerate(panels):
            for spread, colour, label in (
                (half[:, k], PALETTE[1], "95 % interval of measurement"),
                (between[:, k], PALETTE[0], "SD between cycles"),
            ):
                low, high = mean[:, k] - spread, mean[:, k] + spread
                panel.fill_between(
                    *(percent, low, high), color=colour, alpha=BAND_OPACITY, lw=0, label=label
                )
            panel.plot(percent, mean[:, k], label="mean")
        label_panels(panels)
        legend_below(figure, panels[0])
        figure.suptitle(
            f"{name}: pelvis residuals of {len(spans)} gait cycles with 95 % intervals",
            fontsize=10,
        )
    return figure


def _spans(bands: Bands) -> Array:
    """Give start and stop of the cycles, (C, 2) [s]."""
    first = np.flatnonzero(np.diff(bands.cycle, prepend=-1))
    last = np.append(first[1:], len(bands.cycle)) - 1
    return np.column_stack([bands.time[first], bands.time[last]])
