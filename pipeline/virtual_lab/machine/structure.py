"""The treadmill's structure: a frame that bends on an elastic base, and belts on load cells.

Small displacements from where the actuators put a rigid platform, in the platform's own axes. The
frame has six rigid coordinates about the platform's origin and the shapes `SHAPES`, each belt
assembly six about the same origin; four load cells connect it with the frame. The commanded motion
accelerates the structure and turns it in gravity; people and drives push it. It vibrates about the
commanded motion: load cells, accelerometers and markers go with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hbm.numbers import read_numbers
from hbm.spatial import Array, skew
from pipeline.virtual_lab.machine.belts import BeltMotion
from pipeline.virtual_lab.machine.platform import (
    BELT_ASSEMBLIES,
    TERMS,
    Pair,
    PlatformMotion,
    felt_by_terms,
    inertial_wrench,
    motion_terms,
    specific_force,
    weight_of,
)

STRUCTURE: Final = read_numbers("pipeline.virtual_lab.machine", "parameters.toml", "structure")

SHAPES: Final = ("vertical bending", "twist", "sideways bending")
FRAME: Final = 6 + len(SHAPES)
"""Coordinates of the frame."""
ASSEMBLIES: Final = (slice(FRAME, FRAME + 6), slice(FRAME + 6, FRAME + 12))
COORDINATES: Final = FRAME + 12
"""Coordinates of the left and the right belt assembly, and number of all of the structure."""
FRAME_NODES_M: Final = np.array(
    [
        (x, y, z)
        for x in np.linspace(-STRUCTURE.half_length, STRUCTURE.half_length, 7)
        for y in (-0.5, 0.5)
        for z in (-0.4, -0.2)
    ]
)
"""Where the frame's mass is, in equal parts; assumed, a flat box below the belts."""


def springs(stretch: Array, inertia: Array, hz: Array, ratio: float | Array) -> tuple[Array, Array]:
    """Give stiffness and damping matrix of springs with dampers beside them, (21, 21) each.

    Their elongations by the structure's coordinates are ``stretch``, (n, 21); on them inertias have
    natural frequencies [Hz] and damping ratios.
    """
    omega = 2 * np.pi * hz
    stiffness, damping = inertia * omega**2, 2 * ratio * omega * inertia
    return stretch.T @ (stiffness[:, None] * stretch), stretch.T @ (damping[:, None] * stretch)


@dataclass(frozen=True, slots=True)
class Structure:
    """Mass, damping and stiffness of the treadmill's structure.

    Attributes
    ----------
    mass, damping, stiffness
        Matrices of the equations of motion ``M q̈ + C q̇ + K q = load``, (21, 21) each.
    cells
        Stiffness and damping part of the wrench of each assembly's load cells on it, about the
        platform's origin, by displacement and by velocity, (6, 21) each.
    """

    mass: Array
    damping: Array
    stiffness: Array
    cells: tuple[tuple[Array, Array], ...]


def make_structure(
    flexibility: float = 1.0,
    base_hz: Sequence[float] = STRUCTURE.base_frequency,
    base_damping: Sequence[float] = STRUCTURE.base_damping,
) -> Structure:
    """Assemble the structure from its parts.

    Parameters
    ----------
    flexibility
        By which every displacement under a constant load is multiplied, above 0; natural
        frequencies fall with its square root.
    base_hz, base_damping
        Of the whole on its base.

    Returns
    -------
    Structure
        Its matrices are symmetric, and positive definite but for the damping of the assemblies.
    """
    softness, mass, cells = np.sqrt(flexibility), _mass_matrix(), []
    for part, assembly, middle in zip(ASSEMBLIES, BELT_ASSEMBLIES, (0.25, -0.25), strict=True):
        # load cells below the corners of the plate; assumed
        places = np.array([(x, middle + y, -0.2) for x in (-0.8, 0.8) for y in (-0.2, 0.2)])
        # a cell is stretched by how far the assembly moves there from the frame
        stretch = np.zeros((len(places), 3, COORDINATES))
        stretch[:, :, part] = [rigid_shape(place)[:3] for place in places]
        stretch[:, :, :FRAME] = [-frame_shape(place)[:3] for place in places]
        inertia = np.full(3 * len(places), assembly.mass / len(places))
        hz = np.tile(STRUCTURE.cell_frequency, len(places)) / softness
        cells.append(
            springs(stretch.reshape(-1, COORDINATES), inertia, hz, STRUCTURE.steel_damping)
        )
    carried = mass[:FRAME, :FRAME].copy()  # of the frame with the assemblies fixed to it
    for part, (stiffness, _) in zip(ASSEMBLIES, cells, strict=True):
        # how the assembly follows the frame on its cells: K_aa q_a = -K_af q_f
        follow = -np.linalg.solve(stiffness[part, part], stiffness[part, :FRAME])
        carried += follow.T @ mass[part, part] @ follow
    # the base holds the rigid frame in six directions; its springs by the inertia of all about it
    at_base = np.zeros((6, COORDINATES))
    at_base[:, :6] = rigid_shape(STRUCTURE.base)
    from_base = np.linalg.inv(rigid_shape(STRUCTURE.base))
    about_base = np.diag(from_base.T @ carried[:6, :6] @ from_base)
    base = springs(at_base, about_base, np.array(base_hz) / softness, np.array(base_damping))
    # the shapes by their modal masses, with the middle held
    bending, hz = np.eye(COORDINATES)[6:FRAME], np.array(STRUCTURE.shape_frequency) / softness
    shapes = springs(bending, np.diag(carried)[6:], hz, STRUCTURE.steel_damping)
    stiffness, damping = np.sum([base, shapes, *cells], axis=0)
    # the cells' wrench on an assembly is opposite to what deforms them
    wrenches = [
        (-by_displacement[part], -by_velocity[part])
        for part, (by_displacement, by_velocity) in zip(ASSEMBLIES, cells, strict=True)
    ]
    return Structure(mass, damping, stiffness, tuple(wrenches))


