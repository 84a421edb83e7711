"""The original C3D files of a trial or study with compensated force plates, for other programs.

Only the samples of the plates change, and a parameter group says what was done. The copy is made in
slices, and gets its name only after our reader and ezc3d have found nothing else changed.
"""

import filecmp
import shutil
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path, PurePath
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hbm.notes import Note
from hbm.spatial import Array
from pipeline.config.schema import Trial
from pipeline.config.study import Study
from pipeline.io.axes import parse_axes
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
from pipeline.io.input_file import describe_error, file_digest, naming
from pipeline.io.read import file_format
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Compensation, Recording
from pipeline.io.write import whole_file
from pipeline.trial.ground.laboratory import (
    Laboratory,
    bind,
    plate_delays_s,
    with_corrected_plates,
)
from pipeline.trial.ground.platform import moved_corners, platform_pose, pose_at, turned_to_lab
from pipeline.trial.ground.wrenches import plate_artefacts
from pipeline.trial.study_files import read_study_file, read_study_laboratory

PROGRAM: Final = "hbm-residuals"
Frame = Literal["plate", "lab"]
DATA_BLOCK: Final = 8
"""Word of the header that says where the data section begins."""


class Written(NamedTuple):
    """A compensated file.

    Attributes
    ----------
    path
        The file.
    verification
        Which second reader read it and its original and found only the plates changed.
    notes
        What is doubtful about the compensation.
    """

    path: Path
    verification: SecondReading
    notes: tuple[Note, ...]


def write_compensated(
    recording: Recording,
    laboratory: Laboratory,
    target: Path,
    *,
    calibration: Path | None = None,
    belts: Path | None = None,
    frame: Frame | None = None,
    plate_delay_s: float | None = None,
) -> Written:
    """Write a trial's C3D file again with compensated plates.

    Parameters
    ----------
    recording
        The trial, read from a C3D file.
    laboratory
        The treadmill, with the calibration of its platform, its belts or its plates.
    target
        Where to write. A file with other content there is not overwritten.
    calibration, belts
        The files of the calibrations of platform and belts, which the copy names.
    frame
        None changes nothing but the plates' samples: wrenches stay in the plates' own moving
        frame, corners where the file has them. "plate" also moves the corners to the platform's
        mean pose. "lab" expresses every wrench in the lab frame, sample by sample, about the centre
        of the plate's surface in neutral position; the corners stay.
    plate_delay_s
        How much later the plates are than the markers, which show the platform's pose [s]; None
        as their calibration states it.

    Returns
    -------
    Written
        The file, and what is doubtful about it.

    Raises
    ------
    ValueError
        The recording is no C3D file or has no plates, ``target`` is the recording, the calibration
        does not fit it, the pose is needed and unknown, or `rewrite_plates` refuses.
    OSError
        A file cannot be read or written.

    Notes
    -----
    Measured signals stay as they are, without any low-pass, and the prediction is subtracted
    unfiltered too. After the low-pass of the calibration, or a lower one, the plates are those that
    `hbm residuals --calibration` computes.
    """
    if (kind := file_format(recording.source)) != "C3D":
        raise ValueError(
            f"{recording.source.name}: is a {kind} file; c3d copies a C3D file and changes its "
            "plates, so give the trial's C3D file"
        )
    if not recording.plates:
        raise ValueError(f"{recording.source.name}: {recording.why_no_plates}")
    if target.exists() and target.samefile(recording.source):
        raise ValueError(
            f"{recording.source.name}: would be written over the original; name another folder"
        )
    corrected = with_corrected_plates(recording, laboratory.plates)
    artefacts, doubts = plate_artefacts(bind(corrected, laboratory))
    notes = (*corrected.notes[len(recording.notes) :], *doubts)
    pose = None
    if frame is not None:
        platform = laboratory.treadmill.platform
        pose, pose_notes = platform_pose(recording, platform, recording.markers.time)
        notes += pose_notes
        if pose is None:
            raise ValueError(
                f"{recording.source.name}: --frame {frame} needs the pose of the platform: name "
                "its markers or channels"
            )
    changes, corners = list[Array](), list[Array]()
    for k, (plate, after, artefact) in enumerate(
        zip(recording.plates, corrected.plates, artefacts, strict=True)
    ):
        change = after.wrench_in_plate - plate.wrench_in_plate - artefact
        if pose is not None and frame == "plate":
            corners.append(moved_corners(plate, pose))
        elif pose is not None:
            delay_s = plate_delays_s(recording.plates, laboratory.plates, plate_delay_s)[k]
            at_samples = pose_at(recording, pose, plate.time - delay_s)
            in_lab = turned_to_lab(plate, plate.wrench_in_plate + change, at_samples)
            change = in_lab - plate.wrench_in_plate
        change[~np.isfinite(plate.wrench_in_plate).all(axis=1)] = 0  # what is unknown stays so
        changes.append(change)
    of_plates = laboratory.plates
    done = Compensation(
        software=f"{PROGRAM} {version(PROGRAM)}",
        plates=tuple(plate.number for plate in recording.plates),
        calibration=calibration.name if calibration else "",
        calibration_sha256=file_digest(calibration) if calibration else "",
        belts=belts.name if belts else "",
        belts_sha256=file_digest(belts) if belts else "",
        plate_calibration=of_plates.name if of_plates else "",
        plate_calibration_sha256=of_plates.sha256 if of_plates else "",
        cutoff_hz=laboratory.treadmill.cutoff_hz if laboratory.calibration else None,
        frame=frame or "recorded",
    )
    # markers show the unit of the corners: in the file's axes, as these are
    in_file = recording.markers.position @ parse_axes(",".join(recording.axes))
    verification = rewrite_plates(
        *(recording.source, target, changes, done, corners),
        options=recording.options,
        position=in_file,
    )
    return Written(target, verification, notes)


