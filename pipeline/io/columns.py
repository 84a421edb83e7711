"""Markers and plates as columns of a file: in SI units, in lab axes, about the lab's origin."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array, frozen, rotate_wrench
from hbm.spelling import listed, short
from pipeline.io.axes import mean_force, parse_axes, settle_axes, split_axes
from pipeline.io.labels import marker_columns
from pipeline.io.recording import Fact, Plate, Recording, saying
from pipeline.io.stated import CONVERT, Stated, parse_mending

MIN_VERTICAL_FORCE_N: Final = 100.0
"""Below it the centre of pressure is too noisy to compare with."""
MIN_LOADED_SAMPLES: Final = 10
"""Samples from which the point is found; it has up to three unknown coordinates."""
EQUAL_MISFIT_M: Final = 1e-4
"""Files round centres of pressure to tenths of a millimetre: less is no difference."""
EQUAL_MISFIT_RATIO: Final = 1.05
"""A simpler point that fits 5 % worse than the best one is as good."""
MAX_MISFIT_M: Final = 0.01
"""Moments of one plate agree with its centres of pressure within millimetres."""
SI_UNITS: Final = ("N", "Nm", "m")
"""Of plates in formats that state none."""
DFLOW_PLATE: Final = re.compile(r"FP(\d+)\.(For|Mom|Cop)([XYZ])")
"""A plate's column as D-Flow names it, about the origin of the markers' axes."""
UNCHECKED: Final = "about the origin of the file's axes, unchecked"
FREE: Final = "at the force's point (free torque)"
"""Where moments are."""


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
        On labels.
    facts
        What was joined, left out or made gaps.
    """

    names: tuple[str, ...]
    position: Array
    unit: str
    notes: Sequence[Note]
    facts: Sequence[Fact] = ()


def file_markers(
    labels: Sequence[str], unit: str, positions: Callable[[list[int]], Array], stated: Stated
) -> FileMarkers:
    """Give the markers wanted of a file; those that are no numbers or at the origin are gaps.

    ``positions`` gives those of some labels by their indices, (M,) -> (T, M, 3), in the file's
    unit. A ValueError where labels or unit are unknown or contradictory, or the unit contradicts
    the markers' extent.
    """
    metre = stated.metre(unit)
    markers, notes = marker_columns(labels, stated)
    position = positions(list(markers.values()))
    position *= metre
    position[~np.isfinite(position).all(axis=-1) | ~position.any(axis=-1)] = np.nan
    notes += stated.check_positions(position, [*markers], unit)
    return FileMarkers(tuple(markers), position, unit, notes)


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
    """

    number: int
    name: str
    time: Array
    force: Array
    moment: Array
    pressure: Array | None = None
    units: tuple[str, str, str] = field(kw_only=True, default=SI_UNITS)

    def in_si(self, stated: Stated) -> "PlateColumns":
        """Give the same in SI units."""
        force, moment, pressure = self.units
        centre = self.pressure
        return replace(
            self,
            force=self.force * stated.plate_unit("force", force),
            moment=self.moment * stated.plate_unit("moment", moment),
            pressure=None if centre is None else centre * stated.plate_unit("pressure", pressure),
        )


def vectors(columns: Mapping[str, Array], stems: Iterable[str], axes: str = "XYZ") -> Array:
    """Stack the columns of several vectors, (N, stems, 3); a ValueError where one is absent."""
    wanted = [f"{stem}{axis}" for stem in stems for axis in axes]
    if absent := [name for name in wanted if name not in columns]:
        raise ValueError(f"{short(absent[0])} is absent, but others that belong to it are there")
    stacked = np.stack([columns[name] for name in wanted], axis=1)
    return stacked.reshape(len(stacked), -1, 3)


def plate_of(
    number: int,
    name: str,
    time: Array,
    columns: Mapping[str, Array],
    stems: Sequence[str],
    *,
    axes: str = "XYZ",
    units: tuple[str, str, str] = SI_UNITS,
) -> PlateColumns | Fact:
    """Give a plate from the columns of force, moment and, if given, pressure; or why it lacks."""
    try:
        found = vectors(columns, stems, axes)
    except ValueError as error:
        return Fact("left_out", name, str(error))
    return PlateColumns(number, name, time, *found.transpose(1, 0, 2), units=units)


def dflow_plates(
    columns: Mapping[str, Array], time: Array, units: Mapping[str, str] | None = None
) -> Iterator[PlateColumns | Fact]:
    """Give the plates whose columns are named as D-Flow names them, such as FP1.ForX.

    Units are those of the columns by their names; without any, N, N·m and m.
    """
    found = (DFLOW_PLATE.fullmatch(name) for name in columns)
    for number in dict.fromkeys(int(match[1]) for match in found if match):
        stems = [f"FP{number}.{part}" for part in ("For", "Mom", "Cop")]
        force, moment, pressure = SI_UNITS
        if units is not None:
            force, moment = (units.get(f"{stem}X", "") for stem in stems[:2])
            pressure = units.get(f"{stems[2]}X", pressure)
        stems = stems[: 3 if f"{stems[2]}X" in columns else 2]
        of_plate = (force, moment, pressure)
        yield plate_of(number, f"plate {number}", time, columns, stems, units=of_plate)


Located = tuple[Array, str]
"""A wrench about the origin of the file's axes, (N, 6) [N, N·m], and where its moments were."""


