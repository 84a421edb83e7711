"""How adults walk: all coordinates over the gait cycle, from the fitted coefficients."""

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
_FEET: Final = ("foot pitch", "foot progression", "foothold")


def posture(phase: Array, extent: Array, slope: Array, standing: Array) -> Array:
    """Give the coordinates of someone who walks in the mean pattern of healthy adults.

    Parameters
    ----------
    phase
        Phase of the right gait cycle from initial contact, (T,), one per cycle.
    extent
        0 for standing, 1 for steps as long as those of the norms, in proportion between and
        beyond, (T,).
    slope
        How far the belt rises forward, (T,) [rad].
    standing
        The person's coordinates when standing with the arms hanging, (46,).

    Returns
    -------
    Array
        Coordinates, (T, 46) [rad and m]. The pelvis moves about the point where it stands.
    """
    moved = np.zeros((len(phase), len(standing)))
    for name, (about_standing, _) in _table().items():
        if name in _FEET:
            continue
        for side in "RL" if name.startswith("R") else " ":
            i = INDEX[name if side == " " else side + name[1:]]
            value = _evaluate(name, phase + (0.5 if side == "L" else 0.0), slope)
            if not TREE[i].translates:
                value = np.radians(value)
            stays = about_standing or name in ("PelvisX", "PelvisY")
            moved[:, i] = value - (0.0 if stays else standing[i])
    size = size_of(standing)
    moved[:, :2] *= size
    moved[:, 2] *= size * extent  # the height that a leg spans changes with the square of its swing
    return np.asarray(standing + extent[:, None] * moved)


def size_of(standing: Array) -> float:
    """Give the size of a person's legs relative to those the coefficients were fitted to."""
    return float(standing[INDEX["PelvisZ"]]) / HIP_HEIGHT_M


def foot_angles(phase: Array) -> tuple[Array, Array]:
    """Give how far a foot points down and inwards over its own gait cycle, (T,) each [rad]."""
    level = np.zeros_like(phase)
    pitch, progression = (np.radians(_evaluate(name, phase, level)) for name in _FEET[:2])
    return pitch, progression


def foothold(slope: Array) -> Array:
    """Give how far ahead of the pelvis' mean place the ankle comes down, (T,) [m]."""
    return _evaluate("foothold", np.zeros_like(slope), slope)


def _evaluate(name: str, phase: Array, slope: Array) -> Array:
    _, coefficients = _table()[name]
    angle = 2 * np.pi * np.outer(phase, np.arange(coefficients.shape[1]))
    cosines, sines = np.moveaxis(coefficients, 2, 0)
    by_slope = np.cos(angle) @ cosines.T + np.sin(angle) @ sines.T
    return np.asarray(np.sum(by_slope * _polynomials(slope), axis=1))


def _polynomials(slope: Array) -> Array:
    """Give Lagrange's polynomials over the slopes of the table, (T, slopes)."""
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
    """Give, by name, whether it adds to standing, and cosines and sines, (slopes, K, 2)."""
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
