"""Compiled kernels: built once on a machine, checked, and kept in the user's cache.

Libraries are keyed by the kernels' source, the compiler and the processor, carry a checksum, and
appear in the cache in one move, so several processes may build at once. A library that disagrees
with casadi's virtual machine is not kept; its entry in the cache says so instead.
"""

import hashlib
import inspect
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Final

import casadi as ca

from hbm import coordinates
from hbm.kernels import c_source, kernel, skeleton
from hbm.kernels import library as checks
from hbm.kernels.c_source import write_source
from hbm.kernels.cache import (
    UNFINISHED,
    cache_directory,
    make_private,
    remove_unfinished,
    trusted_entry,
    writable_cache,
)
from hbm.kernels.library import disagreement
from hbm.spelling import printable

FLAGS: Final = ("-O1", "-fPIC", "-shared", "-march=native", "-ffp-contract=off", "-Wno-psabi")
"""-O2 and -O3 take longer and gain nothing on straight-line code; contraction of products and sums
would make the numbers depend on the processor; vectors are passed to no other library (psabi)."""

MAX_COMPILING_S: Final = 300.0
"""A compiler takes about ten seconds; a slow, busy machine may take minutes."""
MAX_ANSWER_S: Final = 10.0
"""A compiler says its version at once; one that is a Python package takes a second."""
MAX_OUTPUT: Final = 100_000
"""Bytes of a compiler's output that are read; the first error is at its beginning."""
MAX_REASON: Final = 150
"""Characters of a compiler's own message."""

LIBRARY: Final = f"skeleton{'.dll' if sys.platform == 'win32' else '.so'}"
REFUSED: Final = "refused.txt"


class KernelsDisagreeError(Exception):
    """Compiled kernels give other numbers than casadi's virtual machine."""


class CompilerError(Exception):
    """A compiler fails, or does not end."""


def compilers() -> list[tuple[str, list[str]]]:
    """Give the C compilers of this machine, the best first: name and command."""
    names = [os.environ.get("CC", ""), "cc", "gcc", "clang"]
    programs: dict[str, str] = {}
    for name in filter(shutil.which, filter(None, names)):
        programs.setdefault(os.path.realpath(shutil.which(name) or ""), name)
    commands = [(name, [name]) for name in programs.values()]
    if find_spec("ziglang"):
        commands.append(("ziglang", [sys.executable, "-m", "ziglang", "cc"]))
    return commands


def compiled_library(name: str, command: list[str], announce: Callable[[str], None]) -> Path | None:
    """Give the compiled kernels, building them if the cache holds no intact copy.

    Parameters
    ----------
    name, command
        The compiler.
    announce
        Called with a sentence when something takes long or goes wrong.

    Returns
    -------
    Path | None
        The library; None if this compiler cannot make it.

    Raises
    ------
    KernelsDisagreeError
        If what this compiler made of the kernels gives other numbers than the virtual machine.
    """
    try:
        entry = f"skeleton-{_key(command)}"
        library = _kept(cache_directory() / entry)
        if library is None:
            library = writable_cache(announce) / entry / LIBRARY
            if library.parent.exists():
                announce("a compiled kernel in the cache is damaged or not safe: building it again")
                discard(library)
            announce(f"compiling the kernels with {name} (once on this machine, about ten seconds)")
            _build(command, library)
        remove_unfinished(library.parent.parent)
        refusal = _refusal(library)
    except (OSError, CompilerError) as error:
        reason = printable(str(error))[:MAX_REASON]
        announce(f"compiling with {name} failed ({reason}); trying the next option")
        return None
    if refusal:
        raise KernelsDisagreeError(
            f"the kernels that {name} compiled differ from casadi's virtual machine ({refusal})"
        )
    return library


def discard(library: Path) -> None:
    """Remove a library from the cache."""
    if library.parent.is_symlink():
        library.parent.unlink()
    shutil.rmtree(library.parent, ignore_errors=True)


def _build(command: list[str], library: Path) -> None:
    """Compile and check in a temporary place, then move to the cache; the first process wins.

    What is checked is a copy: on Windows a library cannot be moved once it has been loaded.
    """
    entry = library.parent
    with tempfile.TemporaryDirectory(
        prefix=UNFINISHED, dir=entry.parent, ignore_cleanup_errors=True
    ) as temporary:
        built = Path(temporary) / entry.name / library.name
        built.parent.mkdir()
        source = write_source(Path(temporary))
        _run([*command, *FLAGS, str(source), "-o", str(built), *_libm()], MAX_COMPILING_S)
        difference = disagreement(Path(shutil.copy(built, temporary)))
        if difference:
            built.unlink()
            (built.parent / REFUSED).write_text(difference, encoding="utf-8")
        else:
            _checksum(built).write_text(_sha256(built))
        make_private(built.parent)
        try:
            built.parent.replace(entry)
        except OSError:
            if _kept(entry) is None:
                raise


def _kept(entry: Path) -> Path | None:
    """Give the library of an entry that is trusted and undamaged, or was refused; else None."""
    try:
        library = trusted_entry(entry) / LIBRARY
    except OSError:
        return None
    return library if _sound(library) or _refusal(library) else None


def _sound(library: Path) -> bool:
    """Whether a library exists, can be read and is undamaged."""
    try:
        return _checksum(library).read_text("ascii", "replace") == _sha256(library)
    except OSError:
        return False


def _refusal(library: Path) -> str:
    """Give the reason why a library that was built is not kept; empty if there is none."""
    try:
        return (library.parent / REFUSED).read_text("utf-8", "replace")
    except OSError:
        return ""


def _checksum(library: Path) -> Path:
    return library.with_suffix(".sha256")


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _libm() -> list[str]:
    return [] if sys.platform == "win32" else ["-lm"]


def _key(command: list[str]) -> str:
    """Hash all that a library depends on."""
    version = _run([*command, "--version"], MAX_ANSWER_S)
    modules = (coordinates, skeleton, kernel, c_source, checks, sys.modules[__name__])
    sources = [inspect.getsource(module) for module in modules]
    sources += [c_source.read_c_file(name) for name in c_source.C_FILES]
    parts = [*sources, ca.CasadiMeta.version(), version, _processor(), *FLAGS, *command]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]


def _run(command: list[str], limit_s: float) -> str:
    """Run a compiler, and all that it starts, for a limited time; give what it says.

    Raises
    ------
    CompilerError
        If it fails, with the first line that names an error, or does not end.
    """
    with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as complained:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=complained,
            start_new_session=True,
        )
        try:
            code = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            raise CompilerError(f"no answer within {limit_s:.0f} s") from None
        finally:
            _end(process)
        output, errors = (_beginning(file) for file in (said, complained))
    if code:
        lines = [line for line in errors.splitlines() if line.strip()] or [f"exit code {code}"]
        raise CompilerError(next((line for line in lines if "error" in line), lines[0]))
    return output


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process and, where there are sessions, all that it started."""
    if sys.platform == "win32":
        process.kill()
    else:
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _beginning(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read(MAX_OUTPUT).decode(errors="replace")


def _processor() -> str:
    """Describe the processor as far as compiled code depends on it."""
    info = Path("/proc/cpuinfo")
    flags = ""
    if info.is_file():
        lines = info.read_text(errors="replace").splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return f"{sys.platform} {platform.machine()} {platform.processor()} {flags}"
