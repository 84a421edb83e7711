"""Signals for the machine as files: the motion as CSV."""

from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np

from compensation import MachineLimits, Signal, validation_signals
from compensation.protocol import (
    BELT_KINDS,
    BELT_VARIANCE,
    DURATIONS_S,
    PLATFORM_BELT_MPS,
    PLATFORM_KINDS,
    belt_signal,
    platform_signal,
)
from compensation.signals import check_signal, resample_signal
from pipeline.io.write import whole_file

KINDS: Final = ("pitch_sway", "belt", "validation")


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
    drawn, beyond = list(validation_signals(seed)) if kind == "validation" else [], list[str]()
    draw, kinds, belt_speeds = {
        "pitch_sway": (platform_signal, PLATFORM_KINDS, PLATFORM_BELT_MPS),
        "belt": (belt_signal, BELT_KINDS, tuple(BELT_VARIANCE)),
    }.get(kind, (belt_signal, (), ()))
    for (n, speed), duration, name in product(enumerate(belt_speeds), DURATIONS_S, kinds):
        try:
            drawn.append(draw(name, duration, seed + n, speed, limits))
        except ValueError as error:
            beyond.append(str(error))
    exceeded = [check_signal(signal, limits) for signal in drawn]
    beyond += ["; ".join(map(str, notes)) for notes in exceeded if notes]
    return [s for s, notes in zip(drawn, exceeded, strict=True) if not notes], beyond


def write_signals(signals: Iterable[Signal], folder: Path, rate_hz: float) -> list[Path]:
    """Write signals for a machine, each as CSV.

    Parameters
    ----------
    signals
        Commanded motion, within the machine's limits.
    folder
        Folder for ``<name>.csv``; created where it does not exist.
    rate_hz
        Samples per second in the files [Hz].

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
        columns = [signal.time, signal.sway, np.degrees(signal.pitch), signal.belt_speed]
        with whole_file(table) as temporary:
            head = "time_s,sway_m,pitch_deg,belt_speed_m_per_s"
            np.savetxt(temporary, np.transpose(columns), "%.6f", ",", header=head, comments="")
        written.append(table)
    return written
