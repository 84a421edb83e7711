"""Whether the plates carry the subject, frame by frame: only then is the residual meaningful.

A foot is on the ground while its ankle or its tip moves with it. Its outline has to lie within
those of the plates, and one that is loaded has to be under it wherever the plates measure less than
the motion needs, m(g + a) of the centre of mass.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from compensation import center_of_pressure
from hbm.body import BALL_ABOVE_SOLE, Body
from hbm.numbers import read_numbers
from hbm.poses import joint_positions
from hbm.signals.samples import stretches
from hbm.spatial import GRAVITY_MPS2, Array, Indices, Mask, transform_wrench
from pipeline.config.schema import Settings
from pipeline.trial.gait.events import SIDES

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "carried")

HEEL, TIP, HALF_WIDTH = -0.23, 0.77, 0.19
"""Of a foot by its length: places of heel and tip from the ankle, half its width at the ball."""
OUTLINE: Final = np.array(
    [[1, 0, 0, HEEL, 0], [0, 0, 1, 0, 0], [0, 1, 0, 0, 1], [0, 1, 0, 0, -1], [0.5, 0.5, 0, 0, 0]]
)
"""Heel, tip, both sides of the ball and middle, from ankle, ball, tip, along and across."""
HEIGHTS: Final = np.array([0.3, BALL_ABOVE_SOLE, 0.0])
"""Of ankle, ball and tip above the sole, by the length of the foot."""
ACROSS, LEVEL = HALF_WIDTH * np.array([-1.0, 1.0]), np.array([1.0, 1.0, 0.0])
LEFT_AND_RIGHT: Final = np.arange(2)
"""Numbers of the feet."""
ROUNDING_S: Final = 1e-6
"""Of times."""
PLACES: Final = ("pelvis", *(f"{side}_{part}" for part in ("foot", "toes") for side in SIDES))
"""Segments at whose proximal joints pelvis, ankles and balls are."""


def places_of(body: Body, q: Array) -> Array:
    """Give pelvis, ankles and balls, left before right, coordinates (T, 46) to (T, 5, 3) [m]."""
    return joint_positions(body, q, PLACES)


PlatformFrames = tuple[Array, Array] | None
"""Rotation, (T, 3, 3), and position, (T, 3) [m], of a platform; None where it stands still."""


class Feet(NamedTuple):
    """Where both feet are and how they move, in the axes of the platform.

    Attributes
    ----------
    time
        (T,) [s].
    velocity
        Of pelvis, ankles, balls and tips, (T, 7, 3) [m/s].
    sole
        Height of each sole, (T, 2) [m].
    depth
        How far heel, tip, both sides of the ball and the middle are within each plate, (T, 2, 5, P)
        [m]; negative outside, NaN where the plate's place is unknown.
    """

    time: Array
    velocity: Array
    sole: Array
    depth: Array


def plate_edges(corner: Array) -> tuple[Array, Array]:
    """Give the inward normals of the edges of plates, (P, 4, 2), and where these begin, (P, 4) [m].

    A point over a plate, of whose corners (P, 4, 3) are known, is further along all four normals.
    """
    # edges from corner to corner, and their normals, of either sense
    edge = np.roll(corner, -1, axis=1)[..., :2] - corner[..., :2]
    inward = np.stack([-edge[..., 1], edge[..., 0]], axis=-1)
    # the centre of the plate is on the inner side of each edge
    middle = corner[..., :2].mean(axis=1)[:, None]
    inward *= np.sign(np.sum(inward * (middle - corner[..., :2]), axis=-1, keepdims=True))
    # plates without an area have no edges
    size = np.linalg.norm(inward, axis=-1, keepdims=True)
    inward = inward / np.where(size > 0, size, np.nan)
    return inward, np.sum(inward * corner[..., :2], axis=-1)


class Support:
    """Finds the frames in which plates carry the subject, in one call or frame by frame.

    Parameters
    ----------
    body
        The subject.
    corners
        Of the plates' surfaces with the platform in neutral, (P, 4, 3) [m]; NaN where unknown.
    settings
        Threshold above which a plate is loaded, and the filter, which spreads what is missing into
        other frames. With "realtime" a frame depends on no later one.
    rest_n
        Vertical force that each plate reads without load, (P,) [N].

    Notes
    -----
    Numbers are in thresholds.toml, section carried. A foot is on the ground where its ankle or its
    tip is slower against it than ``standing_speed``. The ground's velocity is that of the ball at
    rest of the foot that carried most, last. The plates do not carry the subject

    1. where heel, tip or a side of the ball of a foot on the ground is outside all plates by more
       than ``overhang``;
    2. where for the time ``lasting`` they measure less than ``lacking`` of the need, while the
       plate under the middle of a foot on the ground is not loaded;
    3. where for that time they measure less than ``least_measured`` of the need;

    and as far as the filter spreads it. A foot above the highest plate by more than ``level``
    hangs in the air; where plates are steps, part of a foot may hang over the edge. The first rule
    says nothing where a loaded plate has no corners, or its centre of pressure is outside them.
    """

    def __init__(
        self, body: Body, corners: Sequence[Array], settings: Settings, rest_n: Array | None = None
    ) -> None:
        corner = np.asarray(corners)
        inward, begins = plate_edges(corner)
        self.begins, self.inward = begins.ravel(), inward.reshape(-1, 2).T
        self.level = corner[..., 2].mean(axis=1)
        self.steps = bool(np.ptp(self.level) > LIMITS.level)
        self.highest = np.max(self.level) + LIMITS.level
        self.length = np.array([body.lengths[f"{side}_foot"] for side in SIDES])[:, None]
        self.heights = HEIGHTS * self.length
        self.weight_n, self.threshold_n = body.mass * GRAVITY_MPS2, settings.contact_threshold_n
        self.rest_n = np.zeros(len(corner)) if rest_n is None else rest_n
        self.method = settings.filter
        self.reach_s = np.array(LIMITS.spread_periods[self.method]) / settings.cutoff_hz
        self.reach_s[1] += LIMITS.lasting
        self.time, self.points = np.full(1, -np.inf), np.full((1, 7, 3), np.nan)
        self.ground: Array = np.full((1, 2, 3), np.nan)
        self.supported_s, self.missing_s = np.full((1, 3), np.inf), np.full(1, -np.inf)

    def feet(self, time: Array, places: Array, pose: PlatformFrames = None) -> Feet:
        """Give where the feet are in the next frames.

        Parameters
        ----------
        time
            (T,) [s].
        places
            Pelvis, ankles and balls in the lab, (T, 5, 3) [m], as `places_of` gives them.
        pose
            Of the platform at these times.
        """
        # in the frame of the platform, in which the plates do not move
        if pose is not None:
            places = (places - pose[1][:, None]) @ pose[0]
        ankle, ball = places[:, 1:3], places[:, 3:]
        # along the foot by its joints, with the length that the foot has in the body
        along = ball - ankle
        # along the foot, level and in space, with its whole length
        size = self.length / np.sqrt(np.cumsum(along * along, axis=2)[..., 1:])
        flat, tip = size[..., :1] * along[..., :2], ankle + TIP * size[..., 1:] * along
        points = np.concatenate([places, tip], axis=1)
        path, times = np.concatenate([self.points, points]), np.concatenate([self.time, time])
        # from the frame before, so that a live frame needs no later one
        velocity = (path[1:] - path[:-1]) / (times[1:] - times[:-1])[:, None, None]
        self.time, self.points = time[-1:], points[-1:]
        heights = points[:, 1:, 2].reshape(-1, 3, 2).transpose(0, 2, 1)
        # the lowest of ankle, ball and tip, each less its height in a foot that is flat
        sole = (heights - self.heights).min(axis=2)
        of_foot = ankle[..., :2], ball[..., :2], tip[..., :2], flat, flat[..., ::-1] * ACROSS
        outline = OUTLINE @ np.array(of_foot).transpose(1, 2, 0, 3)
        return Feet(time, velocity, sole, self._depth(outline))

    def carried(
        self,
        feet: Feet,
        wrenches: Array,
        on: Indices,
        need: Array,
        measured: Array,
        pose: PlatformFrames = None,
    ) -> Mask:
        """Judge the next frames.

        Parameters
        ----------
        feet
            As `feet` gives them.
        wrenches
            Of the plates, lab axes about the lab origin, unfiltered, (T, P, 6) [N, N·m].
        on
            The foot of each plate, 0 left and 1 right, (T, P).
        need, measured
            Vertical force that the motion needs, and that of all plates, filtered, (T,) [N].
        pose
            As for `feet`.
        """
        time, load = feet.time, wrenches[..., 2] - self.rest_n
        # vertical force under each foot, without what plates read at rest
        of_foot = (load[:, None] * (on[:, None] == LEFT_AND_RIGHT[:, None])).sum(axis=2)
        ground = self._ground(feet, of_foot)
        # there is something to carry, and the plates measure less
        lacking = (need > LIMITS.least_need * self.weight_n) & (measured < LIMITS.lacking * need)
        if self.method == "realtime" and not lacking.any() and _within(feet).all():
            self.supported_s = np.full((1, 3), time[-1])  # in a live frame the rest takes long
            return np.asarray(time - self.missing_s > self.reach_s[1] + ROUNDING_S)
        grounded = _grounded(feet, ground)
        outside, idle = self._places(feet, wrenches, of_foot, pose)
        # rule 1: a foot on the ground that is beside the plates
        off_plates = (grounded & outside).any(axis=1)
        # rules 2 and 3: over a plate without load, or carried by something else
        standing = np.column_stack([grounded & idle, measured < LIMITS.least_measured * need])
        doubtful = standing & lacking[:, None]
        # last time at which each of them was not so; the state of the frames before comes first
        ok_s = np.where(doubtful, -np.inf, time[:, None])
        ok_s = np.maximum.accumulate(np.vstack([np.minimum(self.supported_s, time[0]), ok_s]))[1:]
        lasting = doubtful & (time[:, None] - ok_s > LIMITS.lasting + ROUNDING_S)
        missing: Mask = np.asarray(off_plates | lasting.any(axis=1))
        if self.method == "realtime":
            last_s = np.maximum.accumulate(np.where(missing, time, self.missing_s))
            self.supported_s, self.missing_s = ok_s[-1:], last_s[-1:]
            return np.asarray(time - last_s > self.reach_s[1] + ROUNDING_S)
        # afterwards all of a stretch counts as missing, from its first frame on
        for channel, long in zip(standing.T, lasting.T, strict=True):
            for start, stop in stretches(channel):
                missing[start:stop] |= bool(long[start:stop].any())
        return ~widened(missing, time, *self.reach_s)

    def _ground(self, feet: Feet, of_foot: Array) -> Array:
        """Give the velocity of the ground under each foot, (T, 2, 3) [m/s]; NaN where unseen."""
        ball = feet.velocity[:, 3:5]
        # the foot that carries more, while its ball does not rise or sink
        shows = (of_foot > self.threshold_n) & (of_foot >= of_foot[:, ::-1])
        shows &= np.abs(ball[..., 2]) < LIMITS.resting_speed
        # until another frame shows it, the ground keeps its velocity
        last = np.maximum.accumulate(np.where(shows, np.arange(1, len(of_foot) + 1)[:, None], 0))
        velocities = np.concatenate([self.ground, ball * LEVEL])
        ground = velocities[last, LEFT_AND_RIGHT]
        self.ground = ground[-1:]
        return ground

    def _places(
        self, feet: Feet, wrenches: Array, of_foot: Array, pose: PlatformFrames
    ) -> tuple[Mask, Mask]:
        """Find feet that would stand beside the plates, and over none that is loaded, (T, 2).

        A foot over no plate, or over one whose place is unknown, bears the load `of_foot`, (T, 2).
        """
        loaded = wrenches[..., 2] - self.rest_n > self.threshold_n
        if pose is not None:
            # from the lab to the frame of the platform: the inverse of its pose
            back = np.swapaxes(pose[0], -1, -2)
            origin = -(back @ pose[1][..., None])[..., 0]
            wrenches = transform_wrench(wrenches, back[:, None], origin[:, None])
        # plates at about the height of the sole; those of unknown height may be
        near = ~(np.abs(feet.sole[..., None] - self.level) >= LIMITS.level)
        over = (feet.depth[:, :, -1] > 0) & near
        over_loaded, loads = (over & loaded[:, None]).any(axis=2), of_foot > self.threshold_n
        # a foot that should load a plate and does not
        idle = near.any(axis=2) & ~np.where(over.any(axis=2), over_loaded, loads)
        outside = ~_within(feet)
        if self.steps:
            outside &= ~(np.any(feet.depth > -LIMITS.overhang, axis=2) & near).any(axis=2)
        else:
            outside &= feet.sole < self.highest
        surface = np.repeat(feet.sole.min(axis=1), wrenches.shape[1])
        # a loaded plate with its pressure outside has wrong or unknown corners
        pressure = center_of_pressure(wrenches.reshape(-1, 6), self.threshold_n, surface)[:, :2]
        depth = np.diagonal(self._depth(pressure.reshape(*loaded.shape, 2)), axis1=1, axis2=2)
        unknown = (loaded & ~(depth > -LIMITS.overhang)).any(axis=1) | np.isnan(self.level).any()
        return outside & ~unknown[:, None], idle

    def _depth(self, points: Array) -> Array:
        """Give how far points are within each plate's outline, (..., 2) to (..., P) [m]."""
        depth = points @ self.inward - self.begins
        return np.asarray(depth.reshape(*points.shape[:-1], -1, 4).min(axis=-1))


