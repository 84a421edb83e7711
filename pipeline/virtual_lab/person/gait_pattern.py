"""The mean gait pattern of adults: coordinates over the gait cycle, from fitted coefficients."""

import csv
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np

from hbm.coordinates import INDEX, TREE
from hbm.spatial import Array

SPEED_MPS: Final = 1.3
STRIDE_S: Final = 1.08
STEP_M: Final = SPEED_MPS * STRIDE_S / 2
HIP_HEIGHT_M: Final = 0.949
"""Walking speed, stride time, step length, and height of the mid-hip point in standing, for which
the coefficients were fitted (``tests/virtual_gait``)."""
_FEET: Final = ("foot pitch", "foot progression", "foothold")
"""What the table has beside coordinates."""


def posture(phase: Array, extent: Array, slope: Array, standing: Array) -> Array:
    """Give the coordinates of walking in the mean pattern of healthy adults.

    Parameters
    ----------
    phase
        Phase of the right gait cycle from initial contact, (T,), in gait cycles.
    extent
        Step length relative to that of the norms, (T,); 0 for standing. The motion is scaled by it.
    slope
        How steeply the belt rises forward, (T,) [rad].
    standing
        The person's coordinates in standing with the arms hanging, (46,).

    Returns
    -------
    Array
        Coordinates, (T, 46) [rad and m]. The pelvis moves about its place in standing.
    """
    change = np.zeros((len(phase), len(standing)))
    polynomials = _polynomials(slope)
    bases = {side: _basis(phase + (0.5 if side == "L" else 0.0)) for side in " RL"}
    for name, (about_standing, _) in _table().items():
        if name in _FEET:
            continue
        for side in "RL" if name.startswith("R") else " ":
            i = INDEX[name if side == " " else side + name[1:]]
            value = _evaluate(name, bases[side], polynomials)
            if not TREE[i].translates:
                value = np.radians(value)
            from_standing = about_standing or name in ("PelvisX", "PelvisY")
            change[:, i] = value - (0.0 if from_standing else standing[i])
    size = size_of(standing)
    change[:, :2] *= size
    change[:, 2] *= size * extent  # the height of a pendulum changes with the square of its angle
    return np.asarray(standing + extent[:, None] * change)


def size_of(standing: Array) -> float:
    """Give leg length relative to that of the person the coefficients were fitted for."""
    return float(standing[INDEX["PelvisZ"]]) / HIP_HEIGHT_M


def foot_angles(phase: Array) -> tuple[Array, Array]:
    """Give a foot's pitch (down) and progression (inwards) over its gait cycle, (T,) each [rad]."""
    basis, level = _basis(phase), _polynomials(np.zeros_like(phase))
    pitch, progression = (np.radians(_evaluate(name, basis, level)) for name in _FEET[:2])
    return pitch, progression


def foothold(slope: Array) -> Array:
    """Give how far ahead of the pelvis' mean place the ankle is at initial contact, (T,) [m]."""
    return _evaluate("foothold", _basis(np.zeros_like(slope)), _polynomials(slope))


def _basis(phase: Array) -> tuple[Array, Array]:
    """Give the cosines and sines of all harmonics, (T, K) each."""
    harmonics = next(iter(_table().values()))[1].shape[1]
    angle = 2 * np.pi * np.outer(phase, np.arange(harmonics))
    return np.cos(angle), np.sin(angle)


def _evaluate(name: str, basis: tuple[Array, Array], polynomials: Array) -> Array:
    """Evaluate a coordinate at phases and slopes, given what is common to all coordinates, (T,)."""
    (cosines, sines), (cosine, sine) = np.moveaxis(_table()[name][1], 2, 0), basis
    by_slope = cosine @ cosines.T + sine @ sines.T
    return np.asarray(np.sum(by_slope * polynomials, axis=1))


def _polynomials(slope: Array) -> Array:
    """Give the Lagrange polynomials over the slopes of the table, (T, slopes)."""
    at = np.degrees(slope)[:, None]
    nodes = _slopes()
    out = np.ones((len(slope), len(nodes)))
    for j, node in enumerate(nodes):
        for other in nodes:
            if other != node:
                out[:, j] *= (at[:, 0] - other) / (node - other)
    return out


@cache
def _rows() -> list[dict[str, str]]:
    text = files("pipeline.virtual_lab.person").joinpath("gait.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


@cache
def _slopes() -> tuple[float, ...]:
    return tuple(sorted({float(row["slope_deg"]) for row in _rows()}))


@cache
def _table() -> dict[str, tuple[bool, Array]]:
    """Give whether a name's values add to standing, and its cosines and sines, (slopes, K, 2)."""
    slopes = _slopes()
    highest = max(int(row["harmonic"]) for row in _rows())
    table: dict[str, tuple[bool, Array]] = {}
    for row in _rows():
        about = row["about"] == "standing"
        entry = table.setdefault(
            row["coordinate"], (about, np.zeros((len(slopes), highest + 1, 2)))
        )
        pair = float(row["cosine"]), float(row["sine"])
        entry[1][slopes.index(float(row["slope_deg"])), int(row["harmonic"])] = pair
    return table
