"""What a change of a plate's wrench does to its analog channels: the inverse of `force_plates`."""

from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.io.c3d.force_plates import PlateLayout

MAX_CONDITION: Final = 1e9
"""Of channels -> wrench; units of force and moment differ by 1e3, a singular matrix by 1e16."""


def channel_change(plate: PlateLayout, channels: Array, wrench_change: Array) -> Array:
    """Give the change of a plate's channels that changes its wrench.

    Parameters
    ----------
    plate
        The plate.
    channels
        Samples of its channels in the file's units, (N, c).
    wrench_change
        Change of the wrench in the plate's axes about the centre of its surface, (N, 6) [N, N·m].

    Returns
    -------
    Array
        Change of the channels in the file's units, (N, c). TYPE 3: of least norm over its eight
        channels. TYPE 1: NaN where the changed wrench has no centre of pressure on the plate's
        surface, which TYPE 1 stores instead of two of its moments.

    Raises
    ------
    ValueError
        The channels do not determine the wrench: a calibration matrix is singular.

    Notes
    -----
    Wrenches of TYPE 2 to 4 are linear in their channels; the matrix is what `PlateLayout.wrench`
    makes of one unit of each channel.

    Examples
    --------
    >>> x, y = np.array([[1, -1, -1, 1], [1, 1, -1, -1]]) / 2
    >>> corners = np.column_stack([x, y, np.zeros(4)])
    >>> plate = PlateLayout(
    ...     1, 2, (0, 1, 2, 3, 4, 5), np.ones(6), None, np.array([0, 0, -0.1]), corners, np.eye(3)
    ... )
    >>> channel_change(plate, np.zeros((1, 6)), np.array([[10.0, 0, 0, 0, 0, 0]])) + 0.0
    array([[10.,  0.,  0.,  0., -1.,  0.]])
    """
    if plate.kind == 1:
        return _centre_of_pressure_change(plate, channels, wrench_change)
    to_wrench = plate.wrench(np.eye(len(plate.channels))).T
    if not np.linalg.cond(to_wrench) < MAX_CONDITION:
        raise ValueError(
            f"force plate {plate.number}: its channels do not determine its wrench; check "
            f"FORCE_PLATFORM:{'CAL_MATRIX' if plate.kind == 4 else 'ORIGIN'}"
        )
    if plate.kind == 3:
        return wrench_change @ np.linalg.pinv(to_wrench).T
    return np.asarray(np.linalg.solve(to_wrench, wrench_change.T).T)


def _centre_of_pressure_change(plate: PlateLayout, channels: Array, wrench_change: Array) -> Array:
    fx, fy, fz, mx, my, mz = (plate.wrench(channels) + wrench_change).T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y = -my / fz, mx / fz
        wanted = np.column_stack([fx, fy, fz, x, y, mz - (x * fy - y * fx)])
        change = wanted / plate.scale - channels
    reach = np.linalg.norm(plate.corners - plate.corners.mean(axis=0), axis=1).max()
    change[~(np.hypot(x, y) <= reach), 3:] = np.nan
    change[~wrench_change.any(axis=1)] = 0
    return change
