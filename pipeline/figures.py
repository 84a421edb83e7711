"""Figures: residuals over the gait cycle."""

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from pipeline.residuals import AXES, DIRECTIONS, UNITS, cycle_residuals, variants
from pipeline.trial_result import TrialResult

COLOURS: Final = {"measured": "#D55E00", "compensated": "#0072B2", "baseline": "#555555"}
"""Vermilion, blue and grey of the colour-blind safe palette of Okabe and Ito."""
STYLE: Final[Any] = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "font.size": 9,
    "axes.titlesize": 9,
    "svg.fonttype": "none",
}


def residual_figure(result: TrialResult) -> Figure:
    """Draw a trial's six residuals over the gait cycle, mean ± SD over the right foot's cycles.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    matplotlib.figure.Figure
        Six panels; forces above, moments below. Left cycles stand in where there are no right ones.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 5), layout="constrained")
        panels = figure.subplots(2, 3, sharex=True).ravel()
        percent = np.arange(101)
        side = "right" if len(result.cycles["right"]) else "left"
        for variant in variants(result):
            curves = cycle_residuals(result, variant)[side]
            mean, sd = np.nanmean(curves, axis=0), np.nanstd(curves, axis=0)
            for k, panel in enumerate(panels):
                colour = COLOURS[variant]
                panel.plot(percent, mean[:, k], color=colour, lw=1.5, label=variant)
                panel.fill_between(
                    percent,
                    mean[:, k] - sd[:, k],
                    mean[:, k] + sd[:, k],
                    color=colour,
                    alpha=0.2,
                    lw=0,
                )
        for k, panel in enumerate(panels):
            about = "" if k < 3 else "about "
            panel.set_title(f"{AXES[k]} ({about}{DIRECTIONS[k]})", loc="left")
            panel.set_ylabel(UNITS[k])
            panel.axhline(0, color="black", lw=0.5)
            panel.set_xlim(0, 100)
        for panel in panels[3:]:
            panel.set_xlabel("gait cycle (%)")
        if len(variants(result)) > 1:
            panels[0].legend(frameon=False)
        count = len(result.cycles[side])
        figure.suptitle(
            f"{result.source.name}: pelvis residuals, mean ± SD of {count} {side} gait cycles",
            fontsize=10,
        )
    return figure


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG and SVG beside each other."""
    path.parent.mkdir(parents=True, exist_ok=True)
    for suffix in (".png", ".svg"):
        figure.savefig(path.with_suffix(suffix), dpi=150)
