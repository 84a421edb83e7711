"""Markers and plates as columns of a file: in SI units, in lab axes, about the lab's origin."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.samples import medians_of_known
from hbm.spatial import Array, frozen, rotate_wrench, transform_wrench
from hbm.spelling import listed, short
from pipeline.io.axes import above_feet, find_sites, mean_force, parse_axes, settle_axes, split_axes
from pipeline.io.labels import join_trajectories, rename_markers, require_unique, without_prefixes
from pipeline.io.read_options import CONVERT, ReadOptions, parse_mending
from pipeline.io.recording import Fact, Plate, Recording, impossible_samples, saying
from pipeline.io.units import LENGTHS, length_in_m

LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "positions")
MOMENTS: Final = read_numbers("pipeline.io", "thresholds.toml", "moments")
SI_UNITS: Final = ("N", "Nm", "m")
"""Of plates in formats that state none."""
DFLOW_PLATE: Final = re.compile(r"FP(\d+)\.(For|Mom|Cop)([XYZ])")
"""A plate's column as D-Flow names it, about the origin of the markers' axes."""
FREE: Final = "at the force's point (free torque)"
"""Where moments are that belong to a force at a point."""


@dataclass(frozen=True, slots=True)
class FileMarkers:
    """Markers of a file under the labels wanted, in the file's axes.

    Attributes
    ----------
    names
        Labels.
    position
        (T, M, 3) [m]; what no camera saw is NaN.
    unit
        Of positions, as the file writes it.
    notes
        On labels, and what was joined or made gaps.
    absent
        Labels to rename that are not there.
    """

    names: tuple[str, ...]
    position: Array
    unit: str
    notes: Sequence[Note | Fact]
    absent: tuple[str, ...] = ()


def file_markers(
    labels: Sequence[str],
    unit: str,
    positions: Callable[[list[int]], Array],
    options: ReadOptions,
    held: bool = False,
) -> FileMarkers:
    """Give the markers wanted of a file.

    ``positions`` gives those of some labels by their indices, (M,) -> (T, M, 3), in the file's
    unit; ``held`` says that unseen ones stay where they were. A ValueError as `settle_markers`.
    """
    bare, notes = without_prefixes(labels, options)
    return settle_markers(bare, unit, positions([*bare]), options, notes, held)


def settle_markers(
    labels: Mapping[int, str],
    unit: str,
    position: Array,
    options: ReadOptions,
    notes: Iterable[Note | Fact],
    held: bool = False,
) -> FileMarkers:
    """Give markers under the labels wanted, one of each label, in m.

    Gaps are positions that are no numbers, at the origin, codes of missing ones or, where they are
    ``held``, the same as in the frame before.

    Parameters
    ----------
    labels
        Place in the file, from 0 -> label without prefix, of each column.
    unit, position
        Positions, (T, M, 3), in that unit; used up.
    notes
        On labels so far.

    Raises
    ------
    ValueError
        Labels or unit are unknown or contradictory, or the unit contradicts the markers' extent.
    """
    metre = options.metre(unit) if labels else 1.0
    remarks = [*notes, *without_impossible_positions([*labels.values()], position, metre)]
    if held:  # one by one: a file may be as large as the memory allows
        same = [(path[1:] == path[:-1]).all(axis=-1) for path in position.swapaxes(0, 1)]
        position[1:][np.transpose(same)] = np.nan
        if count := np.count_nonzero(same):
            remarks.append(Fact("missing", "markers", f"{count} samples held at their last place"))
    position[~np.isfinite(position).all(axis=-1) | ~position.any(axis=-1)] = np.nan
    position *= metre
    columns, joined = join_trajectories(labels, position, options)
    remarks += joined
    with saying(remarks):
        markers, renamed, absent = rename_markers(columns, options)
        # copied only where columns are left out: a file may be as large as the memory allows
        if len(markers) < len(labels):
            position = position[:, [*markers.values()]]
        _require_extent(position, tuple(markers), options, unit)
    return FileMarkers(tuple(markers), position, unit, [*remarks, *renamed], absent)


def without_impossible_positions(
    names: Sequence[str], position: Array, metre: float, of: str = "markers"
) -> Iterator[Note | Fact]:
    """Make gaps of positions, (T, M, 3), that cannot have been measured, and count them.

    Those are one number in x, y and z, a code of missing ones as programs write 9999, −1 or
    −3.697314e28, and those that no laboratory has. A measured position is on the diagonal of the
    axes by chance: a code counts where it occurs twice, and not where the marker rests. If most
    positions are too far away, their unit is wrong. ``metre`` is one of that unit [m].
    """
    x = position[..., 0]
    equal = (position == x[..., None]).all(axis=-1) & (x != 0)
    codes, counts = np.unique(x[equal], return_counts=True)
    for code in codes[counts > 1]:
        # samples at the code, but of a marker that is there in its other samples too
        written = equal & (x == code)
        for column in np.flatnonzero(written.any(axis=0)).tolist():
            others = position[~written[:, column], column]
            others = others[np.isfinite(others).all(axis=-1) & others.any(axis=-1)]
            away = np.abs(np.median(others, axis=0) - code).max() if len(others) else np.inf
            written[:, column] &= away * metre > LIMITS.least_away_from_code
        position[written] = np.nan
        by_name = zip(names, written.sum(axis=0), strict=True)
        if counted := [f"{short(name)} {n}" for name, n in by_name if n]:
            reason = f"samples at {code:.7g} in x, y and z, a code of missing ones"
            yield Fact("missing", of, f"{reason}: {listed(counted)}")
    # where most are too far away, the unit is wrong, which the extent shows
    far = (np.abs(position) > LIMITS.farthest / metre).any(axis=-1)
    if 2 * np.count_nonzero(far) < np.count_nonzero(np.isfinite(x) & position.any(axis=-1)):
        position[far] = np.nan
        yield from impossible_samples(names, far.sum(axis=0))


def _require_extent(
    position: Array, names: tuple[str, ...], options: ReadOptions, unit: str
) -> None:
    """Refuse positions, (T, M, 3) [m], whose extent is that of no recording or of no person."""
    used, several = options.units or unit, np.isfinite(position).all(axis=-1).sum(axis=1) > 1
    if not several.any():
        return
    highest, lowest = (extreme.reduce(position, axis=1)[several] for extreme in (np.fmax, np.fmin))
    above = above_feet(position, find_sites(names, options.marker_set))
    for what, vectors, (least, largest) in (
        # diagonal of the box around all markers of a frame; height of one who stands
        ("the markers spread over", highest - lowest, LIMITS.spans),
        ("pelvis or shoulders and feet are apart by", above, LIMITS.above_feet),
    ):
        with np.errstate(over="ignore", invalid="ignore"):
            size = float(medians_of_known(np.linalg.norm(vectors, axis=1)))
        if not (size <= least or size >= largest):
            continue
        # the unit is said in which the extent comes nearest to the middle of what is possible
        metres = {name: size / length_in_m(used) * metre for name, metre in LENGTHS.items()}
        middle = np.sqrt(least * largest)
        right = min(metres, key=lambda name: abs(np.log(metres[name] / middle + 1e-9)))
        stating = f'--units {right}, or units = "{right}" in study.toml'
        remedy = f"{metres[right]:.3g} m in {right}: give {stating}"
        if not least < metres[right] < largest:
            remedy = "no unit m, cm or mm mends that: correct the positions"
        fault = f"{size:.3g} m if their unit is {short(used)!r}, expected {least} to {largest:g} m"
        raise ValueError(f"{what} {fault}; {remedy}")


@dataclass(frozen=True, slots=True)
class PlateColumns:
    """What a file holds of one plate in its axes, (N, 3) each.

    Attributes
    ----------
    number, name
        Its number from 1, and what messages call it.
    time
        (N,) [s].
    force, moment
        In the units of the file.
    pressure
        Centre of pressure from the file's origin; None if absent.
    units
        Of force, moment and pressure.
    place
        Where it lies, in the file's axes; None where the file does not say.
    """

    number: int
    name: str
    time: Array
    force: Array
    moment: Array
    pressure: Array | None = None
    units: tuple[str, ...] = field(kw_only=True, default=SI_UNITS)
    place: Plate | None = field(kw_only=True, default=None)

    def in_si(self, options: ReadOptions) -> "PlateColumns":
        """Give the same in SI units."""
        in_si: dict[str, Any] = {
            quantity: getattr(self, quantity) * options.plate_unit(quantity, unit)
            for quantity, unit in zip(CONVERT, self.units, strict=True)
            if getattr(self, quantity) is not None
        }
        return replace(self, **in_si)

    def without_codes(self) -> list[Note | Fact]:
        """Make centres of pressure that are none gaps, and zeros without force; in SI units."""
        if self.pressure is None:
            return []
        size, of = np.linalg.norm(self.force, axis=1), "centres of pressure"
        small = size <= LIMITS.least_force_ratio * np.nanmax(size, initial=0)
        self.pressure[size == 0] = 0
        # noise by hardly a force is far away too, but not the same in x, y and z
        judged = ~small | (self.pressure == self.pressure[:, :1]).all(axis=1)
        pressure = self.pressure[judged]
        facts = [*without_impossible_positions([self.name], pressure[:, None], 1.0, of)]
        self.pressure[judged] = np.where(small[judged, None], np.nan_to_num(pressure), pressure)
        return facts


def vectors(columns: Mapping[str, Array], stems: Iterable[str], axes: str = "XYZ") -> Array:
    """Stack the columns of several vectors, (N, stems, 3); a ValueError where one is absent."""
    names = [f"{stem}{axis}" for stem in stems for axis in axes]
    if absent := [name for name in names if name not in columns]:
        raise ValueError(f"{short(absent[0])} is absent, but others that belong to it are there")
    stacked = np.stack([columns[name] for name in names], axis=1)
    return stacked.reshape(len(stacked), -1, 3)


def plate_of(
    number: int,
    name: str,
    time: Array,
    columns: Mapping[str, Array],
    stems: Sequence[str],
    *,
    axes: str = "XYZ",
    units: tuple[str, ...] = SI_UNITS,
) -> PlateColumns | Fact:
    """Give a plate from the columns of force, moment and, if given, pressure; or why it lacks."""
    try:
        stacked = vectors(columns, stems, axes)
    except ValueError as error:
        return Fact("left_out", name, str(error), plate=True)
    return PlateColumns(number, name, time, *stacked.transpose(1, 0, 2), units=units)


def dflow_plates(
    columns: Mapping[str, Array], time: Array, units: Mapping[str, str] = MappingProxyType({})
) -> Iterator[PlateColumns | Fact]:
    """Give the plates whose columns are named as D-Flow names them, such as FP1.ForX.

    Units are those of the columns by their names; without any, N, N·m and m.
    """
    matches = (DFLOW_PLATE.fullmatch(name) for name in columns)
    for number in dict.fromkeys(int(match[1]) for match in matches if match):
        stems = [f"FP{number}.{part}" for part in ("For", "Mom", "Cop")]
        usual = zip((f"{stem}X" for stem in stems), SI_UNITS, strict=True)
        of_plate = tuple(units.get(name, unit) for name, unit in usual)
        stems = stems[: 3 if f"{stems[2]}X" in columns else 2]
        yield plate_of(number, f"plate {number}", time, columns, stems, units=of_plate)


Located = tuple[Array, str]
"""A wrench about the origin of the file's axes, (N, 6) [N, N·m], and where its moments were."""


