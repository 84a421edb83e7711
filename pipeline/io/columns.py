"""Markers and plates as columns of a file: in SI units, in lab axes, about the lab's origin."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array, frozen, rotate_wrench
from pipeline.io.axes import mean_force, parse_axes, settle_axes
from pipeline.io.labels import marker_columns
from pipeline.io.recording import Plate
from pipeline.io.stated import Stated

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


@dataclass(frozen=True, slots=True)
class FileMarkers:
    """Markers of a file in SI units and the file's axes.

    Attributes
    ----------
    names
        Labels, as wanted.
    position
        (T, M, 3) [m]; what no camera saw is NaN.
    subject
        Prefix that was removed from the labels; empty where there was none.
    notes
        On units and labels.
    """

    names: tuple[str, ...]
    position: Array
    subject: str
    notes: tuple[Note, ...]

    def in_lab(self, time: Array, to_lab: Array) -> Markers:
        """Give the markers in lab axes at times, (T,) [s]."""
        in_lab = frozen(to_lab @ np.moveaxis(self.position, 0, -1))
        return Markers(time, self.names, np.moveaxis(in_lab, -1, 0))


def unseen_as_nan(position: Array, names: Sequence[str]) -> list[Note]:
    """Make positions NaN, in place, that are no numbers or at exactly the origin."""
    position[~np.isfinite(position).all(axis=-1) | ~position.any(axis=-1)] = np.nan
    return []


def file_markers(
    labels: Sequence[str],
    unit: str,
    positions: Callable[[list[int]], Array],
    stated: Stated,
    gaps: Callable[[Array, Sequence[str]], list[Note]] = unseen_as_nan,
) -> FileMarkers:
    """Give the markers wanted of a file.

    Parameters
    ----------
    labels, unit
        As the file has them.
    positions
        Indices of the labels wanted, (M,) -> their positions in that unit, (T, M, 3).
    stated
        What a person states about the file.
    gaps
        Makes positions NaN, in place, that no camera saw, and notes it.

    Raises
    ------
    ValueError
        Labels or unit are unknown or contradictory, or the unit contradicts the markers' extent.
    """
    metre, unit_notes = stated.marker_unit(unit)
    markers, subject, label_notes = marker_columns(labels, stated)
    position = positions(list(markers.values()))
    position *= metre
    gap_notes = gaps(position, tuple(markers))
    stated.check_span(position, unit)
    return FileMarkers(tuple(markers), position, subject, (*unit_notes, *label_notes, *gap_notes))


def lab_axes(
    markers: FileMarkers,
    forces: Iterable[Array],
    stated: Stated,
    default: str | None = None,
    program: str = "",
) -> tuple[Array, tuple[Note, ...]]:
    """Give the rotation from a file's axes to the lab's, (3, 3), and what shows it.

    ``forces`` are those of each plate, (N, 3) [N]; ``default`` are the axes that ``program``
    defines. Errors are those of `settle_axes`.
    """
    axes, notes = settle_axes(
        stated.axes or default,
        markers.position,
        markers.names,
        marker_set=stated.marker_set,
        plate_forces=[mean_force(force) for force in forces],
    )
    if default and stated.axes is None:
        notes = (Note.of("axes_of_format", axes=axes.split(","), program=program), *notes[1:])
    return parse_axes(axes), notes


@dataclass(frozen=True, slots=True)
class PlateColumns:
    """What a file holds of one plate in its axes, (N, 3) each.

    Attributes
    ----------
    number, name
        Its number from 1, and what messages call it.
    time
        (N,) [s].
    units
        Of force, moment and pressure as the file states them.
    force, moment
        In the units of the file, or [N, N·m].
    pressure
        Centre of pressure from the file's origin, in the unit of the file or [m]; None if absent.
    """

    number: int
    name: str
    time: Array
    units: tuple[str, str, str]
    force: Array
    moment: Array
    pressure: Array | None = None


def plates_in_si(
    found: Iterable[PlateColumns | Note], stated: Stated
) -> tuple[list[PlateColumns], list[Note]]:
    """Bring plates to SI units; notes of those that are left out follow those on units."""
    plates, left_out = [], []
    units: list[tuple[str, str, str]] = []
    for each in found:
        if isinstance(each, Note):
            left_out.append(each)
            continue
        force, moment, pressure = each.units
        units.append(each.units)
        plates.append(
            replace(
                each,
                force=each.force * stated.force_unit(force),
                moment=each.moment * stated.moment_unit(moment),
                pressure=None
                if each.pressure is None
                else each.pressure * stated.pressure_unit(pressure),
            )
        )
    return plates, [
        *stated.plate_notes(*zip(*units, strict=True)),
        *left_out,
    ] if units else left_out


def left_out(plate: str, reason: str) -> Note:
    """Say why a plate cannot be used."""
    return Note.of("plate_left_out", plate=plate, reason=reason)


def plates_about_origin(
    columns: Iterable[PlateColumns], to_lab: Array
) -> tuple[tuple[Plate, ...], list[Note]]:
    """Make plates whose wrench is about the lab's origin, and note where their moments were.

    ``to_lab`` turns the file's axes to the lab's, (3, 3). Errors are `wrench_about_origin`'s.
    """
    plates, notes = [], []
    for plate in columns:
        wrench, note = wrench_about_origin(plate, to_lab[2])
        plates.append(Plate.at_origin(plate.number, plate.time, rotate_wrench(wrench, to_lab)))
        notes.append(note)
    return tuple(plates), notes


def wrench_about_origin(plate: PlateColumns, up: Array) -> tuple[Array, Note]:
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
        return wrench, Note.of("moments_without_pressure", plate=name)
    loaded &= np.isfinite(pressure).all(axis=1) & pressure.any(axis=1)
    loaded &= np.isfinite(wrench).all(axis=1)
    if np.count_nonzero(loaded) < MIN_LOADED_SAMPLES:
        return wrench, Note.of("moments_unloaded", plate=name)
    point, misfit = _simplest(force[loaded], moment[loaded], pressure[loaded], up)
    if misfit > MAX_MISFIT_M:
        raise ValueError(
            f"{name}: moments and centres of pressure disagree by {1000 * misfit:.0f} mm about "
            f"any point, expected less than {1000 * MAX_MISFIT_M:.0f} mm: the units, axes or "
            "signs of its columns are not those of one plate"
        )
    wrench[:, 3:] += np.cross(point, force)
    return wrench, _located("moments_located", name, point, misfit)


def _located(code: str, plate: str, point: Array, misfit: float) -> Note:
    x, y, z = (float(coordinate) for coordinate in point)
    return Note.of(code, plate=plate, x_m=x, y_m=y, z_m=z, misfit_m=misfit)


def wrench_of_torque(plate: PlateColumns, up: Array) -> tuple[Array, tuple[Note, ...]]:
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
        return wrench, ()
    own = force[loaded], torque[loaded], point[loaded], up
    vertical = np.linalg.norm(own[1] - np.outer(own[1] @ up, up), axis=1) / np.abs(own[0] @ up)
    about, misfit = _simplest(*own)
    enough = misfit * EQUAL_MISFIT_RATIO + EQUAL_MISFIT_M
    if np.median(vertical) <= enough or misfit > MAX_MISFIT_M:
        return wrench, ()
    note = _located("torques_about_a_point", plate.name, about, misfit)
    return np.hstack([force, torque + np.cross(about, force)]), (note,)


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
