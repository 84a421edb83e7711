"""Figures of experiment 2: plates and belts as measured, as predicted, and the remainder."""

from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from compensation import BeltModel, InertiaModel
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.calibration_ranking.ranking import Model, Ranking
from pipeline.calibration_ranking.trials import RATE_HZ, BeltTrial, PlatformTrial
from pipeline.figures.style import COLOURS, STYLE

LINES: Final = {
    "measured": COLOURS["measured"],
    "predicted": COLOURS["compensated"],
    "remaining": COLOURS["baseline"],
}
LINE_WIDTHS_PT: Final = (1.6, 0.7, 0.7)
"""So that the prediction does not hide the measurement."""
MIN_SHOWN_S: Final = 5.0
MAX_SHOWN_S: Final = 30.0
PERIODS_SHOWN: Final = 10.0
"""Of a platform's motion, within those bounds."""
PULSES_SHOWN_S: Final = 12.0
"""Of a belt trial: two pulses or three, one every 5 s."""


def compensation_figure(trial: PlatformTrial, model: InertiaModel, name: str) -> Figure:
    """Draw an empty plate in a validation trial (Figs 3, F.3–F.6): measured, predicted, remaining.

    Parameters
    ----------
    trial
        The validation trial.
    model
        Of the calibration trial called ``name``.
    """
    predicted = model.predict(trial.accelerations)
    shown = _largest_motion(trial.wrench)
    time = np.arange(len(predicted))[shown] / RATE_HZ
    series = (trial.wrench, predicted, trial.wrench - predicted)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 5), layout="constrained")
        panels = figure.subplots(2, 3, sharex=True).ravel()
        for k, panel in enumerate(panels):
            for label, values, width in zip(LINES, series, LINE_WIDTHS_PT, strict=True):
                panel.plot(time, values[shown, k], color=LINES[label], lw=width, label=label)
            panel.set_title(WRENCH_COMPONENTS[k], loc="left")
            panel.set_ylabel("N" if k < 3 else "N·m")
        for panel in panels[3:]:
            panel.set_xlabel("time (s)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        figure.suptitle(
            f"{trial.name}: empty plate, compensated by {name} (x forward, y left, z up)",
            fontsize=10,
        )
    return figure


def belt_figure(trial: BeltTrial, model: BeltModel, name: str) -> Figure:
    """Draw pitch moment and belt acceleration (Figs 4 and 5).

    Parameters
    ----------
    trial
        A belt trial, with or without a person.
    model
        Of the calibration trial called ``name``.
    """
    predicted = model.predict(trial.acceleration)
    middle = len(predicted) // 2
    shown = slice(middle, middle + round(PULSES_SHOWN_S * RATE_HZ))
    time = np.arange(len(predicted))[shown] / RATE_HZ
    measured = trial.moment - trial.moment.mean()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 4.5), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        series = (measured, predicted, measured - predicted)
        for label, values, width in zip(LINES, series, LINE_WIDTHS_PT, strict=True):
            above.plot(time, values[shown], color=LINES[label], lw=width, label=label)
        above.set_ylabel("My, about left (N·m)")
        figure.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=3)
        below.plot(time, trial.acceleration[shown], color="black", lw=0.8)
        below.set_ylabel("belt (m/s²)")
        below.set_xlabel("time (s)")
        figure.suptitle(f"{trial.name}: pitch moment, predicted by {name}", fontsize=10)
    return figure


def interaction_figure(trial: BeltTrial) -> Figure:
    """Draw the accelerometers while the belt accelerates (Fig. F.2)."""
    middle = len(trial.acceleration) // 2
    shown = slice(middle, middle + round(PULSES_SHOWN_S * RATE_HZ))
    time = np.arange(len(trial.acceleration))[shown] / RATE_HZ
    names = trial.channels
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 7), layout="constrained")
        panels = figure.subplots(len(names) + 1, 1, sharex=True)
        panels[0].plot(time, trial.acceleration[shown], color="black", lw=0.8)
        panels[0].set_ylabel("belt")
        for panel, channel, name in zip(panels[1:], trial.readings.T, names, strict=True):
            panel.plot(
                time, (channel - channel.mean())[shown], color=COLOURS["compensated"], lw=0.6
            )
            panel.set_ylabel(name)
        panels[-1].set_xlabel("time (s)")
        figure.suptitle(
            f"{trial.name}: belt and accelerometers about their means (m/s²)", fontsize=10
        )
    return figure


def rank_figure(ranking: Ranking[Model]) -> Figure:
    """Draw the mean ranks with their bootstrap intervals, best above."""
    table = ranking.table.iloc[::-1]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7, 0.6 + 0.22 * len(table)), layout="constrained")
        panel = figure.subplots()
        panel.hlines(table["trial"], table["rank_low"], table["rank_high"], color="0.7", lw=3)
        best = table["trial"].isin(ranking.possibly_best)
        for chosen, colour, label in (
            (best, COLOURS["compensated"], "may be the best"),
            (~best, COLOURS["baseline"], "others"),
        ):
            ranks, names = table["mean_rank"][chosen], table["trial"][chosen]
            panel.plot(ranks, names, "o", color=colour, ms=4, label=label)
        panel.set_xlabel("mean rank (1 is best); bars: 95 % of the bootstrap")
        panel.set_ylim(-0.7, len(table) - 0.3)
        panel.legend(frameon=False, loc="upper right")
    return figure


def _largest_motion(wrench: Array) -> slice:
    """Give the samples around the largest force: some periods of the motion, 5 to 30 s."""
    size = np.linalg.norm(wrench[:, :3] - wrench[:, :3].mean(axis=0), axis=1)
    power = np.abs(np.fft.rfft(wrench - wrench.mean(axis=0), axis=0)) ** 2
    hz = np.fft.rfftfreq(len(wrench), 1 / RATE_HZ)
    middle = float(hz @ power.sum(axis=1)) / float(power.sum())
    count = min(
        round(np.clip(PERIODS_SHOWN / middle, MIN_SHOWN_S, MAX_SHOWN_S) * RATE_HZ), len(wrench)
    )
    start = int(np.clip(np.argmax(size) - count // 2, 0, len(wrench) - count))
    return slice(start, start + count)
