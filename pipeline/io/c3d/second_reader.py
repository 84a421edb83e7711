"""A C3D file read a second time, by ezc3d, and what differs.

ezc3d 1.7.2 ends the interpreter on some damaged files and asks for 12.6 GB of memory on others, so
it runs in a process of its own with limited memory and time.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from hbm.spelling import short
from pipeline.io.c3d.data import MAX_COUNT, Header, Samples, read_header, read_samples
from pipeline.io.input_file import naming
from pipeline.io.units import MAX_VALUE

PROGRAM: Final = Path(__file__).with_name("ezc3d_arrays.py")
COMPARED: Final = (
    *("POINT:LABELS", "POINT:UNITS", "ANALOG:LABELS", "ANALOG:UNITS"),
    *(f"FORCE_PLATFORM:{name}" for name in ("TYPE", "CHANNEL", "CORNERS", "ORIGIN", "CAL_MATRIX")),
    *("EVENT:LABELS", "EVENT:CONTEXTS", "EVENT:TIMES"),
)
"""Parameters that give the samples their meaning."""
SECONDS: Final = 60.0
"""Left to ezc3d, and 1 s more for each megabyte: ten times what it takes."""
SMALLEST: Final = 4 * float(np.finfo(np.float32).tiny)
"""Numbers below are zero, or occur only in DEC files, where ezc3d 1.7.2 reads four times as
much."""

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class SecondReading:
    """Which second reader read a file and what it reads otherwise, or why it could not.

    Attributes
    ----------
    reader
        "ezc3d" with its version; alone if it is not installed.
    refusal
        Why it does not read the file; empty where it does.
    disagreements
        What differs, one line each.
    """

    reader: str
    refusal: str = ""
    disagreements: tuple[str, ...] = ()


class _Refused(ValueError):
    """ezc3d does not read a file, for a reason that says nothing against our reading."""


def installed() -> bool:
    """Whether ezc3d is installed."""
    try:
        return find_spec("ezc3d") is not None
    except ValueError:  # its import is blocked
        return False


def compare_readers(path: Path) -> SecondReading:
    """Read a C3D file by our reader and by ezc3d, and compare the arrays.

    Compared are frame rate, markers, gaps, analog channels, labels, units, events and the
    parameters of force plates. A ValueError where our reader refuses the file.
    """
    with naming(path):
        header = read_header(path)
        samples = read_samples(header)
    try:
        differences = _differences(header, samples, _read_by_ezc3d(path))
    except _Refused as error:
        return SecondReading(reader(), str(error))
    return SecondReading(reader(), "", tuple(differences))


def reader() -> str:
    """Name the second reader, with its version if it is installed."""
    return f"ezc3d {version('ezc3d')}" if installed() else "ezc3d"


def _read_by_ezc3d(path: Path) -> Arrays:
    """Give points (T, P, 3), residuals, analog samples and parameters; `_Refused` says why not."""
    if not installed():
        raise _Refused("it is not installed")
    size = path.stat().st_size
    # for the interpreter and its libraries, and for each byte of the file: ezc3d takes 11 for
    # samples of 4 bytes, and twice that for those of 2
    memory, seconds = (1 << 30) + 32 * size, SECONDS + size / 1e6
    with TemporaryDirectory(prefix="second_reader_", ignore_cleanup_errors=True) as folder:
        target, program = Path(folder) / "arrays.npz", (sys.executable, "-P", PROGRAM)
        try:
            done = subprocess.run(
                [*program, path.resolve(), target, ",".join(COMPARED), str(memory)],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                timeout=seconds,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise _Refused(f"it takes more than {seconds:.0f} s") from None
        if done.returncode < 0:
            raise _Refused(f"its process ends with {signal.Signals(-done.returncode).name}")
        if done.returncode:
            reason = " ".join(done.stderr.decode(errors="replace").split())
            if "bad_alloc" in reason:
                reason = f"it needs more than {memory / 1e9:.1f} GB of memory"
            raise _Refused(reason[:160] or f"its process ends with {done.returncode}")
        try:
            with np.load(target, allow_pickle=False) as stored:
                return dict(stored)
        except (OSError, ValueError, BadZipFile):
            raise _Refused("its process ends without a result") from None


def _differences(header: Header, samples: Samples, second: Arrays) -> list[str]:
    """Say in which arrays ezc3d's reading differs; `_Refused` where it is known not to read them.

    ezc3d 1.7.2 stops at 65,535 frames where a file has a ROTATION group, reads no channel and wrong
    points where ANALOG:RATE is absent, subtracts the magnitude of ANALOG:OFFSET, and takes the
    header's counts and rate where a file contradicts itself.
    """
    parameters, frame, channels = header.parameters, header.frame, header.frame.channels
    contradictory = bool(header.corrections or samples.corrections)
    points, analog = second["points"], second["analog"]
    counts = [("frames", len(points), header.frames)] * (frame.points > 0)
    counts += [("points", points.shape[1], frame.points)]
    counts += [("analog channels", analog.shape[1], channels)]
    counts += [("samples", len(analog), len(samples.analog))] * (channels > 0)
    for name, read, held in counts:
        if read != held:
            difference = f"it reads {read} of {held} {name}"
            if contradictory or read == 0 or read == MAX_COUNT < held:
                raise _Refused(difference)
            return [difference]
    differences = []
    if samples.rate_hz != second["rate_hz"] and not contradictory:
        theirs_hz = float(second["rate_hz"])
        differences.append(f"frame rate: {samples.rate_hz:g} Hz here, {theirs_hz:g} Hz")
    for key in COMPARED:
        group, name = key.split(":")
        ours = parameters.groups.get(group, {}).get(name, np.empty(0)).ravel(order="F")
        if len(ours) and not _same(ours, second[key]):
            differences.append(
                f"parameter {key}: {short(ours.tolist())} here, {short(second[key].tolist())}"
            )
    points = np.where((second["residuals"] >= 0)[..., None], points, np.nan)
    labels = parameters.texts("POINT", "LABELS")
    of_markers = _seen(samples.points), _seen(points)
    differences += _different_samples("marker", labels, *of_markers, header)
    names = [name for name, _ in header.channels]
    analog = np.where(np.abs(analog) <= MAX_VALUE, analog, np.nan)
    unlike = _different_samples("channel", names, samples.analog, analog, header)
    if unlike and not differences and (parameters.numbers("ANALOG", "OFFSET") < 0).any():
        raise _Refused("it takes ANALOG:OFFSET without its sign")
    return differences + unlike


def _same(first: NDArray[Any], second: NDArray[Any]) -> bool:
    """Whether two parameters are the same but for empty texts at their end and 16-bit signs."""
    if "U" in (first.dtype.kind, second.dtype.kind):
        ours, theirs = ("\0".join(map(str, side.ravel())).rstrip("\0") for side in (first, second))
        return ours == theirs
    if first.shape != second.shape:
        return False
    alike = np.isclose(first, second, rtol=0, atol=SMALLEST, equal_nan=True)
    return bool((alike | (np.abs(first.astype(float) - second) == 65536)).all())


def _seen(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """Give points with NaN where none was seen: a coordinate is no number, or all are zero."""
    missing = ~np.isfinite(points).all(axis=-1) | ~(np.abs(points) > SMALLEST).any(axis=-1)
    return np.where(missing[..., np.newaxis], np.nan, points)


def _different_samples(
    kind: str, names: Sequence[str], first: NDArray[Any], second: NDArray[Any], header: Header
) -> list[str]:
    """Name each marker, (T, M, 3), or channel, (N, M), that differs: first frame, both values."""
    if not first.shape[1]:
        return []
    # programs that scale stored numbers in another order differ by rounding
    rounding = 4 * float(np.finfo(np.float32).eps)
    same = np.isclose(first, second, rtol=rounding, atol=SMALLEST, equal_nan=True)
    different = ~same.reshape(*first.shape[:2], -1).all(axis=-1)
    differences = []
    for k in np.flatnonzero(different.any(axis=0)).tolist():
        at = int(different[:, k].argmax())
        frame = header.first_frame + at * header.frames // len(first)
        name = names[k] if k < len(names) and names[k] else f"{k + 1}"
        differences.append(
            f"{kind} {name}, frame {frame}: {first[at, k]} here, {second[at, k]} by {reader()}"
        )
    return differences
