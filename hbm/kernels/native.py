"""Kernels made ready to run: compiled once and cached, or on casadi's virtual machine.

In order: a library from the user's cache; the system's C compiler; the ``ziglang`` package (extra
``compiler``), which brings one (see `hbm.kernels.compiler`); else casadi's virtual machine, some
forty times slower but equal.

The environment variable ``HBM_KERNELS`` set to ``virtual-machine`` skips compilation;
``HBM_CACHE_DIR`` moves the cache.
"""

import ctypes
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Final

import numpy as np

from hbm.coordinates import MOVING, SEGMENTS
from hbm.kernels import skeleton
from hbm.kernels.compiler import (
    SHARED_INPUTS,
    cache_directory,
    compact,
    compiled_library,
    compilers,
)
from hbm.spatial import Array

__all__ = ["Kernel", "Kernels", "cache_directory", "kernels"]

LEAST_SHARE: Final = 64
Pointers = list[int]


@dataclass(frozen=True, slots=True)
class Kernel:
    """A function of the skeleton, evaluated for many frames at once.

    Attributes
    ----------
    run
        Evaluates a number of frames, given pointers to inputs and to outputs.
    sizes_in, sizes_out
        Numbers per frame of each input and output.
    shared
        Inputs that are the same for all frames.
    """

    run: Callable[[int, Pointers, Pointers], None]
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
        out = tuple(np.empty((frames, n)) for n in self.sizes_out)

        def stretch(start: int, stop: int) -> None:
            at = [0 if i in self.shared else start * x.strides[0] for i, x in enumerate(given)]
            self.run(
                stop - start,
                [x.ctypes.data + offset for x, offset in zip(given, at, strict=True)],
                [x.ctypes.data + start * x.strides[0] for x in out],
            )

        shares = max(1, min(jobs, frames // LEAST_SHARE))
        borders = [frames * k // shares for k in range(shares + 1)]
        if shares == 1:
            stretch(0, frames)
        else:
            with ThreadPoolExecutor(shares) as pool:
                list(pool.map(stretch, borders[:-1], borders[1:]))
        return out


@dataclass(frozen=True, slots=True)
class Kernels:
    """The three kernels and how they run.

    Attributes
    ----------
    newton_step, segment_poses, newton_euler
        As `hbm.kernels.skeleton` writes them.
    backend
        Names the compiler or the virtual machine.
    solve_frames
        Newton's method for a stretch of frames in one call (``descent.c``); None on the virtual
        machine, where `hbm.ik.descent` does the same.
    """

    newton_step: Kernel
    segment_poses: Kernel
    newton_euler: Kernel
    backend: str
    solve_frames: Callable[..., None] | None = None


_READY: dict[str, Kernels] = {}
_LOCK = Lock()


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
    with _LOCK:
        if not _READY:
            _READY["kernels"] = load(announce or (lambda _: None))
        return _READY["kernels"]


def load(tell: Callable[[str], None]) -> Kernels:
    """Try all ways to run the kernels, the fastest first."""
    if os.environ.get("HBM_KERNELS", "") == "virtual-machine":
        return _virtual_machine("virtual machine (HBM_KERNELS)")
    for name, command in compilers():
        library = compiled_library(name, command, tell)
        if library is None:
            continue
        try:
            return _compiled(library, name)
        except OSError as error:
            tell(f"the library that {name} made cannot be loaded ({error}); trying the next way")
    tell(
        "no C compiler works: using the slower virtual machine (same results). "
        "pip install 'hbm-residuals[compiler]' brings a compiler"
    )
    return _virtual_machine("virtual machine (no compiler)")


def _sizes(name: str) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Numbers per frame that go in and out."""
    n_q, geometry = skeleton.N_Q, skeleton.N_GEOMETRY
    sums = skeleton.N_SUMS * len(SEGMENTS)
    inertia = skeleton.N_INERTIA * len(MOVING)
    return {
        "newton_step": ((n_q, sums, n_q, n_q, 1, 1, geometry), (n_q, n_q + 2)),
        "segment_poses": ((n_q, geometry), (12 * len(SEGMENTS),)),
        "newton_euler": ((n_q, n_q, n_q, geometry, inertia), (n_q, 6, 6 * n_q)),
    }[name]


def _compiled(library: Path, backend: str) -> Kernels:
    code = ctypes.CDLL(str(library))
    ready: dict[str, Any] = {}
    for name, shared in SHARED_INPUTS.items():
        evaluate = getattr(code, f"{name}_frames")

        def run(frames: int, inputs: Pointers, outputs: Pointers, evaluate: Any = evaluate) -> None:
            evaluate(
                ctypes.c_longlong(frames),
                (ctypes.c_void_p * len(inputs))(*inputs),
                (ctypes.c_void_p * len(outputs))(*outputs),
            )

        ready[name] = Kernel(run, *_sizes(name), shared)
    return Kernels(backend=backend, solve_frames=code.solve_frames, **ready)


def _virtual_machine(backend: str) -> Kernels:
    step, poses, dynamics = (_interpreted(name) for name in SHARED_INPUTS)
    return Kernels(step, poses, dynamics, backend)


def _interpreted(name: str) -> Kernel:
    """Give a kernel that casadi evaluates instruction by instruction, one frame at a time."""
    (sizes_in, sizes_out), shared = _sizes(name), SHARED_INPUTS[name]
    buffer, trigger = compact(name).buffer()
    given, found = [np.zeros(n) for n in sizes_in], [np.zeros(n) for n in sizes_out]
    for i, x in enumerate(given):
        buffer.set_arg(i, x.data)
    for i, x in enumerate(found):
        buffer.set_res(i, x.data)
    one_at_a_time = Lock()  # the trigger works on one buffer, and does not keep it alive

    def run(frames: int, inputs: Pointers, outputs: Pointers, alive: Any = buffer) -> None:
        counts = [1 if i in shared else frames for i in range(len(inputs))]
        rows = [_view(p, c, n) for p, c, n in zip(inputs, counts, sizes_in, strict=True)]
        results = [_view(p, frames, n) for p, n in zip(outputs, sizes_out, strict=True)]
        with one_at_a_time:
            for t in range(frames):
                for x, row in zip(given, rows, strict=True):
                    x[:] = row[t % len(row)]
                trigger()
                for result, x in zip(results, found, strict=True):
                    result[t] = x

    return Kernel(run, sizes_in, sizes_out, shared)


def _view(pointer: int, frames: int, count: int) -> Array:
    """Give the numbers at an address as an array."""
    numbers = (ctypes.c_double * (frames * count)).from_address(pointer)
    return np.ctypeslib.as_array(numbers).reshape(frames, count)
