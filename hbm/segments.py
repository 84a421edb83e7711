"""Segment inertias by de Leva (1996), scaled to a person.

The table, `de_leva_1996.csv`, ships with the package and names its source. The female column sums
to 99.99 % and is renormalised; an unspecified sex takes the mean of both columns.
"""

import csv
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final, Literal, NamedTuple

import numpy as np

from hbm.spatial import Array, read_only, skew

Sex = Literal["male", "female", "unspecified"]
SEXES: Final[tuple[Sex, ...]] = ("male", "female", "unspecified")
SAMPLE_STATURE_M: Final[dict[str, float]] = {"male": 1.741, "female": 1.735}
"""Mean of de Leva's samples."""

COLUMNS: Final = (
    *("mass_pct", "cm_pct"),
    *("k_sagittal_pct", "k_transverse_pct", "k_longitudinal_pct"),
    "length_mm",
)
PAIRED: Final = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")


class Proportions(NamedTuple):
    """One segment's row of the table.

    Attributes
    ----------
    mass
        Fraction of body mass.
    center
        Centre of mass from the proximal end, as a fraction of the segment's length.
    gyration
        Radii of gyration about the antero-posterior, medio-lateral and longitudinal axis through
        the centre of mass, as fractions of length.
    length
        Mean length of the reference sample as a fraction of stature.
    """

    mass: float
    center: float
    gyration: Array
    length: float


@cache
def _table(sex: str) -> dict[str, Array]:
    """Give mass, centre, three radii of gyration and length of each segment, (6,)."""
    text = files("hbm").joinpath("de_leva_1996.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    raw = {row["segment"]: row for row in rows if row["sex"] == sex}
    total = sum(float(row["mass_pct"]) * (2 if s in PAIRED else 1) for s, row in raw.items())
    units = np.array([total, *4 * [100.0], 1000.0])
    stature = np.array([*5 * [1.0], SAMPLE_STATURE_M[sex]])
    return {
        s: np.array([row[c] for c in COLUMNS], float) / units / stature for s, row in raw.items()
    }


def proportions(sex: Sex) -> dict[str, Proportions]:
    """Give the table's column for a sex.

    Parameters
    ----------
    sex
        "male", "female", or "unspecified" for the mean of both.

    Returns
    -------
    dict[str, Proportions]
        By segment: head, upper_trunk, mid_trunk, lower_trunk, upper_arm, forearm, hand, thigh,
        shank, foot. Masses of the whole body (six of them twice) sum to one.

    Raises
    ------
    ValueError
        If the sex is none of the three.

    Notes
    -----
    de Leva P (1996) J Biomech 29:1223-1230, Table 4, with the endpoints head VERT-CERV, upper
    trunk CERV-XYPH, mid trunk XYPH-OMPH, lower trunk OMPH-MIDH, hand WJC-MET3, shank KJC-AJC. The
    lengths are distances along a segment's longitudinal axis: landmarks of head and trunk, such as
    CERV (the spine of C7) and XYPH (the lower end of the sternum), are projected on it.
    """
    if sex not in SEXES:
        raise ValueError(f"sex must be one of {', '.join(SEXES)}, got {sex!r}")
    if sex == "unspecified":
        men, women = _table("male"), _table("female")
        rows = {s: (men[s] + women[s]) / 2 for s in men}
    else:
        rows = _table(sex)
    return {s: Proportions(row[0], row[1], row[2:5], row[5]) for s, row in rows.items()}


@dataclass(frozen=True, slots=True)
class Inertia:
    """Mass, centre of mass and moment of inertia of a rigid part, in a frame.

    Attributes
    ----------
    mass
        Mass [kg].
    center
        Centre of mass, (3,) [m].
    tensor
        Moment of inertia about the centre of mass, (3, 3) [kg·m²].
    """

    mass: float
    center: Array
    tensor: Array

    def __post_init__(self) -> None:
        if not self.mass >= 0:
            raise ValueError(f"a mass must not be negative, got {self.mass:g} kg")
        for name in ("center", "tensor"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def __add__(self, other: "Inertia") -> "Inertia":
        """Join two parts rigidly, given in the same frame (parallel-axis theorem)."""
        mass = self.mass + other.mass
        if mass == 0:
            return self
        center = (self.mass * self.center + other.mass * other.center) / mass
        tensor = np.zeros((3, 3))
        for part in (self, other):
            lever = skew(part.center - center)
            tensor += part.tensor - part.mass * lever @ lever
        return Inertia(mass, center, tensor)

    def in_frame(self, rotation: Array, origin: Array) -> "Inertia":
        """Give the same part in a frame of this orientation (columns: its axes) and origin."""
        inverse = rotation.T
        center = inverse @ (self.center - origin)
        return Inertia(self.mass, center, inverse @ self.tensor @ rotation)


NO_INERTIA: Final = Inertia(0.0, np.zeros(3), np.zeros((3, 3)))


def segment_inertia(
    part: Proportions, mass: float, proximal: Array, distal: Array, lateral: Array
) -> Inertia:
    """Scale a segment's inertia to its ends.

    Parameters
    ----------
    part
        The segment's proportions.
    mass
        Body mass [kg].
    proximal, distal
        The segment's ends, (3,) [m]; the centre of mass lies between them.
    lateral
        A direction near the medio-lateral axis, (3,).

    Returns
    -------
    Inertia
        In the frame of the given points. Principal moments are ``m (k L)²``.
    """
    along = distal - proximal
    length = float(np.linalg.norm(along))
    if length == 0:
        raise ValueError("a segment's two ends coincide; check its landmarks")
    z = along / length
    x = np.cross(lateral, z)
    x /= np.linalg.norm(x)
    axes = np.column_stack([x, np.cross(z, x), z])
    moments = part.mass * mass * (part.gyration * length) ** 2
    return Inertia(
        part.mass * mass, proximal + part.center * along, axes @ np.diag(moments) @ axes.T
    )
