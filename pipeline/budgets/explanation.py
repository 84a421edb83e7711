"""What a trial's residuals are made of, with what follows from it: files, and errors of a study."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final, TypeVar
from zipfile import BadZipFile

import numpy as np
import pandas as pd
from pydantic import ConfigDict, TypeAdapter, ValidationError

from hbm.spatial import Array
from pipeline.budgets.words import Fix, StatedNow, budget_lines, what_to_fix_first
from pipeline.config.schema import NOUNS, TrialName
from pipeline.explain.budget import Bands, Budget, SharedCause, TrialEvidence
from pipeline.explain.explain import explain_trial
from pipeline.explain.sizes import Evidence
from pipeline.io.input_file import MAX_BYTES, read_text, too_large
from pipeline.io.recording import Recording
from pipeline.io.write import read_parquet, whole_file, write_text
from pipeline.statistics.design import Weigh
from pipeline.statistics.measurement import CELL, Covariances
from pipeline.statistics.recordings import recording_weights, root_mean_square
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.residuals import AXES
from pipeline.trial.result import TrialResult

FORMAT_VERSION: Final = 6
"""Of the files; raised with every change of what they hold."""
SUFFIX: Final = "_explained.json"
BANDS_SUFFIX: Final = "_bands.parquet"
EVIDENCE_SUFFIX: Final = "_evidence.npz"


@dataclass(frozen=True, slots=True)
class StudyExplanation:
    """The faults that the trials of a study show together.

    Attributes
    ----------
    version, key
        As those of an `Explanation`.
    trials
        Names of the trials.
    causes
        Delay and faults of the laboratory, of subjects and of trials.
    lines
        Those that are certain, and what to do.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    version: int
    key: str
    trials: tuple[str, ...]
    causes: tuple[SharedCause, ...]
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Explanation:
    """What a trial's residuals are made of, and what follows from it.

    Attributes
    ----------
    version
        `FORMAT_VERSION` of the program that made it.
    key
        Digest of everything that it depends on; empty for a trial of no study.
    budget
        What they are made of.
    mending
        What is most worth mending.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    version: int
    key: str
    budget: Budget
    mending: tuple[Fix, ...]

    def lines(self) -> Iterator[str]:
        """Say what a table of shares does not: sizes, what to mend, what is merged, the check."""
        return budget_lines(self.budget, self.mending)


def explain(
    recording: Recording,
    laboratory: Laboratory,
    result: TrialResult,
    key: str = "",
) -> Explanation:
    """Explain the residuals of a processed trial; parameters as for `explain_trial`."""
    found = explain_trial(recording, laboratory, result)
    budget = replace(found, source=Path(found.source.name))
    stated = StatedNow.of(result, calibrated=laboratory.plates is not None)
    mending = what_to_fix_first(budget, stated)
    return Explanation(FORMAT_VERSION, key, budget, mending)


def write_explanation(explanation: Explanation | StudyExplanation, path: Path) -> None:
    """Write an explanation as JSON, whole or not at all; numbers come back exactly."""
    kind = TypeAdapter(type(explanation))
    write_text(kind.dump_json(explanation, indent=1).decode(), path)


Kind = TypeVar("Kind", Explanation, StudyExplanation)


def read_explanation(path: Path, kind: type[Kind]) -> Kind:
    """Read an explanation of a trial or of a study back.

    Raises
    ------
    ValueError
        If the file is damaged, or written by another version.
    OSError
        If it cannot be opened.
    """
    try:
        found = TypeAdapter(kind).validate_json(read_text(path))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise ValueError(f"{path.name} is damaged: {place}: {first['msg'].lower()}") from error
    if found.version != FORMAT_VERSION:
        raise ValueError(f"{path.name}: written by another version of hbm")
    return found


def write_bands(bands: Bands, path: Path) -> None:
    """Write residuals over time: a row per frame, whole or not at all.

    Parameters
    ----------
    bands
        Of a trial.
    path
        The file. Its columns are ``time_s``; ``cycle``, the number of the gait cycle; and per axis,
        as reported, ``residual.Fx`` and ``deviation.Fx``, one standard deviation [N, N·m].
    """
    table = pd.DataFrame({"time_s": bands.time, "cycle": bands.cycle})
    for name in ("residual", "deviation"):
        table[[f"{name}.{axis}" for axis in AXES]] = getattr(bands, name)
    with whole_file(path) as temporary:
        table.to_parquet(temporary, index=False)


def write_evidence(evidence: TrialEvidence, path: Path) -> None:
    """Write what a trial says of causes that others share, whole or not at all."""
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **_arrays(evidence))


def _arrays(value: Any, prefix: str = "") -> dict[str, np.ndarray[Any, Any]]:
    """Give the fields of a dataclass as arrays, those of inner ones too."""
    found: dict[str, np.ndarray[Any, Any]] = {}
    for name in (field.name for field in fields(value)):
        own = getattr(value, name)
        inner = _arrays(own, f"{name}.") if is_dataclass(own) else {name: np.asarray(own)}
        found |= {f"{prefix}{key}": array for key, array in inner.items()}
    return found


def read_evidence(path: Path) -> TrialEvidence:
    """Read what a trial says back.

    Raises
    ------
    ValueError
        If the file is damaged, or none of `write_evidence`.
    OSError
        If it cannot be opened.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            if (size := sum(part.file_size for part in stored.zip.infolist())) > MAX_BYTES:
                raise ValueError(f"{path.name}: {too_large(size, MAX_BYTES)}")
            arrays = {name: stored[name] for name in stored.files}
        parts: dict[str, Any] = {
            part: Evidence(
                **{
                    name.partition(".")[2]: _typed(array)
                    for name, array in arrays.items()
                    if name.startswith(f"{part}.")
                }
            )
            for part in ("whole", "first", "second")
        }
        rest = {name: _typed(own) for name, own in arrays.items() if "." not in name}
        return TrialEvidence(**parts, **rest)
    except (BadZipFile, KeyError, TypeError, EOFError) as error:
        raise ValueError(f"{path.name} is damaged; run 'hbm explain' again") from error


