"""Figures of experiment 1, like Figs 2 and F.1 of the thesis."""

from collections.abc import Mapping, Sequence
from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.signal import welch

from compensation import Delay, PlateAlignment
from hbm.spatial import Array
from pipeline.config.plate_study import BeltSide
from pipeline.figures.style import COLOURS, STYLE
from pipeline.plate_accuracy.accuracy import mean_loads
from pipeline.plate_accuracy.trials import RATE_HZ, WeightTrial

CONDITIONS: Final = {
    "zone": "part of the belt",
    "speed_mps": "speed (m/s)",
    "position_m": "start, from the belt's outer edge (m)",
}
"""Column of the errors -> its name on an axis."""
BAR_GROUP_WIDTH: Final = 0.8
"""Of the distance between levels, shared by the bars of a level."""
SPECTRUM_WINDOW_S: Final = 5.0
"""Of Welch's method: resolves 0.2 Hz."""
MAX_SPECTRUM_HZ: Final = 20.0
"""The cut-off of the low-pass."""


def error_figure(errors: pd.DataFrame, along: str, group: str) -> Figure:
    """Draw the error of the centre of pressure along the belt per two conditions (Figs 2, F.1b).

    Parameters
    ----------
    errors
        As in `pipeline.plate_accuracy.accuracy.PlateAccuracy`.
    along, group
        Columns: on the axis, and side by side.
    """
    reported = errors["supports"] == errors["supports"].any()
    part = errors[(errors["quantity"] == "COPx") & reported]
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
    """Draw the spectrum of the centre of pressure minus the marker, by supports (Fig. F.1c)."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6, 3.5), layout="constrained")
        panel = figure.subplots()
        for supports, colour in ((True, "compensated"), (False, "measured")):
            chosen = [t for t in trials if t.weight.supports == supports]
            if not chosen:
                continue
            length = min(int(SPECTRUM_WINDOW_S * RATE_HZ), min(len(t.time) for t in chosen))
            spectra = []
            for trial in chosen:
                difference = -(trial.measured[:, 4] - trial.truth[:, 4]) / trial.truth[:, 2].mean()
                hz, density = welch(1000 * difference, RATE_HZ, nperseg=length)
                spectra.append(density)
            inside = (hz > 0) & (hz <= MAX_SPECTRUM_HZ)
            panel.semilogy(
                hz[inside],
                np.mean(spectra, axis=0)[inside],
                color=COLOURS[colour],
                label="with supports" if supports else "without supports",
            )
        panel.yaxis.set_major_formatter("{x:g}")
        panel.set_xlabel("frequency (Hz)")
        panel.set_ylabel("CoP along the belt (mm²/Hz)")
        panel.legend(frameon=False)
    return figure


def static_figure(
    places: Mapping[BeltSide, tuple[Array, Array]], alignments: Mapping[BeltSide, PlateAlignment]
) -> Figure | None:
    """Draw the distance of plate and marker at every place, before and after (Fig. F.1e)."""
    if not places:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3 * len(places) + 1, 3.6), layout="constrained")
        panels = figure.subplots(1, len(places), sharex=True, sharey=True, squeeze=False)[0]
        for panel, (belt, (plate, camera)) in zip(panels, places.items(), strict=True):
            found = alignments[belt]
            for name, seen, colour in (
                ("before", plate, "measured"),
                ("after", found.to_camera(plate), "compensated"),
            ):
                along, across = 1000 * (seen - camera).T
                panel.plot(along, across, "o", ms=3, color=COLOURS[colour], label=name)
            panel.axhline(0, color="black", lw=0.5)
            panel.axvline(0, color="black", lw=0.5)
            panel.set_aspect("equal", adjustable="box")
            before, after = 1000 * found.rms_before, 1000 * found.rms_after
            panel.set_title(f"{belt}: {before:.2f} mm RMS, then {after:.2f} mm", loc="left")
            panel.set_xlabel("plate − marker along the belt (mm)")
        panels[0].set_ylabel("plate − marker across (mm)")
        lines = panels[0].get_legend_handles_labels()
        figure.legend(*lines, loc="outside lower center", ncols=2, title="alignment")
    return figure


def hammer_figure(delays: Mapping[BeltSide, Delay]) -> Figure | None:
    """Draw the delay of every impact (Fig. F.1f)."""
    if not delays:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5, 3), layout="constrained")
        panel = figure.subplots()
        for belt, delay in delays.items():
            impacts = 1000 * np.array(delay.differences)
            line = panel.plot(np.arange(1, len(impacts) + 1), impacts, "o", ms=4, label=belt)[0]
            panel.axhline(1000 * delay.seconds, color=line.get_color(), lw=1)
        panel.set_xlabel("impact")
        panel.set_ylabel("plate later than marker (ms)")
        panel.legend(frameon=False)
    return figure
