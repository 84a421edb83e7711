"""Compiled kernels: cached, checked, shared by processes, and replaced by the virtual machine."""

import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import psutil
import pytest

from hbm.kernels import c_source, compiler, native
from hbm.kernels.cache import cache_directory
from hbm.kernels.compiler import compiled_library, compilers
from hbm.kernels.kernel import casadi_function, kernel_sizes
from hbm.kernels.library import random_inputs
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
    monkeypatch.setattr(compiler, "disagreement", lambda _: "")


@pytest.fixture
def messages():
    return []


def agree(name, ours, theirs):
    inputs = random_inputs(name, ours, np.random.default_rng(40), frames=70)
    for one, other in zip(ours(*inputs, jobs=2), theirs(*inputs, jobs=2), strict=True):
        scale = np.abs(other).max()
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * scale)


@needs_compiler
def test_a_library_is_compiled_once_with_an_announcement(cache, small, messages):
    first = compiled_library("cc", [COMPILER], messages.append)
    assert first.is_relative_to(cache)
    assert messages == ["compiling the kernels with cc (once on this machine, about ten seconds)"]
    changed = first.stat().st_mtime_ns
    assert compiled_library("cc", [COMPILER], messages.append) == first
    assert first.stat().st_mtime_ns == changed
    assert len(messages) == 1
    assert [path.name for path in cache.iterdir()] == [first.parent.name]


@needs_compiler
@pytest.mark.parametrize("damage", ["library", "checksum", "missing"])
def test_a_damaged_library_is_built_again(cache, small, messages, damage):
    library = compiled_library("cc", [COMPILER], messages.append)
    sound = library.read_bytes()
    if damage == "library":
        library.write_bytes(sound[:-100])
    elif damage == "checksum":
        library.with_suffix(".sha256").write_text("0" * 64)
    else:
        library.unlink()
    assert compiled_library("cc", [COMPILER], messages.append) == library
    assert "a compiled kernel in the cache is damaged or not safe: building it again" in messages
    assert library.read_bytes()[:4] == sound[:4]
    assert library.stat().st_size == len(sound)


@needs_compiler
def test_without_a_writable_cache_the_kernels_are_compiled_for_the_session_with_a_hint(
    tmp_path, monkeypatch, small, messages
):
    (tmp_path / "file").write_text("a file, no folder")
    monkeypatch.setenv("HBM_CACHE_DIR", str(tmp_path / "file"))
    library = compiled_library("cc", [COMPILER], messages.append)
    assert library.is_file()
    assert not library.is_relative_to(tmp_path)
    assert messages[0].startswith("the cache folder cannot be written (")
    assert messages[0].endswith("set HBM_CACHE_DIR to a folder that can")


@needs_compiler
def test_an_intact_library_is_used_from_a_cache_that_cannot_be_written(
    cache, small, messages, monkeypatch
):
    library = compiled_library("cc", [COMPILER], messages.append)
    monkeypatch.setattr(compiler, "writable_cache", lambda *_: pytest.fail("tried to write"))
    assert compiled_library("cc", [COMPILER], messages.append) == library


def test_a_compiler_that_fails_is_skipped_with_its_error(cache, small, messages):
    broken = [sys.executable, "-c", "import sys; sys.exit('no such target')"]
    assert compiled_library("mine", broken, messages.append) is None
    assert messages[-1] == "compiling with mine failed (no such target); trying the next option"


def script(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return [str(path)]


needs_shell = pytest.mark.skipif(sys.platform == "win32", reason="the compilers are shell scripts")


@needs_shell
@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("sleep 600 & wait", "MAX_ANSWER_S"),
        ('[ "$1" = --version ] || sleep 600', "MAX_COMPILING_S"),
    ],
)
def test_a_compiler_that_does_not_end_is_ended_with_all_that_it_started(
    cache, small, messages, monkeypatch, tmp_path, text, limit
):
    monkeypatch.setattr(compiler, limit, 0.5)
    hanging = script(tmp_path / "hanging", text)
    assert compiled_library("mine", hanging, messages.append) is None
    assert re.fullmatch(
        r"compiling with mine failed \(no answer within \d s\); trying the next option",
        messages[-1],
    )
    here = str(tmp_path)
    assert not [p for p in psutil.process_iter(["cmdline"]) if here in str(p.info["cmdline"])]


@needs_compiler
@needs_shell
def test_after_a_compiler_that_fails_comes_the_next_one(cache, small, tmp_path, monkeypatch):
    """Programs that are the same by another name are tried once."""
    (first,) = script(tmp_path / "first", "exit 1")
    (tmp_path / "cc").symlink_to(first)
    (tmp_path / "gcc").symlink_to(COMPILER)
    monkeypatch.setenv("CC", first)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert [name for name, _ in compilers() if name != "ziglang"] == [first, "gcc"]


@needs_shell
def test_of_what_a_compiler_says_a_short_printable_line_is_announced(
    cache, small, messages, tmp_path
):
    loud = script(
        tmp_path / "loud",
        '[ "$1" = --version ] && exit 0\n'
        r"printf '\033]0;title\007\033[31mfatal error: \377 bad' >&2" + "\n"
        "head -c 5000000 /dev/zero | tr '\\0' x >&2; exit 1",
    )
    assert compiled_library("loud", loud, messages.append) is None
    assert messages[-1].isprintable()
    assert "error: \ufffd bad" in messages[-1]
    assert len(messages[-1]) < 300


