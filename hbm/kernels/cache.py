"""The folder of compiled kernels, and what is trusted in it: a library runs with the user's rights.

A folder is trusted if it belongs to the user or to root and only the owner can write to it, and if
the same holds for every folder above it; those may be open to others if they are sticky, as
``/tmp`` is: there nobody can rename what belongs to someone else. Symbolic links are resolved
first, and the folder that they lead to is judged. An entry of a trusted folder is used if the same
holds for it and its files, and none of them is a link. A group counts as others, even a group of
one; access control lists are not looked at. Windows says none of this in a file's mode; there the
user's own folders are private by default.

What is not trusted is never loaded and never changed: the kernels are compiled in a temporary
folder.
"""

import atexit
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

import platformdirs

PRIVATE: Final = stat.S_IRWXU
SHARED: Final = stat.S_IWGRP | stat.S_IWOTH
UNFINISHED: Final = "tmp-skeleton-"
"""Beginning of the name of a folder in which a library is being built."""
MAX_BUILD_S: Final = 3600.0
"""Far longer than a compiler may take: what is older was left by a process that was killed."""


class UntrustedError(OSError):
    """Other users could have written what is to be loaded."""


def cache_directory() -> Path:
    """Give the folder that holds compiled kernels: ``HBM_CACHE_DIR``, or in the user's cache."""
    if "HBM_CACHE_DIR" in os.environ:
        return Path(os.environ["HBM_CACHE_DIR"])
    return platformdirs.user_cache_path("hbm-residuals", appauthor=False, opinion=False)


def writable_cache(announce: Callable[[str], None]) -> Path:
    """Give the cache folder, or one for this process alone where it cannot be used.

    Parameters
    ----------
    announce
        Called with a sentence if it cannot be used.

    Returns
    -------
    Path
        A trusted folder.

    Raises
    ------
    UntrustedError
        If the system's folder for temporary files is not safe either.
    """
    try:
        cache_directory().mkdir(mode=PRIVATE, parents=True, exist_ok=True)
        folder = trusted_folder(cache_directory())
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        untrusted = isinstance(error, UntrustedError)
        announce(
            f"the cache folder {'is not safe' if untrusted else 'cannot be written'} ({error}): "
            "the kernels are compiled for this session only; set HBM_CACHE_DIR to a folder that "
            f"{'only you can write to' if untrusted else 'can'}"
        )
        temporary = Path(tempfile.mkdtemp(prefix="hbm-residuals-"))
        atexit.register(shutil.rmtree, temporary, ignore_errors=True)
        return trusted_folder(temporary)
    return folder


def trusted_folder(folder: Path) -> Path:
    """Give a folder by its path without links.

    Raises
    ------
    OSError
        If it is not there.
    UntrustedError
        If others than the user and root could put something in it, or in its place.
    """
    folder = folder.resolve(strict=True)
    _require_own(folder)
    for above in folder.parents:
        _require_own(above, sticky=True)
    return folder


def trusted_entry(entry: Path) -> Path:
    """Give a folder in the cache by its path without links.

    Raises
    ------
    OSError
        If it is not there.
    UntrustedError
        If others than the user and root could have written it or one of its files.
    """
    entry = trusted_folder(entry.parent) / entry.name
    for path in (entry, *entry.iterdir()):
        _require_own(path)
    return entry


def make_private(entry: Path) -> None:
    """Let only the user read and write an entry and its files, whatever the umask is."""
    for path in (entry, *entry.iterdir()):
        path.chmod(PRIVATE)


def remove_unfinished(folder: Path) -> None:
    """Remove what killed processes left in the cache."""
    for path in folder.glob(f"{UNFINISHED}*"):
        with suppress(OSError):
            if time.time() - path.lstat().st_mtime > MAX_BUILD_S:
                shutil.rmtree(path, ignore_errors=True)


def _require_own(path: Path, *, sticky: bool = False) -> None:
    """Refuse what others can write; in a ``sticky`` folder they may write things of their own."""
    state = path.lstat()
    if stat.S_ISLNK(state.st_mode):
        raise UntrustedError(f"{path} is a link")
    if not hasattr(os, "geteuid"):
        return
    if state.st_uid not in (0, os.geteuid()):
        raise UntrustedError(f"{path} belongs to another user")
    if state.st_mode & SHARED and not (sticky and state.st_mode & stat.S_ISVTX):
        raise UntrustedError(f"other users can write to {path} (chmod go-w)")
