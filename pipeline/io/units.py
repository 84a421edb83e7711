"""Units of files in SI; an unknown unit is an error, never a guess."""

import re
from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.spatial import Array
from hbm.spelling import short

STANDARD_GRAVITY_MPS2: Final = 9.80665
"""What accelerometers mean by 1 g, wherever they are."""
LENGTHS: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
ACCELERATIONS: Final = {
    "g": STANDARD_GRAVITY_MPS2,
    **{f"{m}/{s}": scale for m, scale in LENGTHS.items() for s in ("s²", "s2", "s^2", "s/s")},
}
SPEEDS: Final = {
    **{f"{m}/{s}": scale for m, scale in LENGTHS.items() for s in ("s", "sec", "second")},
    **dict.fromkeys(("km/h", "km/hr", "kmh", "kph"), 1 / 3.6),
    "mph": 0.44704,
}
ANGLES: Final = {name: np.pi / 180 for name in ("deg", "degree", "degrees", "°")} | {
    name: 1.0 for name in ("rad", "radian", "radians")
}
FORCES: Final = {"n": 1.0, "nt": 1.0, "kn": 1e3}
WORDS: Final = {
    **dict.fromkeys(("millimeters", "millimetres"), "mm"),
    **dict.fromkeys(("centimeters", "centimetres"), "cm"),
    **dict.fromkeys(("meters", "metres"), "m"),
    "newtons": "n",
    "kilonewtons": "kn",
}
"""Unit spelled out -> its symbol."""
MIN_LETTERS: Final = 3
"""Of a word that a file has cut off: fewer may be the beginning of another unit."""
STATE_UNITS: Final = 'state it: --units mm, or units = "mm" in study.toml'
STATE_PLATE_UNITS: Final = 'state them: --plate-units N,Nmm, or plate_units = "N,Nmm" in study.toml'
MIN_SPAN_M: Final = 0.05
MAX_SPAN_M: Final = 20.0
"""Between the markers of a person and a treadmill, or of a walkway."""


def length_in_m(unit: str) -> float:
    """Give one length unit in metres; raises ValueError where it is unknown."""
    return _lookup(unit, LENGTHS, "length", "mm, cm or m")


def force_in_n(unit: str) -> float:
    """Give one force unit in newtons; raises ValueError where it is unknown."""
    return _lookup(unit, FORCES, "force", "N or kN")


def moment_in_nm(unit: str) -> float:
    """Give one moment unit in newton metres; raises ValueError where it is unknown."""
    force, length = _force_and_length(unit)
    moments = {force + length: FORCES[force] * LENGTHS[length]} if force else {}
    return _lookup(unit, moments, "moment", "Nmm or Nm", plain=force + length)


def length_of_moment(unit: str) -> str:
    """Give the unit of length in a known unit of moment, such as "mm" in "Nmm"."""
    return _force_and_length(unit)[1]


def acceleration_in_mps2(unit: str) -> float:
    """Give one unit of acceleration in m/s²; raises ValueError where it is unknown."""
    return _lookup(unit, ACCELERATIONS, "acceleration", "g or m/s²")


def speed_in_mps(unit: str) -> float:
    """Give one unit of speed in m/s; raises ValueError where it is unknown."""
    return _lookup(unit, SPEEDS, "speed", "m/s or km/h")


def angle_in_rad(unit: str) -> float:
    """Give one unit of angle in radians; raises ValueError where it is unknown."""
    return _lookup(unit, ANGLES, "angle", "deg or rad")


def check_span(position: Array, unit: str, *, stated: bool) -> None:
    """Refuse marker positions whose extent contradicts their unit.

    Parameters
    ----------
    position
        Marker positions, (T, M, 3) [m].
    unit
        The unit, for the message.
    stated
        Whether a person states it.

    Raises
    ------
    ValueError
        In the median frame the markers lie within 5 cm of each other, or spread over 20 m.
    """
    several = np.isfinite(position).all(axis=-1).sum(axis=1) > 1
    if not several.any():
        return
    extent = np.fmax.reduce(position, axis=1)[several] - np.fmin.reduce(position, axis=1)[several]
    with np.errstate(over="ignore"):
        span = float(np.median(np.linalg.norm(extent, axis=1)))
    if not MIN_SPAN_M < span < MAX_SPAN_M:
        raise ValueError(
            f"the markers spread over {span:.3g} m if their unit is {short(unit)!r}, expected "
            f"{MIN_SPAN_M} to {MAX_SPAN_M:g} m; {correct_units(stated=stated)}"
        )


def correct_units(*, stated: bool) -> str:
    """Say how to correct a wrong unit of the markers, which a person states or the file."""
    if stated:
        return "correct --units, or units in study.toml"
    return f"correct the unit in the file, or {STATE_UNITS}"


def _lookup(
    unit: str, known: Mapping[str, float], quantity: str, examples: str, plain: str | None = None
) -> float:
    plain = _symbol(_plain(unit)) if plain is None else plain
    if not unit.strip():
        raise ValueError(f"no {quantity} unit is stated, expected {examples}")
    if plain not in known:
        raise ValueError(f"unknown {quantity} unit {short(unit)!r}, expected {examples}")
    return known[plain]


def _plain(unit: str) -> str:
    return re.sub(r"[\s.*·_-]", "", unit).lower()


def _symbol(word: str) -> str:
    """Give the symbol of a word or of its beginning, a word that is unknown as it is."""
    word, per, time = word.partition("/")
    if len(word) >= MIN_LETTERS:
        word = next((symbol for known, symbol in WORDS.items() if known.startswith(word)), word)
    return f"{word}{per}{time}"


def _force_and_length(unit: str) -> tuple[str, str]:
    """Give the symbols of force and length in a unit of moment; empty where it is unknown."""
    plain = _plain(unit)
    pairs = ((_symbol(plain[:k]), _symbol(plain[k:])) for k in range(1, len(plain)))
    known = {(force, length) for force, length in pairs if force in FORCES and length in LENGTHS}
    return known.pop() if len(known) == 1 else ("", "")
