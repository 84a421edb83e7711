"""Segment inertias scaled to a person, by two published tables."""

import csv
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final, Literal

import numpy as np

from hbm.segments import Inertia, Sex
from hbm.spatial import Array, axes_from
from pipeline.virtual_lab.person.body.posture import SIDES, Anatomy

Source = Literal["de_leva", "dumas"]
STATURE_M: Final = {
    **{("de_leva", "male"): 1.741, ("de_leva", "female"): 1.735},
    **{("dumas", "male"): 1.77, ("dumas", "female"): 1.61},
}
"""Mean statures of the samples."""
PAIRED: Final = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
TOES_KG: Final = 1e-6
TOES_GYRATION_M: Final = 0.01
"""Mass and size of the toes as the Human Body Model's implementation has them: the tables' feet
include them."""


@dataclass(frozen=True, slots=True)
class Row:
    """A segment of a table: shares of body mass and of the segment's length.

    Attributes
    ----------
    mass
        Share of body mass; those of a whole body add up to one.
    center
        Centre of mass: forward, along the segment, to the right, (3,).
    tensor
        Tensor of inertia about it by mass and length squared, in these axes, (3, 3).
    length
        Mean length by stature; NaN where it is not used.
    """

    mass: float
    center: Array
    tensor: Array
    length: float


@cache
def table(source: Source, sex: Sex) -> dict[str, Row]:
    """Give a table's rows for a sex; "unspecified" is the mean of both.

    Parameters
    ----------
    source
        "de_leva" or "dumas" (see ``segment_inertias.csv``).
    sex
        Of the person.

    Returns
    -------
    dict of str to Row
        By segment, without side.
    """
    if sex == "unspecified":
        men, women = table(source, "male"), table(source, "female")
        return {s: _mean(men[s], women[s]) for s in men}
    text = files(__package__).joinpath("segment_inertias.csv").read_text(encoding="utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    rows = [r for r in csv.DictReader(lines) if (r["source"], r["sex"]) == (source, sex)]
    total = sum(float(r["mass"]) * (2 if r["segment"] in PAIRED else 1) for r in rows)
    return {
        r["segment"]: Row(
            float(r["mass"]) / total,
            np.array([float(r[f"center_{k}"]) / 100 for k in "xyz"]),
            _tensor(*(float(r[k]) / 100 for k in ("xx", "yy", "zz", "xy", "xz", "yz"))),
            float(r["length_mm"] or "nan") / 1000 / STATURE_M[source, sex],
        )
        for r in rows
    }


def navel_share(sex: Sex) -> float:
    """Give the way from xiphoid to navel as a share of that to mid-hip (de Leva 1996)."""
    rows = table("de_leva", sex)
    middle, lower = rows["mid_trunk"].length, rows["pelvis"].length
    return middle / (middle + lower)


def inertias_of(
    anatomy: Anatomy, source: Source, mass_kg: float, sex: Sex, height_m: float
) -> dict[str, Inertia]:
    """Scale a table to a person.

    Parameters
    ----------
    anatomy
        The person in the T-pose.
    source
        Which table.
    mass_kg, sex, height_m
        Of the person [kg, m].

    Returns
    -------
    dict of str to Inertia
        In the frames of the segments; the toes are massless but for rounding.
    """
    found = {}
    for segment, rotation in anatomy.rotations.items():
        side, _, part = segment.rpartition("_")
        name = part if side in SIDES else segment
        name = "upper_arm" if segment.endswith("upper_arm") else name
        rows = table(source, sex)
        if name not in rows:
            continue
        scaled = _de_leva if source == "de_leva" else _dumas
        part_of = scaled(anatomy, segment, rows[name], mass_kg, height_m)
        found[segment] = part_of.in_frame(rotation, anatomy.origin(segment))
    for side in SIDES:
        foot = found[f"{side}_foot"]
        found[f"{side}_foot"] = Inertia(foot.mass - TOES_KG, foot.center, foot.tensor)
        tensor = TOES_KG * TOES_GYRATION_M**2 * np.eye(3)
        found[f"{side}_toes"] = Inertia(TOES_KG, np.zeros(3), tensor)
    return found


def _de_leva(anatomy: Anatomy, segment: str, row: Row, mass_kg: float, _: float) -> Inertia:
    proximal, distal, lateral = anatomy.ends[segment]
    frame = axes_from(np.asarray(lateral), proximal - distal, exact="up")
    return _scaled(row, mass_kg, proximal, frame, float(np.linalg.norm(distal - proximal)), "right")


def _dumas(anatomy: Anatomy, segment: str, row: Row, mass_kg: float, height_m: float) -> Inertia:
    """Place a segment between its joints: the trunk's are C7/T1, T12/L1 and L5/S1."""
    points, side = anatomy.points, segment.partition("_")[0]
    if segment == "pelvis":
        frame = anatomy.rotations["pelvis"]
        return _scaled(row, mass_kg, points["lumbar"], frame, row.length * height_m, "right")
    if side in SIDES:
        _, distal, lateral = anatomy.ends[segment]
        origin = anatomy.origin(segment)
        if segment.endswith("foot"):
            heel, toes = anatomy.ends[segment][0], points[f"{side}_toes"]
            origin, ahead = points[f"{side}_ankle"], distal - heel
            left = axes_from(np.asarray(lateral), np.cross(ahead, lateral), exact="up")[:, 1]
            frame = axes_from(left, np.cross(ahead, left), exact="up")
            return _scaled(row, mass_kg, origin, frame, float(np.linalg.norm(toes - origin)), side)
        frame = axes_from(np.asarray(lateral), origin - distal, exact="up")
        return _scaled(row, mass_kg, origin, frame, float(np.linalg.norm(distal - origin)), side)
    upper, lower = {
        "head": (points["vertex"], points["neck"]),
        "thorax": (points["neck"], points["mid_trunk"]),
        "mid_trunk": (points["mid_trunk"], points["lumbar"]),
    }[segment]
    frame = axes_from(anatomy.rotations[segment][:, 1], upper - lower, exact="up")
    origin = lower if segment == "head" else upper
    return _scaled(row, mass_kg, origin, frame, float(np.linalg.norm(upper - lower)), "right")


def _scaled(
    row: Row, mass_kg: float, origin: Array, frame: Array, length: float, side: str
) -> Inertia:
    """Scale a row to a segment; ``frame`` has the columns forward, left, up of the segment."""
    ahead, left, up = frame.T
    outward = left if side == "left" else -left
    axes = np.column_stack([ahead, up, outward])
    mass = row.mass * mass_kg
    return Inertia(
        mass, origin + length * axes @ row.center, mass * length**2 * axes @ row.tensor @ axes.T
    )


def _tensor(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    radii = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.asarray(np.sign(radii) * radii**2)


def _mean(a: Row, b: Row) -> Row:
    return Row(
        (a.mass + b.mass) / 2,
        (a.center + b.center) / 2,
        _between(a.tensor, b.tensor),
        (a.length + b.length) / 2,
    )


def _between(a: Array, b: Array) -> Array:
    """Average the radii of gyration of two tensors."""
    radii = (np.sign(a) * np.sqrt(np.abs(a)) + np.sign(b) * np.sqrt(np.abs(b))) / 2
    return np.asarray(np.sign(radii) * radii**2)
