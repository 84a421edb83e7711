"""Force plates of a C3D file: analog channels to wrenches on the subject, TYPE 1 to 4.

No centre of pressure is computed: a wrench about a fixed point needs none, and is finite while a
plate is empty.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.units import force_in_n, length_in_m, moment_in_nm

Channel = tuple[str, str]

N_CHANNELS: Final = {1: 6, 2: 6, 3: 8, 4: 6}
VOLTS: Final = {"v", "mv", "uv", "volt", "volts", ""}


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
            [N, N·m].
        """
        if self.matrix is not None:
            channels = channels @ self.matrix.T
        values = channels * self.scale
        if self.kind == 1:
            return _from_centre_of_pressure(values)
        if self.kind == 3:
            return _from_eight_sensors(values, self.origin)
        values[:, 3:] += np.cross(values[:, :3], self.origin)
        return values


@dataclass(frozen=True, slots=True)
class MeasuredPlate:
    """One plate in SI units and the file's axes.

    Attributes
    ----------
    channels
        Indices of the analog channels that it consists of.
    wrench_in_plate
        Action on the subject in the plate's axes about the centre of its surface, (N, 6)
        [N, N·m].
    rotation
        Orientation of the plate in the file's axes (columns: the plate's axes), (3, 3).
    corners
        Corners of the surface in the file's axes, (4, 3) [m].
    """

    channels: tuple[int, ...]
    wrench_in_plate: Array
    rotation: Array
    corners: Array

    @property
    def mean_force(self) -> Array:
        """Mean force on the subject in the file's axes, (3,) [N]."""
        force: Array = np.nan_to_num(self.wrench_in_plate[:, :3]).mean(axis=0)
        return np.asarray(self.rotation @ force)


def measured_plates(
    parameters: Parameters, analog: Array, names: Sequence[str], units: Sequence[str]
) -> list[MeasuredPlate]:
    """Turn the analog channels of all force plates of a file into wrenches.

    Parameters
    ----------
    parameters
        Parameters of the file.
    analog
        Scaled analog samples, (N, channels), in the file's units.
    names, units
        Label and unit of each analog channel as the file writes them.

    Returns
    -------
    list[MeasuredPlate]
        One per plate, in the file's order. In the plate's axes that the corners define, C3D files
        store the force of the plate on the subject; its sign is kept.

    Raises
    ------
    ValueError
        As `plate_layouts`.

    Notes
    -----
    Plate axes: x from corner 2 to 1, y in the surface towards corner 1 from 4, z = x × y (down for
    the usual order). With the channels' force f and moment m about the transducer and ORIGIN o,
    from the transducer to the centre of the surface, the moment about that centre is m + f × o
    (C3D user guide; TYPE 2, and TYPE 4 after its 6 × 6 calibration matrix, which turns volts into
    N and N times the file's length unit). Programs write o with either sign; transducers lie below
    the surface, so o is negated where its z is positive. TYPE 1 stores the centre of pressure p and
    the free moment t: m = p × f + t. TYPE 3 stores eight sensor forces at ORIGIN's distances.

    Deviations from the original
    ----------------------------
    FORCE_PLATFORM:ZERO (a baseline to subtract) is not applied, as in ezc3d. TYPE 3's polynomial
    for the centre of pressure is not used, since no centre of pressure is. ezc3d 1.7.2 gives TYPE 1
    moments the opposite sign, against its own free moment.
    """
    return [
        MeasuredPlate(
            plate.channels,
            plate.wrench(analog[:, plate.channels]),
            plate.rotation,
            plate.corners,
        )
        for plate in plate_layouts(parameters, names, units)
    ]


def plate_layouts(
    parameters: Parameters, names: Sequence[str], units: Sequence[str]
) -> list[PlateLayout]:
    """Read how a file describes its force plates.

    Parameters
    ----------
    parameters
        Parameters of the file.
    names, units
        Label and unit of each analog channel as the file writes them.

    Returns
    -------
    list[PlateLayout]
        One per plate, in the file's order.

    Raises
    ------
    ValueError
        A plate's type is not 1 to 4, its parameters are incomplete, or a unit is unknown.
    """
    used = parameters.integer("FORCE_PLATFORM", "USED", 0)
    types = parameters.integers("FORCE_PLATFORM", "TYPE").ravel()
    if used and len(types) < used:
        raise ValueError(f"FORCE_PLATFORM:TYPE names {len(types)} of {used} plates")
    labelled = list(zip(names, units, strict=True))
    plates = []
    for k in range(used):
        try:
            plates.append(_plate_layout(k, int(types[k]), parameters, labelled))
        except ValueError as error:
            raise ValueError(f"force plate {k + 1}: {error}") from error
    return plates


