"""Figures of experiment 1, like Figs 2 and F.1a to F.1d of the thesis."""

from collections.abc import Sequence
from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.config.plate_study import BeltSide, WeightRecording
from pipeline.figures.style import COLOURS, STYLE
from pipeline.plate_accuracy.accuracy import mean_loads, quantities, reported_errors
from pipeline.plate_accuracy.trials import WeightTrial

CONDITIONS: Final = {
    "zone": "part of the belt",
    "speed_mps": "speed (m/s)",
    "position_m": "start, from the belt's outer edge (m)",
}
"""Column of the errors -> its name on an axis."""
SHOWN_S: Final = 10.0
"""Of a recording: thirty periods of a vibration of 3 Hz."""
BAR_GROUP_WIDTH: Final = 0.8
"""Of the distance between levels, shared by the bars of a level."""


def error_figure(errors: pd.DataFrame, along: str, group: str) -> Figure:
    """Draw the error of the centre of pressure along the belt per two conditions (Figs 2, F.1b).

    Parameters
    ----------
    errors
        As `pipeline.plate_accuracy.accuracy.trial_errors` gives them.
    along, group
        Columns: on the axis, and side by side.
    """
    part = reported_errors(errors)
    part = part[part["quantity"] == "COPx"]
    part = part[(part["zone"] == "all") == (along != "zone")]
    levels = list(dict.fromkeys(part[along])) if along == "zone" else sorted(part[along].unique())
    groups = sorted(part[group].unique())
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6, 3.5), layout="constrained")
        panel = figure.subplots()
        width = BAR_GROUP_WIDTH / len(groups)
        for g, label in enumerate(groups):
            cells = part[part[group] == label].groupby(along)["orthogonal"]
            mean, sd = (1000 * x.reindex(levels) for x in (cells.mean(), cells.std()))
            at = np.arange(len(levels)) + (g - (len(groups) - 1) / 2) * width
            panel.bar(at, mean, 0.9 * width, label=str(label), color=f"C{g}")
            panel.errorbar(at, mean, sd, fmt="none", ecolor="black", lw=0.8)
        panel.set_xticks(range(len(levels)), [str(level) for level in levels])
        panel.set_xlabel(CONDITIONS.get(along, along))
        panel.set_ylabel("CoP along the belt, RMSE (mm)")
        figure.legend(title=CONDITIONS.get(group, group), loc="outside right upper")
    return figure


def linearity_figure(trials: Sequence[WeightTrial]) -> Figure:
    """Draw measured against known vertical force, a line through both, and the difference.

    Like Fig. F.1d.
    """
    sides: tuple[tuple[BeltSide, str, str], ...] = (
        ("left", "o", "measured"),
        ("right", "x", "compensated"),
    )
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6, 4), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        for belt, marker, colour in sides:
            known, measured = mean_loads(trials, belt)
            if not len(known):
                continue
            look = {"ms": 4, "mfc": "none", "color": COLOURS[colour]}
            above.plot(known, measured, marker, label=belt, **look)
            below.plot(known, measured - known, marker, **look)
            if len(np.unique(known.round())) > 1:
                line = np.polynomial.Polynomial.fit(known, measured, 1)
                ends = np.array([known.min(), known.max()])
                above.plot(ends, line(ends), color=COLOURS[colour], lw=0.8)
                below.plot(ends, line(ends) - ends, color=COLOURS[colour], lw=0.8)
        above.set_ylabel("measured (N)")
        below.set_ylabel("measured − known (N)")
        below.set_xlabel("known vertical force (N)")
        above.legend(frameon=False)
    return figure


def vibration_figure(trials: Sequence[WeightTrial]) -> Figure:
    """Draw the centre of pressure in time, minus the marker (Fig. F.1c).

    Of two recordings of equal conditions but for the supports, if there are such, where they are
    compared with the weight.
    """
    groups: dict[WeightRecording, dict[bool, WeightTrial]] = {}
    for trial in trials:
        conditions = trial.weight.model_copy(update={"file": "", "supports": True})
        groups.setdefault(conditions, {})[trial.weight.supports] = trial
    weight, alike = max(groups.items(), key=lambda group: len(group[1]))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6, 3), layout="constrained")
        panel = figure.subplots()
        for supports, trial in alike.items():
            time = trial.time - trial.time[trial.used][0]
            shown = trial.used & (time <= SHOWN_S)
            off = 1000 * (quantities(trial.measured)[:, 0] - trial.marker[:, 0])
            panel.plot(
                time,
                np.where(shown, off, np.nan),
                color=COLOURS["compensated" if supports else "measured"],
                label="with supports" if supports else "without supports",
                lw=0.8,
                zorder=2 + supports,
            )
        panel.set_title(
            f"{weight.belt}, {weight.profile} at {weight.speed_mps:g} m/s, {weight.mass_kg:g} kg, "
            f"{weight.position_m:g} m from the edge",
            loc="left",
        )
        panel.set_xlabel("time (s)")
        panel.set_ylabel("CoP along the belt − marker (mm)")
        panel.legend(frameon=False)
    return figure
