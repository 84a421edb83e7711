"""What of a condition's trials counts, as a study file states it."""

import re
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import BeforeValidator

from hbm.spelling import shown

WORDS: Final = ("cycle", "motion", "recording")
ALLOWED: Final = '"cycle", "motion", "recording", [start_s, stop_s] or ["10 %", "40 %"]'
MAX_STOP: Final = 1e6
"""Seconds; no recording is longer."""
PERCENT: Final = re.compile(r"\s*(-?\d+(?:\.\d+)?)\s*%\s*", re.ASCII)


@dataclass(frozen=True, slots=True)
class Interval:
    """Start and stop of what counts.

    Attributes
    ----------
    start, stop
        In seconds from the recording's first frame or, in a perturbed condition, from the onset of
        each perturbation; or in percent of the perturbed gait cycle.
    unit
        "s" or "%".

    Examples
    --------
    >>> print(Interval(10.0, 40.0, "%"))
    10 to 40 %
    """

    start: float
    stop: float
    unit: Literal["s", "%"]

    def __str__(self) -> str:
        return f"{self.start:g} to {self.stop:g} {self.unit}"


def _window(stated: object) -> object:
    if isinstance(stated, Interval) or stated in WORDS:
        return stated
    if not isinstance(stated, list | tuple) or len(stated) != 2:
        raise ValueError(f"must be {ALLOWED}, got {shown(stated)}")
    percents = [PERCENT.fullmatch(bound) for bound in stated if isinstance(bound, str)]
    numbers: list[float] = [bound for bound in stated if isinstance(bound, int | float)]
    unit: Literal["s", "%"] = "%" if percents else "s"
    if percents:
        numbers = [float(match[1]) for match in percents if match]
    if len(numbers) != 2 or any(isinstance(bound, bool) for bound in stated):
        raise ValueError(f"must be {ALLOWED}, got {shown(stated)}")
    start, stop = numbers
    if start < 0:
        raise ValueError(f"must not begin before zero, got {shown(stated)}")
    if not start < stop <= MAX_STOP:
        raise ValueError(f"must be [start, stop] with start < stop, got {shown(stated)}")
    if unit == "%" and stop > 100:
        raise ValueError(f"ends beyond 100 % of the gait cycle, got {shown(stated)}")
    return Interval(float(start), float(stop), unit)


Window = Annotated[Literal["cycle", "motion", "recording"] | Interval, BeforeValidator(_window)]
"""Gait cycles, their part while the platform moves, all of the recording, or an interval."""
