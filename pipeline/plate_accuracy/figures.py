"""Figures of experiment 1, like Figs 2 and F.1 of the thesis."""

from collections.abc import Mapping, Sequence
from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import welch

from compensation import Delay, PlateAlignment
from hbm.spatial import Array
from pipeline.config.plate_study import BeltSide, WeightRecording
from pipeline.figures.style import COLOURS, STYLE
from pipeline.plate_accuracy.accuracy import mean_loads, quantities, reported_errors
from pipeline.plate_accuracy.trials import AROUND_S, RATE_HZ, HammerTrace, WeightTrial

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
    """Draw the centre of pressure in time, minus the marker (Fig. F.1c), and a spectrum.

    In time: where recordings are compared, of two recordings of equal conditions but for the
    supports, if there are such. The spectrum is of the difference from the true centre of pressure.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6, 5), layout="constrained")
        in_time, spectrum = figure.subplots(2, 1)
        for trial in _alike(trials):
            time = trial.time - trial.time[trial.used][0]
            shown = (time >= 0) & (time <= SHOWN_S)
            in_time.plot(
                time[shown],
                np.where(trial.used, _from_marker(trial), np.nan)[shown],
                color=_colour(trial),
                lw=0.8,
                zorder=2 + trial.weight.supports,
            )
            weight = trial.weight
        in_time.set_title(
            f"{weight.belt}, {weight.profile} at {weight.speed_mps:g} m/s, {weight.mass_kg:g} kg, "
            f"{weight.position_m:g} m from the edge",
            loc="left",
        )
        for supports in (True, False):
            chosen = [t for t in trials if t.weight.supports == supports]
            if not chosen:
                continue
            length = min(int(SPECTRUM_WINDOW_S * RATE_HZ), min(len(t.time) for t in chosen))
            spectra = []
            for trial in chosen:
                hz, density = welch(_error(trial), RATE_HZ, nperseg=length)
                spectra.append(density)
            inside = (hz > 0) & (hz <= MAX_SPECTRUM_HZ)
            spectrum.semilogy(
                hz[inside],
                np.mean(spectra, axis=0)[inside],
                color=_colour(chosen[0]),
                label="with supports" if supports else "without supports",
            )
        in_time.set_xlabel("time (s)")
        in_time.set_ylabel("CoP along the belt − marker (mm)")
        spectrum.yaxis.set_major_formatter("{x:g}")
        spectrum.set_xlabel("frequency (Hz), all recordings")
        spectrum.set_ylabel("CoP error (mm²/Hz)")
        spectrum.legend(frameon=False)
    return figure


def _alike(trials: Sequence[WeightTrial]) -> list[WeightTrial]:
    """Give recordings equal but for the supports; of several such, the median by spread."""
    groups: dict[WeightRecording, list[WeightTrial]] = {}
    for trial in trials:
        conditions = trial.weight.model_copy(update={"file": "", "supports": True})
        groups.setdefault(conditions, []).append(trial)
    both = [g for g in groups.values() if len({t.weight.supports for t in g}) > 1]
    ordered = sorted(
        both or groups.values(),
        key=lambda group: max(float(np.std(_from_marker(t)[t.used])) for t in group),
    )
    middle = ordered[len(ordered) // 2]
    return list({trial.weight.supports: trial for trial in middle}.values())


def _from_marker(trial: WeightTrial) -> Array:
    """Give the measured centre of pressure along the belt minus the marker, (T,) [mm]."""
    return np.asarray(1000 * (quantities(trial.measured) - trial.marker[:, :1])[:, 0])


def _error(trial: WeightTrial) -> Array:
    """Give the measured centre of pressure along the belt minus the true one, (T,) [mm]."""
    return np.asarray(1000 * (quantities(trial.measured) - quantities(trial.truth))[:, 0])


def _colour(trial: WeightTrial) -> str:
    return COLOURS["compensated" if trial.weight.supports else "measured"]


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


def hammer_trace_figure(traces: Mapping[BeltSide, HammerTrace]) -> Figure | None:
    """Draw marker and force around one impact per belt, and the delay between them (Fig. F.1f)."""
    if not traces:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3 * len(traces) + 1, 4), layout="constrained")
        panels = figure.subplots(2, len(traces), sharex=True, sharey="row", squeeze=False)
        for (above, below), (belt, trace) in zip(panels.T, traces.items(), strict=True):
            _draw_impact(above, below, trace)
            above.set_title(f"{belt}: plate {1000 * trace.impact.delay_s:.1f} ms later", loc="left")
            below.set_xlabel("time (ms)")
        panels[0, 0].set_ylabel("marker (mm)")
        panels[1, 0].set_ylabel("vertical force (N)")
        lines = panels[0, 0].get_legend_handles_labels()
        figure.legend(*lines, loc="outside lower center", ncols=2)
    return figure


def _draw_impact(above: Axes, below: Axes, trace: HammerTrace) -> None:
    """Draw the marker with its two paths, and the force with its centroid in time."""
    impact, marker, plate = trace.impact, COLOURS["compensated"], COLOURS["measured"]
    lowest = float(trace.height.min())
    above.plot(
        1000 * (trace.time - impact.marker_s), 1000 * (trace.height - lowest), "o", ms=3, c=marker
    )
    for path, end in ((impact.path_before, -AROUND_S), (impact.path_after, AROUND_S)):
        since = np.linspace(0, end, 50)
        height = np.polynomial.polynomial.polyval(since, path) - lowest
        above.plot(1000 * since, 1000 * height, color=marker, lw=0.8)
    below.plot(
        1000 * (trace.force_time - impact.marker_s), trace.force, ".-", ms=3, lw=0.8, c=plate
    )
    for panel in (above, below):
        panel.axvline(0, color=marker, lw=0.8, ls="--", label="paths of the marker meet")
        panel.axvline(
            1000 * impact.delay_s, color=plate, lw=0.8, ls="--", label="centroid of the force"
        )
