"""What soft tissue does to a trial: masses that move against the bones, unseen by markers.

Part of a segment's mass hangs on springs and dampers from its bone, whose acceleration drives it:
an oscillator in axes of the lab. The plates feel its force. The oscillators are linear, and filters
too: those that the filtered motion drives give the filtered force.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Literal, Self

import numpy as np

from hbm.coordinates import FIXED_TO, MOVING, SIDES
from hbm.poses import segment_frames
from hbm.segments import NO_INERTIA, Inertia
from hbm.signals.filtering import oscillation
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
    "pelvis": {"pelvis": TRUNK},
    "trunk": {"mid_trunk": TRUNK, "thorax": TRUNK},
    "legs": {
        **{f"{side}_thigh": THIGH for side in SIDES},
        **{f"{side}_shank": SHANK for side in SIDES},
    },
}
"""Part of the body -> its segments and their tissue. The masses on springs of Liu and Nigg (2000, J
Biomech 33:219) are 50 of 63 kg of the upper body and 6 of 12 kg of a leg; their springs and dampers
give 3.8 and 8.2 Hz and damping ratios of 0.8 and 1.0. Standing people are in resonance at 5 to 6 Hz
(Matsumoto and Griffin 1998, J Sound Vib 212:85); muscles of the leg vibrate at 10 Hz and more,
shank above thigh, damped the more the more active they are (Wakeling and Nigg 2001, J Appl Physiol
90:412). Of the trunk, the viscera are an eighth of the body's mass at least (9 kg: Minetti and
Belli 1994, J Biomech 27:97). The numbers lie between these; damping below that of the running model
is assumed for walking, as resonances of standing people are seen at all."""

DIRECTIONS: Final = {"vertical": np.diag([0.0, 0.0, 1.0]), "horizontal": np.diag([1.0, 1.0, 0.0])}
STEP: Final = 0.1
"""Of frequency and damping ratio, for differences."""


def soft_tissue_causes(chain: ProcessingChain) -> Iterator[Cause]:
    """Give what soft tissue does to a trial.

    Yields
    ------
    Cause
        Of pelvis, trunk and legs, vertically and horizontally: the mass of soft tissue, as a
        multiple of the published one, which is therefore about one and not zero; and by which share
        its frequency and damping differ from the published ones, to first order.
    """
    known = priors()
    for part, tissues in TISSUES.items():
        masses = [_carried(chain, segment, tissue) for segment, tissue in tissues.items()]
        for direction, along in DIRECTIONS.items():
            wrenches = {"mass": np.sum([each.wrench(along) for each in masses], axis=0)}
            for kind in ("frequency_hz", "damping"):
                more, less = (
                    np.sum([each.times(factor, kind).wrench(along) for each in masses], axis=0)
                    for factor in (1 + STEP, 1 - STEP)
                )
                wrenches[kind.removesuffix("_hz")] = (more - less) / (2 * STEP)
            for kind, wrench in wrenches.items():
                change = partial(_with_wrench, wrench=wrench)
                name = f"soft tissue of {part}: {kind} of {direction} motion"
                yield Cause(name, "soft_tissue", known[f"tissue_{kind}"], change)


def _with_wrench(chain: ProcessingChain, size: float, *, wrench: Array) -> ProcessingChain:
    return chain.with_soft_tissue(size * wrench)


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

    def times(self, factor: float, kind: Literal["frequency_hz", "damping"]) -> Self:
        """Give the same with one of its numbers times a factor."""
        return replace(self, **{kind: factor * getattr(self, kind)})

    def wrench(self, along: Array) -> Array:
        """Give what it adds to the wrench on the ground by moving, (T, 6) [N, N·m].

        Parameters
        ----------
        along
            Projection on the directions in which it can move, (3, 3).

        Returns
        -------
        Array
            Lab axes about the lab origin.

        Notes
        -----
        `hbm.signals.filtering.oscillation` gives ``d``. It adds ``m d̈``, and what it needs acts
        ``d`` beside its place.
        """
        drive = -(self.pull - [0, 0, GRAVITY_MPS2]) @ along
        frames = np.arange(len(drive))
        for column in drive.T:
            seen = np.isfinite(column)
            column[:] = np.interp(frames, frames[seen], column[seen])
        drive -= drive[0]
        shift, force = oscillation(drive, self.time, self.frequency_hz, self.damping)
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
