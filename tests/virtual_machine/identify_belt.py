"""Parameters of a belt's drive from recordings of a real one.

Run as ``python -m tests.virtual_machine.identify_belt FOLDER`` with the folder of
``RandomFastSpeed1.txt`` and ``RandomFastSpeed2.txt`` (Hnat and van den Bogert 2014). The parameters
are fitted on the first recording and judged on the second, and written to
``pipeline/virtual_lab/machine/belt_parameters.toml``; those that a recording of an unloaded belt
does not determine stay as they are there. About a minute.

A simulated recording must have the spectra of the real one: gain and phase of moment by reported
acceleration, and the power of both. Nothing of the fitted models of `compensation` is used.
"""

import argparse
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from hbm.spatial import Array
from pipeline.virtual_lab.machine.belts import (
    PARAMETERS_TOML,
    BeltDrive,
    RotatingLine,
    identified_drive,
)
from tests.virtual_machine.belt_features import (
    Features,
    features,
    find_line,
    left_over,
    line_amplitudes,
    segments,
)
from tests.virtual_machine.belt_recording import BeltRecording, read_recording, simulate_recording

FITTED: Final = {
    "moment_kg_m": (2.7, 2.0, 4.0),
    "servo_hz": (11.0, 6.0, 18.0),
    "servo_damping": (0.4, 0.1, 2.0),
    "report_lag_s": (0.011, 0.001, 0.03),
    "report_delay_s": (-0.009, -0.03, 0.01),
    "report_jitter_s": (0.002, 0.0002, 0.01),
    "rumble_nm_per_sqrt_hz": (0.6, 0.1, 2.0),
}
"""Start and bounds. The command's acceleration (SD) is fitted as well, but is no property of the
drive."""
COMMAND_SD: Final = (4.7, 3.0, 7.0)
ROLLER_TURNS_PER_M: Final = 1.583
LINE_TURNS_PER_M: Final = (6.271, 7.898, 9.185, 12.542, 15.204, 18.370)
"""Where the strongest lines of the left-over moments are, in both recordings."""
LINE_WITHIN_PER_M: Final = 0.004
SEEDS: Final = (1, 2, 3)
BLOCKS: Final = 10
RESAMPLES: Final = 300
MODEL_ERROR: Final = 0.03
"""Of every feature, besides its standard error: the drive is not exact."""
NORMAL_95: Final = 1.96


class Fit(NamedTuple):
    """Fitted parameters in the order of `FITTED`, then the command's SD; 95 % half-widths."""

    values: Array
    half_widths: Array
    difference: Features


class Lines(NamedTuple):
    """Roller and other lines of a recording: turns [1/m], amplitudes by block [N·m/(m/s)²]."""

    turns_per_m: Array
    amplitudes: Array


def find_lines(recording: BeltRecording) -> Lines:
    """Find what turns with the belt in the moment that its acceleration does not explain."""
    rest, speed = left_over(recording)
    turns = [
        find_line(rest, speed, near, LINE_WITHIN_PER_M)
        for near in (ROLLER_TURNS_PER_M, *LINE_TURNS_PER_M)
    ]
    amplitudes = [line_amplitudes(rest, speed, t, BLOCKS) for t in turns]
    return Lines(np.array(turns), np.array(amplitudes))


