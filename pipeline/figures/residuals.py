"""Residuals over the gait cycle: the figure of one trial, and the labels of its panels."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.style import COLOURS, STYLE, draw_band
from pipeline.trial.residuals import AXES, DIRECTIONS, UNITS, cycle_residuals, variants
from pipeline.trial.result import TrialResult


def residual_figure(result: TrialResult) -> Figure:
    """Draw a trial's six residuals over the gait cycle, mean ± SD over the right foot's cycles.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels; forces above, moments below. Cycles of the left foot where there are none of
        the right.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 5), layout="constrained")
        panels = figure.subplots(2, 3, sharex=True).ravel()
        side = "right" if len(result.cycles["right"]) else "left"
        for variant in variants(result):
            curves = cycle_residuals(result, variant)[side]
            mean, sd = np.nanmean(curves, axis=0), np.nanstd(curves, axis=0)
            percent = np.linspace(0, 100, len(mean))
            for k, panel in enumerate(panels):
                draw_band(panel, percent, mean[:, k], sd[:, k], COLOURS[variant], label=variant)
        label_panels(panels)
        if len(variants(result)) > 1:
            panels[0].legend(frameon=False)
        count = len(result.cycles[side])
        figure.suptitle(
            f"{result.source.name}: pelvis residuals, mean ± SD of {count} {side} gait cycles",
            fontsize=10,
        )
    return figure


def axis_label(k: int) -> str:
    """Give a residual's axis with its direction, such as "Mx (about forward)"."""
    return f"{AXES[k]} ({'' if k < 3 else 'about '}{DIRECTIONS[k]})"


def label_panels(panels: Sequence[Axes]) -> None:
    """Label six panels of residuals over the gait cycle, two rows of three."""
    for k, panel in enumerate(panels):
        panel.set_title(axis_label(k), loc="left")
        panel.set_ylabel(UNITS[k])
        panel.axhline(0, color="black", lw=0.5)
        panel.set_xlim(0, 100)
    for panel in panels[3:]:
        panel.set_xlabel("gait cycle (%)")
