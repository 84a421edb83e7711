"""Segment inertias by de Leva (1996), scaled to a person; and those that are known better.

The table, `de_leva_1996.csv`, ships with the package and names its source. The female column sums
to 99.99 % and is renormalised; an unspecified sex takes the mean of both columns.
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from hbm.coordinates import SEGMENTS
from hbm.numbers import read_numbers
from hbm.spatial import Array, cross, freeze_arrays, read_only, skew, unit
from hbm.spelling import did_you_mean, no_segment, parse_toml, shown

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "segments")

Sex = Literal["male", "female", "unspecified"]
SEXES: Final[tuple[Sex, ...]] = ("male", "female", "unspecified")
SAMPLE_STATURE_M: Final[dict[str, float]] = {"male": 1.741, "female": 1.735}
"""Mean of de Leva's samples."""
LEGS_PER_STATURE: Final = 0.245 + 0.246
"""Thigh and shank, as shares of stature (Drillis and Contini 1966, as in Winter 2009, Fig. 4.1)."""

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
    # rounded percentages do not quite add up to 100: fractions of their own sum
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
    tables = [_table(column) for column in columns_of(sex)]
    rows = {s: np.mean([table[s] for table in tables], axis=0) for s in tables[0]}
    return {s: Proportions(row[0], row[1], row[2:5], row[5]) for s, row in rows.items()}


def columns_of(sex: Sex) -> tuple[str, ...]:
    """Give the columns of the table whose mean a sex has."""
    return ("male", "female") if sex == "unspecified" else (sex,)


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
        freeze_arrays(self, "inertia", center=(3,), tensor=(3, 3))

    def __add__(self, other: "Inertia") -> "Inertia":
        """Join two parts rigidly, given in the same frame (parallel-axis theorem)."""
        return self._joined(other, 1.0)

    def __sub__(self, other: "Inertia") -> "Inertia":
        """Give what is left without a part that belongs to this one."""
        return self._joined(other, -1.0)

    def _joined(self, other: "Inertia", sign: float) -> "Inertia":
        mass = self.mass + sign * other.mass
        if mass == 0:
            return self
        # common centre of mass, then each tensor about it: I + m (c² 1 − c cᵀ) = I − m [c]×²
        center = (self.mass * self.center + sign * other.mass * other.center) / mass
        tensor = np.zeros((3, 3))
        for part, factor in ((self, 1.0), (other, sign)):
            lever = skew(part.center - center)
            tensor += factor * (part.tensor - part.mass * lever @ lever)
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
    # longitudinal axis through both ends, medio-lateral as near as can be
    z = along / length
    x = unit(cross(lateral, z))
    axes = np.column_stack([x, cross(z, x), z])
    # I = A diag(m (k L)²) Aᵀ
    moments = part.mass * mass * (part.gyration * length) ** 2
    return Inertia(part.mass * mass, proximal + part.center * along, axes * moments @ axes.T)


COUNTS: Final = {"mass_kg": (1,), "center_m": (3,), "inertia_kg_m2": (3, 6)}
"""Key of the file -> how many numbers it may have."""


@dataclass(frozen=True, slots=True, eq=False)
class SegmentOverride:
    """Values that replace the table's for one segment; None keeps the table's.

    Attributes
    ----------
    mass_kg
        Mass [kg].
    center_m
        Centre of mass in the segment's frame (origin at its proximal joint; forward, left, up in
        the anatomical position), (3,) [m].
    inertia_kg_m2
        Moment of inertia about the centre of mass in that frame, (3, 3) [kg·m²]. Without it the
        table's scales with the mass.
    worn
        What is worn on the segment in addition: a shoe, a brace, a part of an exoskeleton, in the
        segment's frame.

    Examples
    --------
    A prosthesis below the knee, in the body of ``static``, the markers of a calibration pose:

    >>> import hbm
    >>> prosthesis = hbm.SegmentOverride(mass_kg=1.9, center_m=[0.01, 0.0, -0.12])
    >>> body = hbm.build_body(static, mass=74.6, overrides={"right_shank": prosthesis})
    >>> body.segments["right_shank"].mass
    1.9
    >>> f"{sum(part.mass for part in body.segments.values()):.1f} kg"
    '74.6 kg'
    """

    mass_kg: float | None = None
    center_m: Array | None = None
    inertia_kg_m2: Array | None = None
    worn: Inertia | None = None

    def __post_init__(self) -> None:
        if self.mass_kg is not None and not self.mass_kg > 0:
            raise ValueError(f"mass_kg must be positive, got {self.mass_kg:g}")
        for name, shape in (("center_m", (3,)), ("inertia_kg_m2", (3, 3))):
            value = getattr(self, name)
            if value is None:
                continue
            if np.shape(value) != shape or not np.isfinite(value).all():
                raise ValueError(f"{name} must be {shape} finite numbers, got {value}")
            if name == "center_m" and np.abs(value).max() > LIMITS.farthest_center:
                raise ValueError(
                    f"center_m must be within {LIMITS.farthest_center:g} m of the joint, "
                    f"got {list(value)}; that looks like millimetres"
                )
            object.__setattr__(self, name, read_only(value))
        for tensor in (self.inertia_kg_m2, self.worn.tensor if self.worn else None):
            if tensor is not None:
                _require_physical(tensor)


