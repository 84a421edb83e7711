"""ASCII exports of Vicon Nexus."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array, rotate_wrench
from pipeline.io.axes import parse_axes, settle_axes
from pipeline.io.labels import rename_markers
from pipeline.io.moment_reference import wrench_about_origin
from pipeline.io.nexus_blocks import Block, Group, read_blocks
from pipeline.io.recording import Analog, Metadata, Plate, Recording
from pipeline.io.text_table import read_lines
from pipeline.io.units import check_span, force_in_n, length_in_m, moment_in_nm


@dataclass(frozen=True, slots=True)
class _Channels:
    """A plate's columns in SI units, the file's axes and signs."""

    force: Array
    moment: Array
    pressure: Array | None


def read_nexus(
    path: str | Path, axes: str | None = None, *, rename: Mapping[str, str] | None = None
) -> Recording:
    """Read an ASCII export of Vicon Nexus (.csv or .txt).

    Parameters
    ----------
    path
        The file, with a Trajectories block and, for plates, a Devices block.
    axes
        Lab directions of the file's x, y and z axis; inferred from the markers where absent.
    rename
        Label in the file (without subject prefix) -> label wanted.

    Returns
    -------
    Recording
        SI units, lab axes; times start at 0 at the first frame. Devices with Force and Moment are
        plates with identity rotation and centre at the lab origin, so that their wrench is about
        the lab origin; their corners are unknown (NaN). Other devices are analog channels, Model
        Outputs of three components are model outputs. Prefer C3D: it also knows the plates'
        corners and the events.

    Raises
    ------
    ValueError
        The file is damaged, truncated, or contradicts its units, axes or itself. One line.
    OSError
        The file cannot be opened.

    Notes
    -----
    Nexus exports forces in the lab's axes, by its settings as acting on the plate or on the
    subject. Forces that pull down on average are those on the plate, for nobody hangs from one, and
    change sign. Its moments are about the plate's centre, which the file does not state:
    `wrench_about_origin` finds it from the centres of pressure.
    """
    path = Path(path)
    try:
        return _read(path, axes, rename or {})
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error


def _read(path: Path, axes: str | None, rename: Mapping[str, str]) -> Recording:
    blocks, skipped = read_blocks(read_lines(path))
    if "trajectories" not in blocks:
        raise ValueError(f"no Trajectories block; blocks: {', '.join(blocks)}")
    block = blocks["trajectories"]
    markers = [group for group in block.groups if group.components[:3] == ("X", "Y", "Z")]
    markers = [group for group in markers if group.name and not group.name.startswith("*")]
    owners = sorted({prefix for g in markers if (prefix := g.name.rpartition(":")[0])})
    labels = [group.name.rpartition(":")[2] for group in markers]
    if twice := sorted({name for name in labels if labels.count(name) > 1}):
        raise ValueError(f"several markers have the same label: {', '.join(twice)}")
    if not markers:
        raise ValueError("the Trajectories block names no markers with X, Y and Z")
    position = np.stack(
        [block.vector(group) * length_in_m(group.units[0]) for group in markers], axis=1
    )
    position[~np.isfinite(position).all(axis=-1) | ~position.any(axis=-1)] = np.nan
    check_span(position, markers[0].units[0])
    names = tuple(rename_markers(dict.fromkeys(labels, 0), rename))
    settled, axes_notes = settle_axes(axes, position, names)
    to_lab = parse_axes(settled)
    notes = [*axes_notes, *skipped]
    if owners:
        notes.append(Note.of("subject_prefixes_removed", subjects=owners))
    plates: list[Plate] = []
    analog = None
    if "devices" in blocks:
        plates, analog, device_notes = _devices(
            blocks["devices"], block.frame[0], block.rate_hz, to_lab
        )
        notes += device_notes
    return Recording(
        source=path,
        markers=Markers((block.frame - block.frame[0]) / block.rate_hz, names, position @ to_lab.T),
        plates=tuple(plates),
        analog=analog,
        first_frame=int(block.frame[0]),
        metadata=Metadata(software="Vicon Nexus", subject=next(iter(owners), "")),
        model_outputs=_outputs(blocks.get("model outputs"), block),
        notes=tuple(notes),
    )


def _devices(
    block: Block, first: float, rate_hz: float, to_lab: Array
) -> tuple[list[Plate], Analog | None, list[Note]]:
    """Give plates and analog channels in lab axes."""
    per_frame = block.rate_hz / rate_hz
    if abs(per_frame - round(per_frame)) > 1e-6 or block.sub_frame.max() >= round(per_frame):
        raise ValueError(
            f"Devices at {block.rate_hz:g} Hz do not go with Trajectories at {rate_hz:g} Hz "
            f"and sub frames up to {block.sub_frame.max():g}"
        )
    count = (block.frame - first) * round(per_frame) + block.sub_frame
    if (np.diff(count) != 1).any():
        raise ValueError("Devices: frames and sub frames do not count upward one by one")
    time = count / block.rate_hz
    measured: dict[str, dict[str, Group]] = {}
    for group in block.groups:
        stem, _, quantity = group.name.rpartition(" - ")
        if quantity.lower() in ("force", "moment", "cop") and len(group.components) >= 3:
            measured.setdefault(stem, {})[quantity.lower()] = group
    measured = {stem: parts for stem, parts in measured.items() if "force" in parts}
    found = {stem: _channels(block, stem, parts) for stem, parts in measured.items()}
    push = sum(float(np.nan_to_num(c.force @ to_lab[2]).mean()) for c in found.values())
    sign = -1.0 if push < 0 else 1.0
    notes = [Note.of("forces_reversed")] if push < 0 else []
    plates = []
    for number, (stem, channels) in enumerate(found.items(), start=1):
        wrench, note = wrench_about_origin(
            sign * channels.force,
            sign * channels.moment,
            channels.pressure,
            to_lab[2],
            f"plate {number} ({stem})",
        )
        plates.append(Plate.at_origin(number, time, rotate_wrench(wrench, to_lab)))
        notes.append(note)
    used = [group for parts in measured.values() for group in parts.values()]
    return plates, _analog(block, [g for g in block.groups if g not in used], time), notes


def _channels(block: Block, stem: str, parts: Mapping[str, Group]) -> _Channels:
    if "moment" not in parts or "cop" not in parts:
        raise ValueError(
            f"device {stem!r} has forces but no {'moments' if 'moment' not in parts else 'CoP'}; "
            "export Force, Moment and CoP: only together they give the wrench in the lab"
        )
    force, moment, pressure = (
        block.vector(parts[name]) * unit(parts[name].units[0])
        for name, unit in (("force", force_in_n), ("moment", moment_in_nm), ("cop", length_in_m))
    )
    return _Channels(force, moment, pressure)


def _analog(block: Block, groups: list[Group], time: Array) -> Analog | None:
    channels = [
        (f"{group.name} {component}".strip(), unit, group.first + k)
        for group in groups
        for k, (component, unit) in enumerate(zip(group.components, group.units, strict=True))
    ]
    if not channels:
        return None
    names, units, columns = zip(*channels, strict=True)
    return Analog(time, names, units, block.values[:, list(columns)])


def _outputs(block: Block | None, trajectories: Block) -> dict[str, Array]:
    if block is None:
        return {}
    if not np.array_equal(block.frame, trajectories.frame):
        raise ValueError("Model Outputs and Trajectories are not of the same frames")
    return {
        group.name.rpartition(":")[2]: block.vector(group)
        for group in block.groups
        if group.name and group.components == ("X", "Y", "Z")
    }
