"""The skeleton's kernels as C, compiled once on a machine and kept.

Libraries are keyed by the kernels' source, the compiler and the processor, carry a checksum, and
appear in the cache in one move, so several processes may build at once.
"""

import atexit
import hashlib
import inspect
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import casadi as ca

from hbm import coordinates
from hbm.kernels import skeleton

SHARED_INPUTS: Final = {"newton_step": (6,), "segment_poses": (1,), "newton_euler": (3, 4)}
FLAGS: Final = ("-O1", "-fPIC", "-shared", "-march=native", "-ffp-contract=off", "-Wno-psabi")
TIMEOUT_S: Final = 600
BLOCK_LINES: Final = 500
LOOP: Final = """
EXPORT void {name}_frames(long long frames, const double *const *in, double *const *out) {{
  static const int size_in[] = {{{size_in}}}, shared[] = {{{shared}}}, size_out[] = {{{size_out}}};
  lanes room[{room}];
  over_frames({name}, frames, {inputs}, size_in, shared, {outputs}, size_out, in, out, room);
}}
"""


def compact(name: str) -> Any:
    """Give a kernel as a casadi function with dense outputs and no repeated expressions."""
    function = getattr(skeleton, name)()
    symbols = [ca.SX.sym("x", function.size1_in(i)) for i in range(function.n_in())]
    return ca.Function(name, symbols, [ca.densify(x) for x in ca.cse(function.call(symbols))])


def write_source(folder: Path) -> Path:
    """Write the kernels and what runs them over frames as one C file, and give the file."""
    ours = files("hbm.kernels")
    parts = [ours.joinpath("simd.h").read_text("utf-8"), _sizes_in_c()]
    for name, shared in SHARED_INPUTS.items():
        function = compact(name)
        size_in = [function.size1_in(i) for i in range(function.n_in())]
        size_out = [function.size1_out(i) for i in range(function.n_out())]
        parts += [
            _in_lanes(function, folder),
            LOOP.format(
                name=name,
                size_in=", ".join(map(str, size_in)),
                shared=", ".join(str(int(i in shared)) for i in range(len(size_in))),
                size_out=", ".join(map(str, size_out)),
                room=sum(size_in) + sum(size_out),
                inputs=len(size_in),
                outputs=len(size_out),
            ),
        ]
    parts.append(ours.joinpath("descent.c").read_text("utf-8"))
    source = folder / "skeleton.c"
    source.write_text("\n".join(parts), encoding="utf-8")
    return source


def _sizes_in_c() -> str:
    sizes = {
        "N": skeleton.N_Q,
        "SEGMENTS": len(coordinates.SEGMENTS),
        "SUMS": skeleton.N_SUMS,
        "GEOMETRY": skeleton.N_GEOMETRY,
    }
    return "enum { " + ", ".join(f"{name} = {size}" for name, size in sizes.items()) + " };\n"


def _in_lanes(function: Any, folder: Path) -> str:
    """Give a kernel's straight-line C with lanes for numbers.

    Every so many lines an empty jump ends a block: compilers work on one block at a time, and take
    much longer than proportional for long ones (LLVM: a minute instead of four seconds).
    """
    name = function.name()
    generator = ca.CodeGenerator(f"{name}.c")
    generator.add(function)
    generator.generate(f"{folder}{os.sep}")
    text = (folder / f"{name}.c").read_text()
    body = re.search(r"^static int casadi_f\d+\(.*?^}\n", text, re.MULTILINE | re.DOTALL)
    if body is None:
        raise OSError(f"casadi {ca.CasadiMeta.version()} writes C that is not understood here")
    lines = re.sub(r"casadi_f\d+\(", f"{name}(", body.group(), count=1)
    lines = re.sub(r"arg\[\d+\]\? (arg\[\d+\]\[\d+\]) : 0", r"\1", lines)
    lines = re.sub(r"^(  a\d+)=(-?[0-9.e+-]+);", r"\1=broadcast(\2);", lines, flags=re.MULTILINE)
    lines = re.sub(r"\b(?:casadi_)?(sin|cos|fabs|fmax)\(", r"lanes_\1(", lines)
    lines = lines.replace("casadi_real", "lanes").replace("casadi_int", "long long")
    parts = re.split(r"(?<=;\n)(?=  a\d+=)", lines)
    blocks = ["".join(parts[at : at + BLOCK_LINES]) for at in range(0, len(parts), BLOCK_LINES)]
    jumps = (f'  __asm__ goto ("" : : : : block_{k}); block_{k}:;\n' for k in range(1, len(blocks)))
    return blocks[0] + "".join(a + b for a, b in zip(jumps, blocks[1:], strict=True))