def _within(feet: Feet) -> Mask:
    """Whether the outline of each foot is within those of the plates, (T, 2)."""
    inside = (feet.depth[:, :, :-1] > -LIMITS.overhang).any(axis=3)
    return np.asarray(np.all(inside, axis=2))


def _grounded(feet: Feet, ground: Array) -> Mask:
    """Find which feet are on the ground, (T, 2), whose velocity is (T, 2, 3) [m/s]."""
    velocity = feet.velocity
    # a foot whose ground was never seen stands on that of the other one
    ground = np.nan_to_num(np.where(np.isnan(ground), ground[:, ::-1], ground))
    # walking speed: the pelvis above the ground under each foot
    walking = velocity[:, :1, :2] - ground[..., :2]
    most = np.maximum(LIMITS.standing_speed * np.sqrt((walking**2).sum(axis=2)), LIMITS.least_speed)
    ankle_and_tip = velocity[:, [1, 2, 5, 6]].reshape(-1, 2, 2, 3) - ground[:, None]
    return np.asarray(((ankle_and_tip**2).sum(axis=3) < most[:, None] ** 2).any(axis=1))


def widened(mask: Mask, time: Array, before_s: float, after_s: float) -> Mask:
    """Add to the frames of a mask those within a time before and after them."""
    wide = mask.copy()
    for start, stop in stretches(mask):
        first = np.searchsorted(time, time[start] - before_s)
        wide[first : np.searchsorted(time, time[stop - 1] + after_s, "right")] = True
    return wide
