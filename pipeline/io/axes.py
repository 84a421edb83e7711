"""Axes of a recording's own lab: stated by a person, or inferred from the recording; checked.

A direction string such as ``"left,back,up"`` names the lab direction of the file's x, y and z
axis, in that order.
"""

from collections.abc import Iterable, Sequence

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
FACING_ONE_WAY = 0.9
PELVIS_AND_SHOULDERS = ("ASI", "ASIS", "PSI", "PSIS", "SHO", "ACR", "ACROMIUM", "ACROMION")
HEELS = ("HEE", "HEEL", "CAL")
TOES = ("TOE", "MT2", "MT5", "TOETIP", "MT1")
ANKLES = ("ANK", "LM", "MM")
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


def settle_axes(
    axes: str | None,
    position: ArrayLike,
    names: Sequence[str],
    *,
    plate_normals: ArrayLike = (),
    plate_forces: ArrayLike = (),
    screen_up: str = "",
) -> tuple[str, str]:
    """Infer the axes of a recording, or check those that a person states.

    Parameters
    ----------
    axes
        Stated directions as `parse_axes` takes them, or None to infer them.
    position
        Marker positions in the file's axes, (T, M, 3); gaps are NaN; any unit.
    names
        Marker labels.
    plate_normals
        Normals of the plates' surfaces in the file's axes, up or down, (P, 3).
    plate_forces
        Mean force of each plate on the subject in the file's axes, (P, 3) [N].
    screen_up
        The file's own Y_SCREEN hint, such as "+Z"; empty where it gives none.

    Returns
    -------
    str, str
        The directions, and a sentence for a person that states them with the evidence.

    Raises
    ------
    ValueError
        Evidence is missing or contradicts itself (the message asks for the axes), or gravity
        contradicts the stated axes.

    Notes
    -----
    Up is where loaded plates push the subject and where the pelvis and shoulders lie from the
    feet; left is from right-side to left-side markers; forward is left × up, checked against heel
    to toe. Stated axes are refused by up only, for a subject may face either way in a lab; that
    they let the subject face elsewhere than forward is said.
    """
    position = np.asarray(position, float)
    places = {name: k for k, name in enumerate(names)}
    rise = _rise(position, places)
    loads = _loads(plate_forces)
    if axes is not None:
        if rise is not None:
            _check_up(parse_axes(axes)[2], {"pelvis or shoulders above feet": rise, **loads})
        return axes, _sentence(axes, "as stated") + _faces(axes, position, places)
    if not np.isfinite(position).any():
        raise ValueError(f"axes cannot be inferred: no marker is ever visible; {ASK}")
    up, why_up = _infer_up(rise, loads, plate_normals, screen_up)
    left, why_left = _infer_left(position, places, up)
    forward = np.cross(left, up)
    toes = _mean(_differences(position, _heel_toe_pairs(places)))
    why_forward = ""
    if np.isfinite(toes).all():
        if toes @ forward < 0:
            raise ValueError(
                f"axes cannot be inferred: forward is {_axis_name(forward)} by {why_left}, "
                f"but the toes point the other way; {ASK}"
            )
        why_forward = ", and the toes point forward"
    rotation = np.array([forward, left, up])
    axes = ",".join(_direction_name(column) for column in rotation.T)
    return axes, _sentence(axes, f"up by {why_up}; left by {why_left}{why_forward}")


def _faces(axes: str, position: Array, places: dict[str, int]) -> str:
    """Say where the subject faces by the stated axes, if that is one way and not forward."""
    rotation = parse_axes(axes)
    try:
        left, why = _infer_left(position, places, rotation[2])
    except ValueError:
        return ""
    facing = _direction_name(rotation @ np.cross(left, rotation[2]))
    if facing == "forward":
        return ""
    return f" warning: by them the subject faces {facing}, for {why} tell left; are they right?"


def _sentence(axes: str, why: str) -> str:
    return f"The file's x, y, z axes point {axes.replace(',', ', ')}: {why}."


def _rise(position: Array, places: dict[str, int]) -> Array | None:
    high = _sites(places, PELVIS_AND_SHOULDERS)
    low = _sites(places, HEELS + TOES + ANKLES)
    rise = _mean(position[:, high]) - _mean(position[:, low])
    return rise if np.isfinite(rise).all() else None


def _loads(plate_forces: ArrayLike) -> dict[str, Array]:
    forces = np.reshape(np.asarray(plate_forces, float), (-1, 3))
    return {
        f"the load on plate {k}": force
        for k, force in enumerate(forces, start=1)
        if np.linalg.norm(force) > LOADED_N
    }


