"""What a trial's residuals are made of, with what follows from it: files, and errors of a study."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Final

import numpy as np
import pandas as pd
import pyarrow as pa
from pydantic import ConfigDict, TypeAdapter, ValidationError

from hbm.spatial import Array
from pipeline.budgets.words import Mending, budget_lines, most_worth_mending
from pipeline.config.schema import NOUNS, TrialName
from pipeline.explain.budget import Bands, Budget
from pipeline.explain.explain import explain_trial
from pipeline.io.recording import Recording
from pipeline.io.write import whole_file, write_text
from pipeline.statistics.design import Weigh
from pipeline.statistics.measurement import CELL, Covariances
from pipeline.statistics.recordings import recording_weights, root_mean_square
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.residuals import AXES
from pipeline.trial.result import TrialResult

FORMAT_VERSION: Final = 4
"""Of the files; raised with every change of what they hold."""
SUFFIX: Final = "_explained.json"
BANDS_SUFFIX: Final = "_bands.parquet"


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
    mending: tuple[Mending, ...]

    def lines(self) -> Iterator[str]:
        """Say what a table of shares does not: sizes, what to mend, what is merged, the check."""
        return budget_lines(self.budget, self.mending)

    def to_json(self) -> str:
        """Give the content of the file; numbers come back exactly."""
        return _JSON.dump_json(self, indent=1).decode()


_JSON: Final = TypeAdapter(Explanation)


def explain(
    recording: Recording,
    laboratory: Laboratory,
    result: TrialResult,
    key: str = "",
) -> Explanation:
    """Explain the residuals of a processed trial; parameters as for `explain_trial`."""
    found = explain_trial(recording, laboratory, result)
    budget = replace(found, source=Path(found.source.name))
    mending = most_worth_mending(budget, result, laboratory)
    return Explanation(FORMAT_VERSION, key, budget, mending)


def write_explanation(explanation: Explanation, path: Path) -> None:
    """Write an explanation as JSON, whole or not at all."""
    write_text(explanation.to_json(), path)


def read_explanation(path: Path) -> Explanation:
    """Read an explanation back.

    Raises
    ------
    ValueError
        If the file is damaged, or written by another version.
    OSError
        If it cannot be opened.
    """
    try:
        found = _JSON.validate_json(path.read_bytes())
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
        table = pd.read_parquet(path)
        residual, deviation = (
            table[[f"{name}.{axis}" for axis in AXES]].to_numpy()
            for name in ("residual", "deviation")
        )
        return Bands(table["time_s"].to_numpy(), table["cycle"].to_numpy(), residual, deviation)
    except (pa.ArrowInvalid, KeyError) as error:
        raise ValueError(
            f"{path.name}: no residuals with bands; run 'hbm explain' again"
        ) from error


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
