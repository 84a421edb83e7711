"""What plates read when nobody is on them: it is zero, or in every load that they measure."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from hbm.spatial import WRENCH_COMPONENTS, Array, rotate_wrench, shift_wrench
from hbm.spelling import written
from pipeline.io.recording import Plate
from pipeline.trial.findings.finding import Finding
from pipeline.trial.subject import TENTH_S, common_tenths, tenths

MAX_REST_SHARE: Final = 0.1
"""Of body weight that a plate without load may read; more is taken as load."""
REST_SPREAD_N: Final = 6.0
"""Means of a tenth of a second of an unloaded plate lie this close together: noise and creep."""
MIN_REST_S: Final = 0.3
"""In all, so that a foot that lands or leaves does not count as rest: one swing of a foot."""
MAX_REST_N: Final = 10.0
"""About 1 kg: plates drift by less between two zeroings."""
MAX_TOTAL_REST_N: Final = 20.0
"""Of all plates together: 3 % of the weight of a light adult."""
MAX_REST: Final = np.array([10.0, 10.0, np.inf, 5.0, 5.0, 5.0])
"""Of an unloaded plate, moments about its centre [N, N·m]; real plates, zeroed before the session,
read a few newtons. The vertical force is judged by itself."""
MIN_ZERO: Final = np.array([5.0, 5.0, 1.0, 2.5, 2.5, 2.5])
"""Smaller readings of an unloaded plate need no correction [N, N·m]."""


def wrong_zeros(
    plates: Sequence[Plate], readings: Sequence[Array | None]
) -> tuple[Finding, tuple[str, ...]] | None:
    """Find plates that are not zero when nobody is on them.

    Parameters
    ----------
    plates
        Of the trial.
    readings
        Of each, as `readings_without_load` gives them.

    Returns
    -------
    tuple or None
        The finding, with the vertical force that each unloaded plate reads [N], and what has to be
        typed to correct it. Where one reads more than 10 N either way, all together more than 20 N,
        or another component is more than 10 N or 5 N·m from zero.
    """
    rest_n, others, mendings = dict[int, float](), list[str](), list[str]()
    for plate, reading in zip(plates, readings, strict=True):
        if reading is not None:
            rest_n[plate.number] = float(reading[2])
            others += _components(plate, reading)
            mendings += _mendings(plate, reading)
    largest_n, total_n = max(map(abs, rest_n.values()), default=0), sum(rest_n.values())
    if not (others or largest_n > MAX_REST_N or abs(total_n) > MAX_TOTAL_REST_N):
        return None
    words = ", ".join(others)
    return Finding("zero", (*rest_n,), words, size=(*rest_n.values(),)), tuple(mendings)


def _components(plate: Plate, reading: Array) -> Iterator[str]:
    """Name the components that are far from zero, in lab axes."""
    for k in np.flatnonzero(np.abs(reading) > MAX_REST):
        yield f"plate {plate.number} {WRENCH_COMPONENTS[k]} {written(reading[k], '+.0f')}"


def _mendings(plate: Plate, reading: Array) -> Iterator[str]:
    """Give what is typed to subtract a reading, in the plate's axes."""
    in_plate = rotate_wrench(reading, plate.rotation.T)
    for k in np.flatnonzero(np.abs(in_plate) > MIN_ZERO):
        yield f"{plate.number}: zero {WRENCH_COMPONENTS[k]} {in_plate[k]:.1f}"


def readings_without_load(
    plates: Sequence[Plate], wrenches: Sequence[Array], time: Array, weight_n: float
) -> tuple[Array | None, ...]:
    """Give what each plate reads when nobody is on it, (6,), lab axes about its centre.

    None where it is always loaded; other components are zero where only the vertical force is
    known. The wrenches are the action on the subject in lab axes at T times, without what a moving
    platform adds, (T, 6) [N, N·m].
    """
    about_centers = (shift_wrench(w, p.center) for p, w in zip(plates, wrenches, strict=True))
    return tuple(_reading(wrench, time, weight_n) for wrench in about_centers)


def _reading(wrench: Array, time: Array, weight_n: float) -> Array | None:
    level = rest_level(wrench[:, 2], time, weight_n)
    if level is None:
        return None
    means = tenths(wrench, time, *common_tenths(time))
    at_rest = np.abs(means[:, 2] - level) <= REST_SPREAD_N / 2
    zero = np.median(means[at_rest], axis=0) if at_rest.any() else np.zeros(6)
    zero[2] = level
    return zero


def rest_level(vertical: Array, time: Array, weight_n: float) -> float | None:
    """Give what a plate reads when nobody is on it.

    Parameters
    ----------
    vertical
        Vertical force, (T,) [N].
    time
        (T,) [s].
    weight_n
        Body weight.

    Returns
    -------
    float or None
        The level, below a tenth of the body weight, at which the plate is most often [N]: the mean
        over those tenths of a second that lie closest together. None where the plate is never
        at rest for 0.3 s in all: somebody stands on it throughout.
    """
    means = tenths(vertical, time, *common_tenths(time))
    low = np.sort(means[means < MAX_REST_SHARE * weight_n])
    within = np.searchsorted(low, low + REST_SPREAD_N, side="right") - np.arange(len(low))
    if TENTH_S * max(within, default=0) < MIN_REST_S:
        return None
    start = int(np.argmax(within))
    return float(low[start : start + within[start]].mean())
