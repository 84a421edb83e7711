"""Whether the plates carry the subject, frame by frame: only then is the residual meaningful.

Three questions decide it. Which foot is on the ground: its ankle or its tip moves with it. Whether
that foot stands on a plate: its outline lies within those of plates that are loaded. And whether
the plates measure anything near what the motion needs, m(g + a) of the centre of mass.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from compensation import center_of_pressure
from hbm.body import Body
from hbm.poses import joint_positions
from hbm.signals.filtering import Method
from hbm.signals.samples import stretches
from hbm.spatial import GRAVITY_MPS2, Array, Mask, transform_wrench
from pipeline.trial.gait.events import SIDES
from pipeline.trial.gait.pressure import MAX_PRESSURE_DISTANCE_M

MAX_SPEED: Final = 0.8
"""Of an ankle or a tip above the ground that its foot stands on, by the speed of the pelvis above
it: the ankle still moves when the heel lands."""
MIN_SPEED_MPS: Final = 0.3
"""Up to it, a foot stands also where the pelvis does not move: a stumble is faster."""
MAX_RESTING_MPS: Final = 0.1
"""Vertical, of the ball of a foot that carries the subject and shows the speed of the ground."""
MARGIN_M: Final = 0.03
"""By which the outline of a foot may stick out of a plate: half a foot is 5 cm to the side."""
MAX_LEVEL_M: Final = 0.08
"""Between the sole and the surface that it stands on; the next step is twice as high."""
HEEL, TIP, HALF_WIDTH = -0.23, 0.77, 0.19
"""Of a foot by its length: places of heel and tip from the ankle, half its width at the ball."""
HEIGHTS: Final = np.array([0.3, 0.12, 0.0])
"""Of ankle, ball and tip above the sole, by the length of the foot."""
UNLOADED_S: Final = 0.1
"""That a foot may stand on a plate before it loads it, and after: errors of timing."""
ROUNDING_S: Final = 1e-6
"""Of times."""
DRAGS_S: Final = 0.1
"""For which a tip that leaves the ground may still touch it."""
PARTLY_S: Final = 0.3
"""The same of part of a foot, before it rolls there; and where the place of a plate is unknown, in
a double support with the pressure under the other foot."""
MAX_RESTING_SHARE: Final = 0.85
"""Of what the motion needs, measured: from there on, a foot may rest on its plate without load."""
MIN_NEED: Final = 0.3
"""Of body weight: in flight there is nothing to carry."""
MIN_MEASURED: Final = 0.25
"""Of what the motion needs: below, something else carries the subject. No gain or mass errs so."""
SPREAD_PERIODS: Final[Mapping[Method, tuple[float, float]]] = {
    "zero_phase": (0.8, 0.8),
    "realtime": (0.0, 1.0),
}
"""Periods of the cut-off before and after, over which the low-pass brings a force that is not there
into frames where it is: on a treadmill, a missing step leaves 2 N beyond them."""


def places_of(body: Body, q: Array) -> Array:
    """Give pelvis, ankles and balls, left before right, coordinates (T, 46) to (T, 5, 3) [m]."""
    names = ["pelvis", *(f"{side}_{part}" for part in ("foot", "toes") for side in SIDES)]
    return joint_positions(body, q, names)


class Support:
    """Finds the frames in which plates carry the subject, in one call or frame by frame.

    Parameters
    ----------
    body
        The subject.
    corners
        Of the plates' surfaces with the platform in neutral, (P, 4, 3) [m]; NaN where unknown.
    threshold_n
        Vertical force above which a plate is loaded [N].
    cutoff_hz, method
        The filter, which spreads what is missing into other frames. With "realtime" a frame depends
        on no later one.
    at_rest_n
        Vertical force that each plate reads without load, (P,) [N].

    Notes
    -----
    A foot is on the ground where its ankle or its tip is slower than `MAX_SPEED` against it. The
    ground's velocity is that of the ball at rest of the foot that carried most, last. A foot on the
    ground stands beside the plates where its heel, tip, or either side of its ball is outside all
    outlines by more than `MARGIN_M`. It stands on a plate that measures nothing where none of those
    under it is loaded for `UNLOADED_S`, or part of it, more than `MARGIN_M` inside, does for
    `PARTLY_S`. A plate whose centre of pressure is not within its corners, or that has none,
    carries the foot whose middle is within `MAX_PRESSURE_DISTANCE_M`. What is more than
    `MAX_LEVEL_M` above a plate hangs in the air. So does a foot above the highest plate, unless
    plates are steps; from a step, part of a foot may hang over the edge.
    """

    def __init__(
        self,
        body: Body,
        corners: Sequence[Array],
        threshold_n: float,
        cutoff_hz: float,
        method: Method,
        at_rest_n: Array | None = None,
    ) -> None:
        corner = np.asarray(corners)
        edge = np.roll(corner, -1, axis=1)[..., :2] - corner[..., :2]
        inward = np.stack([-edge[..., 1], edge[..., 0]], axis=-1)
        middle = corner[..., :2].mean(axis=1)[:, None]
        inward *= np.sign(np.sum(inward * (middle - corner[..., :2]), axis=-1, keepdims=True))
        size = np.linalg.norm(inward, axis=-1, keepdims=True)
        self.inward = inward / np.where(size > 0, size, np.nan)
        self.begins = np.sum(self.inward * corner[..., :2], axis=-1)
        self.level = corner[..., 2].mean(axis=1)
        self.steps = bool(np.ptp(self.level) > MAX_LEVEL_M)
        highest = np.max(self.level) + MAX_LEVEL_M
        self.highest = np.inf if self.steps or np.isnan(highest) else highest
        self.length = np.array([body.lengths[f"{side}_foot"] for side in SIDES])
        self.weight_n, self.threshold_n = body.mass * GRAVITY_MPS2, threshold_n
        self.at_rest_n = np.zeros(len(corner)) if at_rest_n is None else at_rest_n
        self.method, self.reach_s = method, np.array(SPREAD_PERIODS[method]) / cutoff_hz
        self.reach_s[1] += DRAGS_S
        self.ground: Array = np.full((1, 2, 3), np.nan)
        self.time, self.places = np.full(1, -np.inf), np.full((1, 5, 3), np.nan)
        self.supported_s, self.missing_s = np.full((1, 5), np.inf), np.full(1, -np.inf)

    def carried(
        self,
        time: Array,
        places: Array,
        wrenches: Array,
        on: Array,
        need: Array,
        measured: Array,
        pose: tuple[Array, Array] | None = None,
    ) -> Mask:
        """Judge the next frames.

        Parameters
        ----------
        time
            (T,) [s].
        places
            Pelvis, ankles and balls in the lab, (T, 5, 3) [m], as `places_of` gives them.
        wrenches
            Of the plates, lab axes about the lab origin, unfiltered, (T, P, 6) [N, N·m].
        on
            The foot of each plate, 0 left and 1 right, (T, P).
        need, measured
            Vertical force that the motion needs, and that of all plates, filtered, (T,) [N].
        pose
            Rotation, (T, 3, 3), and position, (T, 3) [m], of the platform; None where it stands
            still.
        """
        if pose is not None:
            back = np.swapaxes(pose[0], -1, -2)
            places = (places - pose[1][:, None]) @ pose[0]
            origin = -(back @ pose[1][..., None])[..., 0]
            wrenches = transform_wrench(wrenches, back[:, None], origin[:, None])
        vertical = wrenches[..., 2] - self.at_rest_n
        loaded = vertical > self.threshold_n
        grounded = self._grounded(time, places, vertical, on)
        beside, idle, partly, allowed_s = self._without_plate(places, wrenches, loaded)
        nothing = (need > MIN_NEED * self.weight_n) & (measured < MIN_MEASURED * need)
        standing = np.column_stack([grounded & idle, grounded & partly, nothing])
        lacking = (measured < MAX_RESTING_SHARE * need)[:, None]
        doubtful = standing & lacking
        ok_s = np.where(doubtful, -np.inf, time[:, None])
        ok_s = np.maximum.accumulate(np.vstack([np.minimum(self.supported_s, time[0]), ok_s]))[1:]
        lasting = doubtful & (time[:, None] - ok_s > allowed_s + ROUNDING_S)
        missing = np.logical_or((grounded & beside).any(axis=1), lasting.any(axis=1))
        if self.method == "realtime":
            last_s = np.where(missing, time, self.missing_s)
            last_s = np.maximum.accumulate(last_s)
            self.supported_s, self.missing_s = ok_s[-1:], last_s[-1:]
            return np.asarray(time - last_s > self.reach_s[1] + ROUNDING_S)
        whole: Mask = np.array(missing, bool)
        for channels in ([0, 2], [1, 3], [4]):
            long = lasting[:, channels].any(axis=1)
            for start, stop in stretches(np.asarray(standing[:, channels].any(axis=1))):
                whole[start:stop] |= bool(long[start:stop].any())
        return ~widened(whole, time, *self.reach_s)

    def _grounded(self, time: Array, places: Array, vertical: Array, on: Array) -> Mask:
        """Find which feet are on the ground, (T, 2)."""
        step_s = np.diff(np.concatenate([self.time, time]))
        velocity = np.diff(np.concatenate([self.places, places]), axis=0) / step_s[:, None, None]
        self.time, self.places = time[-1:], places[-1:]
        load = np.stack([np.sum(vertical * (on == foot), axis=1) for foot in (0, 1)], axis=1)
        ball = velocity[:, 3:]
        shows = (load > self.threshold_n) & (load >= load[:, ::-1])
        shows &= np.abs(ball[..., 2]) < MAX_RESTING_MPS
        last = np.maximum.accumulate(np.where(shows, np.arange(1, len(time) + 1)[:, None], 0))
        known = np.concatenate([self.ground, ball * [1.0, 1.0, 0.0]])
        ground = np.stack([known[last[:, foot], foot] for foot in (0, 1)], axis=1)
        self.ground = ground[-1:]
        ground = np.nan_to_num(np.where(np.isnan(ground), ground[:, ::-1], ground))
        walking = velocity[:, :1, :2] - ground[..., :2]
        speed = np.sqrt(np.sum(walking**2, axis=-1))[:, None]
        ankle = velocity[:, 1:3]
        tip = ankle + (ball - ankle) * self._tip(places)
        above = np.stack([ankle, tip], axis=1) - ground[:, None]
        most = np.maximum(MAX_SPEED * speed, MIN_SPEED_MPS)
        return np.asarray((np.sum(above**2, axis=-1) < most**2).any(axis=1))

    def _without_plate(
        self, places: Array, wrenches: Array, loaded: Mask
    ) -> tuple[Mask, Mask, Mask, Array]:
        """Find feet that would stand beside the plates, on none or in part on none that is loaded.

        (T, 2) each; and for how long that, or plates that measure nothing, may last, (T, 5) [s].
        """
        ankle, ball = places[:, 1:3], places[:, 3:]
        tip = ankle + (ball - ankle) * self._tip(places)
        heights = np.stack([ankle, ball, tip], axis=2)[..., 2]
        sole = (heights - HEIGHTS * self.length[:, None]).min(axis=2)
        depth = self._depth(self._outlines(ankle, ball, tip))
        inside = depth > -MARGIN_M
        touching = inside & (np.abs(sole[..., None] - self.level) < MAX_LEVEL_M)[:, :, None]
        deepest = depth >= np.fmax.reduce(depth, axis=3, keepdims=True)
        carried = (touching & deepest & loaded[:, None, None])[:, :, :3].any(axis=(2, 3))
        partly = touching & (depth > MARGIN_M) & ~loaded[:, None, None]
        partly = partly[:, :, :3].any(axis=(2, 3))
        outside = ~inside.any(axis=3) & (sole < self.highest)[..., None]
        if self.steps:
            outside &= ~touching.any(axis=(2, 3))[..., None]

        flat = wrenches.reshape(-1, 6)
        surface = np.repeat(sole.min(axis=1), wrenches.shape[1])
        pressure = center_of_pressure(flat, self.threshold_n, surface)[:, :2]
        pressure = pressure.reshape(*loaded.shape, 2)
        own = np.diagonal(self._depth(pressure), axis1=1, axis2=2)
        elsewhere = loaded & ~(own > -MARGIN_M)
        apart = pressure[:, None] - ((ankle + ball) / 2)[:, :, None, :2]
        near = np.sum(apart**2, axis=-1) < MAX_PRESSURE_DISTANCE_M**2
        carried |= (near & elsewhere[:, None]).any(axis=2)
        unknown = elsewhere.any(axis=1) | np.isnan(self.level).any()
        allowed_s = np.full((len(places), 5), UNLOADED_S)
        allowed_s[unknown, :2] = allowed_s[:, 2:4] = PARTLY_S
        beside = outside.any(axis=2)
        idle = ~carried & (beside | touching.any(axis=(2, 3)))
        return beside & ~unknown[:, None], idle, partly & ~unknown[:, None], allowed_s

    def _tip(self, places: Array) -> Array:
        """Give how far the tips are from the ankles, by the distance of the balls, (T, 2, 1)."""
        apart = places[:, 3:] - places[:, 1:3]
        return np.asarray((TIP * self.length / np.sqrt(np.sum(apart**2, axis=-1)))[..., None])

    def _outlines(self, ankle: Array, ball: Array, tip: Array) -> Array:
        """Give heel, ball, tip and the sides of the ball of feet, from above, (T, 2, 5, 2) [m]."""
        ankle, ball, tip = ankle[..., :2], ball[..., :2], tip[..., :2]
        along = ball - ankle
        along = along * (self.length / np.sqrt(np.sum(along**2, axis=-1)))[..., None]
        across = HALF_WIDTH * np.stack([-along[..., 1], along[..., 0]], axis=-1)
        return np.stack([ankle + HEEL * along, ball, tip, ball + across, ball - across], axis=2)

    def _depth(self, points: Array) -> Array:
        """Give how far points are within each plate's outline, (..., 2) to (..., P) [m].

        NaN where it is unknown, negative outside.
        """
        depth = points @ self.inward.reshape(-1, 2).T - self.begins.ravel()
        return np.asarray(depth.reshape(*points.shape[:-1], -1, 4).min(axis=-1))


def widened(mask: Mask, time: Array, before_s: float, after_s: float) -> Mask:
    """Add to the frames of a mask those within a time before and after them."""
    wide = mask.copy()
    for start, stop in stretches(mask):
        first = np.searchsorted(time, time[start] - before_s)
        wide[first : np.searchsorted(time, time[stop - 1] + after_s, "right")] = True
    return wide
