"""The treadmill's structure: a frame that bends on an elastic base, and belts on load cells.

Small displacements from where the actuators put a rigid platform, in the platform's own axes. The
frame has six rigid coordinates about the platform's origin and the shapes `SHAPES`, each belt
assembly six about the same origin; four load cells connect it with the frame.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, skew
from pipeline.virtual_lab.machine.treadmill import LEFT_ASSEMBLY, RIGHT_ASSEMBLY, Assembly

SHAPES: Final = ("vertical bending", "twist", "sideways bending")
FRAME: Final = 6 + len(SHAPES)
"""Coordinates of the frame."""
ASSEMBLIES: Final = (slice(FRAME, FRAME + 6), slice(FRAME + 6, FRAME + 12))
COORDINATES: Final = FRAME + 12
"""Coordinates of the left and the right belt assembly, and number of all of the structure."""
FRAME_M: Final = 1.1
"""Half the frame's length; the deflection there is a shape's coordinate."""
FRAME_KG: Final = 300.0
"""Mass of the frame: as much as the thesis' two belt assemblies of 150 kg; assumed."""
FRAME_NODES_M: Final = np.array(
    [
        (x, y, z)
        for x in np.linspace(-FRAME_M, FRAME_M, 7)
        for y in (-0.5, 0.5)
        for z in (-0.4, -0.2)
    ]
)
"""Where the frame's mass is, in equal parts; assumed, a flat box below the belts."""
BASE_M: Final = np.array([0.0, 0.0, -0.3])
"""Point about which the base yields in its six directions independently; assumed, the middle of the
frame."""
CELLS_M: Final = tuple(
    np.array([(x, y + side * 0.25, -0.2) for x in (-0.8, 0.8) for y in (-0.2, 0.2)])
    for side in (1, -1)
)
"""Load cells of the left and the right assembly: below the corners of the plate; assumed."""

BUILT_FOR: Final = (LEFT_ASSEMBLY, RIGHT_ASSEMBLY)
"""Assemblies with which the structure has the natural frequencies that are stated."""


@dataclass(frozen=True, slots=True)
class Elasticity:
    """How stiff a structure is, stated by natural frequencies, which people can imagine.

    The base is chosen so that people shake the plates about as much as those of a real treadmill:
    in the middle of swing, below 10 Hz, while somebody walks on the other plate, the sideways force
    varies by two times and the vertical by half of what a recording of python-gaitalytics shows
    (a treadmill that does not move; the recording is filtered and says nothing of higher
    frequencies), and feet leave the plates 2 ms later than on a rigid machine. On actuators of
    7 Hz with 5 % damping steps let the plates swing by 56 N (SD), which no recording shows.

    Attributes
    ----------
    base_hz
        Natural frequencies of the whole, rigid structure on its base (forward, left, up, roll,
        pitch, yaw) [Hz]: lowest where actuators hold it, sideways and in pitch.
    base_damping
        Damping ratios of these; of actuators more than of bolted steel.
    shape_hz, shape_damping
        Natural frequencies of `SHAPES` with the frame's middle held and the assemblies on it [Hz],
        and damping ratio; assumed.
    cell_hz, cell_damping
        Natural frequencies of an assembly that moves forward, sideways or up on its load cells, the
        frame being held [Hz], and damping ratio: a belt assembly of 90 kg on a force plate reached
        88, 87 and 178 Hz (Kram et al. 1998, J Appl Physiol 85:764); one of 150 kg on cells as
        stiff reaches these. The damping is assumed.
    """

    base_hz: tuple[float, ...] = (30.0, 13.0, 40.0, 35.0, 16.0, 30.0)
    base_damping: tuple[float, ...] = (0.05, 0.3, 0.05, 0.05, 0.3, 0.05)
    shape_hz: tuple[float, ...] = (45.0, 40.0, 50.0)
    shape_damping: float = 0.02
    cell_hz: tuple[float, ...] = (68.0, 67.0, 138.0)
    cell_damping: float = 0.02


