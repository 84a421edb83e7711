"""A C3D file read a second time, by ezc3d, and what differs; a rewritten file and its original.

ezc3d 1.7.2 ends the interpreter on some damaged files and asks for 12.6 GB of memory on others, so
it runs in a process of its own with limited memory and time.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
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
from pipeline.io.c3d.data import Samples, read_samples
from pipeline.io.c3d.header import DATA_STARTS, MAX_COUNT, Header, read_header
from pipeline.io.c3d.labels import channel_labels
from pipeline.io.c3d.parameters import (
    BLOCK_BYTES,
    SECTION_START,
    Parameters,
    length_from_pointer,
    parameter_records,
    values_of,
)

PROGRAM: Final = Path(__file__).with_name("ezc3d_arrays.py")
COMPARED: Final = (
    *("POINT:LABELS", "POINT:UNITS", "ANALOG:LABELS", "ANALOG:UNITS"),
    *(f"FORCE_PLATFORM:{name}" for name in ("TYPE", "CHANNEL", "CORNERS", "ORIGIN", "CAL_MATRIX")),
    *("EVENT:LABELS", "EVENT:CONTEXTS", "EVENT:TIMES"),
)
"""Parameters that give the samples their meaning."""
MEMORY_BYTES: Final = 1 << 30
"""For the interpreter and its libraries."""
MEMORY_PER_BYTE: Final = 32
"""And per byte of the file: ezc3d takes 11 for 4-byte samples, twice that for 2-byte ones."""
SECONDS: Final = 60.0
SECONDS_PER_MB: Final = 1.0
"""Ten times what ezc3d takes."""
MAX_REASON: Final = 160
"""Characters of ezc3d's message that are passed on."""
ROUNDING: Final = 4 * float(np.finfo(np.float32).eps)
"""Relative: by less differ programs that scale stored numbers in another order."""
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
    try:
        header, parameters = read_header(path)
        samples = read_samples(path, header, parameters)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error
    try:
        found = _differences(header, parameters, samples, _read_by_ezc3d(path))
    except _Refused as error:
        return SecondReading(_reader(), str(error))
    return SecondReading(_reader(), "", tuple(found))


def check_rewritten(
    original: Path,
    written: Path,
    *,
    changed_channels: Collection[int],
    added_group: str = "",
    changed_parameters: Collection[str] = (),
) -> SecondReading:
    """Check that a rewritten C3D file differs from its original only where it was to.

    Parameters
    ----------
    original, written
        Both files.
    changed_channels
        Indices from 0 of the analog channels whose samples may differ.
    added_group
        Parameter group that only the written file has.
    changed_parameters
        Parameters whose values may differ, such as ``"FORCE_PLATFORM:CORNERS"``.

    Returns
    -------
    SecondReading
        Whether ezc3d agrees, or why it does not read the original.

    Raises
    ------
    ValueError
        Something else differs; the message says what and where.
    OSError
        A file cannot be opened.

    Notes
    -----
    Header, parameters and samples are compared byte by byte. Then our reader and ezc3d read the
    rewritten file, and both have to read the same arrays.
    """
    try:
        _require_same_bytes(original, written, changed_channels, added_group, changed_parameters)
        found = compare_readers(written)
        before = found if found == SecondReading(_reader()) else compare_readers(original)
        if found.refusal and not before.refusal:
            raise ValueError(f"{found.reader} reads the original only: {found.refusal}")
        if found.disagreements and not before.disagreements:
            raise ValueError(f"{found.disagreements[0]}, and not of the original")
    except ValueError as error:
        raise ValueError(f"the copy is not {original.name} written again: {error}") from error
    if before.disagreements:
        return SecondReading(
            found.reader, f"it reads the original otherwise: {before.disagreements[0]}"
        )
    return found


def _reader() -> str:
    return f"ezc3d {version('ezc3d')}" if installed() else "ezc3d"