def state_matrix(structure: Structure) -> Array:
    """Give the matrix ``A`` of ``ẋ = A x + …`` for displacements and velocities, (42, 42)."""
    by_place = np.linalg.solve(structure.mass, -structure.stiffness)
    by_velocity = np.linalg.solve(structure.mass, -structure.damping)
    size = len(structure.mass)
    return np.block([[np.zeros((size, size)), np.eye(size)], [by_place, by_velocity]])


def rigid_shape(place: Array) -> Array:
    """Give displacement and rotation of a place by those of a rigid body at the origin, (6, 6)."""
    shape = np.eye(6)
    shape[:3, 3:] = -skew(place)
    return shape


def frame_shape(place: Array) -> Array:
    """Give displacement and rotation of a place of the frame by the frame's coordinates.

    Parameters
    ----------
    place
        In the platform frame, (3,) [m].

    Returns
    -------
    Array
        (6, 9) [m, rad per m and rad of the rigid coordinates and m of `SHAPES`].

    Notes
    -----
    Bending deflects by the square of the distance from the middle, twist turns in proportion to
    it; the middle, where the base holds the frame, stays. Plane sections remain plane, and the
    rotation is half the curl of the displacement.
    """
    x, y, z = place / STRUCTURE.half_length
    slope = 1 / STRUCTURE.half_length
    bending = np.column_stack(
        [
            (-2 * z * x, 0, x**2, 0, -2 * x * slope, 0),
            (0, -z * x, y * x, x * slope, -y * slope / 2, -z * slope / 2),
            (-2 * y * x, x**2, 0, 0, 0, 2 * x * slope),
        ]
    )
    return np.hstack([rigid_shape(place), bending])


def _mass_matrix() -> Array:
    """Give the mass matrix of frame and assemblies, (21, 21)."""
    # kinetic energy ½ q̇ᵀ M q̇: point masses of the frame, and rigid assemblies by their centres
    mass = np.zeros((COORDINATES, COORDINATES))
    for node in FRAME_NODES_M:
        shape = frame_shape(node)[:3]
        mass[:FRAME, :FRAME] += STRUCTURE.frame_mass / len(FRAME_NODES_M) * shape.T @ shape
    for part, assembly in zip(ASSEMBLIES, BELT_ASSEMBLIES, strict=True):
        center = np.zeros((6, 6))
        center[:3, :3] = assembly.mass * np.eye(3)
        center[3:, 3:] = assembly.tensor
        shape = rigid_shape(np.array(assembly.center))
        mass[part, part] = shape.T @ center @ shape
    return mass


Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Modes:
    """Complex modes ``ż = λ z + b u`` of which a structure's motion is the sum.

    Attributes
    ----------
    shapes
        State of the structure by mode, of each conjugate pair one, (42, 21).
    by_inputs
        What excites the modes, (21, inputs).
    decay, now, before
        The modes at the next sample: ``decay * z`` and the weights of what excites them at that
        sample and at this one, (21,) each.
    at_rest
        The modes under a constant excitation, by this, (21,).
    """

    shapes: Complex
    by_inputs: Complex
    decay: Complex
    now: Complex
    before: Complex
    at_rest: Complex

    @classmethod
    def of(cls, structure: Structure, load_of_inputs: Array, rate_hz: float) -> "Modes":
        """Find the modes of a structure, excited by inputs that are linear between samples."""
        values, vectors = np.linalg.eig(state_matrix(structure))
        accelerating = np.zeros((2 * COORDINATES, load_of_inputs.shape[1]))
        accelerating[COORDINATES:] = np.linalg.solve(structure.mass, load_of_inputs)
        excited = np.linalg.solve(vectors, accelerating.astype(complex))
        one = values.imag > 0  # of each conjugate pair
        value = values[one].astype(complex)
        # ∫ e^(λ(h-t)) u(t) dt for an input that is linear within a step h, by its two ends
        x = np.asarray(value / rate_hz, complex)
        grown: Complex = np.exp(x)
        now: Complex = (grown - 1 - x) / x**2 / rate_hz
        before: Complex = (grown - 1) / x / rate_hz - now
        at_rest: Complex = np.asarray(-1 / value, complex)
        return cls(vectors[:, one], excited[one], grown, now, before, at_rest)

    def readout(self, output: Array) -> Array:
        """Give the matrix from real and imaginary parts of the modes to outputs of the state."""
        # a pair adds z φ and its conjugate: 2 Re(z φ)
        by_mode = 2 * output @ self.shapes
        return np.hstack([by_mode.real, -by_mode.imag])

    def advance(self, inputs: Array, state: Complex | None) -> tuple[Array, Complex]:
        """Give real and imaginary parts of the modes, (42, n), and the state of their filters."""
        parts = np.vstack([self.by_inputs.real, self.by_inputs.imag]) @ inputs
        modes = len(self.decay)
        if state is None:
            first = parts[:modes, 0] + 1j * parts[modes:, 0]
            state = (self.at_rest - self.now) * first
        after = np.empty_like(state)
        for k in range(modes):
            exciting, one = parts[k] + 1j * parts[modes + k], slice(k, k + 1)
            weights, decay = [self.now[k], self.before[k]], [1, -self.decay[k]]
            moved, after[one] = lfilter(weights, decay, exciting, zi=state[one])
            parts[k], parts[modes + k] = moved.real, moved.imag
        return parts, after


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
        (left, right), (on_left, on_right) = self.plates, self.people
        return left - on_left, right - on_right