def compilers() -> list[tuple[str, list[str]]]:
    """Give the C compilers of this machine, the best first: name and command."""
    own = os.environ.get("CC", "")
    found = [name for name in (own, "cc", "gcc", "clang") if name and shutil.which(name)]
    ways = [(name, [name]) for name in found[:1]]
    if find_spec("ziglang"):
        ways.append(("ziglang", [sys.executable, "-m", "ziglang", "cc"]))
    return ways


def cache_directory() -> Path:
    """Give the folder that holds compiled kernels."""
    if "HBM_CACHE_DIR" in os.environ:
        return Path(os.environ["HBM_CACHE_DIR"])
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return base / "hbm-residuals"


def compiled_library(name: str, command: list[str], tell: Callable[[str], None]) -> Path | None:
    """Give the compiled kernels, building them if the cache holds no sound copy.

    Parameters
    ----------
    name, command
        The compiler.
    tell
        Told, in a sentence, when something takes long or goes wrong.

    Returns
    -------
    Path | None
        The library; None if this compiler cannot make it.
    """
    try:
        entry = Path(f"skeleton-{_key(command)}")
        file = entry / f"skeleton{'.dll' if sys.platform == 'win32' else '.so'}"
        if _sound(cache_directory() / file):
            return cache_directory() / file
        folder = _writable(cache_directory(), tell)
        if (folder / entry).exists():
            tell("a compiled kernel in the cache is damaged: building it again")
            shutil.rmtree(folder / entry, ignore_errors=True)
        tell(f"compiling the kernels with {name} (once on this machine, about ten seconds)")
        _build(command, folder / file)
    except (OSError, subprocess.SubprocessError) as error:
        said = str(error)
        if isinstance(error, subprocess.CalledProcessError) and error.stderr:
            said = error.stderr
        reason = (said.splitlines() or [type(error).__name__])[0]
        tell(f"compiling with {name} failed ({reason}); trying the next way")
        return None
    return folder / file


def _writable(folder: Path, tell: Callable[[str], None]) -> Path:
    """Give the cache folder, or one for this process alone where it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        passing = Path(tempfile.mkdtemp(prefix="hbm-residuals-"))
        atexit.register(shutil.rmtree, passing, ignore_errors=True)
        tell(
            f"the cache folder cannot be written ({error}): the kernels are compiled for this "
            "session only; set HBM_CACHE_DIR to a folder that can"
        )
        return passing
    return folder


def _build(command: list[str], library: Path) -> None:
    """Compile beside the final place, then move there; whoever comes first wins."""
    entry = library.parent
    with tempfile.TemporaryDirectory(dir=entry.parent) as temporary:
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
        _checksum(built).write_text(_sha256(built))
        try:
            built.parent.replace(entry)
        except OSError:
            if not _sound(library):
                raise


def _sound(library: Path) -> bool:
    """Whether a library is there, can be read and is whole."""
    try:
        return _checksum(library).read_text("ascii", "replace") == _sha256(library)
    except OSError:
        return False


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
    this = sys.modules[__name__]
    sources = [inspect.getsource(module) for module in (coordinates, skeleton, this)]
    sources += [
        files("hbm.kernels").joinpath(name).read_text("utf-8") for name in ("simd.h", "descent.c")
    ]
    facts = [*sources, ca.CasadiMeta.version(), version, _processor(), *FLAGS, *command]
    return hashlib.sha256("\0".join(facts).encode()).hexdigest()[:24]


def _processor() -> str:
    """Describe the processor as far as compiled code depends on it."""
    info = Path("/proc/cpuinfo")
    flags = ""
    if info.is_file():
        lines = info.read_text(errors="replace").splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return f"{sys.platform} {platform.machine()} {platform.processor()} {flags}"
