"""What an attack is, and what may become of it."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

MAX_SECONDS: Final = 20.0
"""An attempt that takes longer hangs."""
MAX_MEMORY_BYTES: Final = 2 << 30
"""An attempt that needs more, beyond what the campaign itself holds, needs too much."""
MAX_MESSAGE_CHARACTERS: Final = 700
SURVIVED: Final = ("fine", "noted", "one datum", "refused")
KINDS: Final = (
    *SURVIVED,
    *("silent", "unclear", "traceback", "hang", "crash", "memory", "orphan", "leftover", "leak"),
)
"""Kinds of outcomes; validation/reliability.md says what each means."""
TOLD: Final = "told"
"""File in which an attempt tells what it does, for the case that it cannot say it at the end."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one attack: one of `KINDS`, and the line that shows it."""

    kind: str
    detail: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"no outcome is called {self.kind!r}")

    @property
    def survived(self) -> bool:
        return self.kind in SURVIVED

    def __str__(self) -> str:
        printable = (c if c.isprintable() else repr(c)[1:-1] for c in self.detail)
        return f"{self.kind}: {''.join(printable)}"


@dataclass(frozen=True, slots=True)
class Attack:
    """One attempt, repeatable by the campaign's seed and its name.

    Attributes
    ----------
    campaign, target
        Row of the table: such as "truncation" of "C3D".
    number
        Which one of its row.
    act
        Makes the attempt in an empty folder, with its own random numbers, in a process of its own.
    seconds
        After which it hangs.
    """

    campaign: str
    target: str
    number: int
    act: Callable[[Path, random.Random], Outcome]
    seconds: float = MAX_SECONDS

    @property
    def name(self) -> str:
        return f"{self.campaign}/{self.target}/{self.number}"

    def chance(self, seed: int) -> random.Random:
        """Give the attack's own random numbers."""
        return random.Random(f"{seed} {self.name}")
