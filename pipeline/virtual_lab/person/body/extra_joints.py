"""Motion in joints that the Human Body Model does not have: mid trunk and knee."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, INDEX, N_Q
from hbm.spatial import Array
from pipeline.virtual_lab.faults import BodyFaults
from pipeline.virtual_lab.person.body.skeleton import COLUMN, EXTRA, KNEE
from pipeline.virtual_lab.person.body.variation import drawn

TRUNK: Final = tuple(INDEX[n] for n in ("TrunkFlexion", "TrunkRightBend", "TrunkLeftTwist"))
SPINE_SHARE: Final = 0.42, 0.44, 0.47
"""Share of the mid trunk's joint in the trunk's flexion, bending and twist: its range in walking by
that of it and the lumbar spine, 2.5 of 6.0, 7 of 16 and 4 of 8.5 degrees (Crosbie, Vachalathiti and
Smith 1997, Gait Posture 5:6, recalled)."""
SPINE_SHARE_SD: Final = 0.15
"""Its standard deviation between people; assumed."""
SPINE_WAVE_DEG: Final = 0.8, 1.5, 1.0
"""Amplitude of motion in the mid trunk's joint that the lumbar joint takes back, so that the thorax
is shifted but not turned; assumed, about a quarter of the published ranges."""
SPINE_HARMONIC: Final = 2, 1, 1
"""Its cycles per gait cycle: as the spine's flexion, bending and twist in walking."""
KNEE_AMPLITUDE: Final = (0.0075, np.radians(-2.7), np.radians(8.0))
"""Anterior translation, adduction and internal rotation of a flexed shank [m, rad], with which the
ranges over a stance phase of 5 to 22° are 3.3 mm, 1.2° and 3.5° (published: 3.4 ± 1.6 mm,
2.3 ± 0.6° and 3.6 ± 1.1°; Kefala et al. 2017, Med Sci Sports Exerc 49:2260)."""
KNEE_SCATTER: Final = 0.35
"""Standard deviation between people by those amplitudes: about that of the published ranges."""
KNEE_FLEXION_RAD: Final = np.radians(25.0)
"""Flexion after which the coupled motion has reached 63 % of its amplitude; assumed: most of it is
in the first 30 to 40 degrees (Walker et al. 1988, J Biomech 21:965)."""


@dataclass(frozen=True, slots=True)
class ExtraJoints:
    """How a person moves in the joints that the Human Body Model does not have.

    Attributes
    ----------
    spine_share
        Share of the mid trunk's joint in the trunk's three angles, (3,).
    spine_wave, spine_phase
        Amplitude [rad] and phase [rad] of its own motion, (3,) each.
    knee
        Side's letter -> translation [m] and rotations [rad] that full flexion approaches, (3,).
    t_pose
        Coordinates in which all extra joints are at zero, (46,).
    """

    spine_share: Array
    spine_wave: Array
    spine_phase: Array
    knee: Mapping[str, Array]
    t_pose: Array

    def of_knee(self, letter: str, flexion: Array) -> Array:
        """Give a knee's translation and rotations at flexion angles (T,) [rad], (3, T)."""
        straight = self.t_pose[INDEX[letter + "KneeFlexion"]]
        bent = np.exp(-straight / KNEE_FLEXION_RAD) - np.exp(-flexion / KNEE_FLEXION_RAD)
        return np.outer(self.knee[letter], bent)

    def extend(self, q: Array, phase: Array, walking: Array) -> Array:
        """Add the extra coordinates.

        Parameters
        ----------
        q
            The coordinates of the Human Body Model, the trunk's as angles between pelvis and
            thorax, (46, T) [rad and m].
        phase
            Of the right gait cycle, (T,).
        walking
            From standing (0) to walking (1), (T,).

        Returns
        -------
        Array
            (55, T); the trunk's coordinates are those of the lumbar joint.
        """
        full = np.zeros((len(COORDINATES) + len(EXTRA), q.shape[1]))
        full[:N_Q] = q
        for k, (i, harmonic) in enumerate(zip(TRUNK, SPINE_HARMONIC, strict=True)):
            own = self.spine_share[k] * (q[i] - self.t_pose[i])
            if self.spine_wave[k] != 0:
                angle = 2 * np.pi * harmonic * phase + self.spine_phase[k]
                own += self.spine_wave[k] * walking * np.cos(angle)
            full[N_Q + k] = own
            full[i] -= own
        for letter in self.knee:
            first = COLUMN[letter + KNEE[0]]
            flexion = q[INDEX[letter + "KneeFlexion"]]
            full[first : first + len(KNEE)] = self.of_knee(letter, flexion)
        return full


def draw_extra_joints(faults: BodyFaults, t_pose: Array, rng: np.random.Generator) -> ExtraJoints:
    """Draw a person's motion in the extra joints; none with ``same_body``."""
    spine, knee = (0.0, 0.0) if faults.same_body else (faults.spine_scale, faults.knee_scale)
    share = np.array(SPINE_SHARE) * (1 + SPINE_SHARE_SD * drawn(rng, 3))
    wave = np.radians(SPINE_WAVE_DEG) * (1 + SPINE_SHARE_SD * drawn(rng, 3))
    phase = rng.uniform(0, 2 * np.pi, 3)
    knees = {
        letter: knee * np.array(KNEE_AMPLITUDE) * (1 + KNEE_SCATTER * drawn(rng, 3))
        for letter in "RL"
    }
    return ExtraJoints(spine * share, spine * wave, phase, knees, t_pose)
