"""Every attack in a forked process of its own, with limits; what becomes of it is an outcome."""

import gc
import json
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from tests.campaign.outcome import MAX_MEMORY_BYTES, TOLD, Attack, Outcome

POLL_S: Final = 0.2
MAX_OUTCOME_BYTES: Final = 4096
"""What a pipe takes at once, so that no child waits for its parent."""


@dataclass(frozen=True, slots=True)
class _Child:
    attack: Attack
    pid: int
    pipe: int
    folder: Path
    deadline: float


def carry_out(
    attacks: Iterable[Attack], seed: int, workers: int = 2
) -> Iterator[tuple[Attack, Outcome]]:
    """Make attacks, several at a time; outcomes come as they end."""
    waiting, running = iter(attacks), {}
    gc.freeze()  # children share the parent's memory as long as nobody writes to it
    with tempfile.TemporaryDirectory(prefix="campaign") as home:
        try:
            while True:
                while len(running) < workers and (attack := next(waiting, None)) is not None:
                    child = _start(attack, seed, Path(home))
                    running[child.pipe] = child
                if not running:
                    return
                ready, _, _ = select.select(list(running), [], [], POLL_S)
                late = [pipe for pipe, child in running.items() if time.time() > child.deadline]
                for pipe in {*ready, *late}:
                    child = running.pop(pipe)
                    outcome = _end(child, pipe in ready)
                    shutil.rmtree(child.folder, ignore_errors=True)
                    yield child.attack, outcome
        finally:
            for child in running.values():
                _end(child, False)


def _start(attack: Attack, seed: int, home: Path) -> _Child:
    folder = Path(tempfile.mkdtemp(dir=home))
    reading, writing = os.pipe()
    sys.stdout.flush()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        try:
            outcome = _in_child(attack, seed, folder)
        except BaseException as error:
            outcome = fault_of(error)
        _send(outcome, writing)
        os._exit(0)
    os.close(writing)
    return _Child(attack, pid, reading, folder, time.time() + attack.seconds)


def _in_child(attack: Attack, seed: int, folder: Path) -> Outcome:
    os.setsid()
    with Path(os.devnull).open("r+b") as nothing:
        for stream in (0, 1, 2):
            os.dup2(nothing.fileno(), stream)
    os.chdir(folder)
    most = _address_space() + MAX_MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    return attack.act(folder, attack.chance(seed))


def _address_space() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    return pages * resource.getpagesize()


def _send(outcome: Outcome, pipe: int) -> None:
    plain = asdict(outcome) | {"detail": outcome.detail[:500]}
    os.write(pipe, json.dumps(plain).encode()[:MAX_OUTCOME_BYTES])


def fault_of(error: BaseException) -> Outcome:
    """Give the outcome of an error that nobody caught, with the place where it was raised."""
    if isinstance(error, MemoryError):
        return Outcome("memory", "MemoryError")
    place = ""
    for frame in traceback.extract_tb(error.__traceback__):
        place = f"{Path(frame.filename).name}:{frame.lineno}"
    return Outcome("traceback", f"{type(error).__name__} at {place}: {error!s:.200}")


def _end(child: _Child, in_time: bool) -> Outcome:
    """Take what a child says, end it and whatever it left behind."""
    said = os.read(child.pipe, MAX_OUTCOME_BYTES) if in_time else b""
    os.close(child.pipe)
    if not in_time:
        os.kill(child.pid, signal.SIGKILL)
    _, status = os.waitpid(child.pid, 0)
    left = _end_session(child.pid)
    told = child.folder / TOLD
    what = told.read_text(encoding="utf-8") if told.is_file() else ""
    if not in_time:
        return Outcome("hang", f"{what}; no answer within {child.attack.seconds:g} s")
    if os.WIFSIGNALED(status) or not said:
        return Outcome("crash", f"{what}; ended by signal {os.WTERMSIG(status)}")
    outcome = Outcome(**json.loads(said))
    if left and outcome.survived:
        return Outcome("orphan", f"{left} processes remained")
    return outcome


def _end_session(leader: int) -> int:
    """End what is left of a session that this campaign started; say how many there were."""
    left = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError):
            pid, rest = stat.parent.name, stat.read_text(encoding="latin-1").rpartition(")")[2]
            state, _, _, session = rest.split()[:4]
            if int(session) == leader and state != "Z":
                os.kill(int(pid), signal.SIGKILL)
                left += 1
    return left
