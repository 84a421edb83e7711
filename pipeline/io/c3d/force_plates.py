"""Force plates of a C3D file, TYPE 1 to 4: how they are described, their channels as wrenches."""

from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.numbers import read_numbers
from hbm.spatial import Array, cross, shift_wrench
from hbm.spelling import short
from pipeline.io.c3d.data import Header
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.read_options import CONVERT, Quantity, ReadOptions
from pipeline.io.recording import Fact
from pipeline.io.units import LENGTHS

QUANTITIES: Final[dict[int, tuple[Quantity, ...]]] = {
    1: ("force",) * 3 + ("pressure",) * 2 + ("moment",),
    2: ("force",) * 3 + ("moment",) * 3,
    3: ("force",) * 8,
    4: ("force",) * 3 + ("moment",) * 3,
}
"""TYPE -> what its channels hold; of TYPE 4, what they give after the matrix."""
LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "plates")


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
    to_si
        One of each channel in SI units, (6,); of TYPE 3 and 4, channels -> wrench about the
        transducer, (6, c).
    origin
        From the transducer to the centre of the surface; of TYPE 3 its height alone, of TYPE 1
        zero, (3,) [m].
    corners
        Corners of the surface in the file's axes, (4, 3) [m].
    rotation
        Orientation of the plate in the file's axes (columns: the plate's axes), (3, 3).
    units
        Of forces, moments and pressures, as they are read.
    """

    number: int
    kind: int
    channels: tuple[int, ...]
    to_si: Array
    origin: Array
    corners: Array
    rotation: Array
    units: str = ""

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
        values = channels * self.to_si if self.to_si.ndim == 1 else (self.to_si @ channels.T).T
        # TYPE 1: m = p × f + t, p in the surface, t about its normal
        if self.kind == 1:
            centre = np.pad(values[:, 3:5], ((0, 0), (0, 1)))
            free_moment = np.pad(values[:, 5:], ((0, 0), (2, 0)))
            return np.hstack([values[:, :3], np.cross(centre, values[:, :3]) + free_moment])
        return shift_wrench(values, self.origin)


def plate_layouts(
    header: Header, options: ReadOptions, position: Array | None = None
) -> tuple[list[PlateLayout], list[Fact]]:
    """Read how a file describes its force plates.

    Parameters
    ----------
    header
        What the file says of itself.
    options
        Units that a person states.
    position
        Of markers in the file's axes, (T, M, 3) [m]; they show corners in another unit.

    Returns
    -------
    plates
        In the file's order, those that it describes.
    facts
        The others, left out, and corners that form no rectangle or are in another unit.

    Raises
    ------
    ValueError
        A unit is unknown.
    """
    parameters = header.parameters
    used = parameters.integer("FORCE_PLATFORM", "USED", 0)
    if used > 255:  # which is as many as a dimension of a parameter has entries
        raise ValueError(f"FORCE_PLATFORM:USED says {used} plates: the file is damaged")
    plates: list[PlateLayout] = []
    facts: list[Fact] = []
    for k in range(used):
        try:
            plate, of_corners = _plate_layout(k, header, options, position)
            plates.append(plate)
            facts += of_corners
        except Undescribed as error:
            facts.append(Fact("left_out", f"plate {k + 1}", str(error), plate=True))
        except ValueError as error:
            raise ValueError(f"force plate {k + 1}: {error}") from error
    for k in range(used, parameters.numbers("FORCE_PLATFORM", "TYPE").size):
        with suppress(ValueError):
            plate, _ = _plate_layout(k, header, options, position)
            if not {*plate.channels} & {c for other in plates for c in other.channels}:
                reason = f"FORCE_PLATFORM:USED says {used}, though the file describes it"
                facts.append(Fact("left_out", f"plate {k + 1}", reason, plate=True))
    return plates, facts


def _plate_layout(
    k: int, header: Header, options: ReadOptions, position: Array | None
) -> tuple[PlateLayout, list[Fact]]:
    parameters, labelled = header.parameters, header.channels
    kind = int(_of_plate(parameters, "TYPE", k, ()))
    if kind not in QUANTITIES:
        raise Undescribed(f"plates of TYPE {kind} are not supported; export it with TYPE 2 plates")
    quantities, length = QUANTITIES[kind], parameters.text("POINT", "UNITS")
    metre = options.metre(length)
    corners = _of_plate(parameters, "CORNERS", k, (3, 4)).T
    rotation = plate_axes(corners)
    unit, facts = unit_of_corners(k + 1, corners, metre, position)
    corners = corners * unit
    halves = corners[:2] + corners[2:]  # equal in a rectangle
    error_m = np.linalg.norm(halves[0] - halves[1])
    if error_m > LIMITS.largest_corner_error:
        doubt = f"one corner is {1000 * error_m:.0f} mm from a rectangle's"
        facts.append(Fact("in_doubt", f"plate {k + 1}", doubt))
    numbers = _of_plate(parameters, "CHANNEL", k, (len(quantities),)).astype(int) - 1
    channels = tuple(numbers.tolist())
    if not all(0 <= channel < len(labelled) for channel in channels):
        raise Undescribed(f"it uses channels outside the file's {len(labelled)} analog channels")
    names, units = zip(*(labelled[channel] for channel in channels), strict=True)
    volts = {"v", "mv", "uv", "volt", "volts", ""}
    if kind == 4 and {written.strip().lower() for written in units} <= volts:
        # the matrix makes of them forces in the plates' unit
        force = parameters.text("FORCE_PLATFORM", "UNITS") or "N"
        units = (force,) * 3 + (f"{force}{options.units or length}",) * 3
    to_si = np.empty(len(units))
    for n, (quantity, name, written) in enumerate(zip(quantities, names, units, strict=True)):
        try:
            to_si[n] = options.plate_unit(quantity, written)
        except ValueError as error:
            raise ValueError(f"channel {short(name)}: {error}") from error
    origin = np.zeros(3) if kind == 1 else _of_plate(parameters, "ORIGIN", k, (3,))
    # in the unit of the corners where the transducer is not near a plate in that of the markers
    nearest, farthest = LIMITS.origin_distances
    is_near = nearest <= np.linalg.norm(origin) * metre <= farthest
    origin = origin * (metre if is_near else unit)
    # the transducer lies below the surface, whose z points down: o from it is negative
    origin = -origin if origin[2] > 0 else origin
    if kind == 3:
        # forces x12, x34, y14, y23, z1, z2, z3, z4 of sensors at the distances ±a and ±b
        a, b, _ = origin
        to_si = to_si * [
            [1, 1, 0, 0, 0, 0, 0, 0],
            [0, 0, 1, 1, 0, 0, 0, 0],
            [0, 0, 0, 0, 1, 1, 1, 1],
            [0, 0, 0, 0, b, b, -b, -b],
            [0, 0, 0, 0, -a, a, a, -a],
            [-b, b, a, -a, 0, 0, 0, 0],
        ]
        origin = origin * [0, 0, 1]
    elif kind == 4:
        to_si = to_si[:, np.newaxis] * _of_plate(parameters, "CAL_MATRIX", k, (6, 6))
    of = dict(zip(quantities, units, strict=True))
    read_as = ",".join(options.used_unit(name, of[name]) for name in CONVERT if name in of)
    return PlateLayout(k + 1, kind, channels, to_si, origin, corners, rotation, read_as), facts


def unit_of_corners(
    number: int, corners: Array, metre: float, position: Array | None
) -> tuple[float, list[Fact]]:
    """Give the unit of a plate's corners, (4, 3), in metres: that of the file, if it can be.

    A plate of an odd size is in the one unit in which it has a usual size, if markers are above it
    then, or if its size is impossible otherwise. A ValueError where no unit makes it possible.
    """
    edges = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)

    def fits(unit: float, lowest: float, highest: float) -> bool:
        return bool(lowest <= edges.min() * unit and edges.max() * unit <= highest)

    possible = fits(metre, *LIMITS.possible_edges)
    if fits(metre, *LIMITS.usual_edges):
        return metre, []
    size = f"{1000 * edges[0] * metre:.3g} × {1000 * edges[1] * metre:.3g} mm"
    likely = {name: unit for name, unit in LENGTHS.items() if fits(unit, *LIMITS.likely_edges)}
    for name, unit in likely.items() if len(likely) == 1 else ():
        if not possible or _under_markers(corners * unit, position):
            reason = f"{size} in the unit of the file, {name} used"
            return unit, [Fact("corrected", f"corners of plate {number}", reason)]
    if not possible:
        raise Undescribed(f"its corners are {size} apart, and not one of m, cm and mm mends that")
    return metre, []


def _under_markers(corners: Array, position: Array | None) -> bool:
    """Whether markers come close to the surface of a plate, in the file's axes, (4, 3) [m]."""
    if position is None:
        return False
    axes, centre = plate_axes(corners), corners.mean(axis=0)
    # in the plate's axes: within half of its edges, and near its surface
    half = np.abs((corners - centre) @ axes)[:, :2].max(axis=0)
    place = np.abs((position - centre) @ axes)
    is_near = (place < [*half, LIMITS.near_surface]).all(axis=-1).any(axis=1)
    return bool(is_near.sum() >= LIMITS.near_frames)


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
    z = cross(x, corners[0] - corners[3])
    if not np.linalg.norm(z) > 0:
        raise Undescribed("its corners do not span a surface")
    axes = np.array([x, cross(z, x), z])
    return np.asarray((axes / np.linalg.norm(axes, axis=1, keepdims=True)).T)


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
    ...     1, 2, (0, 1, 2, 3, 4, 5), np.ones(6), np.array([0, 0, -0.1]), corners, np.eye(3)
    ... )
    >>> channel_change(plate, np.array([[10.0, 0, 0, 0, 0, 0]])) + 0.0
    array([[10.,  0.,  0.,  0., -1.,  0.]])
    """
    if plate.kind == 1:
        why = "TYPE 1 stores a centre of pressure, which a compensated force may not have"
        raise ValueError(f"force plate {plate.number}: {why}; export it with TYPE 2 plates")
    to_wrench = plate.wrench(np.eye(len(plate.channels))).T
    # units of force and moment differ by 1e3, a singular matrix by 1e16
    if not np.linalg.cond(to_wrench) < 1e9:
        check = f"check FORCE_PLATFORM:{'CAL_MATRIX' if plate.kind == 4 else 'ORIGIN'}"
        raise ValueError(f"force plate {plate.number}: no wrench by its channels; {check}")
    if plate.kind == 3:
        return wrench_change @ np.linalg.pinv(to_wrench).T
    return np.asarray(np.linalg.solve(to_wrench, wrench_change.T).T)
