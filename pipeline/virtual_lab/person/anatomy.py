"""Marker positions of a person in a T-pose: a reference person, scaled limb by limb."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np

from hbm.segments import Sex
from hbm.spatial import Array

HEIGHTS_M: Final = (0.0, 0.076, 0.520, 0.948, 1.477, 1.782)
"""Floor, ankle, knee, hip, neck and crown of the reference person (``t_pose.csv``)."""
REACHES_M: Final = (0.0, 0.190, 0.478, 0.752, 0.840)
"""Middle, shoulder, elbow, wrist and end of the hand of the reference person, sideways."""
BREADTHS: Final[dict[Sex, tuple[float, float]]] = {
    "male": (1.0, 1.0),
    "female": (1.04, 0.92),
    "unspecified": (1.02, 0.96),
}
"""Breadth of pelvis and shoulders by that of the reference man of the same stature; assumed."""


@dataclass(frozen=True, slots=True)
class Proportions:
    """Sizes of a person's parts by those of the reference person of the same stature.

    Heights between floor, ankle, knee, hip, neck and crown; breadths of pelvis and shoulders;
    depth of the trunk; length of the foot; lengths of the arm's segments.
    """

    ankle: float = 1.0
    shank: float = 1.0
    thigh: float = 1.0
    trunk: float = 1.0
    head: float = 1.0
    pelvis: float = 1.0
    shoulders: float = 1.0
    depth: float = 1.0
    foot: float = 1.0
    upper_arm: float = 1.0
    forearm: float = 1.0
    hand: float = 1.0


def t_pose(names: Sequence[str], height_m: float, sex: Sex, proportions: Proportions) -> Array:
    """Give the markers of a person who stands upright with the arms held out, palms down.

    Parameters
    ----------
    names
        Marker labels of the Human Body Model's sets.
    height_m
        Stature [m].
    sex
        Women have a broader pelvis and narrower shoulders.
    proportions
        Individual proportions; the heights are scaled to add up to the stature.

    Returns
    -------
    Array
        Marker positions, (M, 3) [m]: x forward, y left, z up, floor at z = 0.

    Raises
    ------
    ValueError
        If the reference person has no marker of a name.
    """
    hips, shoulders = BREADTHS[sex]
    own = proportions
    hips, shoulders = hips * own.pelvis, shoulders * own.shoulders
    heights = _scaled(HEIGHTS_M, (own.ankle, own.shank, own.thigh, own.trunk, own.head))
    heights *= HEIGHTS_M[-1] / heights[-1]
    reaches = _scaled(REACHES_M, (shoulders, own.upper_arm, own.forearm, own.hand))
    scale = {
        "pelvis": (own.depth, hips),
        "trunk": (own.depth, shoulders),
        "head": (1.0, 1.0),
        "leg": (1.0, hips),
        "foot": (own.foot, hips),
    }

    position = np.empty((len(names), 3))
    reference = _reference()
    for k, name in enumerate(names):
        if name not in reference:
            raise ValueError(f"the reference person has no marker {name!r}: {', '.join(reference)}")
        part, (x, y, z) = reference[name]
        if part == "arm":
            y = np.sign(y) * np.interp(abs(y), REACHES_M, reaches)
            z += heights[4] - HEIGHTS_M[4]
        else:
            x, y = x * scale[part][0], y * scale[part][1]
            z = np.interp(z, HEIGHTS_M, heights)
        position[k] = x, y, z
    return position * height_m / HEIGHTS_M[-1]


def _scaled(marks: Sequence[float], factors: Sequence[float]) -> Array:
    """Scale each interval between marks by its own factor."""
    return np.append(0.0, np.cumsum(np.diff(marks) * factors))


@cache
def _reference() -> dict[str, tuple[str, tuple[float, float, float]]]:
    """Give part and position [m] of every point, both sides."""
    text = files("pipeline.virtual_lab.person").joinpath("t_pose.csv").read_text(encoding="utf-8")
    points = {}
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        x, y, z = (float(row[axis]) / 1000 for axis in "xyz")
        points[row["point"]] = row["part"], (x, y, z)
        mirrored = _other_side(row["point"])
        points.setdefault(mirrored, (row["part"], (x, -y, z)))
    points["STRN"], points["XYPH"] = points["JN"], points["XIPH"]
    return points


def _other_side(name: str) -> str:
    return "FLTHI" if name == "FRTHI" else "L" + name[1:] if name.startswith("R") else name
