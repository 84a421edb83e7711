"""What plates read when nobody is on them: it is zero, or in every load that they measure."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from hbm.numbers import read_numbers
from hbm.spatial import WRENCH_COMPONENTS, Array, rotate_wrench, shift_wrench
from hbm.spelling import written
from pipeline.io.recording import Plate
from pipeline.trial.findings.finding import Finding
from pipeline.trial.subject import TENTH_S, common_tenths, tenths

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "zeros")


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
    # one plate may be off by much, or several by little each in the same direction
    largest_n, total_n = max(map(abs, rest_n.values()), default=0), sum(rest_n.values())
    if not (others or largest_n > LIMITS.largest_reading or abs(total_n) > LIMITS.largest_total):
        return None
    words = ", ".join(others)
    return Finding("zero", (*rest_n,), words, size=(*rest_n.values(),)), tuple(mendings)


def _components(plate: Plate, reading: Array) -> Iterator[str]:
    """Name the components that are far from zero, in lab axes."""
    for k in np.flatnonzero(np.abs(reading) > LIMITS.largest_components):
        yield f"plate {plate.number} {WRENCH_COMPONENTS[k]} {written(reading[k], '+.0f')}"


def _mendings(plate: Plate, reading: Array) -> Iterator[str]:
    """Give what is typed to subtract a reading, in the plate's axes."""
    # channels are typed in the axes of the plate, about its centre
    in_plate = rotate_wrench(reading, plate.rotation.T)
    for k in np.flatnonzero(np.abs(in_plate) > LIMITS.least_mended):
        yield f"{plate.number}: zero {WRENCH_COMPONENTS[k]} {in_plate[k]:.1f}"


def readings_without_load(
    plates: Sequence[Plate], wrenches: Sequence[Array], time: Array, weight_n: float
) -> tuple[Array | None, ...]:
    """Give what each plate reads when nobody is on it, (6,), lab axes about its centre.

    None where it is always loaded; other components are zero where only the vertical force is
    known. The wrenches are the action on the subject in lab axes at T times, without what a moving
    platform adds, (T, 6) [N, N·m].
    """
    # a zero belongs to the plate: about its own centre, not about the origin of the lab
    about_centers = (shift_wrench(w, p.center) for p, w in zip(plates, wrenches, strict=True))
    return tuple(_reading(wrench, time, weight_n) for wrench in about_centers)


def _reading(wrench: Array, time: Array, weight_n: float) -> Array | None:
    level = rest_level(wrench[:, 2], time, weight_n)
    if level is None:
        return None
    # medians of the components over those tenths in which the vertical force is at rest
    means = tenths(wrench, time, *common_tenths(time))
    at_rest = np.abs(means[:, 2] - level) <= LIMITS.spread / 2
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
    # the densest group of low loads: how many lie within a spread above each one
    low = np.sort(means[means < LIMITS.largest_fraction * weight_n])
    within = np.searchsorted(low, low + LIMITS.spread, side="right") - np.arange(len(low))
    # too short a rest may be a foot that lands or leaves
    if TENTH_S * max(within, default=0) < LIMITS.shortest_rest:
        return None
    start = int(np.argmax(within))
    return float(low[start : start + within[start]].mean())