def recording_of(
    source: Path,
    options: ReadOptions,
    markers: FileMarkers,
    time: Array,
    plates: Iterable[PlateColumns | Fact] = (),
    *,
    axes: str = "",
    program: str = "",
    on_subject: bool = True,
    torques: bool = False,
    placed: Sequence[Plate] = (),
    witnesses: Sequence[Plate] = (),
    units: Sequence[str] = (),
    screen_up: str = "",
    notes: Iterable[Note | Fact] = (),
    **others: Any,
) -> Recording:
    """Make a recording from the columns of a file: SI units, lab axes, plates about the origin.

    Parameters
    ----------
    source, options
        The file, and what a person states about it.
    markers, time
        Its markers, and their times, (T,) [s].
    plates
        Its plates, or why they are left out.
    axes, program
        Those that the file or its program defines; empty to infer them.
    on_subject
        Whether forces are known to act on the subject. Otherwise they change sign where they pull
        on average, for nobody hangs from a plate, and do not show the axes.
    torques
        Whether moments are torques at the centres of pressure (`wrench_of_torque`), or about one
        point (`wrench_about_origin`).
    placed
        Further plates, in the file's axes.
    witnesses, units
        Those of them that show the axes, and their units as the file writes them.
    screen_up
        Which axis the file says is up on a screen.
    notes, others
        What was done, is in doubt or to be noted, and further attributes of the recording.
    """
    plates = list(plates)
    remarks = [*markers.notes, *notes, *(p for p in plates if isinstance(p, Fact))]
    described = [plate for plate in plates if isinstance(plate, PlateColumns)]
    mended = {parse_mending(text)[0] for text in options.mend_plates}  # once axes are known
    with saying(remarks):
        columns = [plate.in_si(options) for plate in described]
        remarks += [fact for plate in columns for fact in plate.without_codes()]
        # a plate that a person mends does not show the axes until it is mended
        forces = [mean_force(p.force) * (p.number not in mended) for p in columns if on_subject]
        forces += [p.rotation @ mean_force(p.wrench_in_plate[:, :3]) for p in witnesses]
        settled, axes_notes = settle_axes(
            options.axes or axes or None,
            markers.position,
            markers.names,
            marker_set=options.marker_set,
            plate_normals=[plate.rotation[:, 2] for plate in witnesses],
            plate_forces=forces,
            screen_up=screen_up,
            by=f"as {program} defines them" if options.axes is None else options.axes_by,
            file=source.name,
        )
        to_lab = parse_axes(settled)
        remarks = [*axes_notes, *remarks]
        written = [*units, *(unit for plate in described for unit in plate.units)]
        remarks += options.unit_notes([markers.unit], written)
        # gravity acts along up, whoever stores its reaction or the load on the plates
        total = to_lab @ sum((mean_force(plate.force) for plate in columns), np.zeros(3))
        loaded_n = max(MOMENTS.least_vertical_force, 2 * abs(total[2]))
        if not on_subject and np.linalg.norm(total) > loaded_n:
            why = "forces and markers have different axes; export both in the same ones"
            raise ValueError(f"the plates' mean force is level in the axes of the markers: {why}")
        if not on_subject and total[2] < 0:
            columns = [replace(p, force=-p.force, moment=-p.moment) for p in columns]
            remarks.append(Note.of("forces_reversed"))
        made = [plate.turned(to_lab) for plate in placed]
        moments, locate = [], wrench_of_torque if torques else wrench_about_origin
        for plate in columns:
            wrench, where = locate(plate, to_lab[2])
            read_as = map(options.used_unit, CONVERT, plate.units)
            of_plate = ",".join([*read_as][: 3 if where == FREE else 2])
            made.append(_placed(plate, rotate_wrench(wrench, to_lab), to_lab, of_plate))
            moments.append(f"{plate.name} {where}")
        if moments:
            remarks.append(Note.of("moments_about", plates=moments))
        numbers = (str(plate.number) for plate in made)
        require_unique(numbers, "several plates have the same number")
        position = frozen(to_lab @ np.moveaxis(markers.position, 0, -1))
        return Recording(
            source=source,
            markers=Markers(time, markers.names, np.moveaxis(position, -1, 0)),
            plates=tuple(sorted(made, key=lambda plate: plate.number)),
            options=options,
            axes=split_axes(settled),
            labels_absent=markers.absent,
            facts=tuple(fact for fact in remarks if isinstance(fact, Fact)),
            notes=tuple(note.note if isinstance(note, Fact) else note for note in remarks),
            **others,
        )


