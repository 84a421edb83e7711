"""Compiled kernels and casadi's virtual machine give the same numbers, and replace each other."""

import re
import shutil
from functools import cache

import numpy as np
import pytest

from hbm.kernels.build import disagreement, random_inputs
from hbm.kernels.kernel import OneFrameKernel
from hbm.kernels.native import (
    WIDTHS,
    compiled_kernels,
    interpreted_kernels,
    kernels,
    lanes_of_processor,
    library_path,
    load,
)

NAMES = ("newton_step", "segment_poses", "newton_euler")
BUILT = [w for w in WIDTHS if library_path(w).is_file()]
needs_library = pytest.mark.skipif(
    not (BUILT and kernels().solve_frames), reason="the kernels are not compiled"
)


def runnable(lanes):
    if lanes > lanes_of_processor(library_path(BUILT[-1])):
        pytest.skip("the processor has no vectors of this width")
    return library_path(lanes)


@needs_library
@pytest.mark.parametrize("lanes", BUILT)
def test_compiled_kernels_agree_with_the_virtual_machine(lanes):
    assert disagreement(runnable(lanes)) == ""


@needs_library
@pytest.mark.parametrize("lanes", BUILT)
@pytest.mark.parametrize("name", NAMES)
def test_the_width_of_vectors_changes_no_bit(name, lanes):
    widest = getattr(kernels(), name)
    narrower = getattr(compiled_kernels(runnable(lanes)), name)
    inputs = random_inputs(name, widest, np.random.default_rng(40), frames=70)
    for one, other in zip(widest(*inputs), narrower(*inputs, jobs=2), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.fixture
def copied(tmp_path):
    for lanes in BUILT:
        shutil.copy(library_path(lanes), tmp_path)
    return tmp_path


@needs_library
def test_a_library_of_another_version_is_not_used(copied):
    for path in copied.iterdir():
        made_from = re.search(rb"[0-9a-f]{64}", path.read_bytes()).group()
        path.write_bytes(path.read_bytes().replace(made_from, b"0" * 64))
    ready = load(lambda _: None, copied)
    assert re.match("virtual machine .*another version", ready.backend)
    assert ready.solve_frames is None


def test_without_a_library_the_virtual_machine_is_used_with_a_hint(tmp_path):
    messages = []
    assert load(messages.append, tmp_path).backend.startswith("virtual machine (no ")
    assert "C compiler" in messages[0]


@pytest.mark.parametrize("jobs", [7])
@pytest.mark.parametrize("frames", [1, 63, 1000])
def test_kernels_do_not_depend_on_the_number_of_threads(frames, jobs):
    kernel = kernels().newton_euler
    inputs = random_inputs("newton_euler", kernel, np.random.default_rng(41), frames)
    for one, many in zip(kernel(*inputs), kernel(*inputs, jobs=jobs), strict=True):
        np.testing.assert_array_equal(one, many)


@cache
def virtual_machine():
    return interpreted_kernels("")


@pytest.mark.parametrize("ready", [kernels, virtual_machine])
def test_outputs_that_are_not_asked_for_are_empty_and_the_others_are_the_same(ready):
    kernel = ready().newton_euler
    inputs = random_inputs("newton_euler", kernel, np.random.default_rng(3), frames=9)
    tau, wrench, motion = kernel(*inputs, asked={1})
    assert len(tau) == len(motion) == 0
    np.testing.assert_array_equal(wrench, kernel(*inputs)[1])


@pytest.mark.parametrize("ready", [kernels, virtual_machine])
@pytest.mark.parametrize(("name", "constants"), [("segment_poses", 1), ("newton_euler", 2)])
def test_one_frame_after_another_gives_what_all_at_once_give(ready, name, constants):
    kernel = getattr(ready(), name)
    inputs = random_inputs(name, kernel, np.random.default_rng(2), frames=5)
    expected = kernel(*inputs)
    one = OneFrameKernel(kernel, *inputs[-constants:])
    for k in range(5):
        found = one(*(x[k] for x in inputs[:-constants]))
        for ours, whole in zip(found, expected, strict=True):
            np.testing.assert_allclose(ours, whole[k], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("revolutions", [0.5, 30.0, 1e5])
def test_sine_and_cosine_are_exact_to_the_last_digit(revolutions):
    """Yaw rotates the pelvis' x axis in the horizontal plane by cos and sin of the angle."""
    yaw = np.random.default_rng(44).uniform(-revolutions, revolutions, 400) * 2 * np.pi
    q = np.zeros((len(yaw), 46))
    q[:, 3] = yaw
    kernel = kernels().segment_poses
    pose = kernel(q, np.zeros(kernel.sizes_in[1]))[0]
    np.testing.assert_allclose(pose[:, 0], np.cos(yaw), rtol=0, atol=4e-16)
    np.testing.assert_allclose(pose[:, 1], np.sin(yaw), rtol=0, atol=4e-16)