def _read_by_ezc3d(path: Path) -> Arrays:
    """Give points (T, P, 3), residuals, analog samples and parameters; `_Refused` says why not."""
    if not installed():
        raise _Refused("it is not installed")
    size = path.stat().st_size
    memory, seconds = MEMORY_BYTES + MEMORY_PER_BYTE * size, SECONDS + SECONDS_PER_MB * size / 1e6
    with TemporaryDirectory(prefix="second_reader_", ignore_cleanup_errors=True) as folder:
        target = Path(folder) / "arrays.npz"
        wanted, limits = ",".join(COMPARED), (str(memory), str(int(seconds) + 1))
        try:
            done = subprocess.run(
                [sys.executable, "-P", PROGRAM, path.resolve(), target, wanted, *limits],
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
            raise _Refused(reason[:MAX_REASON] or f"its process ends with {done.returncode}")
        try:
            with np.load(target, allow_pickle=False) as stored:
                return dict(stored)
        except (OSError, ValueError, BadZipFile):
            raise _Refused("its process ends without a result") from None


def _differences(
    header: Header, parameters: Parameters, samples: Samples, second: Arrays
) -> list[str]:
    """Say in which arrays ezc3d's reading differs; `_Refused` where it is known not to read them.

    ezc3d 1.7.2 stops at 65,535 frames where a file has a ROTATION group, reads no channel and wrong
    points where ANALOG:RATE is absent, subtracts the magnitude of ANALOG:OFFSET, and takes the
    header's counts and rate where a file contradicts itself.
    """
    contradictory = bool(header.notes or samples.notes)
    frames, channels = header.frames, header.channels
    counts: tuple[tuple[str, int, int], ...] = (
        ("frames", len(second["points"]) if header.n_points else frames, frames),
        ("points", second["points"].shape[1], header.n_points),
        ("analog channels", second["analog"].shape[1], channels),
        ("samples", len(second["analog"]) * bool(channels), len(samples.analog) * bool(channels)),
    )
    for name, read, held in counts:
        if read != held:
            said = f"it reads {read} of {held} {name}"
            if contradictory or read == 0 or read == MAX_COUNT < held:
                raise _Refused(said)
            return [said]
    found = []
    if samples.rate_hz != second["rate_hz"] and not contradictory:
        found.append(f"frame rate: {samples.rate_hz:g} Hz here, {float(second['rate_hz']):g} Hz")
    for key in COMPARED:
        ours, theirs = _values(parameters, key), second[key]
        if len(ours) and not _same(ours, theirs):
            found.append(f"parameter {key}: {short(ours.tolist())} here, {short(theirs.tolist())}")
    theirs = np.where((second["residuals"] >= 0)[..., None], second["points"], np.nan)
    labels = parameters.texts("POINT", "LABELS")
    found += _different_samples("marker", labels, _seen(samples.points), _seen(theirs), header)
    names, _ = channel_labels(parameters, channels)
    theirs = np.where(np.isfinite(second["analog"]), second["analog"], np.nan)
    unlike = _different_samples("channel", names, samples.analog, theirs, header)
    if unlike and not found and (parameters.numbers("ANALOG", "OFFSET") < 0).any():
        raise _Refused("it takes ANALOG:OFFSET without its sign")
    return found + unlike


def _values(parameters: Parameters, key: str) -> NDArray[Any]:
    """Give a parameter as ezc3d gives it: without what continues in NAME2, first index fastest."""
    group, name = key.split(":")
    return parameters.groups.get(group, {}).get(name, np.empty(0)).ravel(order="F")


def _same(first: NDArray[Any], second: NDArray[Any]) -> bool:
    """Whether two parameters are the same but for empty texts at their end and 16-bit signs."""
    if "U" in (first.dtype.kind, second.dtype.kind):
        ours, theirs = ("\0".join(map(str, side.ravel())).rstrip("\0") for side in (first, second))
        return ours == theirs
    if first.shape != second.shape:
        return False
    apart = np.abs(first.astype(float) - second)
    alike = (apart <= SMALLEST) | (apart == 65536) | (np.isnan(first) & np.isnan(second))
    return bool((alike | (first == second)).all())


def _seen(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """Give points with NaN where none was seen: a coordinate is no number, or all are zero."""
    missing = ~np.isfinite(points).all(axis=-1) | ~(np.abs(points) > SMALLEST).any(axis=-1)
    return np.where(missing[..., np.newaxis], np.nan, points)


def _different_samples(
    kind: str,
    names: Sequence[str],
    first: NDArray[Any],
    second: NDArray[Any],
    header: Header,
) -> list[str]:
    """Name each marker, (T, M, 3), or channel, (N, M), that differs: first frame, both values."""
    if not first.shape[1]:
        return []
    apart = np.abs(first - second)
    same = apart <= np.maximum(ROUNDING * np.abs(first), SMALLEST)
    different = ~(same | (first == second) | (np.isnan(first) & np.isnan(second)))
    different = different.any(axis=-1) if different.ndim == 3 else different
    found = []
    for k in np.flatnonzero(different.any(axis=0)).tolist():
        at = int(different[:, k].argmax())
        frame = header.first_frame + at * header.frames // len(first)
        name = names[k] if k < len(names) and names[k] else f"{k + 1}"
        further = int(different[:, k].sum()) - 1
        found.append(
            f"{kind} {name}, frame {frame}: {first[at, k]} here, {second[at, k]} by {_reader()}"
            + (f", and {further} further" if further else "")
        )
    return found


def _require_same_bytes(
    original: Path,
    written: Path,
    changed: Collection[int],
    group: str,
    changed_parameters: Collection[str],
) -> None:
    """Refuse a copy that differs in any byte that was not to change.

    Free are where the data begin, the length of the parameter section, the way from its last record
    on and what follows that.
    """
    (header, parameters), (header_again, parameters_again) = map(read_header, (original, written))
    first, second = (np.memmap(path, np.uint8, "r") for path in (original, written))
    start = (header.parameter_block - 1) * BLOCK_BYTES
    section = first[start : header.data_start].tobytes()
    body = section[SECTION_START:]
    records = list(parameter_records(body, header.byte_order))
    owners = {-record.identity: record.name for record in records if record.identity < 0}
    names = [f"{owners.get(abs(r.identity), '')}:{r.name}" for r in records]
    free = {16, 17, start, start + 1, start + 2}
    starts = {":".join(name) for name in DATA_STARTS}
    for record, name in zip(records, names, strict=True):
        if record.identity > 0 and name in {*starts, *changed_parameters}:
            values = values_of(body, record)[2]
            free |= {start + SECTION_START + k for k in range(values.start, values.stop)}
    end = start + SECTION_START
    if records:
        pointer = end + records[-1].pointer
        free |= {pointer, pointer + 1}
        end = pointer + length_from_pointer(records[-1], body)
    for k in np.flatnonzero(first[:end] != second[:end]).tolist():
        if k not in free:
            places = [start + SECTION_START + record.start for record in records]
            at = int(np.searchsorted(places, k, side="right")) - 1
            raise ValueError(
                f"parameter {names[at]} differs" if at >= 0 else f"byte {k + 1} differs"
            )
    if {*parameters_again.groups} - {*parameters.groups} - {group}:
        raise ValueError("it has another group of parameters")
    moved = header_again.data_block - header.data_block
    for place in DATA_STARTS:
        before, after = (side.integer(*place, 0) for side in (parameters, parameters_again))
        if after != (before + moved if before else 0):
            raise ValueError(f"parameter {':'.join(place)} is not where the data begin")
    data, data_again = first[header.data_start :], second[header_again.data_start :]
    if len(data) != len(data_again):
        raise ValueError(f"its data section has {len(data_again)} bytes, expected {len(data)}")
    _require_same_words(data, data_again, header, changed)


def _require_same_words(
    first: NDArray[np.uint8], second: NDArray[np.uint8], header: Header, changed: Collection[int]
) -> None:
    """Compare data sections but for the samples of the changed channels."""
    points, channels = 4 * header.n_points, max(header.channels, 1)
    word, size = np.dtype("u4" if header.scale < 0 else "u2"), header.frame.bytes
    column = np.arange(size // word.itemsize)
    kept = column[(column < points) | ~np.isin((column - points) % channels, [*changed])]
    for frame in range(header.frames):
        part = slice(frame * size, (frame + 1) * size)
        wrong = kept[first[part].view(word)[kept] != second[part].view(word)[kept]]
        if len(wrong):
            at = int(wrong[0])
            kind, k = ("marker", at // 4) if at < points else ("channel", (at - points) % channels)
            raise ValueError(f"{kind} {k + 1} differs in frame {header.first_frame + frame}")
    end = header.frames * size
    if not np.array_equal(first[end:], second[end:]):
        raise ValueError("what follows its samples differs")
