"""The point about which a file's plate moments are, found from its own centres of pressure."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array, rotate_wrench
from pipeline.io.recording import Plate

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


@dataclass(frozen=True, slots=True)
class PlateColumns:
    """What a text file holds of one plate, in SI units and the file's axes.

    Attributes
    ----------
    number, name
        Its number from 1, and what messages call it.
    time
        (N,) [s].
    force, moment
        (N, 3) [N, N·m].
    pressure
        Centre of pressure from the file's origin, (N, 3) [m]; None if absent.
    """

    number: int
    name: str
    time: Array
    force: Array
    moment: Array
    pressure: Array | None


def plates_about_origin(
    columns: Iterable[PlateColumns], to_lab: Array
) -> tuple[tuple[Plate, ...], list[Note]]:
    """Make plates whose wrench is about the lab's origin, and note where their moments were.

    Parameters
    ----------
    columns
        Of each plate.
    to_lab
        Rotation from the file's axes to the lab's, (3, 3).

    Returns
    -------
    plates, notes
        As `wrench_about_origin` gives them, with its errors.
    """
    plates, notes = [], []
    for plate in columns:
        wrench, note = wrench_about_origin(
            plate.force, plate.moment, plate.pressure, to_lab[2], plate.name
        )
        plates.append(Plate.at_origin(plate.number, plate.time, rotate_wrench(wrench, to_lab)))
        notes.append(note)
    return tuple(plates), notes


def wrench_about_origin(
    force: Array, moment: Array, pressure: Array | None, up: Array, plate: str
) -> tuple[Array, Note]:
    """Give a plate's wrench about the origin of the file's axes.

    Parameters
    ----------
    force, moment
        As the file has them, in its axes, (N, 3) [N, N·m].
    pressure
        Centre of pressure in the file's axes from the file's origin, (N, 3) [m]; None if absent.
    up
        Unit vector up in the file's axes, (3,).
    plate
        The plate's name, for messages.

    Returns
    -------
    wrench
        (N, 6) [N, N·m].
    note
        ``moments_located``, or ``moments_without_pressure`` or ``moments_unloaded`` where the
        moments are taken as about the origin unchecked.

    Raises
    ------
    ValueError
        The moments fit the centres of pressure about no point, or the vertical moment is absent.

    Notes
    -----
    A foot pushes but does not pull, so moment − (pressure − point) × force is vertical. Files do
    not state the point. It is the simplest one that explains the loaded samples as well as the
    best one does: the origin, a point on the floor, a point anywhere. The misfit is given as the
    displacement of the centre of pressure that would explain it, median over the samples.
    """
    wrench = np.hstack([force, moment])
    loaded = np.abs(force @ up) > MIN_VERTICAL_FORCE_N
    if loaded.any() and not (moment[loaded] @ up).any():
        raise ValueError(
            f"{plate}: the vertical moment is zero while the plate is loaded, so it was not "
            "exported; export all three moments"
        )
    if pressure is None:
        return wrench, Note.of("moments_without_pressure", plate=plate)
    loaded &= np.isfinite(pressure).all(axis=1) & pressure.any(axis=1)
    loaded &= np.isfinite(wrench).all(axis=1)
    if np.count_nonzero(loaded) < MIN_LOADED_SAMPLES:
        return wrench, Note.of("moments_unloaded", plate=plate)
    point, misfit = _simplest(force[loaded], moment[loaded], pressure[loaded], up)
    if misfit > MAX_MISFIT_M:
        raise ValueError(
            f"{plate}: moments and centres of pressure disagree by {1000 * misfit:.0f} mm about "
            f"any point, expected less than {1000 * MAX_MISFIT_M:.0f} mm: the units, axes or "
            "signs of its columns are not those of one plate"
        )
    wrench[:, 3:] += np.cross(point, force)
    x, y, z = (float(coordinate) for coordinate in point)
    return wrench, Note.of("moments_located", plate=plate, x_m=x, y_m=y, z_m=z, misfit_m=misfit)


def wrench_of_torque(
    force: Array, torque: Array, point: Array, up: Array, plate: str
) -> tuple[Array, tuple[Note, ...]]:
    """Give a wrench about the origin from a force, its point and a torque.

    Parameters
    ----------
    force, torque
        As the file has them, in its axes, (N, 3) [N, N·m].
    point
        Where the force acts, from the file's origin, (N, 3) [m].
    up
        Unit vector up in the file's axes, (3,).
    plate
        The plate's name, for the note.

    Returns
    -------
    wrench
        (N, 6) [N, N·m].
    notes
        ``torques_about_a_point`` where the torques are moments about a fixed point.

    Notes
    -----
    The torque t belongs to the force f at the point p: the moment is p × f + t. A foot does not
    pull, so t is vertical where p is the centre of pressure. Some programs write the moment about
    the origin instead, t ≈ p × f + vertical part, which would then count twice. It is taken as
    such where p moves, as centres of pressure do, t is not vertical, and the point that
    `wrench_about_origin` would find explains t within 1 cm.
    """
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
    x, y, z = (float(coordinate) for coordinate in about)
    note = Note.of("torques_about_a_point", plate=plate, x_m=x, y_m=y, z_m=z, misfit_m=misfit)
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
