"""Kernels on casadi's virtual machine: no compiler needed, some forty times slower."""

import ctypes
from threading import Lock
from typing import Any

import numpy as np

from hbm.kernels.kernel import (
    CONSTANT_INPUTS,
    Kernel,
    Kernels,
    Pointers,
    casadi_function,
    kernel_sizes,
)
from hbm.spatial import Array


def interpreted_kernels(backend: str) -> Kernels:
    """Give kernels that casadi evaluates instruction by instruction, one frame at a time."""
    step, poses, dynamics = (_interpreted(name) for name in CONSTANT_INPUTS)
    return Kernels(step, poses, dynamics, backend)


def _interpreted(name: str) -> Kernel:
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
        views = [_view(p, frames, n) for p, n in zip(outputs, sizes_out, strict=True)]
        with buffer_in_use:
            for t in range(frames):
                for x, row in zip(arguments, rows, strict=True):
                    x[:] = row[t % len(row)]
                evaluate_buffer()
                for view, x in zip(views, results, strict=True):
                    view[t] = x

    return Kernel(evaluate, sizes_in, sizes_out, constant)


def _view(pointer: int, frames: int, count: int) -> Array:
    """Give the numbers at an address as an array."""
    numbers = (ctypes.c_double * (frames * count)).from_address(pointer)
    return np.ctypeslib.as_array(numbers).reshape(frames, count)
