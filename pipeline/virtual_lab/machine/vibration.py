"""How the structure responds to the platform's motion, to people, rollers and motors.

The commanded motion accelerates the structure and turns it in gravity; people and drives push it.
It vibrates about the commanded motion: load cells, accelerometers and markers go with it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.machine.artefacts import inertial_wrench, weight_of
from pipeline.virtual_lab.machine.belt_drive import BeltMotion
from pipeline.virtual_lab.machine.modes import Complex, Modes
from pipeline.virtual_lab.machine.platform import (
    TERMS,
    PlatformMotion,
    felt_by_terms,
    motion_terms,
    specific_force,
)
from pipeline.virtual_lab.machine.structure import (
    ASSEMBLIES,
    COORDINATES,
    FRAME,
    FRAME_KG,
    FRAME_NODES_M,
    Structure,
    frame_shape,
    state_matrix,
)
from pipeline.virtual_lab.machine.treadmill import Assembly

CHUNK_SAMPLES: Final = 8_000
"""Computed at a time, so that all modes stay in the processor's cache."""
Pair = tuple[Array, Array]


@dataclass(frozen=True, slots=True)
class Loads:
    """What acts on the treadmill beside its own inertia and weight, in platform axes.

    Attributes
    ----------
    drives
        What the left and the right plate have to carry of belts, rollers and motors, about the
        platform's origin, (N, 6) each [N, N·m].
    people
        Ground reaction of the left and the right plate on people, likewise; None for nobody.
    on_frame
        Action of people on the frame beside the belts, likewise, (N, 6); None for nobody.
    people_shake
        By which the forces of people are multiplied where they make the structure vibrate.
    """

    drives: Pair
    people: Pair | None = None
    on_frame: Array | None = None
    people_shake: float = 1.0

    @property
    def shaking(self) -> list[Array]:
        """What makes the structure vibrate: on the left and the right plate, and on the frame."""
        on_plates = list(self.drives)
        if self.people is not None and self.people_shake > 0:
            share = self.people_shake
            people = [load if share == 1 else share * load for load in self.people]
            on_plates = [drive + load for drive, load in zip(on_plates, people, strict=True)]
        if self.on_frame is None:
            return on_plates
        return [*on_plates, self.people_shake * self.on_frame]


@dataclass(frozen=True, slots=True)
class Response:
    """What the treadmill's parts undergo, sample by sample.

    Attributes
    ----------
    plates
        What the load cells of the left and the right plate carry, with the sign of an action on a
        person standing there, tared at rest in neutral: in the axes of the vibrating assembly about
        the point of it that rests in the platform's origin, (N, 6) each [N, N·m].
    sensors
        Specific force at each place, in the axes of the vibrating frame there, (N, 3) each [m/s²].
    frame
        Coordinates of the frame relative to the commanded motion at every ``step``-th sample,
        (F, 9) [m, rad]; `frame_shape` gives the displacement of a place.
    people
        The load of people that is part of ``plates``; None for nobody.
    belts
        The left and the right belt, where they are known.
    """

    plates: Pair
    sensors: tuple[Array, ...]
    frame: Array
    people: Pair | None = None
    belts: tuple[BeltMotion, ...] = ()

    @property
    def artefacts(self) -> Pair:
        """What the cells carry of the treadmill itself: all but the load of people."""
        if self.people is None:
            return self.plates
        left, right = (all_ - own for all_, own in zip(self.plates, self.people, strict=True))
        return left, right


