"""The cache of compiled kernels: a library runs only from where nobody else could have put it."""

import hashlib
import os
import shutil
import subprocess
import sys
import time

import pytest

from hbm.kernels import compiler, native
from hbm.kernels.cache import (
    UNFINISHED,
    UntrustedError,
    cache_directory,
    remove_unfinished,
    trusted_entry,
    trusted_folder,
)
from hbm.kernels.native import load

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
NOBODY = 65534
pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="Windows has no owners and modes of files"),
    pytest.mark.skipif(COMPILER is None, reason="this machine has no C compiler"),
]
as_root = pytest.mark.skipif(
    sys.platform == "win32" or os.geteuid() != 0, reason="only root gives files to others"
)
SESSION_ONLY = "the kernels are compiled for this session only"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    monkeypatch.setenv("HBM_CACHE_DIR", str(folder))
    monkeypatch.setattr(native, "compilers", lambda: [("cc", [COMPILER])])
    return folder


def plant(cache, code):
    """Put a library and its own right checksum where a compiled one would be looked for."""
    entry = cache / f"skeleton-{compiler._key([COMPILER])}"
    entry.mkdir(mode=0o700)
    (cache / "planted.c").write_text(code)
    library = entry / compiler.LIBRARY
    subprocess.run([COMPILER, "-shared", "-fPIC", cache / "planted.c", "-o", library], check=True)
    checksum = library.with_suffix(".sha256")
    checksum.write_text(hashlib.sha256(library.read_bytes()).hexdigest())
    for path in (library, checksum):
        path.chmod(0o700)
    return entry


@pytest.fixture
def planted(cache, tmp_path):
    """A library that leaves a file when it is loaded."""
    witness = tmp_path / "it ran"
    code = (
        "#include <stdio.h>\n__attribute__((constructor)) static void run(void)"
        f' {{ fclose(fopen("{witness}", "w")); }}\n'
    )
    return plant(cache, code), witness


@pytest.fixture
def quick(monkeypatch):
    """Compile nothing: what is tested is what happens before."""

    def refused(*_):
        raise compiler.CompilerError("not in this test")

    monkeypatch.setattr(compiler, "_build", refused)


def test_a_planted_library_would_run_if_it_were_trusted(planted, quick):
    """The attack of the tests below works but for what they change."""
    _, witness = planted
    load(lambda _: None)
    assert witness.exists()


@as_root
@pytest.mark.parametrize("which", ["the folder", "the entry", "the library", "the checksum"])
def test_what_belongs_to_another_user_is_never_loaded(planted, cache, quick, which):
    entry, witness = planted
    paths = {
        "the folder": cache,
        "the entry": entry,
        "the library": entry / compiler.LIBRARY,
        "the checksum": (entry / compiler.LIBRARY).with_suffix(".sha256"),
    }
    os.chown(paths[which], NOBODY, NOBODY)
    messages = []
    assert load(messages.append).backend.startswith("virtual machine")
    assert not witness.exists()
    assert any("not safe" in message for message in messages)


@pytest.mark.parametrize("mode", [0o777, 0o1777, 0o770, 0o722])
def test_a_folder_that_others_can_write_to_is_refused_and_left_as_it_is(
    planted, cache, quick, mode
):
    _, witness = planted
    cache.chmod(mode)
    messages = []
    load(messages.append)
    assert not witness.exists()
    assert f"other users can write to {cache}" in messages[0]
    assert SESSION_ONLY in messages[0]
    assert cache.stat().st_mode & 0o7777 == mode


def test_a_folder_below_one_that_others_can_write_to_is_refused(tmp_path):
    shared, folder = tmp_path / "shared", tmp_path / "shared" / "cache"
    folder.mkdir(parents=True, mode=0o700)
    shared.chmod(0o777)
    with pytest.raises(UntrustedError, match=f"other users can write to {shared}"):
        trusted_folder(folder)
    shared.chmod(0o1777)
    assert trusted_folder(folder) == folder, "in a sticky folder nobody can put another in place"


def test_a_link_to_a_folder_is_judged_by_where_it_leads(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.mkdir(mode=0o700)
    link.symlink_to(target)
    assert trusted_folder(link) == target
    target.chmod(0o777)
    with pytest.raises(UntrustedError, match=str(target)):
        trusted_folder(link)


def test_a_link_in_the_cache_is_not_followed(cache, tmp_path):
    elsewhere, entry = tmp_path / "elsewhere", cache / "skeleton-0"
    elsewhere.mkdir(mode=0o700)
    entry.symlink_to(elsewhere)
    with pytest.raises(UntrustedError, match="is a link"):
        trusted_entry(entry)
    entry.unlink()
    entry.mkdir(mode=0o700)
    (entry / "skeleton.so").symlink_to(elsewhere)
    with pytest.raises(UntrustedError, match="is a link"):
        trusted_entry(entry)


def test_what_belongs_to_root_is_trusted_by_everyone(cache, monkeypatch):
    """As in a container whose image was made by root."""
    if os.geteuid() == 0:
        monkeypatch.setattr(os, "geteuid", lambda: NOBODY)
        assert trusted_folder(cache) == cache
    assert trusted_folder(cache.parents[-1] / "usr")


def test_where_files_have_no_owners_nothing_but_links_is_refused(cache, monkeypatch):
    """As on Windows."""
    cache.chmod(0o777)
    monkeypatch.delattr(os, "geteuid")
    assert trusted_folder(cache) == cache


def test_whatever_the_umask_only_the_user_can_write_to_the_cache(cache, monkeypatch):
    monkeypatch.setenv("HBM_CACHE_DIR", str(cache / "new"))
    before = os.umask(0)
    try:
        assert load(lambda _: None).backend == "cc"
    finally:
        os.umask(before)
    written = [cache / "new", *(cache / "new").rglob("*")]
    assert len(written) == 4, "folder, entry, library, checksum"
    assert {oct(path.stat().st_mode & 0o077) for path in written} == {"0o0"}


def test_a_library_without_the_kernels_is_built_again(cache):
    plant(cache, "int answer(void) { return 42; }\n")
    messages = []
    assert load(messages.append).backend == "cc"
    assert messages[0].startswith("a library in the cache cannot be loaded (it lacks newton_step")
    program = (
        "from hbm.kernels import native; "
        f"native.compilers = lambda: [('cc', [{COMPILER!r}])]; print(native.load(print).backend)"
    )
    again = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert again.stdout == "cc\n", again


def test_what_killed_processes_left_is_removed_and_nothing_else(cache):
    old, new, other = (cache / name for name in (f"{UNFINISHED}a", f"{UNFINISHED}b", "tmp of mine"))
    for folder in (old, new, other):
        (folder / "inside").mkdir(parents=True)
    hours_ago = time.time() - 7200
    for folder in (old, other):
        os.utime(folder, (hours_ago, hours_ago))
    remove_unfinished(cache)
    assert sorted(cache.iterdir()) == sorted((new, other))


def test_what_killed_processes_left_goes_though_nothing_has_to_be_built(planted, cache, quick):
    left = cache / f"{UNFINISHED}a"
    left.mkdir()
    os.utime(left, (0, 0))
    load(lambda _: None)
    assert not left.exists()


def test_the_cache_is_the_folder_that_is_stated(cache):
    assert cache_directory() == cache
