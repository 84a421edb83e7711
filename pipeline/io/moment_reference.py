"""About which point a file's plate moments are: found from its own centres of pressure."""

from typing import Final

import numpy as np

from hbm.spatial import Array

LOADED_N: Final = 100.0
FEWEST: Final = 10
SAME_M: Final = 1e-4
AGREES_M: Final = 0.01


def wrench_about_origin(
    force: Array, moment: Array, pressure: Array | None, up: Array, plate: str
) -> tuple[Array, str]:
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
        What was checked or assumed, a sentence.

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
    loaded = np.abs(force @ up) > LOADED_N
    if loaded.any() and not (moment[loaded] @ up).any():
        raise ValueError(
            f"{plate}: the vertical moment is zero while the plate is loaded, so it was not "
            "exported; export all three moments"
        )
    assumed = f"{plate}: moments are taken as about the origin of the file's axes"
    if pressure is None:
        return wrench, f"{assumed}; without centres of pressure this cannot be checked."
    loaded &= np.isfinite(pressure).all(axis=1) & pressure.any(axis=1)
    loaded &= np.isfinite(wrench).all(axis=1)
    if np.count_nonzero(loaded) < FEWEST:
        return wrench, f"{assumed}; the plate is never loaded enough to check this."
    point, misfit = _simplest(force[loaded], moment[loaded], pressure[loaded], up)
    if misfit > AGREES_M:
        raise ValueError(
            f"{plate}: moments and centres of pressure disagree by {1000 * misfit:.0f} mm about "
            f"whatever point, expected less than {1000 * AGREES_M:.0f} mm: the units, axes or "
            "signs of its columns are not those of one plate"
        )
    wrench[:, 3:] += np.cross(point, force)
    where = ", ".join(f"{x:.3f}" for x in point) if point.any() else "0, 0, 0"
    return wrench, (
        f"{plate}: moments are about the point ({where}) m of the file's axes, where they agree "
        f"with the centres of pressure within {1000 * misfit:.1f} mm."
    )


def _simplest(force: Array, moment: Array, pressure: Array, up: Array) -> tuple[Array, float]:
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
    enough = min(misfits) * 1.05 + SAME_M
    chosen = next(k for k, value in enumerate(misfits) if value <= enough)
    return candidates[chosen], misfits[chosen]
