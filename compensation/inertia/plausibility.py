"""Implausible numbers in a fit: units mistaken, a platform that stood still."""

from typing import Final

import numpy as np

from hbm.spatial import GRAVITY_MPS2, Array

GRAVITY_FACTOR: Final = 5.0
"""Either way from gravity, which motion adds to: g, mm/s² and V are farther off."""
MIN_MOTION_MPS2: Final = 0.05
"""Standard deviation of accelerations below which a platform did not move but for its noise."""
MIN_MASS_KG: Final = 1.0
MAX_MASS_KG: Final = 10_000.0
"""Of a belt assembly; 150 kg in the thesis. Forces in kN or accelerations in mm/s² are outside."""
MIN_LEVER_M: Final = 0.001
MAX_LEVER_M: Final = 10.0
"""Moment by force: a belt assembly's size; moments in N·mm are outside."""


def refuse_other_units(a: Array, sensors: tuple[str, ...]) -> None:
    """Raise a ValueError where an accelerometer does not measure gravity, about 9.81 m/s²."""
    for name, reading in zip(sensors, np.split(a, len(sensors), axis=1), strict=True):
        size = float(np.median(np.sqrt(np.vecdot(reading, reading))))
        if not GRAVITY_MPS2 / GRAVITY_FACTOR < size < GRAVITY_FACTOR * GRAVITY_MPS2:
            raise ValueError(
                f"accelerometer {name} reads {size:.3g} m/s² in the median, expected gravity "
                f"({GRAVITY_MPS2}); is it dead, tared, or in another unit (g, mm/s², V)?"
            )


def refuse_still_platform(a: Array) -> None:
    """Raise a ValueError where a calibration trial contains no motion."""
    largest = float(np.max(np.std(a, axis=0)))
    if largest < MIN_MOTION_MPS2:
        raise ValueError(
            f"the platform hardly moved: accelerations vary by {largest:.2g} m/s² at most; "
            "fit on a calibration trial with pitch and sway"
        )


def refuse_other_wrench_units(a: Array, w: Array) -> None:
    """Raise a ValueError where force by acceleration is no mass, or moment by force no lever."""
    force, moment = (np.linalg.norm(np.std(part, axis=0)) for part in (w[:, :3], w[:, 3:]))
    motion = np.linalg.norm(np.std(a.reshape(len(a), -1, 3).mean(axis=1), axis=0))
    mass, arm = force / motion, moment / force
    if not MIN_MASS_KG < mass < MAX_MASS_KG:
        raise ValueError(
            f"wrench: forces correspond to a moving mass of {mass:.3g} kg, expected a belt "
            f"assembly of {MIN_MASS_KG:g} to {MAX_MASS_KG:g} kg; forces must be in N and "
            "accelerations in m/s²"
        )
    if not MIN_LEVER_M < arm < MAX_LEVER_M:
        raise ValueError(
            f"wrench: moments correspond to a lever arm of {arm:.3g} m, expected {MIN_LEVER_M:g} "
            f"to {MAX_LEVER_M:g} m; moments must be in N·m"
        )
