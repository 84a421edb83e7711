"""What motion and feet say of the load on the plates: the evidence by which plates are judged."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy

from hbm.body import BALL_ABOVE_SOLE, Body
from hbm.motion import Motion
from hbm.numbers import read_numbers
from hbm.plausibility.motion import unseen_covariance
from hbm.signals.filtering import low_pass
from hbm.signals.samples import median_of, stretches
from hbm.spatial import GRAVITY_MPS2, Array, Indices, Mask, shift_wrench
from pipeline.config.schema import Settings
from pipeline.io.recording import Plate
from pipeline.trial.gait.contact import FEET

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "evidence")


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What motion and feet say about the load of the plates, at T frames.

    Attributes
    ----------
    plates
        Where they are, P of them.
    time
        (T,) [s].
    wrenches
        Of each plate through the filter of the motion, without what it reads when nobody is on it,
        lab axes about the lab origin, (P, T, 6) [N, N·m].
    load
        Vertical force of each plate, unfiltered, (P, T) [N].
    needed
        Wrench that the motion needs, lab axes about the pelvis origin, (T, 6).
    pelvis
        Where that is, (T, 3) [m].
    carried
        Frames in which the plates carry the subject and motion and forces are known, (T,).
    ankle, ball
        Of the left and the right foot, (T, 2, 3) [m].
    foot_m
        Length of the left and the right foot, (2,).
    weight_n
        Body weight.
    covariance
        Of the residual of a healthy person, lab axes about the pelvis, with what unseen segments
        add, (6, 6).
    """

    plates: tuple[Plate, ...]
    time: Array
    wrenches: Array
    load: Array
    needed: Array
    pelvis: Array
    carried: Mask
    ankle: Array
    ball: Array
    foot_m: Array
    weight_n: float
    covariance: Array

    @classmethod
    def of(
        cls,
        body: Body,
        motion: Motion,
        places: Array,
        plates: Sequence[Plate],
        wrenches: Sequence[Array],
        unloaded: Sequence[Array | None],
        residual: Array,
        carried: Mask,
        settings: Settings,
    ) -> "Evidence":
        """Collect it from the stages of a trial: the motion is filtered, the places are not."""
        time, pelvis, unfiltered = motion.time, motion.q[:, :3], np.stack([*wrenches], axis=1)
        weight_n = body.mass * GRAVITY_MPS2
        filtered = low_pass(unfiltered, time, settings.cutoff_hz, settings.filter).swapaxes(0, 1)
        # the residual is what the motion needs beyond the plates
        needed = residual + shift_wrench(filtered.sum(axis=0), pelvis)
        judged = carried & np.isfinite(needed).all(axis=1)
        # what plates read without load is judged by itself
        for plate, zero, wrench in zip(plates, unloaded, filtered, strict=True):
            if zero is not None:
                wrench -= shift_wrench(zero, -plate.center)
        # forces grow with body weight, moments with body weight × stature
        deviation = weight_n * LIMITS.healthy_spread * np.repeat([1.0, body.height_m], 3)
        return cls(
            plates=tuple(plates),
            time=time,
            wrenches=filtered,
            load=unfiltered[..., 2].T,
            needed=needed,
            pelvis=pelvis,
            carried=judged,
            ankle=places[:, 1:3],
            ball=places[:, 3:],
            foot_m=np.array([body.lengths[foot] for foot in FEET]),
            weight_n=weight_n,
            covariance=np.diag(deviation**2) + unseen_covariance(body, motion, carried),
        )

    @property
    def walking(self) -> Mask:
        """Frames around which a foot moves, (T,): who stands has the same error in all frames."""
        # the faster ankle, since one foot stands in walking
        speed = np.linalg.norm(np.gradient(self.ankle, self.time, axis=0), axis=-1).max(axis=1)
        # double support belongs to walking: frames beside those in which a foot moves
        around = 2 * round(LIMITS.shortest_standing / self.step_s) + 1
        moves = np.nan_to_num(speed) > LIMITS.foot_speed
        return np.asarray(scipy.ndimage.maximum_filter1d(moves.astype(float), around) > 0)

    @property
    def step_s(self) -> float:
        """From frame to frame."""
        return median_of(np.diff(self.time))

    def loaded_s(self, number: int) -> float:
        """How long a plate carries while the motion is known [s]."""
        carries = np.abs(self.wrenches[number, :, 2]) > LIMITS.loaded * self.weight_n
        return float(np.count_nonzero(carries & self.carried)) * self.step_s