def write_compensated_study(
    study: Study, out: Path, frame: Frame | None
) -> Iterator[tuple[str, Written | str]]:
    """Write the C3D file of every trial of a study again with compensated plates.

    Parameters
    ----------
    study
        The study; its ``[treadmill]`` or ``[plates]`` names a calibration.
    out
        Folder for the files, which keep their names relative to the study's folder.
    frame
        As for `write_compensated`.

    Yields
    ------
    tuple
        Name of each recording, in the study's order, and its compensated file, or the reason why
        there is none. A failure stops no other one.

    Raises
    ------
    ValueError
        The study has no calibration, or it cannot be read or fitted.
    OSError
        The calibration cannot be read.
    """
    treadmill = study.file.treadmill
    laboratory = read_study_laboratory(study)
    if laboratory.calibration is None and not laboratory.belts and laboratory.plates is None:
        raise ValueError(
            f"{study.folder}: study.toml names no calibration in [treadmill] or [plates], so that "
            "there is nothing to compensate its plates with"
        )
    for name, trial in recordings_of(study).items():
        try:
            if PurePath(name).is_absolute() or ".." in PurePath(name).parts:
                raise ValueError(f"{name}: lies outside the study's folder")
            recording = read_study_file(study, name, trial)
            written = write_compensated(
                recording,
                laboratory,
                out / name,
                calibration=study.path(treadmill.calibration) if treadmill.calibration else None,
                belts=study.path(treadmill.belt.calibration) if treadmill.belt else None,
                frame=frame,
                plate_delay_s=study.file.settings.plate_delay_s,
            )
        except Exception as error:
            yield name, describe_error(error)
        else:
            yield name, written


def recordings_of(study: Study) -> dict[str, Trial]:
    """Give every recording of a study's trials once: name of the file -> its trial."""
    return {
        trial.file: trial
        for trial in study.trials.values()
        if trial.file is not None and trial.exclude is None
    }


def _file_plates(
    header: Header, options: ReadOptions | None = None, position: Array | None = None
) -> list[PlateLayout]:
    """Give a file's plates, each with channels of its own; parameters as of `plate_layouts`."""
    plates, _ = plate_layouts(header, options or ReadOptions(), position)
    if not plates:
        raise ValueError("the file has no force plates")
    owners = Counter(channel for plate in plates for channel in plate.channels)
    for channel, count in owners.items():
        if count > 1:
            raise ValueError(f"FORCE_PLATFORM:CHANNEL names {header.channels[channel][0]} twice")
    return plates