def _placed(plate: PlateColumns, wrench: Array, to_lab: Array, units: str) -> Plate:
    """Give a plate by its wrench in the lab about its origin, (N, 6), at its place if known."""
    if plate.place is None:
        return Plate.at_origin(plate.number, plate.time, wrench, units)
    place = plate.place.turned(to_lab)
    if place.rotation[2, 2] > 0:
        raise ValueError(f"{plate.name}: its corners are not in the order of its axes: z is up")
    in_plate = transform_wrench(wrench, place.rotation.T, -place.rotation.T @ place.center)
    return replace(place, time=plate.time, wrench_in_plate=in_plate, units=units)


def wrench_about_origin(plate: PlateColumns, up: Array) -> Located:
    """Give a plate's wrench about the origin of the file's axes, (N, 6) [N, N·m], and how.

    Parameters
    ----------
    plate
        In SI units.
    up
        Unit vector up in the file's axes, (3,).

    Raises
    ------
    ValueError
        The moments fit the centres of pressure about no point, or the vertical moment is absent.

    Notes
    -----
    A foot pushes but does not pull, so moment − (pressure − point) × force is vertical. Files do
    not state the point. It is the simplest one that explains the loaded samples as well as the
    best one does: the origin, the centre of the surface where that is known, a point on the floor,
    a point anywhere. The misfit is given as the
    displacement of the centre of pressure that would explain it, median over the samples. Moments
    are taken as about the centre of the surface, or the origin where it is unknown, unchecked,
    without centres of pressure and without load.
    """
    force, moment = plate.force, plate.moment
    center = np.zeros(3) if plate.place is None else plate.place.center
    loaded = np.abs(force @ up) > MOMENTS.least_vertical_force
    if loaded.any() and not (moment[loaded] @ up).any():
        why = "the vertical moment is zero while the plate is loaded; export all three moments"
        raise ValueError(f"{plate.name}: {why}")
    rows = _loaded(plate, up)
    if not len(rows[0]):
        at = "origin of the file's axes" if plate.place is None else "centre of its surface"
        return np.hstack([force, moment + np.cross(center, force)]), f"about the {at}, unchecked"
    point, misfit = _simplest(*rows, up, center)
    if misfit > MOMENTS.largest_misfit:
        fault = f"moments and centres of pressure disagree by {1000 * misfit:.0f} mm about any"
        limit = f"expected less than {1000 * MOMENTS.largest_misfit:.0f} mm"
        raise ValueError(f"{plate.name}: {fault} point, {limit}: units, axes or signs are wrong")
    return _about(plate, point, misfit)


