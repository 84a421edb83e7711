"""Experiment 2 from its recordings: which calibration trial to use, for platform and belts."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from compensation import BeltModel, InertiaModel
from pipeline.calibration_ranking.belts import Interaction, belt_interaction, rank_belts
from pipeline.calibration_ranking.ranking import Ranking, rank_platform
from pipeline.calibration_ranking.trials import (
    BeltTrial,
    PlatformTrial,
    RankingSettings,
    belt_trial,
    platform_trial,
    read_trial,
    trial_files,
)

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class PlatformResults:
    """Ranking of the calibrations of pitch and sway, and the trials that validate them."""

    ranking: Ranking[InertiaModel]
    validation: tuple[PlatformTrial, ...]


@dataclass(frozen=True, slots=True)
class BeltResults:
    """Ranking of the calibrations of the belts.

    Attributes
    ----------
    ranking
        Of the calibration trials.
    validation
        Validation trials with nobody on the belts.
    person
        Those with a person on the other belt.
    interaction
        Response of the accelerometers in the first validation trial.
    """

    ranking: Ranking[BeltModel]
    validation: tuple[BeltTrial, ...]
    person: tuple[BeltTrial, ...]
    interaction: Interaction


@dataclass(frozen=True, slots=True)
class RankingResults:
    """All results of experiment 2; None where it had no recordings."""

    platform: PlatformResults | None = None
    belts: BeltResults | None = None


def rank_recordings(
    folder: Path, settings: RankingSettings, seed: int, progress: Progress | None = None
) -> RankingResults:
    """Read all recordings and rank the calibration trials.

    Parameters
    ----------
    folder
        With sub-folders calibration and validation, belt_calibration and belt_validation, and
        belt_person for trials with a person on the other belt.
    settings
        Plate, channels and filters.
    seed
        Of the bootstrap.
    progress
        Called with the name of every file that is read, how many are, and how many there are.

    Returns
    -------
    RankingResults
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
        recording = read_trial(path, settings)
        if name in platform:
            platform[name].append(platform_trial(recording, settings))
        else:
            belts[name].append(belt_trial(recording, settings))
        if progress is not None:
            progress(path.name, done, len(files))
    of_platform, model = None, None
    if platform["calibration"]:
        ranking = rank_platform(platform["calibration"], platform["validation"], seed=seed)
        of_platform = PlatformResults(ranking, tuple(platform["validation"]))
        model = ranking.models[ranking.winner]
    if not belts["belt_calibration"]:
        return RankingResults(of_platform)
    of_belts = BeltResults(
        rank_belts(belts["belt_calibration"], belts["belt_validation"], seed=seed),
        tuple(belts["belt_validation"]),
        tuple(belts["belt_person"]),
        belt_interaction(belts["belt_validation"][0], model, seed=seed),
    )
    return RankingResults(of_platform, of_belts)
