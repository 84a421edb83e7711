"""What is most worth mending in a trial, and what would tell its causes apart."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from pipeline.budgets.words import mending, size_in_words
from pipeline.explain.budget import Budget, EstimatedCause
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.residuals import AXES, UNITS
from pipeline.trial.result import TrialResult

MIN_FALL: Final = 0.03
"""Share of a residual's RMS that mending a cause has to take away to be worth a word."""
MAX_MENDINGS: Final = 3
LATE: Final = "plates are late"
MASS: Final = "body mass"
"""Names of causes that a person can state."""


@dataclass(frozen=True, slots=True)
class Mending:
    """What to do about a cause of certain size, and what that would change.

    Attributes
    ----------
    cause
        Its name.
    action
        What to do.
    axis
        The residual that falls most, as a share of itself.
    before, after
        Its RMS now and without the cause [N, N·m].
    """

    cause: str
    action: str
    axis: str
    before: float
    after: float

    def __str__(self) -> str:
        unit = UNITS[AXES.index(self.axis)]
        return f"{self.action} ({self.axis} {self.before:.1f} → {self.after:.1f} {unit})"


def most_worth_mending(
    budget: Budget, result: TrialResult, laboratory: Laboratory
) -> tuple[Mending, ...]:
    """Find what is most worth mending.

    Parameters
    ----------
    budget
        What the residuals are made of.
    result, laboratory
        The trial and its laboratory: what is stated of them now.

    Returns
    -------
    tuple of Mending
        Causes whose 95 % interval excludes zero and without which a residual would be smaller, the
        one with the largest share first; none that nothing in the laboratory changes. A delay or a
        mass is given as the line that states it.
    """
    found = []
    for cause in budget.causes:
        fall = 1 - cause.left / budget.rms
        axis = int(fall.argmax())
        if cause.is_certain and fall[axis] >= MIN_FALL:
            action = _stated(cause, result, laboratory)
            rms = float(budget.rms[axis]), float(cause.left[axis])
            if action:
                found.append((fall[axis], Mending(cause.name, action, AXES[axis], *rms)))
    return tuple(own for _, own in _largest(found))


def _largest(found: Iterable[tuple[float, Mending]]) -> list[tuple[float, Mending]]:
    return sorted(found, key=lambda each: -each[0])[:MAX_MENDINGS]


def _stated(cause: EstimatedCause, result: TrialResult, laboratory: Laboratory) -> str:
    """Give the line that states a cause, or what to do where there is none."""
    calibrated = laboratory.plates is not None
    if cause.name == LATE and not calibrated:
        delay_s = (result.settings.plate_delay_s or 0.0) + cause.size
        return f"state plate_delay_s = {delay_s:.3f} under [settings]"
    if cause.name == MASS:
        mass_kg = result.body.mass / (1 + cause.size)
        return f"state mass_kg = {mass_kg:.1f} of the subject, once scales confirm it"
    return mending(cause.group, f"{cause.name} {size_in_words(cause)}")
