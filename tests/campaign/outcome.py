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
MAX_MESSAGE_CHARACTERS: Final = 300
MEANINGS: Final = {
    "fine": "the numbers of the undamaged file",
    "noted": "accepted with a note that the undamaged file does not have",
    "one datum": "accepted; as many measured values differ as the attack replaced by others",
    "refused": "one line per fault, of fewer than 300 printable characters, that names the file; "
    "exit code 2",
    "silent": "other numbers without a note, or a damaged result that is accepted",
    "unclear": "a refusal that is not as above, or an exit code that is not documented",
    "traceback": "an error that is not caught",
    "hang": "more than 20 s",
    "crash": "ended by a signal",
    "memory": "more than 2 GB",
    "orphan": "a process that outlives its command",
    "leftover": "a temporary file that outlives its command, or a file where none should be",
    "leak": "a text of the file reaches a terminal or a page raw, or a person is named",
}
"""Kind of outcome -> what it means."""
TOLD: Final = "told"
"""File in which an attempt tells what it does, for the case that it cannot say it at the end."""
SURVIVED: Final = ("fine", "noted", "one datum", "refused")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one attack: one of `MEANINGS`, and the line that shows it."""

    kind: str
    detail: str = ""

    def __post_init__(self) -> None:
        if self.kind not in MEANINGS:
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
