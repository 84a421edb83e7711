"""Kernels made ready to run: compiled once and cached, or on casadi's virtual machine.

In order: a library from the user's cache; the system's C compiler; the ``ziglang`` package (extra
``compiler``), which brings one; else casadi's virtual machine, some twenty times slower but equal.
Cached libraries are keyed by the kernels' source, the compiler and the processor, carry a checksum,
and are written under a temporary name, so several processes may build at once.

The environment variable ``HBM_KERNELS`` set to ``virtual-machine`` skips compilation;
``HBM_CACHE_DIR`` moves the cache.
"""

import ctypes
import hashlib
import inspect
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np

from hbm import coordinates, skeleton
from hbm.spatial import Array

BLOCK: Final = 64
SHARED_INPUTS: Final = {"newton_step": (6,), "segment_poses": (1,), "newton_euler": (3, 4)}
FLAGS: Final = ("-O2", "-fPIC", "-shared", "-march=native", "-ffp-contract=off")


@dataclass(frozen=True, slots=True)
class Kernel:
    """A function of the skeleton, evaluated for many frames at once.

    Attributes
    ----------
    run
        Evaluates `BLOCK` frames: pointers to inputs, pointers to outputs.
    sizes_in, sizes_out
        Numbers per frame of each input and output.
    shared
        Inputs that are the same for all frames.
    """

    run: Callable[[list[int], list[int]], None]
    sizes_in: tuple[int, ...]
    sizes_out: tuple[int, ...]
    shared: tuple[int, ...]

    def __call__(self, *inputs: Array, jobs: int = 1) -> tuple[Array, ...]:
        """Evaluate frames.

        Parameters
        ----------
        *inputs
            (T, n) per frame, or (n,) where shared by all frames.
        jobs
            Threads to spread the frames over; the result does not depend on it.

        Returns
        -------
        tuple[Array, ...]
            Outputs, (T, n) each.
        """
        given = [np.ascontiguousarray(x, float) for x in inputs]
        frames = next(len(x) for i, x in enumerate(given) if i not in self.shared)
        for i, (x, n) in enumerate(zip(given, self.sizes_in, strict=True)):
            expected = (n,) if i in self.shared else (frames, n)
            if x.shape != expected:
                raise ValueError(f"input {i} must have shape {expected}, got {x.shape}")
        out = [np.empty((frames, n)) for n in self.sizes_out]

        def block(start: int) -> None:
            count = min(BLOCK, frames - start)
            args, results = given, out
            if count < BLOCK:
                args = [
                    x if i in self.shared else np.resize(x[start:], (BLOCK, x.shape[1]))
                    for i, x in enumerate(given)
                ]
                results = [np.empty((BLOCK, n)) for n in self.sizes_out]
            at = start if count == BLOCK else 0
            self.run(
                [
                    x.ctypes.data + (0 if i in self.shared else at * x.strides[0])
                    for i, x in enumerate(args)
                ],
                [x.ctypes.data + at * x.strides[0] for x in results],
            )
            if count < BLOCK:
                for whole, part in zip(out, results, strict=True):
                    whole[start:] = part[:count]

        starts = range(0, frames, BLOCK)
        if jobs > 1 and len(starts) > 1:
            with ThreadPoolExecutor(jobs) as pool:
                list(pool.map(block, starts))
        else:
            for start in starts:
                block(start)
        return tuple(out)


@dataclass(frozen=True, slots=True)
class Kernels:
    """The three kernels and how they run: ``backend`` names the compiler or the machine."""

    newton_step: Kernel
    segment_poses: Kernel
    newton_euler: Kernel
    backend: str


@cache
def kernels(announce: Callable[[str], None] | None = None) -> Kernels:
    """Make the kernels ready; the first time on a machine this compiles for some seconds.

    Parameters
    ----------
    announce
        Told, in a sentence, when something takes long or could be faster.

    Returns
    -------
    Kernels
        The same numbers to 1e-9 whatever the backend.
    """
    tell = announce or (lambda _: None)
    if os.environ.get("HBM_KERNELS", "") == "virtual-machine":
        return _virtual_machine("virtual machine (HBM_KERNELS)")
    for name, command in _compilers():
        try:
            library = _library(name, command, tell)
            return _compiled(library, name)
        except (OSError, subprocess.SubprocessError) as error:
            tell(f"compiling with {name} failed ({_first_line(error)}); trying the next way")
    tell(
        "no C compiler found: using the slower virtual machine (same results). "
        "pip install 'hbm-residuals[compiler]' brings a compiler"
    )
    return _virtual_machine("virtual machine (no compiler)")


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


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _compilers() -> list[tuple[str, list[str]]]:
    found = [os.environ["CC"]] if shutil.which(os.environ.get("CC", "")) else []
    found += [name for name in ("cc", "gcc", "clang") if shutil.which(name)]
    ways = [(name, [name]) for name in found[:1]]
    if find_spec("ziglang"):
        ways.append(("ziglang", [sys.executable, "-m", "ziglang", "cc"]))
    return ways


def _processor() -> str:
    """Describe the processor as far as compiled code depends on it."""
    info = Path("/proc/cpuinfo")
    flags = ""
    if info.is_file():
        lines = info.read_text(errors="replace").splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return f"{sys.platform} {platform.machine()} {platform.processor()} {flags}"


