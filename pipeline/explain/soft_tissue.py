"""What soft tissue does to a trial: masses that move against the bones, unseen by markers.

Part of a segment's mass hangs on springs and dampers from its bone, whose acceleration drives it:
an oscillator in axes of the lab. The plates feel its force. The oscillators are linear, and filters
too: those that the filtered motion drives give the filtered force.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.coordinates import FIXED_TO, MOVING
from hbm.poses import segment_frames
from hbm.segments import NO_INERTIA, Inertia
from hbm.signals.samples import mean_rate_hz
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.explain.cause import Cause
from pipeline.explain.priors import priors
from pipeline.explain.processing_chain import ProcessingChain, needed_wrench


@dataclass(frozen=True, slots=True)
class Tissue:
    """Soft tissue of a segment.

    Attributes
    ----------
    share
        Its mass, of that of the segment [1].
    frequency_hz, damping
        Natural frequency and damping ratio of its oscillation.
    """

    share: float
    frequency_hz: float
    damping: float


TRUNK: Final = Tissue(share=0.5, frequency_hz=4.5, damping=0.5)
THIGH: Final = Tissue(share=0.6, frequency_hz=9.0, damping=0.5)
SHANK: Final = Tissue(share=0.6, frequency_hz=12.0, damping=0.5)
TISSUES: Final[Mapping[str, Mapping[str, Tissue]]] = {
    "trunk": {"pelvis": TRUNK, "mid_trunk": TRUNK, "thorax": TRUNK},
    "legs": {
        "right_thigh": THIGH,
        "left_thigh": THIGH,
        "right_shank": SHANK,
        "left_shank": SHANK,
    },
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
        Of trunk and legs, vertically and horizontally: that soft tissue moves, as a multiple of
        published motion, which is therefore about one and not zero; and that it is damped more, as
        a share of published damping, which makes its force later.
    """
    known = priors()
    for part, tissues in TISSUES.items():
        masses = [_carried(chain, segment, tissue) for segment, tissue in tissues.items()]
        for direction, along in DIRECTIONS.items():
            moves, more, less = (
                np.sum([each.wrench(along, damping) for each in masses], axis=0)
                for damping in (1.0, 1 + STEP, 1 - STEP)
            )
            name = f"soft tissue of {part}: {direction}"
            changes = {"motion": moves, "damping": (more - less) / (2 * STEP)}
            for kind, wrench in changes.items():
                change = partial(_with_wrench, wrench=wrench)
                yield Cause(f"{name} {kind}", "soft_tissue", known[f"tissue_{kind}"], change)


def _with_wrench(chain: ProcessingChain, size: float, *, wrench: Array) -> ProcessingChain:
    return chain.with_ground(chain.ground + size * wrench)


@dataclass(frozen=True, slots=True, eq=False)
class WobblingMass:
    """A mass on springs and dampers, carried along.

    Attributes
    ----------
    mass_kg, frequency_hz, damping
        Its own.
    time
        (T,) [s].
    place
        Where it would be without springs, (T, 3) [m].
    pull
        Its acceleration there less that of gravity, (T, 3) [m/s²].
    """

    mass_kg: float
    frequency_hz: float
    damping: float
    time: Array
    place: Array
    pull: Array

    def wrench(self, along: Array, damping: float = 1.0) -> Array:
        """Give what it adds to the wrench on the ground by moving, (T, 6) [N, N·m].

        Parameters
        ----------
        along
            Projection on the directions in which it can move, (3, 3).
        damping
            Multiple of its damping ratio.

        Returns
        -------
        Array
            Lab axes about the lab origin.

        Notes
        -----
        ``d̈ + 2 ζ ω ḋ + ω² d = -a``, from rest, solved exactly for an acceleration that is linear
        between samples. It adds ``m d̈``, and what it needs acts ``d`` beside its place.
        """
        drive = -(self.pull - [0, 0, GRAVITY_MPS2]) @ along
        frames = np.arange(len(drive))
        for column in drive.T:
            seen = np.isfinite(column)
            column[:] = np.interp(frames, frames[seen], column[seen])
        drive -= drive[0]
        omega = 2 * np.pi * self.frequency_hz
        loss = 2 * damping * self.damping * omega
        system, step = [1.0, loss, omega**2], 1 / mean_rate_hz(self.time)
        shift, speed = (
            lfilter(np.ravel(up), down, drive, axis=0)
            for up, down, _ in (
                cont2discrete((numerator, system), step, method="foh")
                for numerator in ([1.0], [1.0, 0.0])
            )
        )
        force = drive - loss * speed - omega**2 * shift
        moment = np.cross(self.place, force) + np.cross(shift, self.pull + force)
        return self.mass_kg * np.hstack([force, moment])


def _carried(chain: ProcessingChain, segment: str, tissue: Tissue) -> WobblingMass:
    """Put soft tissue at the centre of mass of its segment."""
    own = chain.body.segments[segment]
    k = MOVING.index(FIXED_TO.get(segment, segment))
    rotation, origin = segment_frames(chain.body, chain.motion.value)
    unit = Inertia(1.0, own.center, np.zeros((3, 3)))
    only = {name: unit if name == segment else NO_INERTIA for name in chain.body.segments}
    needed = needed_wrench(replace(chain.body, segments=only), chain.motion)
    return WobblingMass(
        mass_kg=tissue.share * own.mass,
        frequency_hz=tissue.frequency_hz,
        damping=tissue.damping,
        time=chain.time,
        place=origin[:, k] + rotation[:, k] @ own.center,
        pull=needed[:, :3],
    )
