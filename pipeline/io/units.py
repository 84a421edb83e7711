"""Units of files in SI; an unknown unit is an error, never a guess."""

import re
from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.spatial import Array

STANDARD_GRAVITY_MPS2: Final = 9.80665
"""What accelerometers mean by 1 g, wherever they are."""
LENGTHS: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
ACCELERATIONS: Final = {
    "g": STANDARD_GRAVITY_MPS2,
    **{f"{m}/{s}": scale for m, scale in LENGTHS.items() for s in ("s²", "s2", "s^2", "s/s")},
}
ANGLES: Final = {name: np.pi / 180 for name in ("deg", "degree", "degrees", "°")} | {
    name: 1.0 for name in ("rad", "radian", "radians")
}
FORCES: Final = {"n": 1.0, "kn": 1e3}
SPELLINGS: Final = {
    r"newtons?": "n",
    r"^nt": "n",
    r"millimet(er|re)s?": "mm",
    r"centimet(er|re)s?": "cm",
    r"met(er|re)s?": "m",
}
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
    moments = {f + m: FORCES[f] * LENGTHS[m] for f in FORCES for m in LENGTHS}
    return _lookup(unit, moments, "moment", "Nmm or Nm")


def acceleration_in_mps2(unit: str) -> float:
    """Give one unit of acceleration in m/s²; raises ValueError where it is unknown."""
    return _lookup(unit, ACCELERATIONS, "acceleration", "g or m/s²")


def angle_in_rad(unit: str) -> float:
    """Give one unit of angle in radians; raises ValueError where it is unknown."""
    return _lookup(unit, ANGLES, "angle", "deg or rad")


def check_span(position: Array, unit: str) -> None:
    """Refuse marker positions whose extent contradicts the unit that the file states.

    Parameters
    ----------
    position
        Marker positions, (T, M, 3) [m].
    unit
        The unit that the file states, for the message.

    Raises
    ------
    ValueError
        In the median frame the markers lie within 5 cm of each other, or spread over 20 m.
    """
    visible = position[np.isfinite(position).all(axis=-1).sum(axis=1) > 1]
    if not len(visible):
        return
    extent = np.nanmax(visible, axis=1) - np.nanmin(visible, axis=1)
    with np.errstate(over="ignore"):
        span = float(np.median(np.linalg.norm(extent, axis=1)))
    if not MIN_SPAN_M < span < MAX_SPAN_M:
        raise ValueError(
            f"the markers spread over {span:.3g} m if the file's unit {unit!r} is true; "
            f"expected {MIN_SPAN_M} to {MAX_SPAN_M:g} m: correct the unit in the file"
        )


def _lookup(unit: str, known: Mapping[str, float], quantity: str, examples: str) -> float:
    plain = re.sub(r"[\s.*·_-]", "", unit).lower()
    for spelling, symbol in SPELLINGS.items():
        plain = re.sub(spelling, symbol, plain)
    if not plain:
        raise ValueError(f"no {quantity} unit is stated, expected {examples}")
    if plain not in known:
        raise ValueError(f"unknown {quantity} unit {unit!r}, expected {examples}")
    return known[plain]
