"""Long work that is stopped, by Ctrl-C or by SIGTERM: it says what is done and how to go on."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

SIGNAL_EXIT: Final = 128
"""A process ended by signal N exits with this plus N, as in a shell."""


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


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated
