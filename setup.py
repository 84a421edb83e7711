"""Compile the kernels while the package is built: casadi writes the C, a compiler makes libraries.

There is one library for each width of vectors (`hbm.kernels.native` chooses). Where nothing can be
compiled the package is complete without them, and slower.
"""

import os
import platform
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

ROOT: Final = Path(__file__).parent
sys.path.insert(0, str(ROOT))

from hbm.kernels.build import write_source  # noqa: E402
from hbm.kernels.native import SUFFIX, library_path  # noqa: E402

FLAGS: Final = ("-O1", "-fPIC", "-shared", "-ffp-contract=off", "-Wno-psabi")
"""-O2 and -O3 take longer and gain nothing on straight-line code; contraction of products and sums
would make the numbers depend on the processor; vectors are passed to no other library (psabi)."""
VECTORS: Final = {2: (), 4: ("-mavx2",), 8: ("-mavx512f",)}
"""Numbers per vector -> flags; those without flags are there on every processor."""
QUICK: Final = "--param=ira-max-conflict-table-size=0"
"""GCC allocates registers by priority alone, a quarter of its time less: kernels are as fast with
two and with eight numbers per vector, and 8 % slower with four."""
CHECK: Final = """
import sys
from pathlib import Path
from hbm.kernels.build import disagreement
from hbm.kernels.native import lanes_of_processor
lanes, library = int(sys.argv[1]), Path(sys.argv[2])
sys.exit(lanes <= lanes_of_processor(library) and disagreement(library) or None)
"""
"""Run for each library: fails where it differs from casadi's virtual machine, or cannot run."""


def compiler() -> list[str]:
    """Give the command of a C compiler: ``CC``, the system's, or ziglang's."""
    if stated := os.environ.get("CC"):
        return shlex.split(stated)
    found = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
    if found is None and find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    return [found or "cc"]


def check(lanes: int, library: Path) -> subprocess.CompletedProcess[bytes]:
    """Run the check of a library."""
    return subprocess.run([sys.executable, "-c", CHECK, str(lanes), str(library)], cwd=ROOT)


class BuildKernels(build_ext):
    """Builds one library for each width of vectors, all at once; one that fails is left out."""

    def finalize_options(self) -> None:
        """Build at the same time whatever is stated."""
        super().finalize_options()
        self.parallel = True

    def get_ext_filename(self, fullname: str) -> str:
        """Give a file's name without the version of Python, which does not matter here."""
        return str(Path(*fullname.split(".")).with_suffix(SUFFIX))

    def build_extensions(self) -> None:
        """Write the C once, which is the same for every width, then build."""
        Path(self.build_temp).mkdir(parents=True, exist_ok=True)
        try:
            self.source = write_source(Path(self.build_temp))
        except OSError as error:
            self.warn(f"all libraries are left out: {error}")
        else:
            super().build_extensions()

    def build_extension(self, ext: Extension) -> None:
        """Compile and check a library; a right one is kept where it is used from this folder."""
        lanes = int(ext.name.rpartition("_")[2])
        library = Path(self.get_ext_fullpath(ext.name))
        built = library_path(lanes)
        if not (self.editable_mode and built.is_file() and check(lanes, built).returncode == 0):
            built = Path(self.build_temp, library.name).resolve()
            libm = [] if sys.platform == "win32" else ["-lm"]
            flags = [*FLAGS, *VECTORS[lanes], *[QUICK] * (lanes != 4), f"-DLANES={lanes}"]
            files = ["-o", str(built), str(self.source), *libm]
            try:
                subprocess.run([*compiler(), *flags, *files], check=True)
                check(lanes, built).check_returncode()
            except (OSError, subprocess.SubprocessError) as error:
                raise CompileError(f"{library.name} is left out: {error}") from error
        library.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(built, library)


class PlatformWheel(bdist_wheel):
    """A wheel for any Python on one platform: libraries that ctypes loads know no Python."""

    def get_tag(self) -> tuple[str, str, str]:
        """Keep the platform's part of the tag alone."""
        return "py3", "none", super().get_tag()[2]


x86 = platform.machine().lower() in ("x86_64", "amd64")
setup(
    ext_modules=[
        Extension(f"hbm.kernels.{library_path(lanes).stem}", [], optional=True)
        for lanes, flags in VECTORS.items()
        if x86 or not flags
    ],
    cmdclass={"bdist_wheel": PlatformWheel, "build_ext": BuildKernels},
)
