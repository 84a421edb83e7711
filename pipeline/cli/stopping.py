"""Long work that is stopped, by Ctrl-C or by SIGTERM: it says what is done and how to go on."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

SIGNAL_EXIT: Final = 128
"""A process ended by signal N exits with this plus N, as in a shell."""
STOPPING: Final = (signal.SIGINT, signal.SIGTERM)
"""What asks a process to end, and lets it say so."""


class Stopped(Exception):
    """Work that was stopped: what is done and how to go on, and the exit code."""

    def __init__(self, sentence: str, exit_code: int) -> None:
        super().__init__(sentence)
        self.exit_code = exit_code
        self.code = "terminated" if exit_code == SIGNAL_EXIT + signal.SIGTERM else "interrupted"


class Terminated(KeyboardInterrupt):
    """The request to end that ``kill``, a scheduler, or a system that shuts down sends."""


@contextmanager
def stoppable(progress: Callable[[], str]) -> Iterator[None]:
    """End work that is interrupted or terminated by `Stopped`, with exit code 130 or 143.

    Parameters
    ----------
    progress
        Gives a sentence that says what is done and how to go on.
    """
    with terminable():
        try:
            yield
        except KeyboardInterrupt as stop:
            terminated = isinstance(stop, Terminated)
            number = signal.SIGTERM if terminated else signal.SIGINT
            how = "terminated" if terminated else "interrupted"
            raise Stopped(f"{how}: {progress()}", SIGNAL_EXIT + number) from stop


@contextmanager
def terminable() -> Iterator[None]:
    """Let SIGTERM raise `Terminated`, where nothing else is done about it yet."""
    takes_over = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    )
    if takes_over:
        signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        if takes_over:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextmanager
def recorded_requests() -> Iterator[list[int]]:
    """Give a list that requests to stop append their signals to; only a kill interrupts the work.

    An exception could come while an earlier one is handled, when nothing would wait for the end.
    """
    requests: list[int] = []
    before = {
        number: signal.signal(number, lambda number, frame: requests.append(number))
        for number in STOPPING
    }
    try:
        yield requests
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated
