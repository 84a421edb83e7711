"""A C3D file written again with other plate wrenches: only the samples of its plates change.

A parameter group says what was done. The copy is made in slices, and gets its name only after our
reader and ezc3d have found nothing else changed.
"""

import filecmp
import shutil
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hbm.spatial import Array
from pipeline.io.c3d.data import (
    DATA_STARTS,
    Header,
    analog_scaling,
    frame_rate_hz,
    is_unsigned,
    read_header,
)
from pipeline.io.c3d.force_plates import PlateLayout, channel_change, plate_layouts
from pipeline.io.c3d.parameters import (
    BLOCK_BYTES,
    float_bytes,
    floats,
    integer_type,
    with_group,
    with_values,
)
from pipeline.io.c3d.read import GROUP, compensation_group, read_compensation
from pipeline.io.c3d.second_reader import SecondReading, compare_readers, reader
from pipeline.io.input_file import naming
from pipeline.io.recording import Compensation
from pipeline.io.stated import Stated
from pipeline.io.write import whole_file

MAX_REAL: Final = float(np.finfo(np.float32).max)
MAX_DEC: Final = MAX_REAL / 4
"""The same bits mean a quarter of the IEEE number in a DEC file."""
FRAMES_PER_SLICE: Final = 4096
"""Some megabytes at a time: large enough for NumPy, small beside the trial."""
DATA_BLOCK: Final = 8
"""Word of the header that says where the data section begins."""
LABEL_RANGE: Final = 147
LABEL_RANGE_KEY: Final = 12345
"""This number in this word of the header: the file has a section of labels and ranges."""