class Stance(NamedTuple):
    """A single foot on a plate, in the middle half of the contact.

    Attributes
    ----------
    plate
        Index of the plate.
    foot
        0 left, 1 right.
    rows
        Numbers of its frames, (F,).
    along, left
        Directions of the foot in the lab, horizontal, (F, 3).
    expected
        Where its pressure usually is, (F, 3) [m].
    """

    plate: int
    foot: int
    rows: Indices
    along: Array
    left: Array
    expected: Array

    def some(self, of: Indices) -> "Stance":
        """Give the stance in some of its frames."""
        return self._replace(
            rows=self.rows[of],
            along=self.along[of],
            left=self.left[of],
            expected=self.expected[of],
        )


def find_stances(evidence: Evidence) -> Iterator[Stance]:
    """Find single feet on plates; which foot stands, its motion says, not the pressure."""
    time = evidence.time
    velocity = np.gradient(evidence.ball, time, axis=0)
    for plate, load in enumerate(np.abs(evidence.load)):
        # each contact of a plate, of either sign: a plate may measure the other way round
        for start, stop in stretches(load > LIMITS.loaded * evidence.weight_n):
            lasts_s = time[stop - 1] - time[start]
            # contacts that the recording cuts, and people who stand, tell no usual pressure
            if (
                start == 0
                or stop == len(time)
                or not LIMITS.shortest_stance < lasts_s < LIMITS.longest_stance
            ):
                continue
            # the middle half, in which the whole foot is down
            quarter = (stop - start) // 4
            frames = slice(start + quarter, stop - quarter)
            spread = velocity[frames].std(axis=0).sum(axis=-1)
            foot = int(np.argmin(spread))
            # one foot has to be at rest and the other one to swing
            if not (spread[foot] < LIMITS.standing_spread < spread[1 - foot]):
                continue
            ankle, ball = evidence.ankle[frames, foot], evidence.ball[frames, foot]
            # horizontal unit vectors from ankle to ball, and to the left of it
            along = (ball - ankle) * [1.0, 1.0, 0.0]
            along /= np.linalg.norm(along, axis=1)[:, None]
            left = np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(along))])
            length = evidence.foot_m[foot]
            # on the line from ankle to ball, at the height of the sole
            expected = ankle + LIMITS.pressure_along * length * along
            expected[:, 2] = ball[:, 2] - BALL_ABOVE_SOLE * length
            yield Stance(plate, foot, np.arange(len(time))[frames], along, left, expected)


def pressure(wrench: Array, level: Array) -> Array:
    """Give the centre of pressure at a height, (F,) [m], of wrenches in the lab, (…, F, 3) [m]."""
    fx, fy, fz, mx, my, _ = np.moveaxis(wrench, -1, 0)
    # where the moment about both horizontal axes is zero, at this height
    across = (level * fx - my) / fz, (level * fy + mx) / fz
    return np.stack([*across, np.broadcast_to(level, fz.shape)], axis=-1)


def weight_of_steps(evidence: Evidence) -> float | None:
    """Give the body mass by the steps that the plates carry [kg]; None without any.

    What plates read without load does not count.

    The mean vertical force is m (g + Δv/Δt) of the centre of mass over any stretch, Δv from the
    markers; over whole gait cycles Δv is zero.
    """
    # vertical force of all plates, and that of the motion with the assumed mass
    load, need = evidence.wrenches[..., 2].sum(axis=0), evidence.needed[:, 2]
    weighing = np.zeros(len(load), bool)
    for start, stop in stretches(evidence.carried):
        weighing[start:stop] = (
            evidence.time[stop - 1] - evidence.time[start] >= LIMITS.shortest_weighing
        )
    if not weighing.any():
        return None
    load, need = load[weighing], need[weighing]
    # the motion needs forces in proportion to the mass
    factor = float(load.sum() / need.sum())
    apart = float(np.sqrt(np.mean(np.square(load - factor * need))) / load.mean())
    return None if apart > LIMITS.largest_difference else factor * evidence.weight_n / GRAVITY_MPS2