def fit(recording: BeltRecording, lines: Lines, base: BeltDrive) -> Fit:
    """Fit a drive to a recording, whose roller and other lines are known."""
    rotating = tuple(map(RotatingLine, lines.turns_per_m, lines.amplitudes.mean(axis=1)))
    base = replace(base, unbalance_kg_per_m=0.0, lines=rotating)
    speed, moment = segments(recording)
    target = features(speed, moment)
    rng = np.random.default_rng(0)
    blocks = np.array_split(np.arange(len(speed)), BLOCKS)
    drawn = [
        np.concatenate([blocks[b] for b in rng.integers(0, BLOCKS, BLOCKS)])
        for _ in range(RESAMPLES)
    ]
    resampled = np.array([np.concatenate(features(speed[k], moment[k])) for k in drawn])
    sd = np.hypot(resampled.std(axis=0), MODEL_ERROR)
    start, low, high = np.array([*FITTED.values(), COMMAND_SD]).T

    def simulated(x: Array, **others: float) -> Features:
        *own, command_sd = x * np.abs(start)
        drive = replace(base, **dict(zip(FITTED, own, strict=True)), **others)
        parts = [segments(simulate_recording(drive, command_sd, seed)) for seed in SEEDS]
        return features(*(np.concatenate(x) for x in zip(*parts, strict=True)))

    def error(x: Array, **others: float) -> Array:
        return (np.concatenate(simulated(x, **others)) - np.concatenate(target)) / sd

    scale = np.abs(start)
    found = least_squares(
        error, start / scale, bounds=(low / scale, high / scale), diff_step=0.02, max_nfev=8
    )
    inverse = np.linalg.pinv(found.jac)
    spread = (resampled - resampled.mean(axis=0)) / sd
    variance = NORMAL_95**2 * np.var(spread @ inverse.T, axis=0) * (1 + 1 / len(SEEDS))
    variance += NORMAL_95**2 * np.sum(inverse**2 * (MODEL_ERROR / sd) ** 2, axis=1)
    for name, row in assumed().items():
        ends = [error(found.x, **{name: row[end]}) for end in ("low", "high")]
        variance += (inverse @ (ends[1] - ends[0]) / 2) ** 2
    best = simulated(found.x)
    difference = Features(*(a - b for a, b in zip(best, target, strict=True)))
    return Fit(found.x * scale, np.sqrt(variance) * scale, difference)


def assumed() -> dict[str, dict[str, float]]:
    """Give the assumed parameters, whose ranges widen the intervals of the fitted ones."""
    table = tomllib.loads(PARAMETERS_TOML.read_text(encoding="utf-8"))
    return {
        name: row
        for name, row in table.items()
        if name != "lines" and row["source"].startswith("assumed") and row["low"] < row["high"]
    }


def identify(folder: Path) -> None:
    """Fit both recordings; print what the parameters' file states, and how well each is fitted.

    The file has the first recording's values. The force of each of two rollers follows from their
    sum at unknown angles, whose expected square is twice that of one; two recordings leave it
    uncertain by about a third.
    """
    recordings = [read_recording(folder, number) for number in (1, 2)]
    lines = [find_lines(recording) for recording in recordings]
    fits = [fit(*both, identified_drive()) for both in zip(recordings, lines, strict=True)]
    names = [*FITTED, "command_sd_mps2"]
    for number, (fitted, found) in enumerate(zip(fits, lines, strict=True), start=1):
        half = NORMAL_95 * found.amplitudes.std(axis=1) / BLOCKS**0.5
        print(f"file {number}: parameter, value, 95 %; turns per m, moment, 95 %; difference")
        for row in zip(names, fitted.values, fitted.half_widths, strict=True):
            print("{:24}{:10.4g}{:10.4g}".format(*row))
        for row in zip(found.turns_per_m, found.amplitudes.mean(axis=1), half, strict=True):
            print("line at {:.4f} /m{:10.3f}{:10.3f}".format(*row))
        for kind, difference in fitted.difference._asdict().items():
            print(f"{kind}, simulated - recorded:", *(f"{x:+.2f}" for x in difference))
    squares = [found.amplitudes[0].mean() ** 2 for found in lines]
    force = np.sqrt(np.mean(squares) / 2) / identified_drive().roller_place_m
    print(f"unbalance {force:.3f}, {force * 2 / 3:.3f} to {force * 4 / 3:.3f} kg/m")


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.virtual_machine.identify_belt", description=__doc__
    )
    parser.add_argument("folder", type=Path, help="folder of both recordings of a belt")
    identify(parser.parse_args().folder)


if __name__ == "__main__":
    main()
