"""Compiled kernels: built once on a machine, checked, and kept in the user's cache.

Libraries are keyed by the kernels' source, the compiler and the processor, carry a checksum, and
appear in the cache in one move, so several processes may build at once. A library that disagrees
with casadi's virtual machine is not kept; its entry in the cache says so instead.
"""

import atexit
import hashlib
import inspect
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import casadi as ca
import platformdirs

from hbm import coordinates
from hbm.kernels import c_source, kernel, skeleton
from hbm.kernels import library as checks
from hbm.kernels.c_source import write_source
from hbm.kernels.library import disagreement

FLAGS: Final = ("-O1", "-fPIC", "-shared", "-march=native", "-ffp-contract=off", "-Wno-psabi")
"""-O2 and -O3 take longer and gain nothing on straight-line code; contraction of products and sums
would make the numbers depend on the processor; vectors are passed to no other library (psabi)."""

TIMEOUT_S: Final = 600
"""A compiler takes about ten seconds; a slow, busy machine may take minutes."""

LIBRARY: Final = f"skeleton{'.dll' if sys.platform == 'win32' else '.so'}"
REFUSED: Final = "refused.txt"


class KernelsDisagreeError(Exception):
    """Compiled kernels give other numbers than casadi's virtual machine."""


def compilers() -> list[tuple[str, list[str]]]:
    """Give the C compilers of this machine, the best first: name and command."""
    preferred = os.environ.get("CC", "")
    found = [name for name in (preferred, "cc", "gcc", "clang") if name and shutil.which(name)]
    commands = [(name, [name]) for name in found[:1]]
    if find_spec("ziglang"):
        commands.append(("ziglang", [sys.executable, "-m", "ziglang", "cc"]))
    return commands


def cache_directory() -> Path:
    """Give the folder that holds compiled kernels: ``HBM_CACHE_DIR``, or in the user's cache."""
    if "HBM_CACHE_DIR" in os.environ:
        return Path(os.environ["HBM_CACHE_DIR"])
    return platformdirs.user_cache_path("hbm-residuals", appauthor=False, opinion=False)


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
        entry = Path(f"skeleton-{_key(command)}")
        library = cache_directory() / entry / LIBRARY
        if not (_sound(library) or _refusal(library)):
            folder = _writable(cache_directory(), announce)
            library = folder / entry / LIBRARY
            if library.parent.exists():
                announce("a compiled kernel in the cache is damaged: building it again")
                shutil.rmtree(library.parent, ignore_errors=True)
            announce(f"compiling the kernels with {name} (once on this machine, about ten seconds)")
            _build(command, library)
        refusal = _refusal(library)
    except (OSError, subprocess.SubprocessError) as error:
        announce(f"compiling with {name} failed ({_reason(error)}); trying the next option")
        return None
    if refusal:
        raise KernelsDisagreeError(
            f"the kernels that {name} compiled differ from casadi's virtual machine ({refusal})"
        )
    return library


def _reason(error: Exception) -> str:
    """Give the first line that names an error, else the first line."""
    output = str(error)
    if isinstance(error, subprocess.CalledProcessError) and error.stderr:
        output = error.stderr
    lines = output.splitlines() or [type(error).__name__]
    return next((line for line in lines if "error" in line), lines[0])


def _writable(folder: Path, announce: Callable[[str], None]) -> Path:
    """Give the cache folder, or one for this process alone where it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        temporary = Path(tempfile.mkdtemp(prefix="hbm-residuals-"))
        atexit.register(shutil.rmtree, temporary, ignore_errors=True)
        announce(
            f"the cache folder cannot be written ({error}): the kernels are compiled for this "
            "session only; set HBM_CACHE_DIR to a folder that can"
        )
        return temporary
    return folder


def _build(command: list[str], library: Path) -> None:
    """Compile and check in a temporary place, then move to the cache; the first process wins.

    What is checked is a copy: on Windows a library cannot be moved once it has been loaded.
    """
    entry = library.parent
    with tempfile.TemporaryDirectory(dir=entry.parent, ignore_cleanup_errors=True) as temporary:
        built = Path(temporary) / entry.name / library.name
        built.parent.mkdir()
        subprocess.run(
            [*command, *FLAGS, str(write_source(Path(temporary))), "-o", str(built), *_libm()],
            check=True,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=TIMEOUT_S,
        )
        difference = disagreement(Path(shutil.copy(built, temporary)))
        if difference:
            built.unlink()
            (built.parent / REFUSED).write_text(difference, encoding="utf-8")
        else:
            _checksum(built).write_text(_sha256(built))
        try:
            built.parent.replace(entry)
        except OSError:
            if not (_sound(library) or _refusal(library)):
                raise


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
    version = subprocess.run(
        [*command, "--version"],
        check=True,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=TIMEOUT_S,
    ).stdout
    modules = (coordinates, skeleton, kernel, c_source, checks, sys.modules[__name__])
    sources = [inspect.getsource(module) for module in modules]
    sources += [c_source.read_c_file(name) for name in c_source.C_FILES]
    parts = [*sources, ca.CasadiMeta.version(), version, _processor(), *FLAGS, *command]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]


def _processor() -> str:
    """Describe the processor as far as compiled code depends on it."""
    info = Path("/proc/cpuinfo")
    flags = ""
    if info.is_file():
        lines = info.read_text(errors="replace").splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return f"{sys.platform} {platform.machine()} {platform.processor()} {flags}"
