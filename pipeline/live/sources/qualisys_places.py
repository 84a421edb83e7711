"""Where force plates lie, as Qualisys Track Manager's settings state it."""

from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from hbm.spatial import Array
from hbm.spelling import short
from pipeline.io.c3d.force_plates import plate_axes
from pipeline.io.recording import Plate
from pipeline.io.units import length_in_m
from pipeline.io.xdf.channels import AXES

MAX_CORNER_ERROR_M: Final = 0.02
"""Corners that are measured miss a rectangle by millimetres, those in no order by decimetres."""


def place_of(plate: Element, number: int, unit: str, to_lab: Array) -> Plate:
    """Give the place of a plate from its element ``Plate`` of the settings.

    Parameters
    ----------
    plate
        It has a ``Location`` with ``Corner1`` to ``Corner4``, in the axes of the markers.
    number
        The plate's.
    unit
        Of lengths in the settings.
    to_lab
        From the markers' axes to the lab's, (3, 3).

    Returns
    -------
    Plate
        Without samples.

    Raises
    ------
    ValueError
        It states no corners, or they are no rectangle, or not in the order of the C3D format.

    Notes
    -----
    The order of the C3D format, to which the program exports plates, is that of the quadrants
    +x +y, -x +y, -x -y and +x -y of the plate's own axes. The plate's z points down in the
    program's forces, so that corners whose z points up are in another order.
    """
    corners = np.array([_corner(plate, k) for k in range(1, 5)]) * length_in_m(unit) @ to_lab.T
    rotation = plate_axes(corners)
    if np.linalg.norm(corners[0] + corners[2] - corners[1] - corners[3]) > MAX_CORNER_ERROR_M:
        raise ValueError("its corners are no rectangle")
    if rotation[2, 2] >= 0:
        raise ValueError("its corners are in another order than that of the C3D format: z is up")
    empty = np.empty(0)
    return Plate(number, empty, empty.reshape(0, 6), rotation, corners.mean(axis=0), corners)


def _corner(plate: Element, k: int) -> list[float]:
    words = [plate.findtext(f"Location/Corner{k}/{axis}") or "" for axis in AXES]
    try:
        found = list(map(float, words))
    except ValueError:
        found = []
    if not found or not np.isfinite(found).all():
        raise ValueError(f"the program states no corner {k}, but {short(' '.join(words))!r}")
    return found
