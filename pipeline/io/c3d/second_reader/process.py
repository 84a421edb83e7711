"""Libraries that read a C3D file in a process of their own, with limited memory and time.

ezc3d 1.7.2 ends the interpreter on some damaged files and asks for 12.6 GB of memory on others;
neither may happen to a study.
"""

import os
import signal
import subprocess
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from pipeline.io.c3d.second_reader.reading import Reading, Refusal, load_reading

PROGRAM: Final = Path(__file__).with_name("libraries.py")
MEMORY_BYTES: Final = 1 << 30
"""For the interpreter and its libraries."""
MEMORY_PER_BYTE: Final = 32
"""And per byte of the file: ezc3d takes 11 for 4-byte samples, twice that for 2-byte ones."""
SECONDS: Final = 60.0
SECONDS_PER_MB: Final = 1.0
"""Ten times what either library takes."""
MAX_REASON: Final = 160
"""Characters of a library's message that are passed on."""


def read_with(library: str, path: Path) -> Reading | Refusal:
    """Read a C3D file with one library, in a process of its own.

    Parameters
    ----------
    library
        "ezc3d" or "c3d".
    path
        The file.

    Returns
    -------
    Reading | Refusal
        What it read, or in one line why it did not: it is not installed, refuses the file, needs
        more memory or time than it may have, or ended without a message. On Windows and macOS,
        memory is not limited.
    """
    if not installed(library):
        return Refusal(library, "it is not installed", installed=False)
    reader = f"{library} {version(library)}"
    size = path.stat().st_size
    memory = MEMORY_BYTES + MEMORY_PER_BYTE * size
    seconds = SECONDS + SECONDS_PER_MB * size / 1e6
    with TemporaryDirectory(prefix="second_reader_", ignore_cleanup_errors=True) as folder:
        limits = (str(memory), str(int(seconds) + 1))
        try:
            done = subprocess.run(
                [sys.executable, "-P", PROGRAM, library, path.resolve(), folder, *limits],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                timeout=seconds,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return Refusal(reader, f"it takes more than {seconds:.0f} s")
        if done.returncode:
            return Refusal(reader, f"its process ends with {_ending(done.returncode)}")
        try:
            loaded = load_reading(Path(folder))
        except (ValueError, KeyError, OSError):
            return Refusal(reader, "its process ends without a result")
    if isinstance(loaded, Reading):
        return loaded
    if "bad_alloc" in loaded:
        return Refusal(reader, f"it needs more than {memory / 1e9:.1f} GB of memory")
    return Refusal(reader, " ".join(loaded.split())[:MAX_REASON])


def installed(library: str) -> bool:
    """Whether a library is installed."""
    try:
        return find_spec(library) is not None
    except ValueError:  # its import is blocked
        return False


def _ending(returncode: int) -> str:
    try:
        return signal.Signals(-returncode).name
    except ValueError:
        return f"exit code {returncode}"
