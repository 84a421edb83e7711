"""Axes of a recording's own lab: stated by a person, or inferred from the recording and checked.

A direction string such as ``"left,back,up"`` names the lab direction of the file's x, y and z
axis, in that order.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hbm.spatial import Array

DIRECTIONS = {
    "forward": (1, 0, 0),
    "back": (-1, 0, 0),
    "left": (0, 1, 0),
    "right": (0, -1, 0),
    "up": (0, 0, 1),
    "down": (0, 0, -1),
}
LOADED_N = 50.0
PELVIS_AND_SHOULDERS = ("ASI", "ASIS", "PSI", "PSIS", "SHO", "ACR", "ACROMIUM", "ACROMION")
HEELS = ("HEE", "HEEL", "CAL")
TOES = ("TOE", "MT2", "MT5", "TOETIP", "MT1")
ASK = 'state the axes, for example axes="forward,left,up"'


def parse_axes(axes: str) -> Array:
    """Give the rotation from a file's axes to the lab's.

    Parameters
    ----------
    axes
        Lab directions of the file's x, y and z axis: three of forward, back, left, right, up,
        down, separated by commas.

    Returns
    -------
    Array
        Rotation matrix, (3, 3): lab = matrix @ file.

    Raises
    ------
    ValueError
        A word is unknown, or the three do not form right-handed axes.
    """
    words = [word.strip().lower() for word in axes.split(",")]
    if len(words) != 3 or any(word not in DIRECTIONS for word in words):
        raise ValueError(
            f'axes {axes!r} must be three of {", ".join(DIRECTIONS)}, such as "left,back,up"'
        )
    rotation = np.array([DIRECTIONS[word] for word in words], float).T
    if round(np.linalg.det(rotation)) != 1:
        raise ValueError(f"axes {axes!r} are not right-handed axes of three different directions")
    return rotation


def infer_axes(
    position: ArrayLike,
    names: Sequence[str],
    plate_normals: ArrayLike = (),
    loads: ArrayLike = (),
    screen_up: str = "",
) -> tuple[str, str]:
    """Infer the axes of a recording from what was recorded.

    Parameters
    ----------
    position
        Marker positions in the file's axes, (T, M, 3); gaps are NaN; any unit.
    names
        Marker labels.
    plate_normals
        Normals of the plates' surfaces in the file's axes, up or down, (P, 3).
    loads
        Mean force of each loaded plate on the subject in the file's axes, (L, 3).
    screen_up
        The file's own Y_SCREEN hint, such as "+Z"; empty where it gives none.

    Returns
    -------
    str, str
        Directions as `parse_axes` takes them, and the evidence as a sentence for a person.

    Raises
    ------
    ValueError
        Evidence is missing or contradicts itself; the message asks for the axes.

    Notes
    -----
    Up is where loaded plates push the subject and where the pelvis and shoulders lie from the
    feet; left is from right-side to left-side markers; forward is left × up, checked against heel
    to toe.
    """
    position = np.asarray(position, float)
    if not np.isfinite(position).any():
        raise ValueError(f"axes cannot be inferred: no marker is ever visible; {ASK}")
    places = {name: k for k, name in enumerate(names)}
    up, why_up = _infer_up(position, places, plate_normals, loads, screen_up)
    left, why_left = _infer_left(position, places, up)
    forward = np.cross(left, up)
    toes = _direction(position, _heel_toe_pairs(places))
    why_forward = ""
    if toes is not None:
        if toes @ forward < 0:
            raise ValueError(
                f"axes cannot be inferred: forward is {_axis_name(forward)} from {why_left}, "
                f"but the toes point the other way; {ASK}"
            )
        why_forward = ", and the toes point forward"
    rotation = np.array([forward, left, up])
    axes = ",".join(_direction_name(column) for column in rotation.T)
    return axes, f"up from {why_up}; left from {why_left}{why_forward}"


def _infer_up(
    position: Array,
    places: dict[str, int],
    plate_normals: ArrayLike,
    loads: ArrayLike,
    screen_up: str,
) -> tuple[Array, str]:
    evidence: dict[str, Array] = {}
    for load in np.reshape(np.asarray(loads, float), (-1, 3)):
        evidence["loaded plates"] = evidence.get("loaded plates", 0) + _unit(load)
    high, low = _upper_markers(places), _lower_markers(places)
    if high and low:
        with np.errstate(invalid="ignore"):
            rise = _mean(position[:, high]) - _mean(position[:, low])
        if np.isfinite(rise).all():
            evidence["pelvis or shoulders above feet"] = _unit(rise)
    if not evidence:
        raise ValueError(f"axes cannot be inferred: no loaded plate, no known markers; {ASK}")
    signed = {why: _nearest_axis(vector, why) for why, vector in evidence.items()}
    lines = [
        (f"the surface of plate {k + 1}", _nearest_axis(normal, f"the surface of plate {k + 1}"))
        for k, normal in enumerate(np.reshape(np.asarray(plate_normals, float), (-1, 3)))
    ]
    if screen_up[-1:].upper() in {"X", "Y", "Z"}:
        lines.append(("Y_SCREEN", np.eye(3)["XYZ".index(screen_up[-1].upper())]))
    up = next(iter(signed.values()))
    against = [why for why, axis in signed.items() if axis @ up < 0.5]
    against += [why for why, axis in lines if abs(axis @ up) < 0.5]
    if against:
        raise ValueError(
            f"axes cannot be inferred: {next(iter(signed))} says that {_axis_name(up)} is up, "
            f"but {' and '.join(against)} says otherwise; {ASK}"
        )
    return up, " and ".join([*signed, *(why for why, _ in lines)])


def _infer_left(position: Array, places: dict[str, int], up: Array) -> tuple[Array, str]:
    pairs = _side_pairs(places)
    trunk = [pair for pair in pairs if _bare(pair[0])[1:] in PELVIS_AND_SHOULDERS]
    used = trunk or pairs
    left = _direction(position, [(places[right], places[left]) for left, right in used])
    if left is None:
        raise ValueError(
            f"axes cannot be inferred: no marker pair such as LASIS and RASIS tells left; {ASK}"
        )
    names = ", ".join(f"{left}/{right}" for left, right in used[:3])
    return _nearest_axis(left - (left @ up) * up, f"the pairs {names}"), f"the pairs {names}"


def _side_pairs(places: dict[str, int]) -> list[tuple[str, str]]:
    swap = {"L": "R", "l": "r"}
    return [
        (name, other)
        for name in places
        if name[:1] in swap and (other := swap[name[0]] + name[1:]) in places
    ]


def _heel_toe_pairs(places: dict[str, int]) -> list[tuple[int, int]]:
    found: dict[str, int] = {_bare(name): k for name, k in places.items()}
    return [
        (found[side + heel], found[side + toe])
        for side in "LR"
        for heel in HEELS
        for toe in TOES
        if side + heel in found and side + toe in found
    ]


def _upper_markers(places: dict[str, int]) -> list[int]:
    return [k for name, k in places.items() if _bare(name)[1:] in PELVIS_AND_SHOULDERS]


def _lower_markers(places: dict[str, int]) -> list[int]:
    return [k for name, k in places.items() if _bare(name)[1:] in HEELS + TOES + ("ANK", "LM")]


def _bare(name: str) -> str:
    return name.replace(".", "").replace("_", "").upper()


def _direction(position: Array, pairs: Sequence[tuple[int, int]]) -> Array | None:
    if not pairs:
        return None
    start, end = np.array(pairs).T
    vector = _mean(position[:, end] - position[:, start])
    return _unit(vector) if np.isfinite(vector).all() and vector.any() else None


def _mean(vectors: Array) -> Array:
    known = vectors[np.isfinite(vectors).all(axis=-1)]
    return known.mean(axis=0) if len(known) else np.full(3, np.nan)


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)


def _nearest_axis(vector: Array, why: str) -> Array:
    unit = _unit(vector)
    k = int(np.argmax(np.abs(unit)))
    if not abs(unit[k]) > np.cos(np.deg2rad(30)):
        raise ValueError(
            f"axes cannot be inferred: the direction from {why} is more than 30° away from "
            f"every axis of the file; {ASK}"
        )
    return np.asarray(np.sign(unit[k]) * np.eye(3)[k])


def _axis_name(axis: Array) -> str:
    k = int(np.argmax(np.abs(axis)))
    return f"{'+' if axis[k] > 0 else '-'}{'xyz'[k]}"


def _direction_name(vector: Array) -> str:
    return next(name for name, lab in DIRECTIONS.items() if np.allclose(lab, vector))
