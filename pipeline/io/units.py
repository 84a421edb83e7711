"""Units of files in SI; an unknown unit is an error, never a guess."""

import re
from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.spelling import short

MAX_VALUE: Final = 1e9
"""In any unit; beyond it a number was not measured: it is damaged."""
LENGTHS: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
ACCELERATIONS: Final = {
    "g": 9.80665,  # standard gravity: what accelerometers mean by it, wherever they are
    **{f"{m}/{s}": scale for m, scale in LENGTHS.items() for s in ("s²", "s2", "s^2", "s/s")},
}
SPEEDS: Final = {
    **{f"{m}/{s}": scale for m, scale in LENGTHS.items() for s in ("s", "sec", "second")},
    **dict.fromkeys(("km/h", "km/hr", "kmh", "kph"), 1 / 3.6),
    "mph": 0.44704,
}
ANGLES: Final = {
    **dict.fromkeys(("deg", "degree", "degrees", "°"), np.pi / 180),
    **dict.fromkeys(("rad", "radian", "radians"), 1.0),
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


def length_in_m(unit: str) -> float:
    """Give one length unit in metres; raises ValueError where it is unknown."""
    return _lookup(unit, _symbol(_plain(unit)), LENGTHS, "length", "mm, cm or m")


def force_in_n(unit: str) -> float:
    """Give one force unit in newtons; raises ValueError where it is unknown."""
    return _lookup(unit, _symbol(_plain(unit)), FORCES, "force", "N or kN")


def moment_in_nm(unit: str) -> float:
    """Give one moment unit in newton metres; raises ValueError where it is unknown."""
    force, length = _force_and_length(unit)
    moments = {f + m: FORCES[f] * LENGTHS[m] for f in FORCES for m in LENGTHS}
    return _lookup(unit, force + length, moments, "moment", "Nmm or Nm")


def length_unit(unit: str, moment: str) -> str:
    """Give a unit if it is one of length, else the length in a unit of moment: "mm" in "Nmm"."""
    return unit if _symbol(_plain(unit)) in LENGTHS else _force_and_length(moment)[1]


def acceleration_in_mps2(unit: str) -> float:
    """Give one unit of acceleration in m/s²; raises ValueError where it is unknown."""
    expected = "g or m/s² (--accelerometer-unit)"
    return _lookup(unit, _symbol(_plain(unit)), ACCELERATIONS, "acceleration", expected)


def speed_in_mps(unit: str) -> float:
    """Give one unit of speed in m/s; raises ValueError where it is unknown."""
    return _lookup(unit, _symbol(_plain(unit)), SPEEDS, "speed", "m/s or km/h")


def angle_in_rad(unit: str) -> float:
    """Give one unit of angle in radians; raises ValueError where it is unknown."""
    return _lookup(unit, _symbol(_plain(unit)), ANGLES, "angle", "deg or rad")


def _lookup(unit: str, plain: str, units: Mapping[str, float], what: str, examples: str) -> float:
    if not unit.strip():
        raise ValueError(f"no {what} unit is given, expected {examples}")
    if plain not in units:
        raise ValueError(f"unknown {what} unit {short(unit)!r}, expected {examples}")
    return units[plain]


def _plain(unit: str) -> str:
    return re.sub(r"[\s.*·_-]", "", unit).lower()


def _symbol(word: str) -> str:
    """Give the symbol of a word or of its beginning, a word that is unknown as it is."""
    word, per, time = word.partition("/")
    # a file may have cut a word off; fewer letters may be the beginning of another unit
    if len(word) >= 3:
        word = next((symbol for full, symbol in WORDS.items() if full.startswith(word)), word)
    return f"{word}{per}{time}"


def _force_and_length(unit: str) -> tuple[str, str]:
    """Give the symbols of force and length in a unit of moment; empty where it is unknown."""
    plain = _plain(unit)
    # such as "nmm", at each place where it may be cut in two
    for k in range(1, len(plain)):
        force, length = _symbol(plain[:k]), _symbol(plain[k:])
        if force in FORCES and length in LENGTHS:
            return force, length
    return "", ""
