"""Commands in odd environments: the same results, or one clear line."""

import os
import random
import resource
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pipeline.cli.request import TrialRequest
from tests.campaign.judgement import CODES, Ended, commanded, printed_raw, refusal
from tests.campaign.kills import environment
from tests.campaign.outcome import Attack, Outcome

PLAIN_TEXT: Final = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
MAX_COMMAND_S: Final = 60.0


def _no_change() -> None:
    pass


@dataclass(frozen=True, slots=True)
class Environment:
    """What is odd where a command runs.

    Attributes
    ----------
    variables
        Environment variables that are set, or unset where None.
    before
        Called in the new process.
    output
        Where stdout goes: captured, "closed", or a file.
    umask
        What files may not allow.
    may_refuse
        Whether one clear line in place of results will do.
    """

    variables: Mapping[str, str | None] = field(default_factory=dict)
    before: Callable[[], None] = _no_change
    output: str = "captured"
    umask: int = 0o022
    may_refuse: bool = False


def _close(*streams: int) -> Callable[[], None]:
    def close() -> None:
        for stream in streams:
            os.close(stream)

    return close


def _limit(kind: int, most: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(kind, (most, most))


ENVIRONMENTS: Final[Mapping[str, Environment]] = {
    "ASCII": Environment(PLAIN_TEXT),
    "ASCII, 40 columns": Environment(PLAIN_TEXT | {"COLUMNS": "40"}),
    "Latin-1": Environment({"PYTHONIOENCODING": "latin-1"}),
    "UTF-16": Environment({"PYTHONIOENCODING": "utf-16"}),
    **{
        f"COLUMNS={columns}": Environment({"COLUMNS": columns})
        for columns in ("0", "100000", "many")
    },
    "LINES=0": Environment({"LINES": "0"}),
    "no HOME": Environment({"HOME": None, "XDG_CACHE_HOME": None}),
    "HOME is a file": Environment({"HOME": os.devnull, "XDG_CACHE_HOME": None}),
    "HOME cannot be written": Environment({"HOME": "/proc", "XDG_CACHE_HOME": None}),
    "MPLCONFIGDIR cannot be written": Environment({"MPLCONFIGDIR": "/proc/matplotlib"}),
    **{f"TERM={term}": Environment({"TERM": term}) for term in ("dumb", "", "none", "\x1b[2J")},
    "no TERM": Environment({"TERM": None}),
    "NO_COLOR": Environment({"NO_COLOR": "1"}),
    "no PATH": Environment({"PATH": None}),
    "PATH of nothing": Environment({"PATH": "/proc"}),
    "no TMPDIR": Environment({"TMPDIR": "/proc/missing"}),
    "stdout closed": Environment(before=_close(1), output="closed"),
    "stdin closed": Environment(before=_close(0)),
    "all streams closed": Environment(before=_close(0, 1, 2), output="closed"),
    "stdout full": Environment(output="/dev/full", may_refuse=True),
    "umask 077": Environment(umask=0o077),
    "umask 002": Environment(umask=0o002),
    "64 open files": Environment(before=_limit(resource.RLIMIT_NOFILE, 64), may_refuse=True),
    "files of 100 kB": Environment(before=_limit(resource.RLIMIT_FSIZE, 100_000), may_refuse=True),
    "python -O": Environment({"PYTHONOPTIMIZE": "1"}),
    "warnings are errors": Environment({"PYTHONWARNINGS": "default"}),
    "threads of nothing": Environment({"OMP_NUM_THREADS": "0", "OPENBLAS_NUM_THREADS": "none"}),
    "TZ unknown": Environment({"TZ": "Nowhere/Land"}),
}
COMMANDS: Final = ("residuals", "check", "run", "doctor")
ODD_FILES: Final = ("FIFO", "socket", "folder", "loop", "missing", "endless", "forbidden")


def environments(
    request: TrialRequest, study: Path, count: int, chance: random.Random
) -> Iterator[Attack]:
    """Run commands in odd environments and on odd files, ``count`` of all."""
    attacks = []
    for number, (name, odd) in enumerate(ENVIRONMENTS.items()):
        for command in COMMANDS:

            def act(
                folder: Path,
                _: random.Random,
                name: str = name,
                odd: Environment = odd,
                command: str = command,
            ) -> Outcome:
                outcome = _outcome(odd, command, _arguments(command, request, study), folder)
                return Outcome(outcome.kind, f"{name}: {outcome.detail}")

            attacks.append(Attack("environment", command, number, act, MAX_COMMAND_S + 10))
    for number, kind in enumerate(ODD_FILES):

        def attempt(folder: Path, _: random.Random, kind: str = kind) -> Outcome:
            path = _odd_file(kind, folder)
            ended = commanded("residuals", path, "--out", folder / "out")
            outcome = refusal(ended, (path.name,))
            return Outcome(outcome.kind, f"{kind}: {outcome.detail}")

        attacks.append(Attack("environment", "odd file", number, attempt))
    yield from chance.sample(attacks, min(count, len(attacks)))


def _arguments(command: str, request: TrialRequest, study: Path) -> list[str]:
    out = ["--out", "out"]
    static = ["--static", str(request.static), "--sex", "male"]
    return {
        "residuals": ["residuals", str(request.trial), *static, *out],
        "check": ["check", str(study)],
        "run": ["run", str(study), "--condition", "level", *out],
        "doctor": ["doctor"],
    }[command]


def _outcome(odd: Environment, command: str, arguments: list[str], folder: Path) -> Outcome:
    variables = environment(str(folder)) | {k: v for k, v in odd.variables.items() if v is not None}
    for name in (name for name, value in odd.variables.items() if value is None):
        variables.pop(name, None)
    errors = folder / "errors"
    with Path(os.devnull if odd.output in ("captured", "closed") else odd.output).open("w") as to:
        captured = subprocess.PIPE if odd.output == "captured" else to
        with errors.open("wb") as said:
            try:
                done = subprocess.run(
                    [sys.executable, "-m", "pipeline.cli", *arguments],
                    stdout=captured,
                    stderr=said,
                    env=variables,
                    preexec_fn=odd.before,
                    umask=odd.umask,
                    cwd=folder,
                    timeout=MAX_COMMAND_S,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                return Outcome("hang", f"no answer within {MAX_COMMAND_S:g} s")
    encoding = odd.variables.get("PYTHONIOENCODING") or "utf-8"
    out = (done.stdout or b"").decode(encoding, errors="replace")
    err = errors.read_bytes().decode(errors="replace")
    return _judged(odd, command, Ended(done.returncode, out, err), folder)


def _judged(odd: Environment, command: str, ended: Ended, folder: Path) -> Outcome:
    if ended.code < 0:
        return Outcome("crash", f"ended by signal {-ended.code}")
    if "Traceback" in ended.err or "Traceback" in ended.out:
        return Outcome("traceback", ended.err.strip().splitlines()[-1])
    if ended.code not in CODES:
        return Outcome("unclear", f"exit code {ended.code}: {ended.err[:200]!r}")
    if ended.code:
        short = ended.err.count("\n") <= 1
        if odd.may_refuse and short:
            return Outcome("refused", f"exit code {ended.code}: {ended.err.strip()[:200]}")
        return Outcome("unclear", f"exit code {ended.code}: {(ended.err or ended.out)[-200:]!r}")
    if raw := printed_raw(ended.out.replace("\0", "")):
        return Outcome("leak", raw)
    if command == "residuals" and odd.variables.get("COLUMNS") == "40" and "…" in ended.out:
        return Outcome("unclear", "the table is cut at 40 columns")
    return _written(command, folder, 0o666 & ~odd.umask)


def _written(command: str, folder: Path, mode: int) -> Outcome:
    """Judge the files that a command leaves: all there, none hidden, as the umask says."""
    wanted = {"residuals": {".parquet", ".csv", ".png", ".svg"}, "run": {".parquet", ".json"}}
    files = [path for path in (folder / "out").rglob("*") if path.is_file()]
    missing = wanted.get(command, set()) - {path.suffix for path in files}
    if missing:
        return Outcome("unclear", f"exit code 0 without {', '.join(sorted(missing))}")
    if hidden := [path.name for path in files if path.name.startswith(".")]:
        return Outcome("leftover", ", ".join(hidden))
    for path in files:
        if (found := path.stat().st_mode & 0o777) != mode:
            return Outcome("leak", f"{path.name} has mode {found:o}, the umask allows {mode:o}")
    return Outcome("fine")


def _odd_file(kind: str, folder: Path) -> Path:
    path = folder / "odd.c3d"
    if kind == "FIFO":
        os.mkfifo(path)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(path.name)
    elif kind == "folder":
        path.mkdir()
    elif kind == "loop":
        path.symlink_to(path)
    elif kind == "endless":
        path.symlink_to("/dev/zero")
    elif kind == "forbidden":
        path.symlink_to("/proc/self/mem")
    return path
