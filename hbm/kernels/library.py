"""Compiled kernels, and whether they agree with casadi's virtual machine."""

import ctypes
from pathlib import Path
from typing import Any, Final

import numpy as np

from hbm.kernels.kernel import CONSTANT_INPUTS, Kernel, Kernels, Pointers, kernel_sizes
from hbm.kernels.virtual_machine import interpreted_kernels
from hbm.spatial import Array

MAX_DIFFERENCE: Final = 1e-9
"""Largest difference of compiled and interpreted kernels, as a share of a kernel's largest output:
far above rounding (1e-13), far below what a wrong operation would cause."""

FUNCTIONS: Final = (*(f"{name}_frames" for name in CONSTANT_INPUTS), "solve_frames")
"""What a library has to offer."""

TEST_FRAMES: Final = 35
"""Random poses that are compared: several full blocks of SIMD lanes and a part of one."""

TEST_DAMPING: Final = 1e4
"""Added to the Hessian of random marker sums: without it the matrix may be nearly singular, and its
solution mostly rounding."""


def load_library(library: Path, backend: str) -> Kernels:
    """Give the kernels of a compiled library.

    Parameters
    ----------
    library
        As `hbm.kernels.compiler` builds it.
    backend
        What to call it.

    Returns
    -------
    Kernels
        Ready to run.

    Raises
    ------
    OSError
        If the library cannot be loaded, or lacks a kernel.
    """
    code = ctypes.CDLL(str(library))
    missing = [name for name in FUNCTIONS if not hasattr(code, name)]
    if missing:
        raise OSError(f"it lacks {', '.join(missing)}")
    kernels: dict[str, Any] = {}
    for name, constant in CONSTANT_INPUTS.items():
        loop = getattr(code, f"{name}_frames")

        def evaluate(frames: int, inputs: Pointers, outputs: Pointers, loop: Any = loop) -> None:
            loop(
                ctypes.c_longlong(frames),
                (ctypes.c_void_p * len(inputs))(*inputs),
                (ctypes.c_void_p * len(outputs))(*outputs),
            )

        kernels[name] = Kernel(evaluate, *kernel_sizes(name), constant)
    return Kernels(backend=backend, solve_frames=code.solve_frames, **kernels)


def disagreement(library: Path) -> str:
    """Compare a compiled library with the virtual machine on random poses.

    Parameters
    ----------
    library
        As `hbm.kernels.compiler` builds it.

    Returns
    -------
    str
        Which kernel differs by how much; empty where all agree.

    Raises
    ------
    OSError
        If the library cannot be loaded.
    """
    compiled, interpreted = load_library(library, ""), interpreted_kernels("")
    random = np.random.default_rng(0)
    for name in CONSTANT_INPUTS:
        kernel: Kernel = getattr(interpreted, name)
        inputs = random_inputs(name, kernel, random)
        pairs = zip(getattr(compiled, name)(*inputs), kernel(*inputs), strict=True)
        worst = max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)
        if not worst <= MAX_DIFFERENCE:
            return f"{name} by {worst:.2g} of its largest number"
    return ""


def random_inputs(
    name: str, kernel: Kernel, random: np.random.Generator, frames: int = TEST_FRAMES
) -> list[Array]:
    """Give normally distributed inputs for a kernel, all of the order of 1."""
    inputs = [
        random.normal(size=n if i in kernel.constant_inputs else (frames, n))
        for i, n in enumerate(kernel.sizes_in)
    ]
    if name == "newton_step":
        damping = 4
        inputs[damping] += TEST_DAMPING
    return inputs
