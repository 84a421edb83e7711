"""The wrench of the ground: the rate of change of momentum of the segments and of soft tissue.

And the true joint moments of legs: what the segments beyond a joint need and the ground does not
give. Newton's and Euler's laws for the person's true body; nothing of it is shared with the inverse
dynamics of `hbm`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.segments import Inertia
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.virtual_lab.faults import BodyFaults
from pipeline.virtual_lab.person.anatomy import SIDES
from pipeline.virtual_lab.person.body import (
    COLUMN,
    LINKS,
    PARENT,
    Frame,
    Skeleton,
    chunks,
    frames,
    moved,
    placed,
)
from pipeline.virtual_lab.person.variation import drawn

TISSUE: Final = {
    "thigh": (0.70, 10.0, 0.30),
    "shank": (0.55, 14.0, 0.30),
    "thorax": (0.40, 5.0, 0.40),
    "mid_trunk": (0.60, 5.0, 0.40),
}
"""Share of the segment's mass, natural frequency [Hz] and damping ratio. Shares: soft tissue beside
bone of thigh, shank and trunk, after the wobbling mass models of Gruber et al. (1998, J Biomech
31:439) and Pain and Challis (2006, J Biomech 39:119), rounded; the thorax' less, for its wall is
stiff. Frequencies: soft tissue of the legs in walking and running 10 to 50 Hz, strongly damped by
active muscle (Wakeling and Nigg 2001, J Appl Physiol 90:412); trunk and viscera of standing people
about 5 Hz (Matsumoto and Griffin 1998, J Sound Vib 212:85). Values within these ranges and the
damping ratios are assumed."""
SCATTER: Final = 0.15
"""Standard deviation between people of all three, by their values; assumed."""


@dataclass(frozen=True, slots=True)
class WobblingMass:
    """A point mass on springs in a segment.

    Attributes
    ----------
    segment
        What carries it.
    mass_kg
        Its mass, part of the segment's.
    place
        Where it is in the T-pose: the segment's centre of mass, (3,) [m], segment frame.
    frequency_hz, damping
        Natural frequency and damping ratio, equal in all directions.
    """

    segment: str
    mass_kg: float
    place: Array
    frequency_hz: float
    damping: float


class Oscillator:
    """Integrates a wobbling mass through a trial, chunk by chunk.

    Notes
    -----
    ``d̈ + 2 ζ ω ḋ + ω² d = -Rᵀ (a - g)`` in the segment's frame, with the acceleration ``a`` of the
    place in which the mass rests, relative to its value at the start. Solved exactly for a right
    side that is linear between samples.
    """

    def __init__(self, wobbling: WobblingMass, rate_hz: float) -> None:
        self.mass = wobbling
        self._omega = 2 * np.pi * wobbling.frequency_hz
        denominator = np.array([1.0, 2 * wobbling.damping * self._omega, self._omega**2])
        self._filters = [
            cont2discrete((np.array(numerator), denominator), 1 / rate_hz, method="foh")[:2]
            for numerator in ([1.0], [1.0, 0.0])
        ]
        self._states = [np.zeros((3, 2)), np.zeros((3, 2))]
        self._start: Array | None = None

    def add_reaction(self, wrench: Array, frame: Frame) -> None:
        """Add to a ground wrench (6, T) what the mass changes by not moving with the bone."""
        rotation, first, second = frame.rotation
        place = self.mass.place
        rest, at_rest = frame.point(place), frame.point_acceleration(place)
        at_rest[2] += GRAVITY_MPS2
        drive = -np.einsum("ijt,it->jt", rotation, at_rest)
        if self._start is None:
            self._start = drive[:, :1].copy()
        drive -= self._start
        shift, speed = (self._step(k, drive) for k in range(2))
        pull = drive - 2 * self.mass.damping * self._omega * speed - self._omega**2 * shift
        away = _turned(rotation, shift)
        more = _turned(second, shift) + 2 * _turned(first, speed) + _turned(rotation, pull)
        force, extra = self.mass.mass_kg * (at_rest + more), self.mass.mass_kg * more
        add_force(wrench, extra, rest)
        wrench[3:] += np.cross(away, force, axis=0)

    def _step(self, k: int, drive: Array) -> Array:
        numerator, denominator = (np.ravel(row) for row in self._filters[k])
        out, self._states[k] = lfilter(numerator, denominator, drive, axis=1, zi=self._states[k])
        return np.asarray(out)


def draw_wobbling_masses(
    inertias: Mapping[str, Inertia], faults: BodyFaults, rng: np.random.Generator
) -> tuple[WobblingMass, ...]:
    """Draw a person's wobbling masses; none with ``same_body`` or without size."""
    masses = []
    carriers = {"thorax": "thorax", "mid_trunk": "mid_trunk"}
    carriers |= {f"{side}_{part}": part for side in SIDES for part in ("thigh", "shank")}
    for name, tissue in carriers.items():
        scatter = 1 + SCATTER * drawn(rng, 3)
        share, frequency_hz, damping = np.array(TISSUE[tissue]) * scatter
        part, share = inertias[name], min(faults.wobble_scale * share, 1.0)
        if share > 0 and not faults.same_body:
            masses.append(WobblingMass(name, share * part.mass, part.center, frequency_hz, damping))
    return tuple(masses)


def _turned(rotation: Array, vectors: Array) -> Array:
    """Apply rotations (3, 3, T) to vectors (3, T)."""
    return np.asarray(np.einsum("ijt,jt->it", rotation, vectors))


