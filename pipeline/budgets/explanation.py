"""What a trial's residuals are made of, with what follows from it: as a file, and as lines."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Final

from pydantic import ConfigDict, TypeAdapter, ValidationError

from pipeline.budgets.advice import Mending, most_worth_mending
from pipeline.budgets.words import (
    are_apart,
    group_name,
    how_to_tell_apart,
    shares_in_words,
    size_in_words,
)
from pipeline.explain.budget import Budget
from pipeline.explain.explain import MIN_CYCLES, explain_trial
from pipeline.io.recording import Recording
from pipeline.io.write import write_text
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.result import TrialResult
from pipeline.trial.summary import fault_of

FORMAT_VERSION: Final = 1
"""Of the files; raised with every change of what they hold."""
MAX_CAUSES: Final = 5
"""Named one by one; the file has all."""
SUFFIX: Final = "_explained.json"


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

    def to_json(self) -> str:
        """Give the content of the file; numbers come back exactly."""
        return _JSON.dump_json(self, indent=1).decode()


_JSON: Final = TypeAdapter(Explanation)


def explain(
    recording: Recording,
    laboratory: Laboratory,
    result: TrialResult,
    key: str = "",
    draws: int = 0,
) -> Explanation:
    """Explain the residuals of a processed trial; parameters as for `explain_trial`."""
    found = explain_trial(recording, laboratory, result, draws)
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
        raise ValueError(f"{path.name} is damaged: {fault_of(error)}") from error
    if found.version != FORMAT_VERSION:
        raise ValueError(f"{path.name}: written by another version of hbm")
    return found


def explanation_lines(explanation: Explanation) -> Iterator[str]:
    """Say what a table of shares does not: sizes, what to mend, what is merged, the check.

    Parameters
    ----------
    explanation
        Of a trial.

    Yields
    ------
    str
        A line each.
    """
    budget = explanation.budget
    certain = [cause for cause in budget.causes if cause.is_certain][:MAX_CAUSES]
    if certain:
        named = [f"{cause.name} {size_in_words(cause)}" for cause in certain]
        yield f"Largest causes (size ± 95 % interval): {'; '.join(named)}."
    else:
        yield "No single cause is certain: the 95 % interval of every size contains zero."
    if explanation.mending:
        yield f"Most worth mending: {'; '.join(map(str, explanation.mending))}."
    else:
        yield "Nothing is clearly worth mending: no certain cause makes much of a residual."
    for group in budget.groups:
        if are_apart(group.groups):
            ways = how_to_tell_apart(group.groups)
            how = f": {'; '.join(ways)}" if ways else ""
            yield f"This trial cannot tell apart {group_name(group.groups)}{how or ' from it'}."
    of = "cycles" if budget.cycles >= MIN_CYCLES else "frames"
    yield (
        f"Held-out check: the causes found in one half of the {of} take away of the mean square of "
        f"the other half {shares_in_words(budget.held_out)}."
    )
