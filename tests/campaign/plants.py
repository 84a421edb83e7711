"""Faults of plates, put into a recording before anything else reads it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hbm.coordinates import UP
from hbm.spatial import Array, rotation_about, shift_wrench
from pipeline.io.recording import Plate, Recording

Change = Callable[[Array], Array]
"""Of the samples of a channel."""


def with_plate(recording: Recording, index: int, change: Callable[[Plate], Plate]) -> Recording:
    """The same recording with one plate changed."""
    plates = [*recording.plates]
    plates[index] = change(plates[index])
    return replace(recording, plates=tuple(plates))


def channel(recording: Recording, index: int, component: int, change: Change) -> Recording:
    """The same recording with one channel changed, moments about the surface."""

    def changed(plate: Plate) -> Plate:
        wrench = np.array(plate.wrench_in_plate)
        wrench[:, component] = change(wrench[:, component])
        return replace(plate, wrench_in_plate=wrench)

    return with_plate(recording, index, changed)


def raw(recording: Recording, index: int, component: int, change: Change) -> Recording:
    """The same with one channel of the transducer changed, as its converter would."""
    transducer = recording.plates[index].transducer

    def about(recording: Recording, point: Array) -> Recording:
        return with_plate(
            recording,
            index,
            lambda p: replace(p, wrench_in_plate=shift_wrench(p.wrench_in_plate, point)),
        )

    changed = channel(about(recording, transducer), index, component, change)
    return about(changed, -transducer)


def amplified(recording: Recording, index: int, component: int, gain: float) -> Recording:
    """A channel that is larger by a factor."""
    return channel(recording, index, component, lambda values: gain * values)


def clipped(share: float) -> Change:
    """A channel that stays at a share of its largest value."""

    def change(values: Array) -> Array:
        limit = share * np.abs(values).max()
        return np.clip(values, -limit, limit)

    return change


def overflowing(share: float) -> Change:
    """A channel that starts anew at a share of its largest value."""

    def change(values: Array) -> Array:
        limit = share * np.abs(values).max()
        return (values + limit) % (2 * limit) - limit

    return change


def moved(recording: Recording, index: int, shift: Array) -> Recording:
    """Corners that are stated elsewhere."""

    def changed(plate: Plate) -> Plate:
        return replace(plate, center=plate.center + shift, corners=plate.corners + shift)

    return with_plate(recording, index, changed)


def turned(recording: Recording, index: int, degrees: float, *, corners: bool = True) -> Recording:
    """A plate that is stated to be turned about its middle."""
    turn = rotation_about(UP, np.radians(degrees))

    def changed(plate: Plate) -> Plate:
        around = plate.center + (plate.corners - plate.center) @ turn.T
        rotation = turn @ plate.rotation
        return replace(plate, rotation=rotation, corners=around if corners else plate.corners)

    return with_plate(recording, index, changed)


def exchanged(recording: Recording, one: int, other: int) -> Recording:
    """Two plates whose channels are connected to each other's place."""
    plates = [*recording.plates]
    first, second = plates[one], plates[other]
    plates[one] = replace(first, wrench_in_plate=second.wrench_in_plate, time=second.time)
    plates[other] = replace(second, wrench_in_plate=first.wrench_in_plate, time=first.time)
    return replace(recording, plates=tuple(plates))


def later(recording: Recording, delay_s: float, *indices: int) -> Recording:
    """The same recording with plates that are later."""
    for index in indices:
        recording = with_plate(recording, index, lambda p: replace(p, time=p.time + delay_s))
    return recording


def lost(count: int) -> Change:
    """A channel that reads zero for so many samples, from where it is largest."""

    def change(values: Array) -> Array:
        start = int(np.argmax(np.abs(values)))
        return np.r_[values[:start], np.zeros(count), values[start + count :]]

    return change


def jumping(size: float) -> Change:
    """A channel that reads more from its middle on."""
    return lambda values: values + size * (np.arange(len(values)) > len(values) // 2)


def drifting(size: float) -> Change:
    """A channel that reads more and more."""
    return lambda values: values + np.linspace(0, size, len(values))


def noisy(size: float) -> Change:
    """A channel with white noise of a standard deviation."""
    return lambda values: values + np.random.default_rng(0).normal(0, size, len(values))


def dead(size: float) -> Change:
    """A channel that shows noise alone."""
    return lambda values: noisy(size)(0 * values)


def offset(size: float) -> Change:
    """A channel that was not zeroed."""
    return lambda values: values + size


def without_load(recording: Recording, index: int, from_s: float, to_s: float) -> Recording:
    """A plate that reads nothing for a while, as if a step was beside it."""

    def changed(plate: Plate) -> Plate:
        inside = (plate.time >= from_s) & (plate.time < to_s)
        return replace(plate, wrench_in_plate=np.where(inside[:, None], 0, plate.wrench_in_plate))

    return with_plate(recording, index, changed)


def until(recording: Recording, share: float) -> Recording:
    """Plates that end before the markers."""
    for index, plate in enumerate(recording.plates):
        kept = slice(0, round(share * len(plate.time)))
        time, wrench = plate.time[kept], plate.wrench_in_plate[kept]
        recording = with_plate(
            recording, index, lambda p, t=time, w=wrench: replace(p, time=t, wrench_in_plate=w)
        )
    return recording