def _require_physical(tensor: Array) -> None:
    """Refuse a tensor with a negative moment, or with one above the sum of the other two."""
    moments = np.linalg.eigvalsh(tensor)
    # rounding, relative to the largest moment
    slack = 1e-9 * float(np.abs(moments).max())
    if not np.allclose(tensor, tensor.T) or moments[0] < -slack:
        raise ValueError("inertia_kg_m2 must be symmetric with no negative principal moment")
    if moments[2] > LIMITS.largest_moment:
        raise ValueError(
            f"inertia_kg_m2 must be at most {LIMITS.largest_moment:g} kg·m², got {moments[2]:g}; "
            "no segment of a person has more"
        )
    # of any rigid body: Ixx + Iyy − Izz = 2 Σ m z² ≥ 0
    if moments[2] > moments[0] + moments[1] + slack:
        raise ValueError("inertia_kg_m2 has a principal moment above the sum of the other two")


def read_overrides(text: str, name: str = "overrides") -> dict[str, SegmentOverride]:
    """Read overrides from TOML.

    Parameters
    ----------
    text
        TOML with one table per segment: ``mass_kg``, ``center_m`` (3) and ``inertia_kg_m2`` (3
        principal moments, or 6: xx yy zz xy xz yz), each optional. A table ``worn`` in it, with
        the same keys, of which mass and centre are needed, is added to the segment.
    name
        Name of the text in errors.

    Returns
    -------
    dict[str, SegmentOverride]
        By segment.

    Raises
    ------
    ValueError
        If the text is not TOML, a segment or key is unknown, or a value is impossible; the message
        lists all such faults.

    Examples
    --------
    >>> import hbm
    >>> overrides = hbm.read_overrides('''
    ... [right_shank]
    ... mass_kg = 1.9
    ... [left_foot.worn]
    ... mass_kg = 0.3
    ... center_m = [0.05, 0.0, -0.04]
    ... ''')
    >>> overrides["right_shank"].mass_kg, overrides["left_foot"].worn.mass
    (1.9, 0.3)
    """
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise ValueError(f"{name} is not valid TOML: {error}") from error
    overrides, faults = {}, []
    for segment, entry in table.items():
        if segment not in SEGMENTS:
            faults.append(no_segment(segment, SEGMENTS))
            continue
        try:
            overrides[segment] = _override(entry)
        except (ValueError, OverflowError) as error:
            faults.append(f"{segment}: {error}")
    if faults:
        raise ValueError(f"{name}: " + "; ".join(faults))
    return overrides


def _override(entry: Any) -> SegmentOverride:
    if not isinstance(entry, dict):
        raise ValueError(
            f"must be a table with some of {', '.join(COUNTS)}, worn; got {shown(entry)}"
        )
    values: dict[str, Any] = {}
    for key, value in entry.items():
        if key == "worn":
            worn = _override(value)
            if worn.mass_kg is None or worn.center_m is None:
                raise ValueError("worn needs mass_kg and center_m")
            tensor = np.zeros((3, 3)) if worn.inertia_kg_m2 is None else worn.inertia_kg_m2
            values[key] = Inertia(worn.mass_kg, worn.center_m, tensor)
            continue
        if key not in COUNTS:
            raise ValueError(f"no key {shown(key)}{did_you_mean(key, (*COUNTS, 'worn'))}")
        numbers = [value] if key == "mass_kg" else value
        counted = isinstance(numbers, list) and len(numbers) in COUNTS[key]
        if not counted or any(type(x) not in (int, float) for x in numbers):
            wanted = " or ".join(str(n) for n in COUNTS[key])
            raise ValueError(
                f"{key} must be {wanted} number{'s' * (key != 'mass_kg')}, got {shown(value)}"
            )
        values[key] = float(value) if key == "mass_kg" else np.array(numbers, float)
    if "inertia_kg_m2" in values:
        xx, yy, zz, xy, xz, yz = [*values["inertia_kg_m2"], 0.0, 0.0, 0.0][:6]
        values["inertia_kg_m2"] = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return SegmentOverride(**values)


def apply_overrides(
    inertias: Mapping[str, Inertia], overrides: Mapping[str, SegmentOverride], mass: float
) -> dict[str, Inertia]:
    """Replace a body's inertias by overrides without changing its total mass.

    Parameters
    ----------
    inertias
        Segment -> inertia by the table.
    overrides
        By segment.
    mass
        Total mass, prostheses and shoes included [kg].

    Returns
    -------
    dict[str, Inertia]
        By segment. Segments whose mass is not overridden share the remaining mass in the table's
        proportions.

    Raises
    ------
    ValueError
        If a segment is unknown, or the overrides leave nothing for the other segments.
    """
    for segment in overrides:
        if segment not in inertias:
            raise ValueError(f"overrides: {no_segment(segment, inertias)}")
    mass_of = {s: o.mass_kg for s, o in overrides.items() if o.mass_kg is not None}
    worn = sum(o.worn.mass for o in overrides.values() if o.worn)
    table = sum(part.mass for s, part in inertias.items() if s not in mass_of)
    # the total mass is measured: what is stated or worn is taken from the other segments
    rest = mass - sum(mass_of.values()) - worn
    if table and not rest > 0:
        raise ValueError(
            f"the overrides weigh {mass - rest:.2f} kg, which leaves nothing of {mass:g} kg for "
            "the other segments"
        )
    factor_of_rest = rest / table if table else 1.0
    result = {}
    for s, part in inertias.items():
        override = overrides.get(s, SegmentOverride())
        # a tensor that is not stated scales with its mass
        factor = mass_of[s] / part.mass if s in mass_of else factor_of_rest
        center, tensor = override.center_m, override.inertia_kg_m2
        center = part.center if center is None else center
        tensor = factor * part.tensor if tensor is None else tensor
        result[s] = Inertia(float(factor * part.mass), center, tensor)
        if override.worn:
            result[s] += override.worn
    return result
