"""Belt compensation on drives that are not of its family.

Run as ``python -m tests.virtual_machine.judge_belt [DRIVES]``. Every drive is drawn within the
intervals of its parameters, follows the 24 calibration signals of the belts and the validation
pulses, and is processed as `hbm calibration rank` does: 10 Hz, 100 Hz, the second-order model of
every calibration signal judged on the pulses. What is left is printed, also for the same drive
with nothing out of balance, without rumble and with ideal instruments: then only the model's
family is wrong.
"""

import sys
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from compensation.belt.model import belt_acceleration, fit_belt
from compensation.belt.roller import fit_roller
from compensation.signals.protocol import ADVISED_BELT_SIGNAL, belt_signals
from compensation.signals.signal import Signal, resample_signal
from compensation.signals.validation import validation_signals
from hbm.signals.filtering import low_pass
from hbm.spatial import Array
from pipeline.virtual_lab.machine.belt_drive import run_belt
from pipeline.virtual_lab.machine.belt_parameters import BeltDrive, scattered_drive

RATE_HZ: Final = 1000.0
MODEL_HZ: Final = 100.0
CUTOFF_HZ: Final = 10.0
MEAN_SPEEDS_MPS: Final = (1.0, 2.0)
PLATE_NOISE_NM: Final = 1.0
SPEED_NOISE_MPS: Final = 0.005
"""White, at 1000 Hz: those of the virtual laboratory."""
EDGE: Final = 100
"""Samples of the filter's settling at both ends."""
FIRST_SEED: Final = 100


class BeltTrial(NamedTuple):
    """Filtered acceleration [m/s²] and pitch moment about its mean [N·m], and speed, at 100 Hz."""

    acceleration: Array
    moment: Array
    speed: Array


class Judged(NamedTuple):
    """R² of every calibration signal and of the advised one, and RMS [N·m], on the pulses."""

    r_squared: Array
    advised: float
    raw: float
    left: float
    left_without_roller: float


def record(drive: BeltDrive, signal: Signal, seed: int, *, ideal: bool) -> BeltTrial:
    """Record and filter one trial of an empty belt."""
    command = resample_signal(signal, RATE_HZ).belt_speed
    belt, plate, channel = (np.random.default_rng((seed, n)) for n in range(3))
    motion = run_belt(drive, command, RATE_HZ, belt)
    noise = 0.0 if ideal else 1.0
    moment = motion.pitch_moment + noise * PLATE_NOISE_NM * plate.normal(size=len(command))
    speed = motion.reported_speed + noise * SPEED_NOISE_MPS * channel.normal(size=len(command))
    step = round(RATE_HZ / MODEL_HZ)
    kept = slice(EDGE * step, -EDGE * step, step)
    filtered = low_pass(moment, RATE_HZ, CUTOFF_HZ, "realtime")[kept]
    acceleration = belt_acceleration(speed, RATE_HZ, CUTOFF_HZ, "realtime")[kept]
    return BeltTrial(acceleration, filtered - filtered.mean(), speed[kept])


def judge(drive: BeltDrive, seed: int, *, ideal: bool) -> Judged:
    """Fit all calibration signals of a drive, and judge them on the pulses."""
    signals = [s for n, v in enumerate(MEAN_SPEEDS_MPS) for s in belt_signals(2 * seed + n, v)]
    pulses = record(drive, validation_signals(seed)[4], seed, ideal=ideal)
    variance = np.var(pulses.moment)
    scores = {}
    for number, signal in enumerate(signals, start=1):
        trial = record(drive, signal, 100 * seed + number, ideal=ideal)
        model = fit_belt(trial.acceleration, trial.moment)
        error = pulses.moment - model.predict(pulses.acceleration)
        scores[signal.name] = float(1 - np.var(error) / variance), error
    advised, error = scores[ADVISED_BELT_SIGNAL]
    roller = fit_roller(error, pulses.speed, MODEL_HZ, CUTOFF_HZ)
    without = error - roller.predict(pulses.speed, MODEL_HZ)
    r_squared = np.array([score for score, _ in scores.values()])
    return Judged(
        r_squared, advised, float(variance**0.5), float(error.std()), float(without.std())
    )


def main(drives: int) -> None:
    """Print a table with one row per drive."""
    print(
        "| drive | raw | R² % of 24 signals | R² % advised | left | without roller | ideal left |"
    )
    print("|---|---|---|---|---|---|---|")
    rows = []
    for seed in range(FIRST_SEED, FIRST_SEED + drives):
        drive = scattered_drive(np.random.default_rng(seed))
        quiet = replace(drive, unbalance_kg_per_m=0.0, lines=(), rumble_nm_per_sqrt_hz=0.0)
        real, ideal = judge(drive, seed, ideal=False), judge(quiet, seed, ideal=True)
        low, high = 100 * real.r_squared.min(), 100 * real.r_squared.max()
        rows.append((100 * real.advised, real.left, real.left_without_roller, ideal.left))
        print(
            f"| {seed - FIRST_SEED + 1} | {real.raw:.2f} | {low:.2f} to {high:.2f} "
            f"| {100 * real.advised:.2f} | {real.left:.2f} | {real.left_without_roller:.2f} "
            f"| {ideal.left:.2f} |",
            flush=True,
        )
    mean, sd = np.mean(rows, axis=0), np.std(rows, axis=0, ddof=1)
    cells = (f"{m:.2f} ± {s:.2f}" for m, s in zip(mean, sd, strict=True))
    print("| mean ± SD | | |", " | ".join(cells), "|")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
