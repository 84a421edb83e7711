"""Compiled kernels: kept, checked, shared by processes, and done without."""

import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from hbm.kernels import compiler, native
from hbm.kernels.compiler import cache_directory, compiled_library, compilers
from hbm.kernels.native import kernels, load

NAMES = ("newton_step", "segment_poses", "newton_euler")
SMALL = "int answer(void) { return 42; }\n"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="this machine has no C compiler")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HBM_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def small(monkeypatch):
    """A library that compiles in a moment."""

    def write(folder):
        (folder / "skeleton.c").write_text(SMALL)
        return folder / "skeleton.c"

    monkeypatch.setattr(compiler, "write_source", write)


@pytest.fixture
def said():
    return []


def agree(name, ours, theirs):
    rng = np.random.default_rng(40)
    inputs = [
        rng.normal(size=n if i in ours.shared else (70, n)) for i, n in enumerate(ours.sizes_in)
    ]
    if name == "newton_step":
        inputs[4] += 1e4  # far from singular, or the numbers are rounding blown up
    for one, other in zip(ours(*inputs, jobs=2), theirs(*inputs, jobs=2), strict=True):
        scale = np.abs(other).max()
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * scale)


@needs_compiler
def test_a_library_is_compiled_once_and_says_so(cache, small, said):
    first = compiled_library("cc", [COMPILER], said.append)
    assert first.is_relative_to(cache)
    assert said == ["compiling the kernels with cc (once on this machine, about ten seconds)"]
    changed = first.stat().st_mtime_ns
    assert compiled_library("cc", [COMPILER], said.append) == first
    assert first.stat().st_mtime_ns == changed
    assert len(said) == 1
    assert [path.name for path in cache.iterdir()] == [first.parent.name]


@needs_compiler
@pytest.mark.parametrize("damage", ["library", "checksum", "missing"])
def test_a_damaged_library_is_built_again(cache, small, said, damage):
    library = compiled_library("cc", [COMPILER], said.append)
    sound = library.read_bytes()
    if damage == "library":
        library.write_bytes(sound[:-100])
    elif damage == "checksum":
        library.with_suffix(".sha256").write_text("0" * 64)
    else:
        library.unlink()
    assert compiled_library("cc", [COMPILER], said.append) == library
    assert "a compiled kernel in the cache is damaged: building it again" in said
    assert library.read_bytes()[:4] == sound[:4]
    assert library.stat().st_size == len(sound)


@needs_compiler
def test_a_cache_that_cannot_be_written_costs_a_compilation_and_a_hint(
    tmp_path, monkeypatch, small, said
):
    (tmp_path / "file").write_text("a file, no folder")
    monkeypatch.setenv("HBM_CACHE_DIR", str(tmp_path / "file"))
    library = compiled_library("cc", [COMPILER], said.append)
    assert library.is_file()
    assert not library.is_relative_to(tmp_path)
    assert said[0].startswith("the cache folder cannot be written (")
    assert said[0].endswith("set HBM_CACHE_DIR to a folder that can")


@needs_compiler
def test_a_sound_library_is_used_from_a_cache_that_cannot_be_written(
    cache, small, said, monkeypatch
):
    library = compiled_library("cc", [COMPILER], said.append)
    monkeypatch.setattr(compiler, "_writable", lambda *_: pytest.fail("tried to write"))
    assert compiled_library("cc", [COMPILER], said.append) == library


def test_a_compiler_that_fails_is_passed_over_with_its_first_words(cache, small, said):
    broken = [sys.executable, "-c", "import sys; sys.exit('no such target')"]
    assert compiled_library("mine", broken, said.append) is None
    assert said[-1] == "compiling with mine failed (no such target); trying the next way"