def _check_up(up: Array, evidence: dict[str, Array]) -> None:
    for why, vector in evidence.items():
        if vector @ up < 0:
            raise ValueError(
                f"{_axis_name(up)} is up by the stated axes, but {why} says the opposite: "
                "the axes are wrong, or the plate stores the force that acts on itself"
            )


def _infer_up(
    rise: Array | None, loads: dict[str, Array], plate_normals: ArrayLike, screen_up: str
) -> tuple[Array, str]:
    evidence = dict(loads)
    if rise is not None:
        evidence["pelvis or shoulders above feet"] = rise
    if not evidence:
        raise ValueError(f"axes cannot be inferred: no loaded plate, no known markers; {ASK}")
    signed = {why: _nearest_axis(vector, why) for why, vector in evidence.items()}
    normals = np.reshape(np.asarray(plate_normals, float), (-1, 3))
    surfaces = {f"the surface of plate {k}": normal for k, normal in enumerate(normals, start=1)}
    lines = {why: _nearest_axis(normal, why) for why, normal in surfaces.items()}
    if screen_up[-1:].upper() in {"X", "Y", "Z"}:
        lines["Y_SCREEN"] = np.eye(3)["XYZ".index(screen_up[-1].upper())]
    first, up = next(iter(signed.items()))
    against = [why for why, axis in signed.items() if axis @ up < 0.5]
    against += [why for why, axis in lines.items() if abs(axis @ up) < 0.5]
    if against:
        raise ValueError(
            f"axes cannot be inferred: {first} says that {_axis_name(up)} is up, "
            f"but {' and '.join(against)} says otherwise; {ASK}"
        )
    return up, ", ".join([*signed, *lines])


def _infer_left(position: Array, places: dict[str, int], up: Array) -> tuple[Array, str]:
    pairs = _side_pairs(places)
    trunk = [pair for pair in pairs if _bare(pair[0])[1:] in PELVIS_AND_SHOULDERS]
    used = trunk or pairs
    across = _differences(position, [(places[right], places[left]) for left, right in used])
    mean = _mean(across)
    if not np.isfinite(mean).all():
        raise ValueError(
            f"axes cannot be inferred: no marker pair such as LASIS and RASIS tells left; {ASK}"
        )
    why = "the pairs " + ", ".join("/".join(pair) for pair in used[:3])
    left = _nearest_axis(mean - (mean @ up) * up, why)
    seen = across[np.isfinite(across).all(axis=-1)]
    if trunk and np.mean(seen @ left > 0) < FACING_ONE_WAY:
        raise ValueError(f"axes cannot be inferred: the subject turns around; {ASK}")
    return left, why


def _sites(places: dict[str, int], sites: Iterable[str]) -> list[int]:
    return [k for name, k in places.items() if _bare(name)[1:] in sites]


def _side_pairs(places: dict[str, int]) -> list[tuple[str, str]]:
    swap = {"L": "R", "l": "r"}
    return [
        (name, other)
        for name in places
        if name[:1] in swap and (other := swap[name[0]] + name[1:]) in places
    ]


def _heel_toe_pairs(places: dict[str, int]) -> list[tuple[int, int]]:
    found = {_bare(name): k for name, k in places.items()}
    return [
        (found[side + heel], found[side + toe])
        for side in "LR"
        for heel in HEELS
        for toe in TOES
        if side + heel in found and side + toe in found
    ]


def _bare(name: str) -> str:
    return name.replace(".", "").replace("_", "").upper()


def _differences(position: Array, pairs: Sequence[tuple[int, int]]) -> Array:
    start, end = np.reshape(np.array(pairs, int), (-1, 2)).T
    return position[:, end] - position[:, start]


def _mean(vectors: Array) -> Array:
    known = vectors[np.isfinite(vectors).all(axis=-1)]
    return known.mean(axis=0) if len(known) else np.full(3, np.nan)


def _nearest_axis(vector: Array, why: str) -> Array:
    k = int(np.argmax(np.abs(vector)))
    if not abs(vector[k]) > np.cos(np.deg2rad(30)) * np.linalg.norm(vector):
        raise ValueError(
            f"axes cannot be inferred: the direction from {why} is more than 30° away from "
            f"every axis of the file; {ASK}"
        )
    return np.asarray(np.sign(vector[k]) * np.eye(3)[k])


def _axis_name(axis: Array) -> str:
    k = int(np.argmax(np.abs(axis)))
    return f"{'+' if axis[k] > 0 else '-'}{'xyz'[k]}"


def _direction_name(vector: Array) -> str:
    return next(name for name, lab in DIRECTIONS.items() if np.allclose(lab, vector))
