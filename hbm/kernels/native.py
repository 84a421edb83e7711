"""Kernels made ready to run: compiled once and cached, or on casadi's virtual machine.

In order: a library from the user's cache; the system's C compiler; the ``ziglang`` package (extra
``compiler``), which brings one (see `hbm.kernels.compiler`); else casadi's virtual machine, some
forty times slower but equal. A library is compared with the virtual machine when it is built, and
refused where their numbers differ.

The environment variable ``HBM_KERNELS`` set to ``virtual-machine`` skips compilation;
``HBM_CACHE_DIR`` moves the cache (`hbm.kernels.cache` says which folders are trusted).
"""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock

from hbm.kernels.cache import UNFINISHED, cache_directory
from hbm.kernels.compiler import KernelsDisagreeError, compiled_library, compilers, discard
from hbm.kernels.kernel import Kernel, Kernels
from hbm.kernels.library import load_library
from hbm.kernels.virtual_machine import interpreted_kernels

__all__ = ["Kernel", "Kernels", "cache_directory", "kernels"]

_READY: dict[str, Kernels] = {}
_LOCK = Lock()


def kernels(announce: Callable[[str], None] | None = None) -> Kernels:
    """Make the kernels ready; the first time on a machine this compiles for some seconds.

    Parameters
    ----------
    announce
        Called with a sentence when something takes long, goes wrong or could be faster.

    Returns
    -------
    Kernels
        The same numbers to 1e-9 whatever the backend.
    """
    with _LOCK:
        if not _READY:
            _READY["kernels"] = load(announce or (lambda _: None))
        return _READY["kernels"]


def load(announce: Callable[[str], None]) -> Kernels:
    """Try all ways to run the kernels, the fastest first."""
    if os.environ.get("HBM_KERNELS", "") == "virtual-machine":
        return interpreted_kernels("virtual machine (HBM_KERNELS)")
    refused = False
    for name, command in compilers():
        try:
            compiled = _compiled(name, command, announce)
            if compiled is not None:
                return compiled
        except KernelsDisagreeError as error:
            refused = True
            announce(f"{error}; trying the next option")
        except OSError as error:
            announce(
                f"the library that {name} made cannot be loaded ({error}); trying the next option"
            )
    if refused:
        announce(
            "using the slower virtual machine, whose numbers are right; please report this with "
            "the output of 'hbm doctor'"
        )
        return interpreted_kernels("virtual machine (compiled kernels differ from it)")
    announce(
        "no C compiler works: using the slower virtual machine (same results). "
        "pip install 'hbm-residuals[compiler]' brings a compiler"
    )
    return interpreted_kernels("virtual machine (no compiler)")


def _compiled(name: str, command: list[str], announce: Callable[[str], None]) -> Kernels | None:
    """Load what a compiler makes of the kernels; what the cache holds of it may be useless."""
    library = compiled_library(name, command, announce)
    if library is None:
        return None
    try:
        return load_library(library, name)
    except OSError as error:
        announce(f"a library in the cache cannot be loaded ({error}): building it again")
        discard(library)
    library = compiled_library(name, command, announce)
    if library is None:
        return None
    # by another path, since the system remembers by its path what was loaded before
    with TemporaryDirectory(
        prefix=UNFINISHED, dir=library.parent.parent, ignore_cleanup_errors=True
    ) as folder:
        return load_library(Path(shutil.copy(library, folder)), name)