def _plate_layout(
    k: int, kind: int, parameters: Parameters, labelled: list[Channel]
) -> PlateLayout:
    if kind not in N_CHANNELS:
        raise ValueError(
            f"plates of TYPE {kind} are not supported, only TYPE 1 to 4: "
            "export the file with TYPE 2 plates"
        )
    metre = length_in_m(parameters.text("POINT", "UNITS"))
    corners = _of_plate(parameters, "CORNERS", k, (3, 4)).T * metre
    numbers = _of_plate(parameters, "CHANNEL", k, (N_CHANNELS[kind],)).astype(int) - 1
    channels = tuple(numbers.tolist())
    if not all(0 <= channel < len(labelled) for channel in channels):
        raise ValueError(f"it uses channels outside the file's {len(labelled)} analog channels")
    matrix = _of_plate(parameters, "CAL_MATRIX", k, (6, 6)) if kind == 4 else None
    scale = _scale(kind, [labelled[channel] for channel in channels], parameters)
    origin = np.zeros(3) if kind == 1 else _origin(parameters, k) * metre
    rotation = plate_axes(corners)
    return PlateLayout(k + 1, kind, channels, scale, matrix, origin, corners, rotation)


def _of_plate(parameters: Parameters, name: str, k: int, shape: tuple[int, ...]) -> Array:
    values = parameters.numbers("FORCE_PLATFORM", name)
    values = values[..., None] if values.ndim == len(shape) else values
    fits = values.ndim == len(shape) + 1 and values.shape[-1] > k
    if not fits or any(has < needs for has, needs in zip(values.shape, shape, strict=False)):
        raise ValueError(f"FORCE_PLATFORM:{name} does not describe it")
    part: Array = values[(..., k)][tuple(slice(n) for n in shape)]
    if not np.isfinite(part).all():
        raise ValueError(f"FORCE_PLATFORM:{name} holds something that is not a number")
    return part


def _origin(parameters: Parameters, k: int) -> Array:
    origin = _of_plate(parameters, "ORIGIN", k, (3,))
    return -origin if origin[2] > 0 else origin


def plate_axes(corners: Array) -> Array:
    """Give the axes of a plate from the corners of its surface.

    Parameters
    ----------
    corners
        Corners in the order of the C3D format, (4, 3) [m].

    Returns
    -------
    Array
        Orientation of the plate in the corners' axes (columns: the plate's axes), (3, 3).

    Raises
    ------
    ValueError
        The corners do not span a surface.
    """
    x = corners[0] - corners[1]
    z = np.cross(x, corners[0] - corners[3])
    if not np.linalg.norm(z) > 0:
        raise ValueError("its corners do not span a surface")
    axes = np.array([x, np.cross(z, x), z])
    return np.asarray((axes / np.linalg.norm(axes, axis=1, keepdims=True)).T)


def _scale(kind: int, sources: list[Channel], parameters: Parameters) -> Array:
    if kind == 1:
        parts = ((force_in_n, slice(3)), (length_in_m, slice(3, 5)), (moment_in_nm, slice(5, 6)))
        return np.hstack([_scales(convert, sources[part]) for convert, part in parts])
    if kind == 3:
        return _scales(force_in_n, sources)
    if kind == 4 and {unit.strip().lower() for _, unit in sources} <= VOLTS:
        force = force_in_n(parameters.text("FORCE_PLATFORM", "UNITS") or "N")
        moment = force * length_in_m(parameters.text("POINT", "UNITS"))
        return np.repeat([force, moment], 3)
    return np.hstack([_scales(force_in_n, sources[:3]), _scales(moment_in_nm, sources[3:])])


def _scales(convert: Callable[[str], float], sources: list[Channel]) -> Array:
    scales = []
    for name, unit in sources:
        try:
            scales.append(convert(unit))
        except ValueError as error:
            raise ValueError(f"channel {name}: {error}") from error
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
