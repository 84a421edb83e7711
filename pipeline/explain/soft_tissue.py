"""What a trial shows of soft tissue: masses that move against the bones, which markers do not show.

The mass of a segment moves with its bone but for a part, on springs and dampers, which the bone's
acceleration drives: an oscillator in axes of the lab. The plates carry its force as well.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.coordinates import FIXED_TO, MOVING, SIDES
from hbm.poses import segment_frames
from hbm.segments import NO_INERTIA, Inertia
from hbm.signals.samples import mean_rate_hz
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.explain.cause import Cause
from pipeline.explain.priors import priors
from pipeline.explain.processing_chain import ProcessingChain, needed_wrench


@dataclass(frozen=True, slots=True)
class Tissue:
    """Soft tissue of a part of the body.

    Attributes
    ----------
    segments
        Whose mass it is a share of.
    share
        Of their mass [1].
    frequency_hz, damping
        Natural frequency and damping ratio of its oscillation.
    """

    segments: tuple[str, ...]
    share: float
    frequency_hz: float
    damping: float


TISSUES: Final[Mapping[str, Tissue]] = {
    "trunk": Tissue(("pelvis", "mid_trunk", "thorax"), 0.5, 4.5, 0.5),
    "thighs": Tissue(tuple(f"{side}_thigh" for side in SIDES), 0.6, 9.0, 0.5),
    "shanks": Tissue(tuple(f"{side}_shank" for side in SIDES), 0.6, 12.0, 0.5),
}
"""x"""

DIRECTIONS: Final = {"vertical": np.diag([0.0, 0.0, 1.0]), "horizontal": np.diag([1.0, 1.0, 0.0])}
STEP: Final = 0.1
"""Of the damping ratio, for differences."""


def soft_tissue_causes(chain: ProcessingChain) -> Iterator[Cause]:
    """Give what soft tissue does to a trial.

    Yields
    ------
    Cause
        Per part of the body, vertically and horizontally: that its tissue moves, as a multiple of
        the published motion, whose mean is not zero; and that it is damped more, as a share of the
        published damping, which is what moves its force in time.
    """
    known = priors()
    for part, tissue in TISSUES.items():
        places = [_place(chain, segment) for segment in tissue.segments]
        for direction, along in DIRECTIONS.items():
            moves, more, less = (
                sum(
                    tissue.share * mass * along_wrench(chain.time, place, pull, along, tissue.frequency_hz, damping)
                    for mass, place, pull in places
                )
                for damping in tissue.damping * np.array([1, 1 + STEP, 1 - STEP])
            )
            name = f"soft tissue of {part}, {direction}"
            change = partial(_with_wrench, wrench=moves)
            yield Cause(f"{name}: motion", "soft_tissue", known["tissue_motion"], change)
            change = partial(_with_wrench, wrench=(more - less) / (2 * STEP))
            yield Cause(f"{name}: damping", "soft_tissue", known["tissue_damping"], change)


def _with_wrench(chain: ProcessingChain, size: float, *, wrench: Array) -> ProcessingChain:
    return chain.with_ground(chain.ground + size * wrench)


def _place(chain: ProcessingChain, segment: str) -> tuple[float, Array, Array]:
    """Give a segment's mass, and its centre's place [m] and what a unit mass there needs [N/kg]."""
    own = chain.body.segments[segment]
    k = MOVING.index(FIXED_TO.get(segment, segment))
    rotation, origin = segment_frames(chain.body, chain.motion.value)
    unit = Inertia(1.0, own.center, np.zeros((3, 3)))
    only = {name: unit if name == segment else NO_INERTIA for name in chain.body.segments}
    needed = needed_wrench(replace(chain.body, segments=only), chain.motion)
    return own.mass, origin[:, k] + rotation[:, k] @ own.center, needed[:, :3]


def along_wrench(
    time: Array, place: Array, pull: Array, along: Array, frequency_hz: float, damping: float
) -> Array:
    """Give what a unit mass on springs adds to the wrench on the ground, (T, 6) [N/kg, N·m/kg].

    Parameters
    ----------
    time
        (T,) [s].
    place
        Where it would be without moving, (T, 3) [m].
    pull
        Its acceleration there, and that against gravity, (T, 3) [m/s²].
    along
        Projection on the directions in which it moves, (3, 3).
    frequency_hz, damping
        Natural frequency and damping ratio.

    Returns
    -------
    Array
        Lab axes about the lab origin.

    Notes
    -----
    ``d̈ + 2 ζ ω ḋ + ω² d = -a``: solved exactly for an acceleration that is linear between samples,
    from rest. The force is ``d̈`` at the place; and what the mass needs acts ``d`` beside it.
    """
    drive = -(pull - [0, 0, GRAVITY_MPS2]) @ along
    frames = np.arange(len(time))
    for column in drive.T:
        seen = np.isfinite(column)
        column[:] = np.interp(frames, frames[seen], column[seen])
    drive = drive - drive[0]
    omega = 2 * np.pi * frequency_hz
    denominator = [1.0, 2 * damping * omega, omega**2]
    shift, speed = (
        lfilter(np.ravel(up), down, drive, axis=0)
        for up, down, _ in (
            cont2discrete((numerator, denominator), 1 / mean_rate_hz(time), method="foh")
            for numerator in ([1.0], [1.0, 0.0])
        )
    )
    force = drive - 2 * damping * omega * speed - omega**2 * shift
    return np.hstack([force, np.cross(place, force) + np.cross(shift, pull + force)])