@dataclass(frozen=True, slots=True)
class _PlateSamples:
    """How the samples of a file's plates are stored: value = (sample − offset) · scale."""

    header: Header
    plates: list[PlateLayout]
    names: list[str]
    scale: NDArray[np.float64]
    rate_hz: float
    unsigned: bool

    def changed(self, data: bytes, wrench_changes: Sequence[Array], first_frame: int) -> bytes:
        """Change the plates' wrenches in some frames of the data section.

        ``wrench_changes`` are per plate what is to be added to its wrench in the whole trial, in
        the plate's axes about the centre of its surface, (N, 6) [N, N·m]. A sample whose wrench is
        not changed keeps its bytes. A ValueError names channel and time where a channel cannot hold
        what it would have to.
        """
        frame = self.header.frame
        words = np.frombuffer(data, self._word_type).reshape(-1, frame.bytes // frame.word_bytes)
        words = words.copy()
        start = first_frame * frame.per_channel
        for plate, change in zip(self.plates, wrench_changes, strict=True):
            part = change[start : start + len(words) * frame.per_channel]
            in_frame = np.add.outer(frame.channels * np.arange(frame.per_channel), plate.channels)
            columns = 4 * frame.points + in_frame
            cells = words[:, columns]
            stored = self._changed_plate(plate, cells.reshape(len(part), -1), part, start)
            words[:, columns] = stored.reshape(cells.shape)
        return words.tobytes()

    def _changed_plate(
        self, plate: PlateLayout, stored: NDArray[np.integer], wrench_change: Array, start: int
    ) -> NDArray[np.integer]:
        """Change stored samples (N, c) of one plate."""
        chosen = list(plate.channels)
        real, order = self.header.scale < 0, self.header.byte_order
        scale = self.scale[chosen]
        before = stored.astype(float)
        if real:
            before = floats(stored.tobytes(), order).reshape(stored.shape).astype(float)
        known = np.isfinite(before).all(axis=1)
        change = np.zeros(before.shape)
        change[known] = channel_change(plate, wrench_change[known])
        with np.errstate(divide="ignore", invalid="ignore"):
            after = np.where(change == 0, before, before + change / scale)
        after = after if real else np.rint(after)
        low, high = self._limits
        for wrong, reason in (
            ((change != 0) & ((scale == 0) | ~np.isfinite(scale)), "its scale is 0 or no number"),
            (
                (change != 0) & ~((after >= low) & (after <= high)),
                f"the compensated sample is outside the range of the file's samples, {low:g} to "
                f"{high:g}; export the recording with real (floating-point) samples",
            ),
        ):
            if wrong.any():
                sample, channel = np.argwhere(wrong)[0].tolist()
                raise ValueError(
                    f"force plate {plate.number}, channel {self.names[chosen[channel]]}, at "
                    f"{(start + sample) / self.rate_hz:.4f} s: {reason}"
                )
        if real:
            encoded = np.frombuffer(float_bytes(after, order), "<u4").reshape(stored.shape)
        else:
            encoded = after.astype(self._word_type)
        return np.where(change == 0, stored, encoded)

    @property
    def _word_type(self) -> np.dtype:
        """Type of a sample: its value where it is whole, its bytes where it is real."""
        if self.header.scale < 0:
            return np.dtype("<u4")
        return integer_type(self.header.byte_order, signed=not self.unsigned)

    @property
    def _limits(self) -> tuple[float, float]:
        if self.header.scale < 0:
            most = MAX_DEC if self.header.byte_order == "dec" else MAX_REAL
            return -most, most
        return float(np.iinfo(self._word_type).min), float(np.iinfo(self._word_type).max)


def _plate_samples(header: Header, stated: Stated) -> _PlateSamples:
    plates, _ = plate_layouts(header, stated)
    names = [name for name, _ in header.channels]
    if not plates:
        raise ValueError("the file has no force plates")
    owners = Counter(channel for plate in plates for channel in plate.channels)
    if shared := [names[channel] for channel, count in owners.items() if count > 1]:
        raise ValueError(f"FORCE_PLATFORM:CHANNEL names {shared[0]} twice")
    _, scale, _ = analog_scaling(header)
    rate_hz = frame_rate_hz(header)[0] * header.frame.per_channel
    unsigned = is_unsigned(header)
    return _PlateSamples(header, plates, names, scale, rate_hz, unsigned)


def rewrite_plates(
    original: Path,
    target: Path,
    changes: Sequence[Array],
    compensation: Compensation,
    corners: Sequence[Array] = (),
    *,
    stated: Stated | None = None,
) -> SecondReading:
    """Write a C3D file again with changed plate wrenches.

    Parameters
    ----------
    original
        The file; it is only read.
    target
        Where to write.
    changes
        Per plate, what is to be added to its wrench in the plate's axes about the centre of its
        surface, (N, 6) [N, N·m]. Where it is zero, a sample keeps its bytes.
    compensation
        What was done; becomes a parameter group.
    corners
        Per plate, new corners of its surface, in the plate's axes about the centre of its surface
        as they are in ``original``, (4, 3) [m]; none to keep them.

    stated
        What was stated about ``original`` when it was read: units in whose place others are stated.
        The copy keeps its own labels and units.

    Returns
    -------
    SecondReading
        Which second reader read both files and found nothing else changed.

    Raises
    ------
    ValueError
        The plates are compensated already, their channels cannot hold the changed wrenches (the
        message names channel and time), the parameters leave no room for a group, something else
        differs, or there is another file at ``target``.
    OSError
        A file cannot be read or written.

    Notes
    -----
    Integer samples are rounded to a count. Samples that are not a number stay so.
    """
    stated = stated or Stated()
    with naming(original):
        header = read_header(original)
        if (before := read_compensation(header.parameters)) is not None:
            raise ValueError(f"its plates are compensated already, by {before.software}")
        samples = _plate_samples(header, stated)
        parameter_start = (header.parameter_block - 1) * BLOCK_BYTES
        with whole_file(target) as temporary:
            with original.open("rb") as source, temporary.open("wb") as copy:
                head = source.read(parameter_start)
                section = source.read(header.data_start - parameter_start)
                section = _changed_section(
                    section, samples, compensation, corners, stated or Stated()
                )
                copy.write(_moved(head, header, len(section) // BLOCK_BYTES) + section)
                for start in range(0, header.frames, FRAMES_PER_SLICE):
                    count = min(FRAMES_PER_SLICE, header.frames - start)
                    data = source.read(count * header.frame.bytes)
                    copy.write(samples.changed(data, changes, start))
                shutil.copyfileobj(source, copy)
            verification = check_rewritten(
                original,
                temporary,
                changed_channels={
                    channel for plate in samples.plates for channel in plate.channels
                },
                added_group=GROUP,
                changed_parameters=["FORCE_PLATFORM:CORNERS"] if corners else [],
            )
            if target.exists() and not filecmp.cmp(temporary, target, shallow=False):
                raise ValueError(f"{target} exists and is another file; nothing is overwritten")
        return verification


def _moved(head: bytes, header: Header, parameter_blocks: int) -> bytes:
    """Give what comes before the parameters, with the new start of the data."""
    words = np.frombuffer(head, integer_type(header.byte_order, signed=False)).copy()
    if len(head) < BLOCK_BYTES:
        raise ValueError("its parameters begin within the header")
    data_block = header.parameter_block + parameter_blocks
    if data_block != words[DATA_BLOCK] and words[LABEL_RANGE] == LABEL_RANGE_KEY:
        raise ValueError("it has a section of labels and ranges, which this program cannot move")
    words[DATA_BLOCK] = data_block
    return words.tobytes()


def _changed_section(
    section: bytes,
    samples: _PlateSamples,
    compensation: Compensation,
    corners: Sequence[Array],
    stated: Stated,
) -> bytes:
    """Give the parameter section with the group, the data's new start and new corners."""
    order, length = samples.header.byte_order, len(section)
    parameters = samples.header.parameters
    section = with_group(section, order, GROUP, compensation_group(compensation))
    moved = (len(section) - length) // BLOCK_BYTES
    for group, name in DATA_STARTS if moved else ():
        if start := parameters.integer(group, name, 0):
            section = with_values(section, order, group, name, np.array([start + moved]))
    if corners:
        metre = stated.metre(parameters.text("POINT", "UNITS"))
        values = parameters.numbers("FORCE_PLATFORM", "CORNERS")
        by_plate = values if values.ndim == 3 else values[..., np.newaxis]
        for plate, moved_corners in zip(samples.plates, corners, strict=True):
            in_file = moved_corners @ plate.rotation.T + plate.corners.mean(axis=0)
            by_plate[:3, :4, plate.number - 1] = in_file.T / metre
        section = with_values(section, order, "FORCE_PLATFORM", "CORNERS", values)
    return section


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
    Header and samples are compared byte by byte, parameters by their values. Then our reader and
    ezc3d read the rewritten file, and both have to read the same arrays.
    """
    try:
        free = {*changed_parameters, *map(":".join, DATA_STARTS)}
        _require_same(original, written, changed_channels, added_group, free)
        found = compare_readers(written)
        before = found if found == SecondReading(reader()) else compare_readers(original)
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


def _require_same(
    original: Path, written: Path, changed: Collection[int], group: str, free: Collection[str]
) -> None:
    """Refuse a copy that differs where it was not to: header, parameters, samples, what follows.

    In the header only the start of the data is free.
    """
    header, header_again = map(read_header, (original, written))
    before, after = header.parameters, header_again.parameters
    first, second = (np.memmap(path, np.uint8, "r") for path in (original, written))
    different = {*np.flatnonzero(first[:BLOCK_BYTES] != second[:BLOCK_BYTES]).tolist()}
    if different - {16, 17}:
        raise ValueError(f"byte {min(different - {16, 17}) + 1} differs")
    ours, theirs = (
        {f"{g}:{name}": values for g in side.groups for name, values in side.groups[g].items()}
        for side in (before, after)
    )
    added = {name for name in theirs if name.startswith(f"{group}:")}
    for name in sorted({*ours, *theirs} - {*free} - added):
        alike = name in ours and name in theirs and ours[name].shape == theirs[name].shape
        if not alike or ours[name].tobytes() != theirs[name].tobytes():
            raise ValueError(f"parameter {name} differs")
    moved = header_again.data_block - header.data_block
    for place in DATA_STARTS:
        start = before.integer(*place, 0)
        if after.integer(*place, 0) != (start + moved if start else 0):
            raise ValueError(f"parameter {':'.join(place)} is not where the data begin")
    data, data_again = first[header.data_start :], second[header_again.data_start :]
    if len(data) != len(data_again):
        raise ValueError(f"its data section has {len(data_again)} bytes, expected {len(data)}")
    points, channels, size = 4 * header.frame.points, header.frame.channels, header.frame.bytes
    column = np.arange(size // header.frame.word_bytes)
    of_changed = np.isin((column - points) % max(channels, 1), [*changed])
    kept = np.repeat((column < points) | ~of_changed, header.frame.word_bytes)
    for frame in range(header.frames):
        part = slice(frame * size, (frame + 1) * size)
        if (data[part] != data_again[part])[kept].any():
            raise ValueError(f"other samples differ in frame {header.first_frame + frame}")
    if not np.array_equal(data[header.frames * size :], data_again[header.frames * size :]):
        raise ValueError("what follows its samples differs")
