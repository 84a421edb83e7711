"""Numbers that cannot be: units mistaken, a platform that stood still, a plate not empty."""

import numpy as np

from hbm.spatial import GRAVITY_MPS2, Array

_STILL = 0.05  # m/s²: standard deviation below which the platform did not move


def refuse_other_units(a: Array, sensors: tuple[str, ...]) -> None:
    """Raise a ValueError where an accelerometer does not read gravity, about 9.81 m/s²."""
    for name, reading in zip(sensors, np.split(a, len(sensors), axis=1), strict=True):
        size = float(np.median(np.linalg.norm(reading, axis=1)))
        if not GRAVITY_MPS2 / 5 < size < 5 * GRAVITY_MPS2:
            raise ValueError(
                f"accelerometer {name} reads {size:.3g} m/s² in the median, expected gravity "
                f"({GRAVITY_MPS2}); is it dead, tared, or in another unit (g, mm/s², V)?"
            )


def refuse_still_platform(a: Array) -> None:
    """Raise a ValueError where a calibration trial holds no motion."""
    largest = float(np.max(np.std(a, axis=0)))
    if largest < _STILL:
        raise ValueError(
            f"the platform hardly moved: accelerations vary by {largest:.2g} m/s² at most; "
            "fit on a calibration trial with pitch and sway"
        )


def refuse_other_wrench_units(a: Array, w: Array) -> None:
    """Raise a ValueError where force by acceleration is no mass, or moment by force no lever."""
    force, moment = (np.linalg.norm(np.std(part, axis=0)) for part in (w[:, :3], w[:, 3:]))
    motion = np.linalg.norm(np.std(a.reshape(len(a), -1, 3).mean(axis=1), axis=0))
    mass, arm = force / motion, moment / force
    if not 1 < mass < 10_000:
        raise ValueError(
            f"wrench: forces look like a moving mass of {mass:.3g} kg, expected a belt assembly "
            "of 1 to 10000 kg; forces must be in N and accelerations in m/s²"
        )
    if not 0.001 < arm < 10:
        raise ValueError(
            f"wrench: moments look like a lever arm of {arm:.3g} m, expected 0.001 to 10 m; "
            "moments must be in N·m"
        )