def _loaded(plate: PlateColumns, up: Array) -> tuple[Array, Array, Array]:
    """Give force, moment and pressure of loaded samples, (K, 3); none where they are too few."""
    if plate.pressure is None:
        return (np.empty((0, 3)),) * 3
    rows = np.stack([plate.force, plate.moment, plate.pressure])
    loaded = np.abs(plate.force @ up) > MOMENTS.least_vertical_force
    loaded &= np.isfinite(rows).all(axis=(0, 2)) & plate.pressure.any(axis=1)
    enough = loaded.sum() >= MOMENTS.loaded_samples
    force, moment, pressure = rows[:, loaded if enough else []]
    return force, moment, pressure


def _about(plate: PlateColumns, point: Array, misfit: float) -> Located:
    place = ", ".join(f"{coordinate:.3f}" for coordinate in point)
    where = f"about ({place}) m of the file's axes (within {1000 * misfit:.1f} mm)"
    return np.hstack([plate.force, plate.moment + np.cross(point, plate.force)]), where


def wrench_of_torque(plate: PlateColumns, up: Array) -> Located:
    """Give a wrench about the origin, (N, 6) [N, N·m], from a force, its point and a torque.

    Parameters
    ----------
    plate
        In SI units; ``pressure`` is where the force acts, ``moment`` the torque.
    up
        Unit vector up in the file's axes, (3,).

    Notes
    -----
    The torque t belongs to the force f at the point p: the moment is p × f + t. A foot does not
    pull, so t is vertical where p is the centre of pressure. Some programs write the moment about
    the origin instead, t ≈ p × f + vertical part, which would then count twice. It is taken as
    such where p moves, as centres of pressure do, t is not vertical, and the point that
    `wrench_about_origin` would find explains t within 1 cm; a note says so.
    """
    at = np.zeros_like(plate.force) if plate.pressure is None else plate.pressure
    free = np.hstack([plate.force, np.cross(at, plate.force) + plate.moment]), FREE
    force, torque, point = rows = _loaded(plate, up)
    if not len(force) or np.ptp(point, axis=0).max() <= MOMENTS.rounding:
        return free
    # level part of the torque, as a distance of the force's line from the point
    level = np.linalg.norm(torque - np.outer(torque @ up, up), axis=1) / np.abs(force @ up)
    about, misfit = _simplest(*rows, up)
    as_good = misfit * MOMENTS.simpler_ratio + MOMENTS.rounding
    if np.median(level) <= as_good or misfit > MOMENTS.largest_misfit:
        return free
    return _about(plate, about, misfit)