def _key(command: list[str]) -> str:
    version = subprocess.run(
        [*command, "--version"], capture_output=True, text=True, check=True, timeout=60
    ).stdout
    sources = [inspect.getsource(module) for module in (coordinates, skeleton)]
    facts = [*sources, ca.CasadiMeta.version(), version, _processor(), str(BLOCK), *FLAGS, *command]
    return hashlib.sha256("\0".join(facts).encode()).hexdigest()[:24]


def _library(name: str, command: list[str], tell: Callable[[str], None]) -> Path:
    """Give the compiled library, building it if the cache holds no sound copy."""
    folder = cache_directory()
    folder.mkdir(parents=True, exist_ok=True)
    library = folder / f"skeleton-{_key(command)}{'.dll' if sys.platform == 'win32' else '.so'}"
    checksum = library.with_suffix(".sha256")
    if library.is_file() and checksum.is_file():
        if checksum.read_text() == _sha256(library):
            return library
        tell("a compiled kernel in the cache is damaged: building it again")
    tell(f"compiling the kernels with {name} (once on this machine, about ten seconds)")
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        source = _write_source(Path(temporary))
        built = Path(temporary) / library.name
        subprocess.run(
            [*command, *FLAGS, str(source), "-o", str(built), *_libm()],
            check=True,
            capture_output=True,
            timeout=600,
        )
        digest = Path(temporary) / checksum.name
        digest.write_text(_sha256(built))
        built.replace(library)
        digest.replace(checksum)
    return library


def _libm() -> list[str]:
    return [] if sys.platform == "win32" else ["-lm"]


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _mapped(name: str) -> Any:
    """Give a kernel over one block of frames, as casadi evaluates or prints it."""
    function = getattr(skeleton, name)()
    symbols = [ca.SX.sym("x", function.size1_in(i)) for i in range(function.n_in())]
    outputs = [ca.densify(x) for x in ca.cse(function.call(symbols))]
    compact = ca.Function(name, symbols, outputs)
    return compact.map(f"{name}_block", "serial", BLOCK, list(SHARED_INPUTS[name]), [])


def _write_source(folder: Path) -> Path:
    generator = ca.CodeGenerator("skeleton.c")
    for name in SHARED_INPUTS:
        generator.add(_mapped(name))
    generator.generate(f"{folder}{os.sep}")
    return folder / "skeleton.c"


def _sizes(name: str) -> tuple[tuple[int, ...], tuple[int, ...]]:
    n_q, geometry = skeleton.N_Q, skeleton.N_GEOMETRY
    sums = skeleton.N_SUMS * len(coordinates.SEGMENTS)
    inertia = skeleton.N_INERTIA * len(coordinates.MOVING)
    return {
        "newton_step": ((n_q, sums, n_q, n_q, 1, 1, geometry), (n_q, n_q + 2)),
        "segment_poses": ((n_q, geometry), (12 * len(coordinates.SEGMENTS),)),
        "newton_euler": ((n_q, n_q, n_q, geometry, inertia), (n_q, 6, 6 * n_q)),
    }[name]


def _compiled(library: Path, backend: str) -> Kernels:
    code = ctypes.CDLL(str(library))
    ready = {}
    for name, shared in SHARED_INPUTS.items():
        evaluate = getattr(code, f"{name}_block")
        work = [ctypes.c_longlong() for _ in range(4)]
        getattr(code, f"{name}_block_work")(*(ctypes.byref(w) for w in work))
        n_arg, n_res, n_iw, n_w = (w.value for w in work)

        def run(
            inputs: list[int],
            outputs: list[int],
            evaluate: Any = evaluate,
            size: tuple[int, int, int, int] = (n_arg, n_res, n_iw, n_w),
        ) -> None:
            arg = (ctypes.c_void_p * size[0])(*inputs)
            res = (ctypes.c_void_p * size[1])(*outputs)
            integers = (ctypes.c_longlong * (size[2] + 1))()
            reals = (ctypes.c_double * (size[3] + 1))()
            evaluate(arg, res, integers, reals, 0)

        sizes_in, sizes_out = _sizes(name)
        ready[name] = Kernel(run, sizes_in, sizes_out, shared)
    return Kernels(**ready, backend=backend)


def _virtual_machine(backend: str) -> Kernels:
    ready = {}
    for name, shared in SHARED_INPUTS.items():
        sizes_in, sizes_out = _sizes(name)
        buffer, trigger = _mapped(name).buffer()
        counts_in = [n * (1 if i in shared else BLOCK) for i, n in enumerate(sizes_in)]
        counts_out = [n * BLOCK for n in sizes_out]

        def run(
            inputs: list[int],
            outputs: list[int],
            buffer: Any = buffer,
            trigger: Any = trigger,
            counts: tuple[list[int], list[int]] = (counts_in, counts_out),
        ) -> None:
            views = [_view(p, n) for p, n in zip(inputs, counts[0], strict=True)]
            results = [_view(p, n) for p, n in zip(outputs, counts[1], strict=True)]
            for i, view in enumerate(views):
                buffer.set_arg(i, view)
            for i, view in enumerate(results):
                buffer.set_res(i, view)
            trigger()

        ready[name] = Kernel(run, sizes_in, sizes_out, shared)
    return Kernels(**ready, backend=backend)


def _view(pointer: int, count: int) -> Any:
    return memoryview((ctypes.c_double * count).from_address(pointer)).cast("B").cast("d")
