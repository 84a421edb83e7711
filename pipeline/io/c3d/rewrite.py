"""A C3D file written again with other plate wrenches: its own bytes but for the plates' samples.

A parameter group says what was done. The copy is made in slices, and gets its name only after our
reader and another one have found nothing else changed.
"""

import filecmp
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.io.c3d.byte_order import BLOCK_BYTES, integer_type
from pipeline.io.c3d.compensation import GROUP, compensation_group, read_compensation
from pipeline.io.c3d.encoding import with_group, with_values
from pipeline.io.c3d.header import DATA_STARTS, Header, read_header
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.c3d.plate_samples import PlateSamples, plate_samples
from pipeline.io.c3d.second_reader.rewritten import Verification, check_rewritten
from pipeline.io.recording import Compensation
from pipeline.io.stated import Stated
from pipeline.io.write import remove_leftovers, whole_file

FRAMES_PER_SLICE: Final = 4096
"""Some megabytes at a time: large enough for NumPy, small beside the trial."""
DATA_BLOCK: Final = 8
"""Word of the header that says where the data section begins."""
LABEL_RANGE: Final = 147
LABEL_RANGE_KEY: Final = 12345
"""This number in this word of the header: the file has a section of labels and ranges."""


def rewrite_plates(
    original: Path,
    target: Path,
    changes: Sequence[Array],
    compensation: Compensation,
    corners: Sequence[Array] = (),
    *,
    stated: Stated | None = None,
) -> Verification:
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
    Verification
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
    try:
        return _rewrite(original, target, changes, compensation, corners, stated or Stated())
    except ValueError as error:
        if original.name in str(error):
            raise
        raise ValueError(f"{original.name}: {error}") from error


def _rewrite(
    original: Path,
    target: Path,
    changes: Sequence[Array],
    compensation: Compensation,
    corners: Sequence[Array],
    stated: Stated,
) -> Verification:
    header, parameters = read_header(original)
    if (before := read_compensation(parameters)) is not None:
        raise ValueError(f"its plates are compensated already, by {before.software}")
    samples = plate_samples(header, parameters, stated)
    _require_whole(changes, samples, header.frames * header.analog_per_frame)
    parameter_start = (header.parameter_block - 1) * BLOCK_BYTES
    remove_leftovers(target.parent)
    with whole_file(target) as temporary:
        with original.open("rb") as source, temporary.open("wb") as copy:
            head = source.read(parameter_start)
            section = source.read(header.data_start - parameter_start)
            section = _changed_section(section, samples, parameters, compensation, corners, stated)
            copy.write(_moved(head, header, len(section) // BLOCK_BYTES) + section)
            for start in range(0, header.frames, FRAMES_PER_SLICE):
                count = min(FRAMES_PER_SLICE, header.frames - start)
                data = source.read(count * header.frame.bytes)
                copy.write(samples.changed(data, changes, start))
            shutil.copyfileobj(source, copy)
        verification = check_rewritten(
            original,
            temporary,
            changed_channels={channel for plate in samples.plates for channel in plate.channels},
            added_group=GROUP,
            changed_parameters={":".join(name) for name in DATA_STARTS}
            | ({"FORCE_PLATFORM:CORNERS"} if corners else set()),
        )
        if target.exists() and not filecmp.cmp(temporary, target, shallow=False):
            raise ValueError(f"{target} exists and is another file; nothing is overwritten")
    return verification


def _require_whole(changes: Sequence[Array], samples: PlateSamples, expected: int) -> None:
    for plate, change in zip(samples.plates, changes, strict=True):
        if change.shape != (expected, 6) or not np.isfinite(change).all():
            raise ValueError(
                f"the change of plate {plate.number} must have shape ({expected}, 6) and no gaps, "
                f"got {change.shape}"
            )


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
    samples: PlateSamples,
    parameters: Parameters,
    compensation: Compensation,
    corners: Sequence[Array],
    stated: Stated,
) -> bytes:
    """Give the parameter section with the group, the data's new start and new corners."""
    order, length = samples.header.byte_order, len(section)
    section = with_group(section, order, GROUP, compensation_group(compensation))
    moved = (len(section) - length) // BLOCK_BYTES
    for group, name in DATA_STARTS if moved else ():
        if start := parameters.integer(group, name, 0):
            section = with_values(section, order, group, name, np.array([start + moved]))
    if corners:
        metre, _ = stated.marker_unit(parameters.text("POINT", "UNITS"))
        values = parameters.numbers("FORCE_PLATFORM", "CORNERS")
        by_plate = values if values.ndim == 3 else values[..., np.newaxis]
        for plate, moved_corners in zip(samples.plates, corners, strict=True):
            in_file = moved_corners @ plate.rotation.T + plate.corners.mean(axis=0)
            by_plate[:3, :4, plate.number - 1] = in_file.T / metre
        section = with_values(section, order, "FORCE_PLATFORM", "CORNERS", values)
    return section
