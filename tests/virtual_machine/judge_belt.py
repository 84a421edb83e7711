"""Belt compensation on drives that are not of its family.

Run as ``python -m tests.virtual_machine.judge_belt [DRIVES]``. Every drive is drawn within the
intervals of its parameters. First, a model of one random recording is judged on another at 6 Hz, as
of the real one, for twice as many drives. Then every drive follows the 24 calibration signals of
the belts and the validation pulses, and is processed as `hbm calibration rank` does: 10 Hz, 100 Hz,
the second-order model of every calibration signal judged on the pulses. What is left is printed
[N·m]; "no roller" is without the roller that `fit_roller` finds, and "ideal left" of the same drive
with nothing out of balance, without rumble or jitter and with ideal instruments: then only the
model's family is wrong.
"""

import sys
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from compensation.belts import belt_acceleration, fit_belt
from compensation.protocol import ADVISED_BELT_SIGNAL, belt_signals, validation_signals
from compensation.signals import Signal, resample_signal
from hbm.signals.filtering import low_pass
from hbm.spatial import Array
from pipeline.virtual_lab.machine.belts import BeltDrive, run_belt, scattered_drive
from tests.virtual_machine.belt_recording import COMMAND_SD_MPS2, simulate_recording
from tests.virtual_machine.roller import fit_roller

RATE_HZ: Final = 1000.0
MODEL_HZ: Final = 100.0
CUTOFF_HZ: Final = 10.0
MEAN_SPEEDS_MPS: Final = (1.0, 2.0)
PLATE_NOISE_NM: Final = 1.0
SPEED_NOISE_MPS: Final = 0.005
"""White, at 1000 Hz: those of the virtual laboratory."""
EDGE: Final = 100
"""Samples of the filter's settling at both ends."""
PUBLISHED_CUTOFF_HZ: Final = 6.0
"""Of Hnat and van den Bogert (2014)."""
BELT_PULSES: Final = 4
"""Of the validation signals: nobody on the treadmill."""
REPEATS: Final = 5
"""Of the pulses, in which the rollers begin at other angles."""
QUIET: Final = ("unbalance_kg_per_m", "rumble_nm_per_sqrt_hz", "report_jitter_s")
"""Without which only the model's family is wrong, and the speed low-passed."""
FIRST_SEED: Final = 100


class BeltTrial(NamedTuple):
    """Filtered acceleration [m/s²] and pitch moment about its mean [N·m], and speed, at 100 Hz."""

    acceleration: Array
    moment: Array
    speed: Array


class Judged(NamedTuple):
    """R² of every calibration signal, of the advised one on repeated pulses, and RMS [N·m]."""

    r_squared: Array
    repeated: Array
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
    if ideal:
        signals = [signal for signal in signals if signal.name == ADVISED_BELT_SIGNAL]
    validation = validation_signals(seed)[BELT_PULSES]
    pulses = [record(drive, validation, 100 * seed + n, ideal=ideal) for n in range(REPEATS)]
    scores = {}
    for number, signal in enumerate(signals, start=REPEATS):
        trial = record(drive, signal, 100 * seed + number, ideal=ideal)
        model = fit_belt(trial.acceleration, trial.moment)
        errors = [p.moment - model.predict(p.acceleration) for p in pulses]
        r_squared = [1 - np.var(e) / np.var(p.moment) for e, p in zip(errors, pulses, strict=True)]
        scores[signal.name] = np.array(r_squared), errors
    advised, errors = scores[ADVISED_BELT_SIGNAL]
    without = [
        e - fit_roller(e, p.speed, MODEL_HZ, CUTOFF_HZ).predict(p.speed, MODEL_HZ)
        for e, p in zip(errors, pulses, strict=True)
    ]
    raw, left, rest = (float(np.std(x)) for x in ([p.moment for p in pulses], errors, without))
    return Judged(np.array([score[0] for score, _ in scores.values()]), advised, raw, left, rest)


def judge_as_recorded(drive: BeltDrive, seed: int) -> tuple[float, float, float, float]:
    """Fit one random recording at 6 Hz and judge it on another, as the real ones were.

    Gives R², RMS before and after [N·m], and the roller's amplitude [N·m per (m/s)²].
    """
    pairs = []
    for n in range(2):
        recording = simulate_recording(drive, COMMAND_SD_MPS2, 2 * seed + n)
        a = belt_acceleration(recording.speed, MODEL_HZ, PUBLISHED_CUTOFF_HZ, "realtime")
        moment = low_pass(recording.moment, MODEL_HZ, PUBLISHED_CUTOFF_HZ, "realtime")
        pairs.append((a, moment, recording.speed))
    model = fit_belt(*pairs[0][:2])
    a, moment, speed = pairs[1]
    error = moment - model.predict(a)
    roller = fit_roller(error, speed, MODEL_HZ, PUBLISHED_CUTOFF_HZ)
    inner = slice(EDGE, -EDGE)
    raw, left = float(np.std(moment[inner])), float(np.std(error[inner]))
    return 1 - (left / raw) ** 2, raw, left, roller.amplitude


def print_as_recorded(drives: int) -> None:
    """Print a table of `judge_as_recorded`, best first."""
    print("| R² % | raw | left | roller |")
    print("|---|---|---|---|")
    rows = [
        judge_as_recorded(scattered_drive(np.random.default_rng(seed)), seed)
        for seed in range(FIRST_SEED, FIRST_SEED + drives)
    ]
    for r_squared, raw, left, roller in sorted(rows, reverse=True):
        print(f"| {100 * r_squared:.2f} | {raw:.2f} | {left:.2f} | {roller:.2f} |")
    mean, sd = np.mean(rows, axis=0), np.std(rows, axis=0, ddof=1)
    print("mean ± SD of R², raw, left, roller:", mean.round(4), sd.round(4))


def print_pulses(drives: int) -> None:
    """Print a table of `judge`, one row per drive."""
    print("| drive | raw | R² % of 24 signals | of 5 repeats | left | no roller | ideal left |")
    print("|---|---|---|---|---|---|---|")
    rows = []
    for seed in range(FIRST_SEED, FIRST_SEED + drives):
        drive = scattered_drive(np.random.default_rng(seed))
        quiet = replace(drive, **dict.fromkeys(QUIET, 0.0), lines=())
        real, ideal = judge(drive, seed, ideal=False), judge(quiet, seed, ideal=True)
        signals, repeats = (
            f"{100 * r.min():.2f} to {100 * r.max():.2f}" for r in (real.r_squared, real.repeated)
        )
        sizes = (real.left, real.left_without_roller, ideal.left)
        rows.append((100 * real.repeated.mean(), *sizes))
        cells = " | ".join(f"{size:.2f}" for size in sizes)
        number = seed - FIRST_SEED + 1
        print(f"| {number} | {real.raw:.2f} | {signals} | {repeats} | {cells} |", flush=True)
    mean, sd = np.mean(rows, axis=0), np.std(rows, axis=0, ddof=1)
    cells = " | ".join(f"{m:.2f} ± {s:.2f}" for m, s in zip(mean, sd, strict=True))
    print(f"| mean ± SD | | | {cells} |")


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    print_as_recorded(2 * count)
    print_pulses(count)