def respond(
    structure: Structure | None,
    assemblies: tuple[Assembly, Assembly],
    motion: PlatformMotion,
    loads: Loads,
    places: tuple[Array, ...],
    rate_hz: float,
    step: int,
) -> Response:
    """Give the response of the structure, which rests under its first loads at the beginning.

    Parameters
    ----------
    structure
        None for a rigid one.
    assemblies
        Left and right belt assembly, those of the structure.
    motion
        Of the platform as its actuators move it, N samples.
    loads
        Of people and drives.
    places
        Of accelerometers on the frame, (3,) each [m].
    rate_hz
        Sampling rate [Hz].
    step
        Samples from one value of ``Response.frame`` to the next.

    Returns
    -------
    Response
        Without a structure the rigid answer.

    Notes
    -----
    The complex modes of ``M q̈ + C q̇ + K q = load`` are independent first-order systems, which are
    solved exactly for loads that are linear between samples. The plates' wrench is the elastic and
    damping force of their cells, so that a constant load is carried exactly.
    """
    terms = motion_terms(motion)
    by_terms = [inertial_wrench(assembly, motion.pivot) for assembly in assemblies]
    sensors = tuple(specific_force(motion, place) for place in places)
    count = len(range(0, len(terms), step))
    if structure is None:
        plates = np.stack(
            [terms @ wrench.T + own for wrench, own in zip(by_terms, loads.drives, strict=True)]
        )
        if loads.people is not None:
            plates += loads.people
        return Response((plates[0], plates[1]), sensors, np.zeros((count, FRAME)), loads.people)

    series = [terms, *loads.shaking]
    by_inputs = _load_of_inputs(by_terms, motion.pivot)[:, : sum(part.shape[1] for part in series)]
    modes = Modes.of(structure, by_inputs, rate_hz)
    output, through = _output(structure, by_inputs, places)
    readout = modes.readout(output)
    of_frame = modes.readout(np.eye(FRAME, 2 * COORDINATES))
    weights = [weight_of(assembly) for assembly in assemblies]
    plates, frame = np.empty((2, len(terms), 6)), np.empty((count, FRAME))
    chunk = CHUNK_SAMPLES // step * step
    state: Complex | None = None
    for start in range(0, len(terms), chunk):
        now = slice(start, start + chunk)
        inputs = np.concatenate([part[now].T for part in series])
        modal, state = modes.advance(inputs, state)
        found = readout @ modal + through @ inputs
        frame[start // step : -(-(start + inputs.shape[1]) // step)] = (
            of_frame @ modal[:, ::step]
        ).T
        for k, weight in enumerate(weights):
            wrench, moved = found[12 * k : 12 * k + 6], found[12 * k + 6 : 12 * k + 12]
            plates[k, now] = _in_moved_axes(wrench, weight, moved).T
        for k, sensor in enumerate(sensors):
            own = found[24 + 6 * k : 30 + 6 * k]
            felt = sensor[now].T
            sensor[now] = (felt + own[:3] - _cross(own[3:], felt)).T
    if loads.people is not None and loads.people_shake != 1:
        plates += (1 - loads.people_shake) * np.stack(loads.people)
    return Response((plates[0], plates[1]), sensors, frame, loads.people)


def _load_of_inputs(by_terms: list[Array], pivot: Array) -> Array:
    """Give the load on the structure by motion terms, what both plates carry, and on the frame."""
    load = np.zeros((COORDINATES, TERMS + 18))
    for node in FRAME_NODES_M:
        felt = FRAME_KG / len(FRAME_NODES_M) * felt_by_terms(node, pivot)
        load[:FRAME, :TERMS] -= frame_shape(node)[:3].T @ felt
    for k, (part, wrench) in enumerate(zip(ASSEMBLIES, by_terms, strict=True)):
        load[part, :TERMS] = -wrench
        load[part, TERMS + 6 * k : TERMS + 6 * k + 6] = -np.eye(6)
    load[:6, TERMS + 12 :] = np.eye(6)
    return load


def _output(
    structure: Structure, load_of_inputs: Array, places: tuple[Array, ...]
) -> tuple[Array, Array]:
    """Give what is read of the state, and directly of the inputs.

    Of each plate the cells' wrench and the assembly's coordinates; of each place of the frame its
    acceleration and rotation: six rows each.
    """
    accelerating = state_matrix(structure)[COORDINATES:]
    by_load = np.linalg.solve(structure.mass, load_of_inputs)
    rows, through = [], []
    for part, (by_displacement, by_velocity) in zip(ASSEMBLIES, structure.cells, strict=True):
        rows += [np.hstack([by_displacement, by_velocity]), np.eye(2 * COORDINATES)[part]]
        through.append(np.zeros((12, load_of_inputs.shape[1])))
    for place in places:
        shape = frame_shape(place)
        rotation = np.zeros((3, 2 * COORDINATES))
        rotation[:, :FRAME] = shape[3:]
        rows += [shape[:3] @ accelerating[:FRAME], rotation]
        through += [shape[:3] @ by_load[:FRAME], np.zeros((3, load_of_inputs.shape[1]))]
    return np.vstack(rows), np.vstack(through)


def _in_moved_axes(wrench: Array, weight: Array, moved: Array) -> Array:
    """Give a tared wrench, (6, n), in axes that are displaced and turned a little, about them."""
    total = wrench + weight[:, None]
    force, shift, turn = total[:3], moved[:3], moved[3:]
    seen = wrench.copy()
    seen[:3] -= _cross(turn, force)
    seen[3:] -= _cross(turn, total[3:]) + _cross(shift, force)
    return seen


def _cross(a: Array, b: Array) -> Array:
    """Give the cross product of vectors in columns, (3, n)."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
