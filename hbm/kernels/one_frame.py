"""A kernel for one frame after another, in arrays that stay."""

import numpy as np

from hbm.kernels.kernel import Kernel
from hbm.spatial import Array


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
        for own, given in zip(self._inputs, inputs, strict=True):
            own[:] = given
        self._evaluate(1, self._from, self._to)
        return self._outputs
