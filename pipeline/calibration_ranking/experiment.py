"""Experiment 2 from its recordings: which calibration trial to use, for platform and belts."""

from collections.abc import Callable
from pathlib import Path

from pipeline.calibration_ranking.belts import interaction, rank_belts
from pipeline.calibration_ranking.ranking import rank_platform
from pipeline.calibration_ranking.report import Experiment2
from pipeline.calibration_ranking.trials import (
    BeltTrial,
    PlatformTrial,
    Rules,
    belt_trial,
    platform_trial,
    read_trial,
    trial_files,
)

Progress = Callable[[str, int, int], None]


def rank_recordings(
    folder: Path, rules: Rules, seed: int, progress: Progress | None = None
) -> Experiment2:
    """Read all recordings and rank the calibration trials.

    Parameters
    ----------
    folder
        With sub-folders calibration and validation, belt_calibration and belt_validation.
    rules
        Which plate and channels, and the filters.
    seed
        Of the bootstrap.
    progress
        Called with the name of every file that is read, how many are, and how many there are.

    Returns
    -------
    Experiment2
        The rankings of those kinds of trials that there are recordings of.

    Raises
    ------
    ValueError, OSError
        If a recording cannot be used, or a sub-folder is missing.
    """
    platform: dict[str, list[PlatformTrial]] = {"calibration": [], "validation": []}
    belts: dict[str, list[BeltTrial]] = {
        name: [] for name in ("belt_calibration", "belt_validation", "belt_person")
    }
    files = [(name, path) for name, paths in trial_files(folder).items() for path in paths]
    for done, (name, path) in enumerate(files, start=1):
        recording = read_trial(path, rules)
        if name in platform:
            platform[name].append(platform_trial(recording, rules))
        else:
            belts[name].append(belt_trial(recording, rules))
        if progress is not None:
            progress(path.name, done, len(files))
    validation = tuple(platform["validation"])
    ranking, model = None, None
    if platform["calibration"]:
        ranking = rank_platform(platform["calibration"], platform["validation"], seed=seed)
        model = ranking.models[ranking.winner]
    if not belts["belt_calibration"]:
        return Experiment2(ranking, validation)
    first = belts["belt_validation"][0]
    return Experiment2(
        ranking,
        validation,
        rank_belts(belts["belt_calibration"], belts["belt_validation"], seed=seed),
        (*belts["belt_validation"], *belts["belt_person"]),
        (interaction(first, first.channels, model, seed=seed), first.channels),
    )
