"""``hbm run`` killed at random instants, and run again: the same bytes, and nothing left behind."""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.campaign.outcome import Attack, Outcome

ROOT: Final = Path(__file__).resolve().parents[2]
MAX_RUN_S: Final = 300.0
MAX_STOP_S: Final = 20.0
MAX_ORPHAN_S: Final = 10.0
"""After which a process of a killed run is an orphan."""
TOKEN: Final = "HBM_CAMPAIGN"
"""Environment variable that processes inherit: by its value they are found again."""
STOPPED: Final = (130, 143, -signal.SIGTERM)
"""Exit codes after SIGTERM; without the last one if it had begun to listen."""


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """A run that nothing disturbed: its results and how long it took."""

    study: Path
    results: dict[str, bytes]
    seconds: float


def undisturbed(study: Path, out: Path) -> Undisturbed:
    """Run a study to the end."""
    start = time.monotonic()
    code, errors = _run(study, out, "undisturbed")
    if code or not (results := _results(out)):
        raise RuntimeError(f"the undisturbed run failed: {errors}")
    return Undisturbed(study, results, time.monotonic() - start)


def kills(known: Undisturbed, count: int) -> Iterator[Attack]:
    """Kill a run ``count`` times, by SIGKILL and SIGTERM in turn."""
    for number in range(count):
        sent = (signal.SIGKILL, signal.SIGTERM)[number % 2]

        def act(folder: Path, chance: random.Random, sent: int = sent) -> Outcome:
            return _killed_and_run_again(known, folder, sent, chance.uniform(0, known.seconds))

        seconds = 2 * MAX_RUN_S + MAX_STOP_S + MAX_ORPHAN_S
        yield Attack("kill", signal.Signals(sent).name, number, act, seconds)


def _killed_and_run_again(known: Undisturbed, folder: Path, sent: int, after_s: float) -> Outcome:
    out, token = folder / "out", str(folder)
    with (folder / "printed").open("w") as printed, (folder / "errors").open("w") as errors:
        running = subprocess.Popen(
            _command(known.study, out), stdout=printed, stderr=errors, env=environment(token)
        )
        with suppress(subprocess.TimeoutExpired):
            running.wait(after_s)
        running.send_signal(sent)
        try:
            code = running.wait(MAX_STOP_S)
        except subprocess.TimeoutExpired:
            _end_all(token)
            return Outcome("hang", f"still there {MAX_STOP_S:g} s after signal {sent}")
    when = f"signal {sent} after {after_s:.2f} s, exit code {code}"
    said = (folder / "errors").read_text(encoding="utf-8")
    if "Traceback" in said:
        return Outcome("traceback", f"{when}: {said.strip().splitlines()[-1]}")
    if orphans := _orphans(token):
        _end_all(token)
        return Outcome("orphan", f"{when}: {orphans} processes after {MAX_ORPHAN_S:g} s")
    if sent == signal.SIGTERM and code not in (0, *STOPPED):
        return Outcome("unclear", f"{when}: {said[:200]!r}")
    if wrong := [n for n, content in _results(out).items() if known.results.get(n) != content]:
        return Outcome("silent", f"{when}: {', '.join(wrong)} differs")
    code, said = _run(known.study, out, token)
    if code:
        return Outcome("unclear", f"{when}; run again: exit code {code}: {said[:200]!r}")
    if _results(out) != known.results:
        return Outcome("silent", f"{when}; run again: other results")
    if left := [path.name for path in out.rglob(".*")]:
        return Outcome("leftover", f"{when}; after the next run: {', '.join(left)}")
    return Outcome("fine", when)


def _command(study: Path, out: Path) -> list[str]:
    command = [sys.executable, "-m", "pipeline.cli", "run", str(study)]
    return [*command, "--jobs", "2", "--out", str(out)]


def environment(token: str) -> dict[str, str]:
    """Give an environment in which this checkout is imported, and that is recognised."""
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths)), TOKEN: token}


def _run(study: Path, out: Path, token: str) -> tuple[int, str]:
    done = subprocess.run(
        _command(study, out),
        capture_output=True,
        text=True,
        env=environment(token),
        timeout=MAX_RUN_S,
        check=False,
    )
    return done.returncode, done.stderr


def _results(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (out / "trials").glob("*.parquet")}


def _marked(token: str) -> list[int]:
    """List the processes that carry a token and are not dead."""
    mark = f"{TOKEN}={token}\0".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if mark in (folder / "environ").read_bytes():
                found.append(int(folder.name))
    return found


def _orphans(token: str) -> int:
    """Count the processes that are still there when all should have ended."""
    deadline = time.monotonic() + MAX_ORPHAN_S
    while (left := len(_marked(token))) and time.monotonic() < deadline:
        time.sleep(0.1)
    return left


def _end_all(token: str) -> None:
    for pid in _marked(token):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