def _simplest(
    force: Array, moment: Array, pressure: Array, up: Array, *likely: Array
) -> tuple[Array, float]:
    """Give the simplest point about which the moments may be, (3,), and its misfit [m]."""
    axes = np.eye(3)
    level = axes[np.abs(axes @ up) < 0.5]
    # m − p × f, which is −point × f but for a vertical part if m is about the point
    tilt = moment - np.cross(pressure, force)

    def misfit(point: Array) -> float:
        rest = (tilt + np.cross(point, force)) @ level.T
        return float(np.median(np.linalg.norm(rest, axis=1) / np.abs(force @ up)))

    candidates = [np.zeros(3), *likely]
    # least squares of the level components, for a point on the floor and for one anywhere
    for directions in (level, axes):
        columns = [(np.cross(axis, force) @ level.T).ravel() for axis in directions]
        solved = np.linalg.lstsq(np.stack(columns, 1), -(tilt @ level.T).ravel())[0]
        candidates.append(solved @ directions)
    misfits = [misfit(point) for point in candidates]
    # candidates stand from simple to free: the first that fits as well as the best one
    as_good = min(misfits) * MOMENTS.simpler_ratio + MOMENTS.rounding
    chosen = next(k for k, value in enumerate(misfits) if value <= as_good)
    return candidates[chosen], misfits[chosen]
