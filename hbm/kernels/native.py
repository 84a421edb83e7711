"""Kernels made ready to run: libraries compiled with the package, or casadi's virtual machine.

The C is the same on every machine. It is compiled when the package is installed (``setup.py``),
once for each width of vectors; the widest that the processor has is used. Without these libraries
casadi's virtual machine gives equal numbers, some forty times slower. The environment variable
``HBM_KERNELS`` set to ``virtual-machine`` asks for it.
"""

import ctypes
import hashlib
import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any, Final

import numpy as np

from hbm.kernels.kernel import CONSTANT_INPUTS, Kernel, Kernels, Pointers, kernel_sizes
from hbm.spatial import Array

FOLDER: Final = Path(__file__).parent
SUFFIX: Final = ".dll" if sys.platform == "win32" else ".so"
WIDTHS: Final = (8, 4, 2)
"""Numbers per vector, widest first: AVX-512, AVX2, and what every processor has."""
SOURCES: Final = (
    "../coordinates.py",
    "skeleton.py",
    "kernel.py",
    "build.py",
    "simd.h",
    "descent.c",
)
"""What the libraries are made from."""

ONE_FRAME: Final = 4
"""Numbers per vector for a single frame, whose other places are computed in vain: measured."""

_READY: dict[int, Kernels] = {}
_LOCK = Lock()


class LibraryError(Exception):
    """A compiled library is missing, cannot be loaded, or was made from other sources."""


def kernels(announce: Callable[[str], None] | None = None, lanes: int = WIDTHS[0]) -> Kernels:
    """Make the kernels ready.

    Parameters
    ----------
    announce
        Called with a sentence where the slower virtual machine has to be used.
    lanes
        Numbers per vector at most; the results do not depend on it.

    Returns
    -------
    Kernels
        The same numbers to 1e-9 whatever the backend.
    """
    with _LOCK:
        if lanes not in _READY:
            _READY[lanes] = load(announce or (lambda _: None), lanes=lanes)
        return _READY[lanes]


def load(announce: Callable[[str], None], folder: Path = FOLDER, lanes: int = WIDTHS[0]) -> Kernels:
    """Load the widest library that the processor can run, else use the virtual machine."""
    if os.environ.get("HBM_KERNELS", "") == "virtual-machine":
        return interpreted_kernels("virtual machine (HBM_KERNELS)")
    try:
        # the narrowest library runs anywhere and says what the processor has
        widest = min(lanes_of_processor(library_path(min(WIDTHS), folder)), lanes)
        there = [w for w in WIDTHS if w <= widest and library_path(w, folder).is_file()]
        return compiled_kernels(library_path(there[0], folder))
    except LibraryError as error:
        announce(
            f"{error}: using the slower virtual machine (same results). "
            "Install a C compiler (gcc or clang), then the package again"
        )
        return interpreted_kernels(f"virtual machine ({error})")


def library_path(lanes: int, folder: Path = FOLDER) -> Path:
    """Give the library that evaluates so many frames at once."""
    return folder / f"compiled_{lanes}{SUFFIX}"


def sources_digest() -> str:
    """Give the SHA-256 of what libraries are made from."""
    return hashlib.sha256(b"\0".join((FOLDER / name).read_bytes() for name in SOURCES)).hexdigest()


def open_library(library: Path) -> ctypes.CDLL:
    """Open a library that was made from the sources as they are."""
    if not library.is_file():
        raise LibraryError("no compiled kernels")
    try:
        code = ctypes.CDLL(str(library))
        made_from = (ctypes.c_char * 64).in_dll(code, "sources_digest").raw.decode()
    except (OSError, ValueError) as error:
        raise LibraryError(f"compiled kernels cannot be loaded, {error}") from error
    # numbers of another version of the tree or of a kernel would be plausible and wrong
    if made_from != sources_digest():
        raise LibraryError("compiled kernels of another version")
    return code


def lanes_of_processor(library: Path) -> int:
    """Give the numbers per vector of this processor, as a library says."""
    return int(open_library(library).lanes_of_processor())


def compiled_kernels(library: Path) -> Kernels:
    """Give the kernels of a compiled library."""
    code = open_library(library)

    def evaluate(loop: Any, frames: int, inputs: Pointers, outputs: Pointers) -> None:
        # releases the interpreter, so that threads evaluate blocks at once
        loop(
            ctypes.c_longlong(frames),
            (ctypes.c_void_p * len(inputs))(*inputs),
            (ctypes.c_void_p * len(outputs))(*outputs),
        )

    step, poses, dynamics = (
        Kernel(partial(evaluate, code[f"{name}_frames"]), *kernel_sizes(name), constant)
        for name, constant in CONSTANT_INPUTS.items()
    )
    return Kernels(
        step, poses, dynamics, f"compiled, {code.lanes()} frames at once", code.solve_frames
    )


def interpreted_kernels(backend: str) -> Kernels:
    """Give kernels that casadi evaluates instruction by instruction, one frame at a time."""
    step, poses, dynamics = (_interpreted(name) for name in CONSTANT_INPUTS)
    return Kernels(step, poses, dynamics, backend)


def _interpreted(name: str) -> Kernel:
    from hbm.kernels.skeleton import casadi_function  # casadi, which compiled kernels do without

    (sizes_in, sizes_out), constant = kernel_sizes(name), CONSTANT_INPUTS[name]
    buffer, evaluate_buffer = casadi_function(name).buffer()
    arguments, results = [np.zeros(n) for n in sizes_in], [np.zeros(n) for n in sizes_out]
    for i, x in enumerate(arguments):
        buffer.set_arg(i, x.data)
    for i, x in enumerate(results):
        buffer.set_res(i, x.data)
    buffer_in_use = Lock()

    # casadi does not keep the buffer alive while evaluate_buffer exists: the default argument does
    def evaluate(frames: int, inputs: Pointers, outputs: Pointers, keep: Any = buffer) -> None:
        counts = [1 if i in constant else frames for i in range(len(inputs))]
        rows = [_view(p, c, n) for p, c, n in zip(inputs, counts, sizes_in, strict=True)]
        sizes = zip(outputs, sizes_out, results, strict=True)
        asked = [(_view(p, frames, n), x) for p, n, x in sizes if p]
        with buffer_in_use:
            for t in range(frames):
                for x, row in zip(arguments, rows, strict=True):
                    x[:] = row[t % len(row)]
                evaluate_buffer()
                for view, x in asked:
                    view[t] = x

    return Kernel(evaluate, sizes_in, sizes_out, constant)


def _view(pointer: int, frames: int, count: int) -> Array:
    """Give the numbers at an address as an array."""
    numbers = (ctypes.c_double * (frames * count)).from_address(pointer)
    return np.ctypeslib.as_array(numbers).reshape(frames, count)