def _typed(array: np.ndarray[Any, Any]) -> Any:
    """Give an array of numbers as it is, of texts as a tuple, and a single value as itself."""
    if array.ndim == 0:
        return array.item()
    return array if array.dtype.kind != "U" else tuple(map(str, array))


def read_bands(path: Path) -> Bands:
    """Read residuals over time back.

    Raises
    ------
    ValueError
        If the file is damaged, or none of `write_bands`.
    OSError
        If it cannot be opened.
    """
    try:
        table = read_parquet(path)
        residual, deviation = (
            table[[f"{name}.{axis}" for axis in AXES]].to_numpy()
            for name in ("residual", "deviation")
        )
        return Bands(table["time_s"].to_numpy(), table["cycle"].to_numpy(), residual, deviation)
    except (ValueError, KeyError) as error:
        raise ValueError(f"{path.name}: no bands ({error}); run 'hbm explain' again") from error


def study_covariances(
    explained: Mapping[TrialName, Explanation], residuals: pd.DataFrame, weigh: Weigh = "cycle"
) -> tuple[Covariances | None, str]:
    """Give how errors of measurement vary together in a study's residuals.

    Parameters
    ----------
    explained
        Explanations of its trials.
    residuals
        Long table of RMS residuals, one row per recording and axis, each of the window that its
        condition asks for.

    Returns
    -------
    covariances
        Over draws of causes' sizes, which are the same in all trials that share them; None unless
        every trial of the table is explained, over the window that its residuals are of.
    missing
        Why there are none, and what adds them; empty where there are.
    """
    once = residuals.drop_duplicates([*TrialName._fields])
    open_trials, weights = set[TrialName](), recording_weights(once, weigh)
    found: dict[tuple[str, str, bool], list[tuple[Array, float]]] = {}
    names = [TrialName(*key) for key in once[[*TrialName._fields]].itertuples(index=False)]
    for trial, window, weight in zip(names, once["window"], weights, strict=True):
        budget = explained[trial].budget if trial in explained else None
        if budget is None or (window not in (*NOUNS, "span") and not budget.of_window):
            open_trials.add(trial)
            continue
        for own in budget.of_window or budget.uncertainty:
            cell = trial.subject, trial.condition, own.compensated
            found.setdefault(cell, []).append((own.draws, weight))
    draws = {}
    for cell, recordings in sorted(found.items()):
        of_each, weights_of_cell = zip(*recordings, strict=True)
        draws[cell] = root_mean_square(np.stack(of_each), np.array(weights_of_cell))
    if open_trials or not draws:
        every, known = len(once), len(once) - len(open_trials)
        some = f"; {known} of {every} trials are explained" * (known > 0)
        return None, f"'hbm explain RESULTS' adds intervals of measurement{some}." * (every > 0)
    cells = pd.MultiIndex.from_tuples(draws, names=CELL)
    of_axes = np.stack(list(draws.values()), axis=2).swapaxes(0, 1)
    covariances = {
        axis: pd.DataFrame(np.atleast_2d(np.cov(own, rowvar=False)), cells, cells)
        for axis, own in zip(AXES, of_axes, strict=True)
    }
    return covariances, ""