def _changed_frames(
    data: bytes,
    header: Header,
    plates: Sequence[PlateLayout],
    changes: Sequence[Array],
    first_frame: int,
) -> bytes:
    """Change the plates' wrenches in some frames of the data section; as `rewrite_plates`."""
    frame = header.frame
    # a sample's value where it is whole, its bytes where it is real
    signed = integer_type(header.byte_order, signed=not is_unsigned(header))
    word = np.dtype("<u4") if header.scale < 0 else signed
    words = np.frombuffer(data, word).reshape(-1, frame.bytes // frame.word_bytes).copy()
    analog = words[:, 4 * frame.points :].reshape(-1, frame.per_channel, frame.channels)
    start = first_frame * frame.per_channel
    for plate, change in zip(plates, changes, strict=True):
        part = change[start : start + len(words) * frame.per_channel]
        stored = analog[..., plate.channels]
        changed = _changed_samples(stored.reshape(len(part), -1), header, plate, part, start)
        analog[..., plate.channels] = changed.reshape(stored.shape)
    return words.tobytes()


def _changed_samples(
    stored: NDArray[np.integer], header: Header, plate: PlateLayout, wrench: Array, start: int
) -> NDArray[np.integer]:
    """Change stored samples of one plate, (N, c), from `start` on, by a change of its wrench.

    A sample whose wrench is not changed keeps its bytes. A ValueError names channel and time where
    a channel cannot hold what it would have to.
    """
    real, order = header.scale < 0, header.byte_order
    scale = analog_scaling(header)[1][[*plate.channels]]
    numbers = floats(stored.tobytes(), order).reshape(stored.shape) if real else stored
    before = numbers.astype(float)
    is_known = np.isfinite(before).all(axis=1)
    change = np.zeros(before.shape)
    change[is_known] = channel_change(plate, wrench[is_known])
    # value = (sample − offset) · scale
    with np.errstate(divide="ignore", invalid="ignore"):
        after = np.where(change == 0, before, before + change / scale)
    unusable = np.broadcast_to((scale == 0) | ~np.isfinite(scale), after.shape)
    faults = {"its scale is 0 or no number": unusable}
    if not real:
        # whole samples are counts of a converter, with its range
        after, limits = np.rint(after), np.iinfo(stored.dtype)
        reason = (
            f"the compensated sample is outside the range of the file's samples, {limits.min} to "
            f"{limits.max}; export the recording with real (floating-point) samples"
        )
        faults[reason] = ~((after >= limits.min) & (after <= limits.max))
    for reason, wrong in faults.items():
        for sample, number in np.argwhere((change != 0) & wrong)[:1].tolist():
            channel, _ = header.channels[plate.channels[number]]
            time_s = (start + sample) / header.frame.per_channel / frame_rate_hz(header)[0]
            where = f"force plate {plate.number}, channel {channel}, at {time_s:.4f} s"
            raise ValueError(f"{where}: {reason}")
    if real:
        after = np.frombuffer(float_bytes(after, order), stored.dtype).reshape(stored.shape)
    return np.where(change == 0, stored, after.astype(stored.dtype))


def rewrite_plates(
    original: Path,
    target: Path,
    changes: Sequence[Array],
    compensation: Compensation,
    corners: Sequence[Array] = (),
    *,
    options: ReadOptions | None = None,
    position: Array | None = None,
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
    options, position
        What was stated about ``original`` when it was read (the copy keeps its own labels and
        units), and its markers, as `plate_layouts` takes both.

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
    with naming(original):
        header = read_header(original)
        if (before := read_compensation(header.parameters)) is not None:
            raise ValueError(f"its plates are compensated already, by {before.software}")
        plates = _file_plates(header, options, position)
        parameter_start = (header.parameter_block - 1) * BLOCK_BYTES
        with whole_file(target) as temporary:
            with original.open("rb") as source, temporary.open("wb") as copy:
                head = source.read(parameter_start)
                section = source.read(header.data_start - parameter_start)
                group = compensation_group(compensation)
                section = with_group(section, header.byte_order, GROUP, group)
                copy.write(_moved(head, header, len(section) // BLOCK_BYTES))
                copy.write(_changed_section(section, header, plates, corners))
                # some megabytes at a time: much for NumPy, and little beside the trial
                for start in range(0, header.frames, 4096):
                    count = min(4096, header.frames - start)
                    data = source.read(count * header.frame.bytes)
                    copy.write(_changed_frames(data, header, plates, changes, start))
                shutil.copyfileobj(source, copy)
            verification = check_rewritten(
                original,
                temporary,
                changed_channels={channel for plate in plates for channel in plate.channels},
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
    # 12345 in word 147: the file has a section of labels and ranges
    if data_block != words[DATA_BLOCK] and words[147] == 12345:
        raise ValueError("it has a section of labels and ranges, which this program cannot move")
    words[DATA_BLOCK] = data_block
    return words.tobytes()


def _changed_section(
    section: bytes, header: Header, plates: Sequence[PlateLayout], corners: Sequence[Array]
) -> bytes:
    """Give a parameter section that may have grown the data's new start, and new corners."""
    order, parameters = header.byte_order, header.parameters
    moved = header.parameter_block + len(section) // BLOCK_BYTES - header.data_block
    for group, name in DATA_STARTS if moved else ():
        if start := parameters.integer(group, name, 0):
            section = with_values(section, order, group, name, np.array([start + moved]))
    if corners:
        values = parameters.numbers("FORCE_PLATFORM", "CORNERS")
        by_plate = values if values.ndim == 3 else values[..., np.newaxis]
        for plate, moved_corners in zip(plates, corners, strict=True):
            # from the plate's axes about its centre to the file's
            in_file = moved_corners @ plate.rotation.T + plate.corners.mean(axis=0)
            stored = by_plate[:3, :4, plate.number - 1]
            # the unit of the file's corners [m]
            unit = np.ptp(plate.corners, axis=0).max() / np.ptp(stored, axis=1).max()
            by_plate[:3, :4, plate.number - 1] = in_file.T / unit
        section = with_values(section, order, "FORCE_PLATFORM", "CORNERS", values)
    return section


def check_rewritten(
    original: Path,
    written: Path,
    *,
    changed_channels: Collection[int],
    changed_parameters: Collection[str] = (),
) -> SecondReading:
    """Check that a rewritten C3D file differs from its original only where it was to.

    Free are also the group that says what was done, and where the data begin.

    Parameters
    ----------
    original, written
        Both files.
    changed_channels
        Indices from 0 of the analog channels whose samples may differ.
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
        _require_same(original, written, changed_channels, free)
        reading = compare_readers(written)
        before = reading if reading == SecondReading(reader()) else compare_readers(original)
        if reading.refusal and not before.refusal:
            raise ValueError(f"{reading.reader} reads the original only: {reading.refusal}")
        if reading.disagreements and not before.disagreements:
            raise ValueError(f"{reading.disagreements[0]}, and not of the original")
    except ValueError as error:
        raise ValueError(f"the copy is not {original.name} written again: {error}") from error
    if before.disagreements:
        return SecondReading(
            reading.reader, f"it reads the original otherwise: {before.disagreements[0]}"
        )
    return reading


def _require_same(
    original: Path, written: Path, changed: Collection[int], free: Collection[str]
) -> None:
    """Refuse a copy that differs where it was not to: header, parameters, samples, what follows.

    In the header only the start of the data is free.
    """
    header, header_again = map(read_header, (original, written))
    first, second = (np.memmap(path, np.uint8, "r") for path in (original, written))
    different = {*np.flatnonzero(first[:BLOCK_BYTES] != second[:BLOCK_BYTES]).tolist()}
    if different - {16, 17}:
        raise ValueError(f"byte {min(different - {16, 17}) + 1} differs")
    before, after = (
        {
            f"{group}:{name}": (values.shape, values.tobytes())
            for group, members in side.parameters.groups.items()
            for name, values in members.items()
        }
        for side in (header, header_again)
    )
    for name in sorted({*before, *after} - {*free}):
        if before.get(name) != after.get(name) and not name.startswith(f"{GROUP}:"):
            raise ValueError(f"parameter {name} differs")
    moved = header_again.data_block - header.data_block
    for place in DATA_STARTS:
        start = header.parameters.integer(*place, 0)
        if header_again.parameters.integer(*place, 0) != (start + moved if start else 0):
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
