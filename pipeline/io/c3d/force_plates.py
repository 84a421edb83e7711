"""Force plates of a C3D file, TYPE 1 to 4: how they are described, their channels as wrenches."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, shift_wrench
from hbm.spelling import short
from pipeline.io.c3d.data import Header
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.recording import Fact
from pipeline.io.stated import Quantity, Stated

Channel = tuple[str, str]

QUANTITIES: Final[dict[int, tuple[Quantity, ...]]] = {
    1: ("force",) * 3 + ("pressure",) * 2 + ("moment",),
    2: ("force",) * 3 + ("moment",) * 3,
    3: ("force",) * 8,
    4: ("force",) * 3 + ("moment",) * 3,
}
"""TYPE -> what its channels hold; of TYPE 4, what they give after the matrix."""
MAX_PLATES: Final = 255
"""As many as a dimension of a parameter has entries."""
MAX_CORNER_ERROR_M: Final = 0.005
"""By which the corners may miss a rectangle: what measuring them by a marker misses."""
VOLTS: Final = {"v", "mv", "uv", "volt", "volts", ""}
MAX_CONDITION: Final = 1e9
"""Of channels -> wrench; units of force and moment differ by 1e3, a singular matrix by 1e16."""


class Undescribed(ValueError):
    """A plate that the file does not describe, so that it cannot be used."""


@dataclass(frozen=True, slots=True)
class PlateLayout:
    """How a file describes one plate: which channels it has, what they mean, where it lies.

    Attributes
    ----------
    number
        The plate's number in the file, from 1.
    kind
        Its TYPE, 1 to 4.
    channels
        Indices of the analog channels that it consists of.
    scale
        One of each channel in SI units; of TYPE 4, of each component after the matrix, (c,).
    matrix
        Calibration matrix of TYPE 4, (6, 6); None for the others.
    origin
        From the transducer to the centre of the surface; of TYPE 3 the distances of its sensors,
        of TYPE 1 zero, (3,) [m].
    corners
        Corners of the surface in the file's axes, (4, 3) [m].
    rotation
        Orientation of the plate in the file's axes (columns: the plate's axes), (3, 3).
    """

    number: int
    kind: int
    channels: tuple[int, ...]
    scale: Array
    matrix: Array | None
    origin: Array
    corners: Array
    rotation: Array

    def wrench(self, channels: Array) -> Array:
        """Turn samples of the plate's channels into wrenches.

        Parameters
        ----------
        channels
            In the file's units, (N, c).

        Returns
        -------
        Array
            Action on the subject in the plate's axes about the centre of its surface, (N, 6)
            [N, N·m]. In these axes C3D files store the force of the plate on the subject; its sign
            is kept.

        Notes
        -----
        Plate axes: x from corner 2 to 1, y in the surface towards corner 1 from 4, z = x × y (down
        for the usual order). With the channels' force f and moment m about the transducer and
        ORIGIN o, from the transducer to the centre of the surface, the moment about that centre is
        m + f × o (C3D user guide; TYPE 2, and TYPE 4 after its 6 × 6 calibration matrix, which
        turns volts into N and N times the file's length unit). Programs write o with either sign;
        transducers lie below the surface, so o is negated where its z is positive. TYPE 1 stores
        the centre of pressure p and the free moment t: m = p × f + t. TYPE 3 stores eight sensor
        forces at ORIGIN's distances.

        Deviations from the original
        ----------------------------
        FORCE_PLATFORM:ZERO (a baseline to subtract) is not applied, as in ezc3d. TYPE 3's
        polynomial for the centre of pressure is not used, since no centre of pressure is. ezc3d
        1.7.2 gives TYPE 1 moments the opposite sign, against its own free moment.
        """
        if self.matrix is not None:
            channels = channels @ self.matrix.T
        values = channels * self.scale
        if self.kind == 1:
            return _from_centre_of_pressure(values)
        if self.kind == 3:
            return _from_eight_sensors(values, self.origin)
        return shift_wrench(values, self.origin)


def plate_layouts(header: Header, stated: Stated) -> tuple[list[PlateLayout], list[Fact]]:
    """Read how a file describes its force plates.

    Parameters
    ----------
    header
        What the file says of itself.
    stated
        Units that a person states.

    Returns
    -------
    plates
        In the file's order, those that it describes.
    facts
        The others, left out, and corners that form no rectangle.

    Raises
    ------
    ValueError
        A unit is unknown.
    """
    parameters = header.parameters
    used = parameters.integer("FORCE_PLATFORM", "USED", 0)
    types = parameters.integers("FORCE_PLATFORM", "TYPE").ravel()
    if used > MAX_PLATES:
        raise ValueError(f"FORCE_PLATFORM:USED says {used} plates: the file is damaged")
    plates: list[PlateLayout] = []
    facts: list[Fact] = []
    for k in range(used):
        try:
            if k >= len(types):
                raise Undescribed("FORCE_PLATFORM:TYPE does not name its type")
            plates.append(_plate_layout(k, int(types[k]), header, stated))
            halves = plates[-1].corners[:2] + plates[-1].corners[2:]  # equal in a rectangle
            error_m = np.linalg.norm(halves[0] - halves[1])
            if error_m > MAX_CORNER_ERROR_M:
                doubt = f"one corner is {1000 * error_m:.0f} mm from a rectangle's"
                facts.append(Fact("in_doubt", f"plate {k + 1}", doubt))
        except Undescribed as error:
            facts.append(Fact("left_out", f"plate {k + 1}", str(error)))
        except ValueError as error:
            raise ValueError(f"force plate {k + 1}: {error}") from error
    return plates, facts


def _plate_layout(k: int, kind: int, header: Header, stated: Stated) -> PlateLayout:
    parameters, labelled = header.parameters, header.channels
    if kind not in QUANTITIES:
        raise Undescribed(
            f"plates of TYPE {kind} are not supported, only TYPE 1 to 4; export the file with "
            "TYPE 2 plates"
        )
    metre = stated.metre(parameters.text("POINT", "UNITS"))
    corners = _of_plate(parameters, "CORNERS", k, (3, 4)).T * metre
    numbers = _of_plate(parameters, "CHANNEL", k, (len(QUANTITIES[kind]),)).astype(int) - 1
    channels = tuple(numbers.tolist())
    if not all(0 <= channel < len(labelled) for channel in channels):
        raise Undescribed(f"it uses channels outside the file's {len(labelled)} analog channels")
    matrix = _of_plate(parameters, "CAL_MATRIX", k, (6, 6)) if kind == 4 else None
    scale = _scale(kind, [labelled[channel] for channel in channels], parameters, stated)
    origin = np.zeros(3) if kind == 1 else _of_plate(parameters, "ORIGIN", k, (3,)) * metre
    origin = -origin if origin[2] > 0 else origin
    rotation = plate_axes(corners)
    return PlateLayout(k + 1, kind, channels, scale, matrix, origin, corners, rotation)


def _of_plate(parameters: Parameters, name: str, k: int, shape: tuple[int, ...]) -> Array:
    values = parameters.numbers("FORCE_PLATFORM", name)
    values = values[..., None] if values.ndim == len(shape) else values
    fits = values.ndim == len(shape) + 1 and values.shape[-1] > k
    if not fits or any(has < needs for has, needs in zip(values.shape, shape, strict=False)):
        raise Undescribed(f"FORCE_PLATFORM:{name} does not describe it")
    part: Array = values[(..., k)][tuple(slice(n) for n in shape)]
    if not np.isfinite(part).all():
        raise Undescribed(f"FORCE_PLATFORM:{name} holds something that is not a number")
    return part


def plate_axes(corners: Array) -> Array:
    """Give the axes of a plate (columns), (3, 3), from the corners of its surface, (4, 3).

    They are in the order of the C3D format. A ValueError where they do not span a surface.
    """
    x = corners[0] - corners[1]
    z = np.cross(x, corners[0] - corners[3])
    if not np.linalg.norm(z) > 0:
        raise Undescribed("its corners do not span a surface")
    axes = np.array([x, np.cross(z, x), z])
    return np.asarray((axes / np.linalg.norm(axes, axis=1, keepdims=True)).T)


def _scale(kind: int, sources: list[Channel], parameters: Parameters, stated: Stated) -> Array:
    """Give one of each channel in SI units; of TYPE 4, of each component.

    Where the channels of TYPE 4 state volts, its force is in the plates' unit.
    """
    names, units = zip(*sources, strict=True)
    if kind == 4 and {unit.strip().lower() for unit in units} <= VOLTS:
        force = parameters.text("FORCE_PLATFORM", "UNITS") or "N"
        moment = f"{force}{stated.units or parameters.text('POINT', 'UNITS')}"
        units = (force,) * 3 + (moment,) * 3
    scales = []
    for quantity, name, unit in zip(QUANTITIES[kind], names, units, strict=True):
        try:
            scales.append(stated.plate_unit(quantity, unit))
        except ValueError as error:
            raise ValueError(f"channel {short(name)}: {error}") from error
    return np.array(scales)


def _from_centre_of_pressure(values: Array) -> Array:
    force, centre = values[:, :3], np.pad(values[:, 3:5], ((0, 0), (0, 1)))
    moment = np.cross(centre, force)
    moment[:, 2] += values[:, 5]
    return np.hstack([force, moment])


def _from_eight_sensors(values: Array, distances: Array) -> Array:
    x12, x34, y14, y23, z1, z2, z3, z4 = values.T
    a, b, height = distances
    force = np.column_stack([x12 + x34, y14 + y23, z1 + z2 + z3 + z4])
    moment = np.column_stack(
        [b * (z1 + z2 - z3 - z4), a * (z2 + z3 - z1 - z4), b * (x34 - x12) + a * (y14 - y23)]
    )
    return np.hstack([force, moment + np.cross(force, [0.0, 0.0, height])])


def channel_change(plate: PlateLayout, wrench_change: Array) -> Array:
    """Give the change of a plate's channels that changes its wrench.

    Parameters
    ----------
    plate
        The plate, of TYPE 2, 3 or 4.
    wrench_change
        Change of the wrench in the plate's axes about the centre of its surface, (N, 6) [N, N·m].

    Returns
    -------
    Array
        Change of the channels in the file's units, (N, c). TYPE 3: of least norm over its eight
        channels.

    Raises
    ------
    ValueError
        The channels do not determine the wrench: a calibration matrix is singular, or they are of
        TYPE 1, which stores a centre of pressure in place of two moments.

    Notes
    -----
    Wrenches are linear in their channels; the matrix is what `PlateLayout.wrench`
    makes of one unit of each channel.

    Examples
    --------
    >>> x, y = np.array([[1, -1, -1, 1], [1, 1, -1, -1]]) / 2
    >>> corners = np.column_stack([x, y, np.zeros(4)])
    >>> plate = PlateLayout(
    ...     1, 2, (0, 1, 2, 3, 4, 5), np.ones(6), None, np.array([0, 0, -0.1]), corners, np.eye(3)
    ... )
    >>> channel_change(plate, np.array([[10.0, 0, 0, 0, 0, 0]])) + 0.0
    array([[10.,  0.,  0.,  0., -1.,  0.]])
    """
    if plate.kind == 1:
        raise ValueError(
            f"force plate {plate.number}: plates of TYPE 1 store a centre of pressure in place of "
            "moments, which a compensated force may not have; export the file with TYPE 2 plates"
        )
    to_wrench = plate.wrench(np.eye(len(plate.channels))).T
    if not np.linalg.cond(to_wrench) < MAX_CONDITION:
        raise ValueError(
            f"force plate {plate.number}: its channels do not determine its wrench; check "
            f"FORCE_PLATFORM:{'CAL_MATRIX' if plate.kind == 4 else 'ORIGIN'}"
        )
    if plate.kind == 3:
        return wrench_change @ np.linalg.pinv(to_wrench).T
    return np.asarray(np.linalg.solve(to_wrench, wrench_change.T).T)
