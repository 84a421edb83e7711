"""What is known of a segment better than the table says: prostheses, braces, shoes, scans."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from hbm.coordinates import MOVING
from hbm.markers import did_you_mean
from hbm.segments import Inertia
from hbm.spatial import Array, read_only

LONGEST_M: Final = 1.0
MOST_KG_M2: Final = 10.0
COUNTS: Final = {"mass_kg": (1,), "center_m": (3,), "inertia_kg_m2": (3, 6)}


@dataclass(frozen=True, slots=True, eq=False)
class SegmentOverride:
    """What replaces the table's values of one segment; what is None stays.

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
        What the segment carries besides: a shoe, a brace, a part of an exoskeleton, in its frame.
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
            if name == "center_m" and np.abs(value).max() > LONGEST_M:
                raise ValueError(
                    f"center_m must be within {LONGEST_M:g} m of the joint, got {list(value)}; "
                    "that looks like millimetres"
                )
            object.__setattr__(self, name, read_only(value))
        for tensor in (self.inertia_kg_m2, self.worn.tensor if self.worn else None):
            if tensor is not None:
                _require_physical(tensor)


def _require_physical(tensor: Array) -> None:
    """Refuse what no body can have: moments are not negative, none exceeds the other two's sum."""
    moments = np.linalg.eigvalsh(tensor)
    slack = 1e-9 * max(1e-12, float(moments[2]))
    if not np.allclose(tensor, tensor.T) or moments[0] < -slack:
        raise ValueError("inertia_kg_m2 must be symmetric with no negative principal moment")
    if moments[2] > MOST_KG_M2:
        raise ValueError(
            f"inertia_kg_m2 must be at most {MOST_KG_M2:g} kg·m², got {moments[2]:g}; no segment "
            "of a person has more"
        )
    if moments[2] > moments[0] + moments[1] + slack:
        raise ValueError("inertia_kg_m2 has a principal moment greater than the other two together")


def read_overrides(text: str, name: str = "overrides") -> dict[str, SegmentOverride]:
    """Read overrides from TOML.

    Parameters
    ----------
    text
        TOML with one table per segment: ``mass_kg``, ``center_m`` (3) and ``inertia_kg_m2`` (3
        principal moments, or 6: xx yy zz xy xz yz), each optional. A table ``worn`` in it, with
        the same keys, of which mass and centre are needed, is added to the segment.
    name
        What to call the text in errors.

    Returns
    -------
    dict[str, SegmentOverride]
        By segment.

    Raises
    ------
    ValueError
        If the text is not TOML, a segment or key is unknown, or a value makes no sense; the
        message lists all such faults.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{name} is not valid TOML: {error}") from error
    overrides, faults = {}, []
    for segment, entry in table.items():
        if segment not in MOVING:
            faults.append(f"no segment {segment!r}{did_you_mean(segment, MOVING)}")
            continue
        try:
            overrides[segment] = _override(entry)
        except ValueError as error:
            faults.append(f"{segment}: {error}")
    if faults:
        raise ValueError(f"{name}: " + "; ".join(faults))
    return overrides


def _override(entry: Any) -> SegmentOverride:
    if not isinstance(entry, dict):
        raise ValueError(f"must be a table with some of {', '.join(COUNTS)}, worn; got {entry!r}")
    values = _values({key: value for key, value in entry.items() if key != "worn"})
    if "worn" not in entry:
        return SegmentOverride(**values)
    worn = entry["worn"]
    if not isinstance(worn, dict) or not {"mass_kg", "center_m"} <= set(worn):
        raise ValueError("worn needs mass_kg and center_m")
    extra = {"inertia_kg_m2": np.zeros((3, 3))} | _values(worn)
    return SegmentOverride(
        **values, worn=Inertia(extra["mass_kg"], extra["center_m"], extra["inertia_kg_m2"])
    )


def _values(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Check numbers and their count; a mass is one number, the others are arrays."""
    values: dict[str, Any] = {}
    for key, value in entry.items():
        if key not in COUNTS:
            raise ValueError(f"no key {key!r}{did_you_mean(key, (*COUNTS, 'worn'))}")
        numbers = [value] if key == "mass_kg" else value
        right = isinstance(numbers, list) and len(numbers) in COUNTS[key]
        if not right or any(type(x) not in (int, float) for x in numbers):
            wanted = " or ".join(str(n) for n in COUNTS[key])
            raise ValueError(f"{key} must be {wanted} in number, got {value!r}")
        values[key] = float(value) if key == "mass_kg" else np.array(numbers, float)
    if "inertia_kg_m2" in values:
        xx, yy, zz, xy, xz, yz = [*values["inertia_kg_m2"], 0.0, 0.0, 0.0][:6]
        values["inertia_kg_m2"] = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return values


def apply_overrides(
    inertias: Mapping[str, Inertia], overrides: Mapping[str, SegmentOverride], mass: float
) -> dict[str, Inertia]:
    """Put overrides into a body's inertias so that the whole still weighs what the plates say.

    Parameters
    ----------
    inertias
        Segment -> inertia by the table.
    overrides
        By segment.
    mass
        Everything together, prostheses and shoes included [kg].

    Returns
    -------
    dict[str, Inertia]
        Segments whose mass is not overridden share the rest in the table's proportions.

    Raises
    ------
    ValueError
        If a segment is unknown, or the overrides leave nothing for the other segments.
    """
    for segment in overrides:
        if segment not in inertias:
            hint = did_you_mean(segment, inertias)
            raise ValueError(f"override for {segment!r}, which is no moving segment{hint}")
    stated = {s: o.mass_kg for s, o in overrides.items() if o.mass_kg is not None}
    worn = sum(o.worn.mass for o in overrides.values() if o.worn)
    table = sum(part.mass for s, part in inertias.items() if s not in stated)
    rest = mass - sum(stated.values()) - worn
    if table and not rest > 0:
        raise ValueError(
            f"the overrides weigh {mass - rest:.2f} kg, which leaves nothing of {mass:g} kg for "
            "the other segments"
        )
    share = rest / table if table else 1.0
    result = {}
    for s, part in inertias.items():
        override = overrides.get(s, SegmentOverride())
        factor = stated[s] / part.mass if s in stated else share
        part = Inertia(factor * part.mass, part.center, factor * part.tensor)
        if override.center_m is not None:
            part = replace(part, center=override.center_m)
        if override.inertia_kg_m2 is not None:
            part = replace(part, tensor=override.inertia_kg_m2)
        result[s] = part + override.worn if override.worn else part
    return result