def respond(
    structure: Structure | None,
    motion: PlatformMotion,
    drives: Pair,
    people: Pair | None,
    on_frame: Array | None,
    places: tuple[Array, ...],
    rate_hz: float,
    step: int,
) -> Response:
    """Give the response of the structure, which rests under its first loads at the beginning.

    Parameters
    ----------
    structure
        None for a rigid one.
    motion
        Of the platform as its actuators move it, N samples.
    drives
        What the left and the right plate have to carry of belts, rollers and motors, in platform
        axes about the platform's origin, (N, 6) each [N, N·m].
    people
        Ground reaction of the left and the right plate on people, likewise; None for nobody.
    on_frame
        Action of people on the frame beside the belts, likewise, (N, 6); None for nobody.
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
    by_terms = [inertial_wrench(assembly, motion.pivot) for assembly in BELT_ASSEMBLIES]
    sensors = tuple(specific_force(motion, place) for place in places)
    count = len(range(0, len(terms), step))
    if structure is None:
        left, right = (terms @ by.T + drive for by, drive in zip(by_terms, drives, strict=True))
        if people is not None:
            left, right = left + people[0], right + people[1]
        return Response((left, right), sensors, np.zeros((count, FRAME)), people)

    series = [terms, *drives]
    if people is not None:
        series[1:] = [drive + load for drive, load in zip(drives, people, strict=True)]
    if on_frame is not None:
        series.append(on_frame)
    by_inputs = _load_of_inputs(by_terms, motion.pivot)[:, : sum(part.shape[1] for part in series)]
    modes = Modes.of(structure, by_inputs, rate_hz)
    output, through = _output(structure, by_inputs, places)
    readout = modes.readout(output)
    of_frame = modes.readout(np.eye(FRAME, 2 * COORDINATES))
    weights = [weight_of(assembly) for assembly in BELT_ASSEMBLIES]
    plates, frame = np.empty((2, len(terms), 6)), np.empty((count, FRAME))
    chunk = 8_000 // step * step  # samples at a time, so that all modes stay in the cache
    state: Complex | None = None
    for start in range(0, len(terms), chunk):
        now = slice(start, start + chunk)
        inputs = np.concatenate([part[now].T for part in series])
        modal, state = modes.advance(inputs, state)
        # six rows each: per plate wrench and coordinates, per sensor acceleration and rotation
        blocks = np.split(readout @ modal + through @ inputs, 4 + len(sensors))
        shapes = (of_frame @ modal[:, ::step]).T
        frame[start // step :][: len(shapes)] = shapes
        for k, weight in enumerate(weights):
            plates[k, now] = _in_moved_axes(blocks[2 * k], weight, blocks[2 * k + 1]).T
        for sensor, block in zip(sensors, blocks[4:], strict=True):
            # the vibration's acceleration is added, and the rigid platform's is seen in turned axes
            rigid = sensor[now].T
            sensor[now] = (rigid + block[:3] - np.cross(block[3:], rigid, axis=0)).T
    return Response((plates[0], plates[1]), sensors, frame, people)


def _load_of_inputs(by_terms: list[Array], pivot: Array) -> Array:
    """Give the load on the structure by motion terms, what both plates carry, and on the frame."""
    # in axes that move with the platform every mass is pushed by minus its specific force
    load = np.zeros((COORDINATES, TERMS + 18))
    for node in FRAME_NODES_M:
        inertial = STRUCTURE.frame_mass / len(FRAME_NODES_M) * felt_by_terms(node, pivot)
        load[:FRAME, :TERMS] -= frame_shape(node)[:3].T @ inertial
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
    # to first order in the displacement: F - φ × F, and M - φ × M - s × F
    in_cells = wrench.copy()
    in_cells[:3] -= np.cross(turn, force, axis=0)
    in_cells[3:] -= np.cross(turn, total[3:], axis=0) + np.cross(shift, force, axis=0)
    return in_cells
