"""A format that the program reads, with a small valid file of it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pipeline.cli.request import TrialRequest
from tests.campaign.judgement import attempted
from tests.campaign.mutations import Damage
from tests.campaign.outcome import Outcome


@dataclass(frozen=True)
class Format:
    """A format with a valid file of it.

    Attributes
    ----------
    name
        As in the table.
    file
        The valid file.
    judge
        Path of a damaged file of that name, alone in a folder, and its damage -> the outcome.
    text
        Whether it is text.
    request
        Path -> how ``hbm residuals`` is asked to process it; None where it is no recording.
    """

    name: str
    file: Path
    judge: Callable[[Path, Damage], Outcome]
    text: bool = True
    request: Callable[[Path], TrialRequest] | None = None

    @cached_property
    def content(self) -> bytes:
        return self.file.read_bytes()


def read_alone(read: Callable[[], object], path: Path) -> Outcome:
    """Read what a person or a program has stated: any value is taken that can be one."""

    def act() -> Outcome:
        read()
        return Outcome("fine")

    return attempted(act, (path.name,))
