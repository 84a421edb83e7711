"""Units that files write, in SI; an unknown unit is an error, never a guess."""

import re

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
FORCES = {"n": 1.0, "kn": 1e3}
SPELLINGS = {
    r"newtons?": "n",
    r"^nt": "n",
    r"(milli|centi|)met(?:er|re)s?": lambda found: {"milli": "mm", "centi": "cm"}.get(
        found[1], "m"
    ),
}


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


def _lookup(unit: str, known: dict[str, float], quantity: str, examples: str) -> float:
    plain = re.sub(r"[\s.*·_-]", "", unit).lower()
    for spelling, symbol in SPELLINGS.items():
        plain = re.sub(spelling, symbol, plain)
    if plain not in known:
        raise ValueError(f"unknown {quantity} unit {unit!r}, expected {examples}")
    return known[plain]
