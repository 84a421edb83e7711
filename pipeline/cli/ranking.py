"""Experiment 2 on the command line: signals for the machine, and the ranking."""

from pathlib import Path
from typing import Final

from rich.console import Console
from rich.progress import track

from compensation import (
    Limits,
    Signal,
    belt_signals,
    pitch_and_sway_signals,
    validation_signals,
)
from pipeline.calibration_ranking.belts import interaction, rank_belts
from pipeline.calibration_ranking.ranking import Ranking, rank_platform
from pipeline.calibration_ranking.report import Experiment2, write_experiment
from pipeline.calibration_ranking.signal_files import write_signals
from pipeline.calibration_ranking.trials import (
    BeltTrial,
    PlatformTrial,
    Rules,
    belt_trial,
    platform_trial,
    read_trial,
    trial_files,
)

KINDS: Final = ("pitch_sway", "belt", "validation")


def signals(out: Path, *, kind: str, rate_hz: float, seed: int, limits: Limits) -> None:
    """Write the protocol's signals as CSV with pictures.

    Parameters
    ----------
    out
        Folder to write to, one sub-folder per kind.
    kind
        One of `KINDS`, or "all".
    rate_hz
        Samples per second in the files [Hz].
    seed
        Of the random motion.
    limits
        Of the machine.

    Raises
    ------
    ValueError
        If the kind is unknown or the machine cannot do a signal; nothing of that kind is written.
    OSError
        If a file cannot be written.
    """
    if kind not in (*KINDS, "all"):
        raise ValueError(f"kind must be one of {', '.join(KINDS)} or all, got {kind!r}")
    console = Console(highlight=False, markup=False)
    for name in KINDS if kind == "all" else (kind,):
        written = write_signals(_drawn(name, seed, limits), out / name, rate_hz, limits)
        console.print(f"{len(written)} signals at {rate_hz:g} Hz in {out / name}", soft_wrap=True)
    console.print(
        "columns: sway to the left, pitch (positive lowers the front), speed of both belts; next: "
        "record one with the treadmill empty and fit it (hbm calibration fit), or several and rank "
        "them (hbm calibration rank)",
        soft_wrap=True,
    )


def rank(folder: Path, out: Path, *, rules: Rules, simulate: bool, seed: int) -> None:
    """Rank calibration trials and write tables, figures and a recommendation.

    Parameters
    ----------
    folder
        With sub-folders calibration and validation, belt_calibration and belt_validation.
    out
        Folder to write to.
    rules
        Which plate and channels, and the filters.
    simulate
        True to fill the folder from the virtual laboratory first.
    seed
        Of simulation and bootstrap.

    Raises
    ------
    ValueError, OSError
        If a recording cannot be used, or the folder to simulate into has recordings already.
    """
    console = Console(highlight=False, markup=False)
    if simulate:
        _simulate(folder, seed, console)
    files = trial_files(folder)
    read: dict[str, list[PlatformTrial]] = {"calibration": [], "validation": []}
    belts: dict[str, list[BeltTrial]] = {
        name: [] for name in ("belt_calibration", "belt_validation", "belt_person")
    }
    channels: tuple[str, ...] = ()
    jobs = [(name, path) for name, paths in files.items() for path in paths]
    for name, path in track(jobs, "reading", console=console):
        recording = read_trial(path, rules)
        if name in read:
            read[name].append(platform_trial(recording, rules))
        else:
            belts[name].append(belt_trial(recording, rules))
    platform: Ranking | None = None
    if read["calibration"]:
        platform = rank_platform(read["calibration"], read["validation"], seed=seed)
    found = Experiment2(platform, tuple(read["validation"]))
    if belts["belt_calibration"]:
        console.print("fitting the belt models", style="dim")
        ranked = rank_belts(belts["belt_calibration"], belts["belt_validation"], seed=seed)
        first = belts["belt_validation"][0]
        channels = first.channels
        model = platform.models[platform.winner] if platform is not None else None
        found = Experiment2(
            platform,
            tuple(read["validation"]),
            ranked,
            (*belts["belt_validation"], *belts["belt_person"]),
            (interaction(first, channels, model, seed=seed), channels),
        )
    for sentence in write_experiment(found, out):
        console.print(sentence, soft_wrap=True)
    console.print(f"written to {out}: ranking.md, tables, figures", soft_wrap=True)


def _drawn(kind: str, seed: int, limits: Limits) -> list[Signal]:
    if kind == "pitch_sway":
        pairs = [pitch_and_sway_signals(seed + n, v, limits) for n, v in enumerate((0.0, 3.0))]
    elif kind == "belt":
        pairs = [belt_signals(seed + n, v, limits) for n, v in enumerate((1.0, 2.0))]
    else:
        pairs = [validation_signals()]
    return [signal for pair in pairs for signal in pair]


def _simulate(folder: Path, seed: int, console: Console) -> None:
    from pipeline.virtual_lab.protocol.ranking_study import TRIALS, simulate_ranking

    if folder.exists() and any(folder.rglob("*.c3d")):
        raise ValueError(f"{folder} has recordings already; simulate into a new folder")
    for _ in track(simulate_ranking(folder, seed), "simulating", total=TRIALS, console=console):
        pass
