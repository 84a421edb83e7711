"""Faults of one plate about its own centre, as the virtual laboratory has and states them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.io.recording import Plate, Recording
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    PLATE_CENTERS_M,
    Clock,
    InstrumentedTreadmill,
    misplaced,
)

UNIT_WRENCHES: Final = np.eye(6)


@dataclass(frozen=True, slots=True, eq=False)
class PlateFault:
    """What is wrong with a plate, in its own axes about the centre of its surface.

    Attributes
    ----------
    gain
        What it shows too much, by what it carries, (6, 6).
    zero
        What it shows of nothing, (6,) [N, N·m].
    place
        By how much it is stated too far along its axes, (3,) [m].
    direction
        By how much it is stated to be turned too far, as a rotation vector, (3,) [rad].
    """

    gain: Array = field(default_factory=lambda: np.zeros((6, 6)))
    zero: Array = field(default_factory=lambda: np.zeros(6))
    place: Array = field(default_factory=lambda: np.zeros(3))
    direction: Array = field(default_factory=lambda: np.zeros(3))

    def __add__(self, other: "PlateFault") -> "PlateFault":
        return PlateFault(
            self.gain + other.gain,
            self.zero + other.zero,
            self.place + other.place,
            self.direction + other.direction,
        )


def with_faults(
    treadmill: InstrumentedTreadmill, faults: Sequence[PlateFault], late_s: float
) -> InstrumentedTreadmill:
    """Give a treadmill whose plates' load cells have these faults too, and are so late."""
    plates = []
    for plate, fault, center in zip(treadmill.plates, faults, PLATE_CENTERS_M, strict=True):
        to_center, back = about(center), about(-center)
        clock = plate.clock
        changed = replace(
            plate,
            gain=back @ (np.eye(6) + fault.gain) @ to_center @ plate.gain,
            offset=plate.offset + back @ fault.zero,
            clock=Clock(clock.delay_s + late_s, clock.rate, clock.jitter_s),
        )
        plates.append(changed)
    return replace(treadmill, plates=tuple(plates))


def restated(recording: Recording, faults: Sequence[PlateFault]) -> Recording:
    """Give a recording that states its plates to be where they are not."""
    plates = tuple(
        plate if not (fault.place.any() or fault.direction.any()) else _moved(plate, fault)
        for plate, fault in zip(recording.plates, faults, strict=True)
    )
    return replace(recording, plates=plates)


def shown_by(treadmill: InstrumentedTreadmill) -> list[Array]:
    """Give what each plate shows of what it carries, about its own centre, (6, 6)."""
    seen = misplaced(UNIT_WRENCHES, treadmill.faults.plates).T
    return [
        about(center) @ plate.gain @ seen @ about(-center)
        for plate, center in zip(treadmill.plates, PLATE_CENTERS_M, strict=True)
    ]


def true_sizes(
    treadmill: InstrumentedTreadmill, recording: Recording, loads: Sequence[Array]
) -> dict[str, float]:
    """Give the true sizes of what is wrong with the plates, by the names of causes.

    Parameters
    ----------
    treadmill
        As it recorded.
    recording
        What it recorded, with the plates as stated.
    loads
        Per plate what it carries in its own axes about its centre, (T, 6) [N, N·m]: linear errors
        that are not among the causes count as those of the causes that are most alike under them.
    """
    delays = [plate.clock.delay_s for plate in treadmill.plates]
    sizes = {"plates delayed": float(np.mean(delays))}
    truth = zip(
        treadmill.plates, shown_by(treadmill), recording.plates, PLATE_CENTERS_M, loads, strict=True
    )
    for plate, shown, stated, center, load in truth:
        name = f"plate {stated.number}"
        zero = about(center) @ plate.offset
        linear = _linear_sizes(shown - np.eye(6), load)
        linear["place"] += stated.center - center
        linear["direction"] += Rotation.from_matrix(stated.rotation).as_rotvec()
        for k, component in enumerate(WRENCH_COMPONENTS):
            sizes[f"{name}: zero of {component}"] = float(zero[k])
            sizes[f"{name}: gain of {component}"] = float(linear["gain"][k])
        for k, component in enumerate(WRENCH_COMPONENTS[:2]):
            sizes[f"{name}: Fz in {component}"] = float(linear["cross-talk"][k])
        for k, letter in enumerate("xyz"):
            sizes[f"{name}: place along {letter}"] = float(linear["place"][k])
            sizes[f"{name}: direction about {letter}"] = float(linear["direction"][k])
    return sizes


def about(point: Array) -> Array:
    """Give what brings a wrench about the origin to another point, (6, 6): ``M − p × F``."""
    result = np.eye(6)
    result[3:, :3] = -cross_matrix(point)
    return result


def cross_matrix(vector: Array) -> Array:
    """Give the matrix whose product is that with a vector from the left, (3, 3)."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _moved(plate: Plate, fault: PlateFault) -> Plate:
    """State a plate to be where it is not."""
    turn = Rotation.from_rotvec(fault.direction).as_matrix()
    shift = plate.rotation @ fault.place
    corners = plate.center + shift + (plate.corners - plate.center) @ turn.T
    return replace(
        plate, rotation=plate.rotation @ turn, center=plate.center + shift, corners=corners
    )


def _linear_sizes(shown: Array, load: Array) -> dict[str, Array]:
    """Find gains, cross-talk, place and direction that show most nearly the same, (6, 6)."""
    gains = [np.diag(unit) for unit in np.eye(6)]
    talks = [np.outer(unit, np.eye(6)[2]) for unit in np.eye(6)[:2]]
    places, directions = [], []
    for axis in np.eye(3):
        place, turn = np.zeros((6, 6)), np.zeros((6, 6))
        place[3:, :3] = cross_matrix(axis)
        turn[:3, :3] = turn[3:, 3:] = cross_matrix(axis)
        places.append(place)
        directions.append(turn)
    kinds = {"gain": gains, "cross-talk": talks, "place": places, "direction": directions}
    every = [each for own in kinds.values() for each in own]
    root = np.linalg.cholesky(load.T @ load / len(load) + 1e-6 * np.eye(6))
    design = np.column_stack([(each @ root).ravel() for each in every])
    found = np.linalg.lstsq(design, (shown @ root).ravel())[0]
    ends = np.cumsum([len(own) for own in kinds.values()])[:-1]
    return dict(zip(kinds, np.split(found, ends), strict=True))