@dataclass(frozen=True, slots=True)
class Springs:
    """Springs with dampers beside them.

    Attributes
    ----------
    stretch
        Their elongations by the structure's coordinates, (n, 21).
    stiffness, damping
        Of each, (n,) [N/m or N·m/rad; N·s/m or N·m·s/rad].
    """

    stretch: Array
    stiffness: Array
    damping: Array

    @classmethod
    def of(
        cls, stretch: Array, inertia: Array, hz: tuple[float, ...], ratio: float | Array
    ) -> "Springs":
        """Give springs on which inertias have natural frequencies [Hz] and damping ratios."""
        omega = 2 * np.pi * np.array(hz)
        return cls(stretch, inertia * omega**2, 2 * ratio * omega * inertia)

    def softer(self, flexibility: float) -> "Springs":
        """Give springs that yield more by a factor, with the same damping ratios."""
        return Springs(
            self.stretch, self.stiffness / flexibility, self.damping / np.sqrt(flexibility)
        )

    def matrices(self) -> tuple[Array, Array]:
        """Give their part of the stiffness and of the damping matrix, (21, 21) each."""
        return (
            self.stretch.T @ (self.stiffness[:, None] * self.stretch),
            self.stretch.T @ (self.damping[:, None] * self.stretch),
        )


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
    assemblies: tuple[Assembly, Assembly] = (LEFT_ASSEMBLY, RIGHT_ASSEMBLY),
    elasticity: Elasticity | None = None,
    flexibility: float = 1.0,
) -> Structure:
    """Assemble the structure from its parts.

    Parameters
    ----------
    assemblies
        Left and right belt assembly; load cells and base are as stiff whatever they weigh.
    elasticity
        How stiff the structure is; by default `Elasticity`.
    flexibility
        By which every displacement under a constant load is multiplied, above 0; natural
        frequencies fall with its square root.

    Returns
    -------
    Structure
        Its matrices are symmetric, and positive definite but for the damping of the assemblies.
    """
    elastic = elasticity or Elasticity()
    cells = []
    for part, assembly, places in zip(ASSEMBLIES, BUILT_FOR, CELLS_M, strict=True):
        stretch = np.zeros((len(places), 3, COORDINATES))
        stretch[:, :, part] = [rigid_shape(place)[:3] for place in places]
        stretch[:, :, :FRAME] = [-frame_shape(place)[:3] for place in places]
        inertia = np.full(3 * len(places), assembly.mass / len(places))
        hz = elastic.cell_hz * len(places)
        cells.append(
            Springs.of(stretch.reshape(-1, COORDINATES), inertia, hz, elastic.cell_damping)
        )
    carried = _inertia_of_frame(_mass_matrix(BUILT_FOR), cells)
    at_base = np.zeros((6, COORDINATES))
    at_base[:, :6] = rigid_shape(BASE_M)
    from_base = np.linalg.inv(rigid_shape(BASE_M))
    about_base = np.diag(from_base.T @ carried[:6, :6] @ from_base)
    base = Springs.of(at_base, about_base, elastic.base_hz, np.array(elastic.base_damping))
    bending = np.eye(COORDINATES)[6:FRAME]
    shapes = Springs.of(bending, np.diag(carried)[6:], elastic.shape_hz, elastic.shape_damping)
    springs = [part.softer(flexibility) for part in (base, shapes, *cells)]
    stiffness, damping = np.sum([part.matrices() for part in springs], axis=0)
    wrenches = []
    for part, own in zip(ASSEMBLIES, springs[2:], strict=True):
        by_displacement, by_velocity = own.matrices()
        wrenches.append((-by_displacement[part], -by_velocity[part]))
    return Structure(_mass_matrix(assemblies), damping, stiffness, tuple(wrenches))


def natural_modes(structure: Structure) -> tuple[Array, Array]:
    """Give frequencies and damping ratios of a structure's free vibration.

    Parameters
    ----------
    structure
        The structure.

    Returns
    -------
    hz
        Undamped natural frequencies in rising order, (21,) [Hz].
    ratio
        Damping ratio of each, (21,).

    Examples
    --------
    >>> hz, ratio = natural_modes(make_structure())
    >>> [f"{value:.1f}" for value in hz[:3]]
    ['12.7', '15.9', '28.8']
    """
    values = np.linalg.eigvals(state_matrix(structure))
    values = values[values.imag > 0]
    order = np.argsort(np.abs(values))
    hz = np.abs(values[order]) / (2 * np.pi)
    return hz, -values[order].real / np.abs(values[order])


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
    x, y, z = place / FRAME_M
    slope = 1 / FRAME_M
    bending = np.column_stack(
        [
            (-2 * z * x, 0, x**2, 0, -2 * x * slope, 0),
            (0, -z * x, y * x, x * slope, -y * slope / 2, -z * slope / 2),
            (-2 * y * x, x**2, 0, 0, 0, 2 * x * slope),
        ]
    )
    return np.hstack([rigid_shape(place), bending])


def inertia_about_origin(assembly: Assembly) -> Array:
    """Give the mass matrix of a rigid body by its motion at the platform's origin, (6, 6)."""
    center = np.zeros((6, 6))
    center[:3, :3] = assembly.mass * np.eye(3)
    center[3:, 3:] = assembly.tensor
    shape = rigid_shape(np.array(assembly.center))
    return shape.T @ center @ shape


def _mass_matrix(assemblies: tuple[Assembly, Assembly]) -> Array:
    """Give the mass matrix of frame and assemblies, (21, 21)."""
    mass = np.zeros((COORDINATES, COORDINATES))
    for node in FRAME_NODES_M:
        shape = frame_shape(node)[:3]
        mass[:FRAME, :FRAME] += FRAME_KG / len(FRAME_NODES_M) * shape.T @ shape
    for part, assembly in zip(ASSEMBLIES, assemblies, strict=True):
        mass[part, part] = inertia_about_origin(assembly)
    return mass


def _inertia_of_frame(mass: Array, cells: list[Springs]) -> Array:
    """Give the frame's mass matrix with the assemblies fixed to it, (9, 9)."""
    total = mass[:FRAME, :FRAME].copy()
    for part, own in zip(ASSEMBLIES, cells, strict=True):
        stiffness = own.matrices()[0]
        follow = -np.linalg.solve(stiffness[part, part], stiffness[part, :FRAME])
        total += follow.T @ mass[part, part] @ follow
    return total
