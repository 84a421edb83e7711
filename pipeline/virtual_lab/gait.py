"""The joints' pattern over a gait cycle: Fourier coefficients from published norms."""

import csv
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np

from hbm.coordinates import INDEX, TREE
from hbm.spatial import Array

FOOT: Final = ("foot pitch", "foot progression")


def posture(phase: Array, extent: Array, standing: Array) -> Array:
    """Give the coordinates of someone who walks in the mean pattern of healthy adults.

    Parameters
    ----------
    phase
        Phase of the right gait cycle from initial contact, (T,), one per cycle.
    extent
        0 for standing, 1 for walking at self-chosen speed, in proportion between and beyond, (T,).
    standing
        The person's coordinates when standing with the arms hanging, (46,).

    Returns
    -------
    Array
        Coordinates, (T, 46) [rad and m]; the pelvis' translations are those of ``standing``.
    """
    walking = np.tile(standing, (len(phase), 1))
    for name, (about_standing, _) in _table().items():
        if name in FOOT:
            continue
        for side in "RL" if name.startswith("R") else " ":
            i = INDEX[name if side == " " else side + name[1:]]
            value = _evaluate(name, phase + (0.5 if side == "L" else 0.0))
            value *= 0.01 if TREE[i].translates else np.pi / 180
            walking[:, i] = value + about_standing * standing[i]
    return standing + extent[:, None] * (walking - standing)


def foot_angles(phase: Array) -> tuple[Array, Array]:
    """Give how far a foot points down and inwards over its own gait cycle, (T,) each [rad]."""
    pitch, progression = (np.radians(_evaluate(name, phase)) for name in FOOT)
    return pitch, progression


def _evaluate(name: str, phase: Array) -> Array:
    _, coefficients = _table()[name]
    angle = 2 * np.pi * np.outer(phase, np.arange(len(coefficients)))
    return np.asarray(np.cos(angle) @ coefficients[:, 0] + np.sin(angle) @ coefficients[:, 1])


@cache
def _table() -> dict[str, tuple[bool, Array]]:
    """Give, by name, whether it adds to standing, and the cosines and sines, (K, 2)."""
    text = files("pipeline.virtual_lab").joinpath("gait.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    highest = max(int(row["harmonic"]) for row in rows)
    table = {
        row["coordinate"]: (row["about"] == "standing", np.zeros((highest + 1, 2))) for row in rows
    }
    for row in rows:
        pair = float(row["cosine"]), float(row["sine"])
        table[row["coordinate"]][1][int(row["harmonic"])] = pair
    return table
