"""A kernel for one frame at a time gives what it gives for all frames at once."""

import numpy as np
import pytest

from hbm.kernels.library import random_inputs
from hbm.kernels.native import kernels
from hbm.kernels.one_frame import OneFrameKernel
from hbm.kernels.virtual_machine import interpreted_kernels


@pytest.mark.parametrize("ready", [kernels(), interpreted_kernels("")], ids=lambda k: k.backend)
@pytest.mark.parametrize(("name", "constants"), [("segment_poses", 1), ("newton_euler", 2)])
def test_one_frame_after_another_gives_what_all_at_once_give(ready, name, constants):
    kernel = getattr(ready, name)
    inputs = random_inputs(name, kernel, np.random.default_rng(2), frames=5)
    expected = kernel(*inputs)
    one = OneFrameKernel(kernel, *inputs[-constants:])
    for k in range(5):
        found = one(*(x[k] for x in inputs[:-constants]))
        for ours, whole in zip(found, expected, strict=True):
            np.testing.assert_allclose(ours, whole[k], rtol=1e-12, atol=1e-12)
