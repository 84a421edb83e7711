"""Kernels: functions of the skeleton, evaluated for many frames at once."""

from collections.abc import Callable, Container
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.coordinates import MOVING, N_Q, RIGID_BODIES, SUBJECT_AXES, SUBJECT_OFFSETS
from hbm.spatial import Array

CONSTANT_INPUTS: Final = {"newton_step": (6,), "segment_poses": (1,), "newton_euler": (3, 4)}
"""Kernel -> numbers of the inputs that are the same for all frames: the body's."""

N_GEOMETRY: Final = 3 * (len(SUBJECT_OFFSETS) + len(SUBJECT_AXES))
"""The offsets and axes that are the subject's own, in this order, 3 numbers each."""

N_SUMS: Final = 23
"""Per segment, summed over its markers: w, w p (3), w p pᵀ (xx yy zz xy xz yz), w m (3), w m pᵀ
(9), w mᵀm, where w is the weight, p the position in the segment and m the measured position."""

N_INERTIA: Final = 10
"""Per segment: mass, centre of mass (3), moment of inertia about it (xx yy zz xy xz yz)."""

MIN_FRAMES_PER_THREAD: Final = 64
"""Fewer frames take less time than starting a thread."""

Pointers = list[int]
"""Addresses; that of an output that is not asked for is 0."""


@dataclass(frozen=True, slots=True)
class Kernel:
    """A function of the skeleton, evaluated for many frames at once.

    Attributes
    ----------
    evaluate
        Evaluates a number of frames, given pointers to inputs and to outputs.
    sizes_in, sizes_out
        Numbers per frame of each input and output.
    constant_inputs
        Numbers of the inputs that are the same for all frames.
    """

    evaluate: Callable[[int, Pointers, Pointers], None]
    sizes_in: tuple[int, ...]
    sizes_out: tuple[int, ...]
    constant_inputs: tuple[int, ...]

    def __call__(
        self, *inputs: Array, jobs: int = 1, asked: Container[int] = ()
    ) -> tuple[Array, ...]:
        """Evaluate frames.

        Parameters
        ----------
        *inputs
            (T, n) per frame, or (n,) where the same for all frames.
        jobs
            Threads to spread the frames over; the result does not depend on it.
        asked
            Numbers of the outputs that are asked for; by default all are.

        Returns
        -------
        tuple[Array, ...]
            Outputs, (T, n) each, and (0, n) where not asked for.
        """
        arrays = [np.ascontiguousarray(x, float) for x in inputs]
        frames = next(len(x) for i, x in enumerate(arrays) if i not in self.constant_inputs)
        for i, (x, n) in enumerate(zip(arrays, self.sizes_in, strict=True)):
            expected = (n,) if i in self.constant_inputs else (frames, n)
            if x.shape != expected:
                raise ValueError(f"input {i} must have shape {expected}, got {x.shape}")
        every = enumerate(self.sizes_out)
        outputs = tuple(np.empty((frames * (not asked or i in asked), n)) for i, n in every)

        def evaluate_block(start: int, stop: int) -> None:
            offsets = [
                0 if i in self.constant_inputs else start * x.strides[0]
                for i, x in enumerate(arrays)
            ]
            self.evaluate(
                stop - start,
                [x.ctypes.data + offset for x, offset in zip(arrays, offsets, strict=True)],
                [x.ctypes.data + start * x.strides[0] if len(x) else 0 for x in outputs],
            )

        in_threads(evaluate_block, frames, jobs)
        return outputs


class OneFrameKernel:
    """Evaluates a kernel for a single frame in a fraction of the time that `Kernel` needs for one.

    Parameters
    ----------
    kernel
        The kernel.
    *constants
        Its last inputs, which are the same for all frames, (n,) each.

    Examples
    --------
    With ``body``:

    >>> from hbm.kernels.native import kernels
    >>> poses = OneFrameKernel(kernels().segment_poses, body.geometry)
    >>> (found,) = poses(np.zeros(46))
    >>> found.shape
    (228,)
    """

    def __init__(self, kernel: Kernel, *constants: Array) -> None:
        self._evaluate = kernel.evaluate
        given = kernel.sizes_in[: len(kernel.sizes_in) - len(constants)]
        self._inputs = [np.empty(n) for n in given]
        self._constants = [np.ascontiguousarray(x, float) for x in constants]
        self._outputs = tuple(np.empty(n) for n in kernel.sizes_out)
        self._from = [x.ctypes.data for x in (*self._inputs, *self._constants)]
        self._to = [x.ctypes.data for x in self._outputs]

    def __call__(self, *inputs: Array) -> tuple[Array, ...]:
        """Evaluate a frame.

        Parameters
        ----------
        *inputs
            (n,) each.

        Returns
        -------
        tuple of Array
            Outputs, (n,) each; the next call overwrites them.
        """
        for buffer, given in zip(self._inputs, inputs, strict=True):
            buffer[:] = given
        self._evaluate(1, self._from, self._to)
        return self._outputs


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
        Newton's method for many frames in one call (``descent.c``); None on the virtual machine,
        where `hbm.ik.descent` does the same.
    """

    newton_step: Kernel
    segment_poses: Kernel
    newton_euler: Kernel
    backend: str
    solve_frames: Callable[..., None] | None = None


def in_threads(work: Callable[[int, int], None], frames: int, jobs: int) -> None:
    """Split frames into equal blocks, one per thread, and do ``work(start, stop)`` on each."""
    blocks = max(1, min(jobs, frames // MIN_FRAMES_PER_THREAD))
    borders = [frames * k // blocks for k in range(blocks + 1)]
    if blocks == 1:
        work(0, frames)
    else:
        with ThreadPoolExecutor(blocks) as pool:
            list(pool.map(work, borders[:-1], borders[1:]))


def kernel_sizes(name: str) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Give the numbers per frame that go into a kernel, input by input, and come out."""
    n_q, geometry = N_Q, N_GEOMETRY
    sums = N_SUMS * len(MOVING)
    inertia = N_INERTIA * len(RIGID_BODIES)
    return {
        "newton_step": ((n_q, sums, n_q, n_q, 1, 1, geometry), (n_q, n_q + 3)),
        "segment_poses": ((n_q, geometry), (12 * len(MOVING),)),
        "newton_euler": ((n_q, n_q, n_q, geometry, inertia), (n_q, 6, 6 * n_q)),
    }[name]