@needs_compiler
def test_processes_that_start_at_once_share_one_library(cache):
    program = (
        "import sys; from hbm.kernels import compiler\n"
        "def write(folder):\n"
        f"    (folder / 'skeleton.c').write_text({SMALL!r}); return folder / 'skeleton.c'\n"
        "compiler.write_source = write; compiler.disagreement = lambda _: ''\n"
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


def test_without_a_compiler_the_virtual_machine_is_used_with_a_hint(monkeypatch, messages):
    monkeypatch.setattr(native, "compilers", list)
    assert load(messages.append).backend == "virtual machine (no compiler)"
    assert messages == [
        "no C compiler works: using the slower virtual machine (same results). "
        "pip install 'hbm-residuals[compiler]' brings a compiler"
    ]


def test_the_virtual_machine_can_be_requested(monkeypatch, messages):
    monkeypatch.setenv("HBM_KERNELS", "virtual-machine")
    assert load(messages.append).backend == "virtual machine (HBM_KERNELS)"
    assert messages == []


@pytest.fixture
def wrong_rewriting(cache, monkeypatch):
    """casadi's C rewritten wrongly: the first sine of each kernel becomes a cosine."""
    right = c_source.simd_source

    def wrong(function, folder):
        return right(function, folder).replace("simd_sin(", "simd_cos(", 1)

    monkeypatch.setattr(c_source, "simd_source", wrong)
    monkeypatch.setattr(compiler, "FLAGS", ("-O0", *compiler.FLAGS[1:]))
    monkeypatch.setattr(native, "compilers", lambda: [("cc", [COMPILER])])


@needs_compiler
def test_kernels_with_wrong_numbers_are_refused_and_the_virtual_machine_is_used(
    wrong_rewriting, cache, messages
):
    ready = load(messages.append)
    assert ready.backend == "virtual machine (compiled kernels differ from it)"
    assert ready.solve_frames is None
    assert messages[0].startswith("compiling the kernels with cc")
    assert re.fullmatch(
        r"the kernels that cc compiled differ from casadi's virtual machine "
        r"\(newton_step by [\d.e+-]+ of its largest number\); trying the next option",
        messages[1],
    )
    assert messages[2].startswith("using the slower virtual machine, whose numbers are right")
    assert not list(cache.rglob(compiler.LIBRARY))

    again = []
    assert load(again.append).backend == ready.backend
    assert again == messages[1:], "announced each time, compiled once"


@needs_compiler
def test_where_there_is_a_compiler_the_kernels_are_compiled(messages):
    ready = load(messages.append)
    assert ready.solve_frames is not None, (ready.backend, messages)


@pytest.mark.parametrize("name", NAMES)
def test_the_sizes_of_inputs_and_outputs_are_those_of_the_symbolic_functions(name):
    function = casadi_function(name)
    sizes_in, sizes_out = kernel_sizes(name)
    assert sizes_in == tuple(function.size1_in(i) for i in range(function.n_in()))
    assert sizes_out == tuple(function.size1_out(i) for i in range(function.n_out()))


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
def test_kernels_do_not_depend_on_the_number_of_threads(frames, jobs):
    kernel = kernels().newton_euler
    rng = np.random.default_rng(41)
    inputs = [
        rng.normal(size=n if i in kernel.constant_inputs else (frames, n))
        for i, n in enumerate(kernel.sizes_in)
    ]
    for one, many in zip(kernel(*inputs), kernel(*inputs, jobs=jobs), strict=True):
        np.testing.assert_array_equal(one, many)


def test_a_kernel_refuses_input_of_the_wrong_shape():
    kernel = kernels().segment_poses
    with pytest.raises(ValueError, match=r"input 0 must have shape \(3, 46\), got \(3, 45\)"):
        kernel(np.zeros((3, 45)), np.zeros(kernel.sizes_in[1]))


@pytest.mark.slow
@pytest.mark.skipif(find_spec("ziglang") is None, reason="the extra 'compiler' is not installed")
def test_the_compiler_of_the_extra_compiles_and_runs_the_kernels(cache, monkeypatch, messages):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    assert [name for name, _ in compilers()] == ["ziglang"]
    brought = load(messages.append)
    assert brought.backend == "ziglang"
    assert brought.solve_frames is not None
    for name in NAMES:
        agree(name, getattr(brought, name), getattr(kernels(), name))


def test_the_cache_is_the_user_s_own(monkeypatch):
    for name in ("HBM_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert cache_directory().name == "hbm-residuals"
    assert cache_directory().is_relative_to(Path.home())


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="XDG is for the other systems")
def test_the_cache_is_where_xdg_puts_it(monkeypatch, tmp_path):
    monkeypatch.delenv("HBM_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_directory() == tmp_path / "hbm-residuals"


def test_hbm_cache_dir_moves_the_cache(cache):
    assert cache_directory() == cache


@needs_compiler
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


def test_a_library_that_cannot_be_read_counts_as_missing(tmp_path, monkeypatch):
    library = tmp_path / "skeleton.so"
    library.write_bytes(b"library")
    compiler._checksum(library).write_text(compiler._sha256(library))
    assert compiler._sound(library)

    def refused(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(library), "read_bytes", refused)
    assert not compiler._sound(library)