@needs_compiler
def test_processes_that_start_at_once_share_one_library(cache):
    program = (
        "import sys; from hbm.kernels import compiler\n"
        "def write(folder):\n"
        f"    (folder / 'skeleton.c').write_text({SMALL!r}); return folder / 'skeleton.c'\n"
        "compiler.write_source = write\n"
        f"print(compiler.compiled_library('cc', [{COMPILER!r}], lambda _: None))"
    )
    processes = [
        subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    answers = {process.communicate(timeout=120)[0].strip() for process in processes}
    assert [process.returncode for process in processes] == [0] * 4
    (answer,) = answers
    assert [path.name for path in cache.iterdir()] == [Path(answer).parent.name]


def test_without_a_compiler_the_virtual_machine_steps_in_with_a_hint(monkeypatch, said):
    monkeypatch.setattr(native, "compilers", list)
    assert load(said.append).backend == "virtual machine (no compiler)"
    assert said == [
        "no C compiler works: using the slower virtual machine (same results). "
        "pip install 'hbm-residuals[compiler]' brings a compiler"
    ]


def test_the_virtual_machine_can_be_asked_for(monkeypatch, said):
    monkeypatch.setenv("HBM_KERNELS", "virtual-machine")
    assert load(said.append).backend == "virtual machine (HBM_KERNELS)"
    assert said == []


@needs_compiler
def test_where_there_is_a_compiler_the_kernels_are_compiled(said):
    ready = load(said.append)
    assert ready.solve_frames is not None, (ready.backend, said)


@needs_compiler
@pytest.mark.parametrize("name", NAMES)
def test_the_virtual_machine_and_the_compiled_kernels_give_the_same_numbers(name, monkeypatch):
    compiled = getattr(kernels(), name)
    monkeypatch.setenv("HBM_KERNELS", "virtual-machine")
    interpreted = getattr(load(lambda _: None), name)
    agree(name, compiled, interpreted)


@needs_compiler
@pytest.mark.parametrize("jobs", [2, 7])
@pytest.mark.parametrize("frames", [1, 63, 64, 1000])
def test_kernels_do_not_show_how_the_work_was_cut(frames, jobs):
    kernel = kernels().newton_euler
    rng = np.random.default_rng(41)
    inputs = [
        rng.normal(size=n if i in kernel.shared else (frames, n))
        for i, n in enumerate(kernel.sizes_in)
    ]
    for one, many in zip(kernel(*inputs), kernel(*inputs, jobs=jobs), strict=True):
        np.testing.assert_array_equal(one, many)


def test_a_kernel_refuses_input_of_the_wrong_shape():
    kernel = kernels().segment_poses
    with pytest.raises(ValueError, match=r"input 0 must have shape \(3, 46\), got \(3, 45\)"):
        kernel(np.zeros((3, 45)), np.zeros(kernel.sizes_in[1]))


@pytest.mark.skipif(find_spec("ziglang") is None, reason="the extra 'compiler' is not installed")
def test_the_compiler_that_pip_brings_compiles_and_runs_the_kernels(cache, monkeypatch, said):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    assert [name for name, _ in compilers()] == ["ziglang"]
    brought = load(said.append)
    assert brought.backend == "ziglang"
    assert brought.solve_frames is not None
    for name in NAMES:
        agree(name, getattr(brought, name), getattr(kernels(), name))


@pytest.mark.parametrize(
    ("platform", "variable", "tail"),
    [("win32", "LOCALAPPDATA", "hbm-residuals"), ("linux", "XDG_CACHE_HOME", "hbm-residuals")],
)
def test_the_cache_is_the_user_s_own(monkeypatch, tmp_path, platform, variable, tail):
    monkeypatch.delenv("HBM_CACHE_DIR", raising=False)
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setenv(variable, str(tmp_path))
    assert cache_directory() == tmp_path / tail


@needs_compiler
@pytest.mark.parametrize("turns", [0.5, 30.0, 1e5])
def test_sines_of_lanes_are_those_of_the_library(turns):
    """The yaw of the pelvis turns the x axis in the plane, once per two π, exactly."""
    yaw = np.random.default_rng(44).uniform(-turns, turns, 400) * 2 * np.pi
    q = np.zeros((len(yaw), 46))
    q[:, 3] = yaw
    kernel = kernels().segment_poses
    pose = kernel(q, np.zeros(kernel.sizes_in[1]))[0]
    np.testing.assert_allclose(pose[:, 0], np.cos(yaw), rtol=0, atol=4e-16)
    np.testing.assert_allclose(pose[:, 1], np.sin(yaw), rtol=0, atol=4e-16)


def test_a_cache_that_cannot_be_read_is_no_cache(tmp_path, monkeypatch):
    library = tmp_path / "skeleton.so"
    library.write_bytes(b"library")
    compiler._checksum(library).write_text(compiler._sha256(library))
    assert compiler._sound(library)

    def refused(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(library), "read_bytes", refused)
    assert not compiler._sound(library)
