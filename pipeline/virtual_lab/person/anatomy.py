"""Where the markers of a person in a T-pose are: a reference person, stretched limb by limb."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np

from hbm.segments import Sex
from hbm.spatial import Array

HEIGHTS: Final = (0.0, 0.076, 0.520, 0.948, 1.477, 1.782)
REACHES: Final = (0.0, 0.190, 0.478, 0.752, 0.840)
BREADTHS: Final[dict[Sex, tuple[float, float]]] = {
    "male": (1.0, 1.0),
    "female": (1.04, 0.92),
    "unspecified": (1.02, 0.96),
}


@dataclass(frozen=True, slots=True)
class Build:
    """How much longer or wider than the reference person's the parts of a person are.

    Heights between floor, ankle, knee, hip, neck and crown; breadths of pelvis and shoulders; depth
    of the trunk; length of the foot; lengths of the arm's parts. All relative to stature.
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


def t_pose(names: Sequence[str], height_m: float, sex: Sex, build: Build) -> Array:
    """Place the markers of a person who stands upright with the arms held out, palms down.

    Parameters
    ----------
    names
        Marker labels of the Human Body Model's sets.
    height_m
        Stature [m].
    sex
        Women have a broader pelvis and narrower shoulders.
    build
        Individual proportions; the heights are scaled to add up to the stature.

    Returns
    -------
    Array
        Marker positions, (M, 3) [m]: x forward, y left, z up, floor at z = 0.

    Raises
    ------
    ValueError
        If a label is none of the reference person's.
    """
    hips, shoulders = BREADTHS[sex]
    hips, shoulders = hips * build.pelvis, shoulders * build.shoulders
    heights = _stretched(HEIGHTS, (build.ankle, build.shank, build.thigh, build.trunk, build.head))
    heights *= HEIGHTS[-1] / heights[-1]
    reaches = _stretched(REACHES, (shoulders, build.upper_arm, build.forearm, build.hand))
    scale = {
        "pelvis": (build.depth, hips),
        "trunk": (build.depth, shoulders),
        "head": (1.0, 1.0),
        "leg": (1.0, hips),
        "foot": (build.foot, hips),
    }

    placed = np.empty((len(names), 3))
    reference = _reference()
    for k, name in enumerate(names):
        if name not in reference:
            raise ValueError(f"the reference person has no marker {name!r}: {', '.join(reference)}")
        part, (x, y, z) = reference[name]
        if part == "arm":
            y = np.sign(y) * np.interp(abs(y), REACHES, reaches)
            z += heights[4] - HEIGHTS[4]
        else:
            x, y = x * scale[part][0], y * scale[part][1]
            z = np.interp(z, HEIGHTS, heights)
        placed[k] = x, y, z
    return placed * height_m / HEIGHTS[-1]


def _stretched(marks: Sequence[float], factors: Sequence[float]) -> Array:
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
