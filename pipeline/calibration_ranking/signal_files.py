"""Signals for the machine as files: the motion as CSV, motion and spectra as a figure."""

from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from compensation import (
    MachineLimits,
    Signal,
    acceleration_spectrum,
    check_signal,
    resample_signal,
    validation_signals,
)
from compensation.protocol import (
    BELT_KINDS,
    BELT_VARIANCE,
    DURATIONS_S,
    PLATFORM_BELT_MPS,
    PLATFORM_KINDS,
    belt_signal,
    platform_signal,
)
from pipeline.figures.style import COLOURS, DPI, STYLE
from pipeline.io.write import whole_file

KINDS: Final = ("pitch_sway", "belt", "validation")
HEADER: Final = "time_s,sway_m,pitch_deg,belt_speed_m_per_s"
MAX_SHOWN_HZ: Final = 50.0
"""Half the rate of the protocol's signals."""
MIN_SHOWN_SHARE: Final = 1e-6
"""Of a spectrum's peak, below which it is not drawn."""
ROUNDING: Final = 1e-12
"""Power below this is the rounding of a channel at rest."""


def protocol_signals(kind: str, seed: int, limits: MachineLimits) -> tuple[list[Signal], list[str]]:
    """Make the protocol's signals of one kind, each at every belt speed of the protocol.

    Parameters
    ----------
    kind
        One of `KINDS`.
    seed
        Of the random motion.
    limits
        Of the machine.

    Returns
    -------
    possible
        Those within the machine's limits: for pitch and sway with the belts at 0 and 3 m/s, for the
        belts about 1 and 2 m/s, or the validation signals.
    beyond
        A line for each of the others: its name, and the limits that it exceeds.
    """
    drawn = list(validation_signals(seed)) if kind == "validation" else []
    beyond: list[str] = []
    draw, kinds, belt_speeds = (
        (platform_signal, PLATFORM_KINDS, PLATFORM_BELT_MPS)
        if kind == "pitch_sway"
        else (belt_signal, BELT_KINDS, tuple(BELT_VARIANCE))
    )
    for n, speed in enumerate(belt_speeds if kind != "validation" else ()):
        for duration, name in product(DURATIONS_S, kinds):
            try:
                drawn.append(draw(name, duration, seed + n, speed, limits))
            except ValueError as error:
                beyond.append(str(error))
    exceeded = [check_signal(signal, limits) for signal in drawn]
    beyond += ["; ".join(map(str, notes)) for notes in exceeded if notes]
    return [s for s, notes in zip(drawn, exceeded, strict=True) if not notes], beyond


def write_signals(
    signals: Iterable[Signal], folder: Path, rate_hz: float, limits: MachineLimits
) -> list[Path]:
    """Write signals for a machine, each as CSV and PNG.

    Parameters
    ----------
    signals
        Commanded motion, within the machine's limits.
    folder
        Folder for ``<name>.csv`` and ``<name>.png``; created where it does not exist.
    rate_hz
        Samples per second in the files [Hz].
    limits
        Of the machine, for the figures.

    Returns
    -------
    list[pathlib.Path]
        The CSV files.

    Raises
    ------
    ValueError
        If the rate is below a signal's.
    OSError
        If a file cannot be written.
    """
    written = []
    for signal in (resample_signal(signal, rate_hz) for signal in signals):
        table = folder / f"{signal.name}.csv"
        write_signal(signal, table)
        with mpl.rc_context(STYLE), whole_file(table.with_suffix(".png")) as temporary:
            signal_figure(signal, limits).savefig(temporary, format="png", dpi=DPI)
        written.append(table)
    return written


def write_signal(signal: Signal, path: Path) -> None:
    """Write one signal as CSV: time, sway to the left, pitch (positive lowers the front), belts."""
    columns = [signal.time, signal.sway, np.degrees(signal.pitch), signal.belt_speed]
    with whole_file(path) as temporary:
        np.savetxt(
            temporary,
            np.column_stack(columns),
            fmt="%.6f",
            delimiter=",",
            header=HEADER,
            comments="",
            encoding="utf-8",
        )


def signal_figure(signal: Signal, limits: MachineLimits) -> Figure:
    """Draw a signal over time and the spectra of its accelerations, with the machine's limits.

    Parameters
    ----------
    signal
        Commanded motion of the machine.
    limits
        Of the machine; dashed.

    Returns
    -------
    matplotlib.figure.Figure
        Sway, pitch and belts from top to bottom; over time on the left, over frequency on the
        right.
    """
    frequency, density_of = acceleration_spectrum(signal)
    sway, pitch, belt = density_of.T
    rows = (
        ("sway (m)", signal.sway, limits.sway_m, sway, "(m/s²)²/Hz"),
        (
            "pitch (°)",
            np.degrees(signal.pitch),
            limits.pitch_deg,
            pitch * np.degrees(1.0) ** 2,
            "(°/s²)²/Hz",
        ),
        ("belts (m/s)", signal.belt_speed, limits.belt_m_per_s, belt, "(m/s²)²/Hz"),
    )
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 6), layout="constrained")
        panels = figure.subplots(3, 2, width_ratios=(2, 1), sharex="col")
        for (motion, density), (name, values, limit, power, unit) in zip(panels, rows, strict=True):
            motion.plot(signal.time, values, color=COLOURS["compensated"], linewidth=0.6)
            for level in (-limit, limit):
                motion.axhline(level, color=COLOURS["measured"], linestyle="--", linewidth=1)
            motion.set_ylabel(name)
            moves = power > max(MIN_SHOWN_SHARE * power.max(), ROUNDING)
            shown = np.where(moves, power, np.nan)
            density.plot(frequency, shown, color=COLOURS["compensated"], linewidth=1)
            density.set_ylabel(unit)
            if moves.any():
                density.set_yscale("log")
                density.yaxis.set_major_formatter("{x:g}")
            else:
                density.text(0.5, 0.5, "no acceleration", transform=density.transAxes, ha="center")
                density.set_yticks([])
        panels[0, 0].set_title("motion, and limits of the machine (dashed)")
        panels[0, 1].set_title("spectrum of the acceleration")
        panels[2, 0].set_xlabel("time (s)")
        panels[2, 1].set_xlabel("frequency (Hz)")
        panels[2, 1].set_xlim(0, MAX_SHOWN_HZ)
        figure.suptitle(signal.name, fontsize=10)
    return figure