def ground_wrench(
    skeleton: Skeleton,
    motion: tuple[Array, Array, Array],
    oscillators: Sequence[Oscillator] = (),
) -> Array:
    """Give the wrench that the ground must exert on a person.

    Parameters
    ----------
    skeleton
        The person's.
    motion
        Coordinates and their first and second derivatives, (55, T) each [rad and m, s].
    oscillators
        Wobbling masses, which the motion at equal intervals drives from rest.

    Returns
    -------
    Array
        In lab axes about the lab origin, (T, 6) [N, N·m].

    Notes
    -----
    Newton's and Euler's laws for the whole body: the wrench is the sum over all mass of
    ``(p̈ - g) dm`` and ``p × (p̈ - g) dm``. With ``p = o + R x`` in each segment both integrals
    depend on its mass, its centre and ``J = ∫ x xᵀ dm`` alone: the moment of ``R x × R̈ x`` is the
    antisymmetric part of ``R J R̈ᵀ``.
    """
    count = motion[0].shape[1]
    wrench = np.zeros((6, count))
    parts = [(name, part, second_moment(part)) for name, part in skeleton.inertias.items()]
    for chunk in chunks(count):
        found = frames(skeleton, tuple(values[:, chunk] for values in motion))
        own = wrench[:, chunk]
        for name, part, moment in parts:
            add_segment(own, found[name], part, moment)
        for oscillator in oscillators:
            oscillator.add_reaction(own, found[oscillator.mass.segment])
    return wrench.T


def center_of_mass(skeleton: Skeleton, q: Array) -> Array:
    """Give the centre of mass at coordinates (55, T), (T, 3) [m]."""
    center = np.zeros((3, q.shape[1]))
    for chunk in chunks(q.shape[1]):
        found = frames(skeleton, (q[:, chunk],))
        for name, part in skeleton.inertias.items():
            center[:, chunk] += part.mass * found[name].point(part.center)
    return center.T / skeleton.mass


def second_moment(part: Inertia) -> Array:
    """Give ``∫ x xᵀ dm`` of a segment about its frame's origin, (3, 3) [kg·m²]."""
    about_center = np.trace(part.tensor) / 2 * np.eye(3) - part.tensor
    return np.asarray(about_center + part.mass * np.outer(part.center, part.center))


def add_force(wrench: Array, force: Array, place: Array) -> None:
    """Add a force (3, T) [N] that acts at a place (3, T) [m] to a wrench (6, T)."""
    wrench[:3] += force
    wrench[3:] += np.cross(place, force, axis=0)


def add_segment(wrench: Array, frame: Frame, part: Inertia, moment: Array) -> None:
    """Add what a segment with a `second_moment` needs to a wrench (6, T) about the lab origin."""
    rotation, _, second = frame.rotation
    first = part.mass * part.center
    arm, inertial = first @ rotation, first @ second
    upward = frame.acceleration.copy()
    upward[2] += GRAVITY_MPS2
    add_force(wrench, part.mass * upward + inertial, frame.origin)
    turned = np.asarray(moment @ rotation)
    spin = [
        (turned[j] * second[k]).sum(axis=0) - (turned[k] * second[j]).sum(axis=0)
        for j, k in ((1, 2), (2, 0), (0, 1))
    ]
    wrench[3:] += np.cross(arm, upward, axis=0) + spin


LEG_JOINTS: Final = {
    "toes": (),
    "foot": ("FootPronation",),
    "talus": ("AnklePlantarFlexion",),
    "shank": ("KneeFlexion",),
    "thigh": ("HipFlexion", "HipAbduction", "HipInternalRotation"),
}
"""Segments of a leg from its tip on -> coordinates of the joint that carries each."""
LEG_COORDINATES: Final = tuple(
    side[0].upper() + name for side in SIDES for names in LEG_JOINTS.values() for name in names
)


def moments_of(
    skeleton: Skeleton,
    state: tuple[Array, ...],
    feet: Mapping[str, Array],
    oscillators: Sequence[Oscillator],
) -> Array:
    """Give the moments of `LEG_COORDINATES`, (12, T), in a state (55, T) with feet under (T, 6)."""
    found = frames(skeleton, state, [f"{side}_{part}" for side in SIDES for part in LEG_JOINTS])
    moments = dict[str, Array]()
    for side in SIDES:
        need = -feet[side].T
        for part in LEG_JOINTS:
            segment = f"{side}_{part}"
            if segment in skeleton.inertias:
                inertia = skeleton.inertias[segment]
                add_segment(need, found[segment], inertia, second_moment(inertia))
            for oscillator in oscillators:
                if oscillator.mass.segment == segment:
                    oscillator.add_reaction(need, found[segment])
            # about the axes of the joint's coordinates, each where those before it have turned it
            carrier = found[PARENT[segment]]
            frame = Frame(carrier.rotation[:1], carrier.origin, carrier.acceleration)
            frame = placed(frame, skeleton.offsets.get(segment, np.zeros(3)))
            for link, axis in zip(LINKS, skeleton.axes, strict=True):
                if link.segment == segment:
                    about = need[3:] - np.cross(frame.origin, need[:3], axis=0)
                    moments[link.name] = np.sum((axis @ frame.rotation[0]) * about, axis=0)
                    frame = moved(frame, link, axis, (state[0][COLUMN[link.name]],))
    return np.stack([moments[name] for name in LEG_COORDINATES])
