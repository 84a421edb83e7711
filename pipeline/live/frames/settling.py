"""Which frames count: pose known, legs and pelvis shown, filters settled."""

from collections.abc import Sequence

import numpy as np

from hbm.coordinates import LIMBS, TREE
from hbm.ik.frame_tracking import FrameSolution
from hbm.model import Body
from hbm.spatial import Mask
from pipeline.trial.motion_check import LEGS, MAX_UNSEEN_PELVIS_S
from pipeline.trial.quality import Quality


class LiveValidity:
    """What was unknown when, frame by frame.

    Parameters
    ----------
    body
        The subject.
    markers
        Names of the markers that are solved from, (K,).
    settling_s
        How long the filters need after a gap [s].
    longest_s
        Longest step between frames that is no gap for the filters [s].
    """

    def __init__(
        self, body: Body, markers: Sequence[str], settling_s: float, longest_s: float
    ) -> None:
        segment_of = body.segment_of
        self.of_pelvis = np.array([segment_of[name] == "pelvis" for name in markers])
        parts = {part for leg in LEGS for part in LIMBS[leg]}
        self.of_legs = np.array([c.segment in parts for c in TREE])
        self.shown: Mask = np.zeros(len(TREE), bool)
        self.settling_s, self.longest_s = settling_s, longest_s
        self.time = -np.inf
        self.known_since: float | None = None
        self.pelvis_seen_s = -np.inf

    def of_pose(self, time: float, solution: FrameSolution) -> Quality:
        """Say what markers do not show in a frame."""
        if not solution.converged:
            return Quality.POSE_UNKNOWN
        found = Quality(0)
        self.shown |= solution.observed
        pelvis = bool(np.isfinite(solution.marker_error[self.of_pelvis]).any())
        if (self.shown & ~solution.observed & self.of_legs).any() or not pelvis:
            found |= Quality.LIMB_UNSEEN
        if pelvis:
            self.pelvis_seen_s = time
        elif time - self.pelvis_seen_s >= MAX_UNSEEN_PELVIS_S:
            found |= Quality.POSE_UNKNOWN
        return found

    def settled(self, time: float, gap: bool) -> bool:
        """Whether the filters have settled in a frame, which is a gap of pose or forces or none."""
        since_s, self.time = time - self.time, time
        if gap:
            self.known_since = None
            return False
        if self.known_since is None or since_s > self.longest_s:
            self.known_since = time
        return time - self.known_since >= self.settling_s