def recording_of(
    source: Path,
    stated: Stated,
    markers: FileMarkers,
    time: Array,
    plates: Iterable[PlateColumns | Fact] = (),
    *,
    axes: str = "",
    program: str = "",
    on_subject: bool = True,
    locate: Callable[[PlateColumns, Array], Located] | None = None,
    placed: Callable[[Array], list[Plate]] | None = None,
    facts: Iterable[Fact] = (),
    notes: Iterable[Note] = (),
    **others: Any,
) -> Recording:
    """Make a recording from the columns of a file: SI units, lab axes, plates about the origin.

    Parameters
    ----------
    source, stated
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
    locate
        Finds wrenches about the origin; by default `wrench_about_origin`.
    placed
        Rotation to the lab, (3, 3) -> further plates.
    facts, notes, others
        What was done or is in doubt, notes, and further attributes of the recording.
    """
    plates = list(plates)
    facts = [*markers.facts, *facts, *(plate for plate in plates if isinstance(plate, Fact))]
    found = [plate for plate in plates if isinstance(plate, PlateColumns)]
    mended = {parse_mending(text)[0] for text in stated.mend_plates}  # once axes are known
    with saying(facts):
        columns = [plate.in_si(stated) for plate in found]
        settled, axes_notes = settle_axes(
            stated.axes or axes or None,
            markers.position,
            markers.names,
            marker_set=stated.marker_set,
            plate_forces=[
                mean_force(plate.force) * (plate.number not in mended)
                for plate in columns
                if on_subject
            ],
            by=program if stated.axes is None else "",
        )
        to_lab = parse_axes(settled)
        noted = [*axes_notes, *markers.notes, *notes, *(fact.note for fact in facts)]
        written = [unit for plate in found for unit in plate.units]
        noted += stated.unit_notes([markers.unit], written)
        pull = -sum(float(np.nan_to_num(plate.force @ to_lab[2]).mean()) for plate in columns)
        if pull > 0 and not on_subject:
            columns = [replace(each, force=-each.force, moment=-each.moment) for each in columns]
            noted.append(Note.of("forces_reversed"))
        made = placed(to_lab) if placed else []
        moments = []
        for plate in columns:
            wrench, where = (locate or wrench_about_origin)(plate, to_lab[2])
            read_as = map(stated.used_unit, CONVERT, plate.units)
            units = ",".join([*read_as][: 3 if where == FREE else 2])
            in_lab = rotate_wrench(wrench, to_lab)
            made.append(Plate.at_origin(plate.number, plate.time, in_lab, units))
            moments.append(f"{plate.name} {where}")
        if moments:
            noted.append(Note.of("moments_about", plates=moments))
        numbers = sorted(plate.number for plate in made)
        if len(set(numbers)) < len(numbers):
            raise ValueError(f"several plates have the same number: {listed(numbers)}")
        position = frozen(to_lab @ np.moveaxis(markers.position, 0, -1))
        return Recording(
            source=source,
            markers=Markers(time, markers.names, np.moveaxis(position, -1, 0)),
            plates=tuple(sorted(made, key=lambda plate: plate.number)),
            stated=stated,
            axes=split_axes(settled),
            facts=tuple(facts),
            notes=tuple(noted),
            **others,
        )


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
    best one does: the origin, a point on the floor, a point anywhere. The misfit is given as the
    displacement of the centre of pressure that would explain it, median over the samples. Moments
    are taken as about the origin, unchecked, without centres of pressure and without load.
    """
    name, force, moment, pressure = plate.name, plate.force, plate.moment, plate.pressure
    wrench = np.hstack([force, moment])
    loaded = np.abs(force @ up) > MIN_VERTICAL_FORCE_N
    if loaded.any() and not (moment[loaded] @ up).any():
        raise ValueError(
            f"{name}: the vertical moment is zero while the plate is loaded, so it was not "
            "exported; export all three moments"
        )
    if pressure is None:
        return wrench, UNCHECKED
    loaded &= np.isfinite(np.hstack([pressure, wrench])).all(axis=1) & pressure.any(axis=1)
    if np.count_nonzero(loaded) < MIN_LOADED_SAMPLES:
        return wrench, UNCHECKED
    point, misfit = _simplest(force[loaded], moment[loaded], pressure[loaded], up)
    if misfit > MAX_MISFIT_M:
        raise ValueError(
            f"{name}: moments and centres of pressure disagree by {1000 * misfit:.0f} mm about "
            f"any point, expected less than {1000 * MAX_MISFIT_M:.0f} mm: the units, axes or "
            "signs of its columns are not those of one plate"
        )
    wrench[:, 3:] += np.cross(point, force)
    return wrench, _about(point, misfit)


def _about(point: Array, misfit: float) -> str:
    place = ", ".join(f"{coordinate:.3f}" for coordinate in point)
    return f"about ({place}) m of the file's axes (within {1000 * misfit:.1f} mm)"


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
    force, torque = plate.force, plate.moment
    point = np.zeros_like(force) if plate.pressure is None else plate.pressure
    wrench = np.hstack([force, np.cross(point, force) + torque])
    loaded = np.abs(force @ up) > MIN_VERTICAL_FORCE_N
    loaded &= np.isfinite(np.hstack([wrench, point])).all(axis=1) & point.any(axis=1)
    moving = loaded.any() and np.ptp(point[loaded], axis=0).max() > EQUAL_MISFIT_M
    if np.count_nonzero(loaded) < MIN_LOADED_SAMPLES or not moving:
        return wrench, FREE
    own = force[loaded], torque[loaded], point[loaded], up
    vertical = np.linalg.norm(own[1] - np.outer(own[1] @ up, up), axis=1) / np.abs(own[0] @ up)
    about, misfit = _simplest(*own)
    enough = misfit * EQUAL_MISFIT_RATIO + EQUAL_MISFIT_M
    if np.median(vertical) <= enough or misfit > MAX_MISFIT_M:
        return wrench, FREE
    return np.hstack([force, torque + np.cross(about, force)]), _about(about, misfit)


def _simplest(force: Array, moment: Array, pressure: Array, up: Array) -> tuple[Array, float]:
    """Give the simplest point about which the moments may be, (3,), and its misfit [m]."""
    axes = np.eye(3)
    level = axes[np.abs(axes @ up) < 0.5]
    tilt = moment - np.cross(pressure, force)

    def misfit(point: Array) -> float:
        rest = (tilt + np.cross(point, force)) @ level.T
        return float(np.median(np.linalg.norm(rest, axis=1) / np.abs(force @ up)))

    candidates = [np.zeros(3)]
    for directions in (level, axes):
        columns = [(np.cross(axis, force) @ level.T).ravel() for axis in directions]
        solved = np.linalg.lstsq(np.stack(columns, 1), -(tilt @ level.T).ravel())[0]
        candidates.append(solved @ directions)
    misfits = [misfit(point) for point in candidates]
    enough = min(misfits) * EQUAL_MISFIT_RATIO + EQUAL_MISFIT_M
    chosen = next(k for k, value in enumerate(misfits) if value <= enough)
    return candidates[chosen], misfits[chosen]
