"""Joint angles, moments and powers over gait cycles.

A moment is the net internal one, the generalised force of a coordinate by body mass: positive in
the direction in which the angle grows, so that moment times angular velocity is the power that the
joint gives to the body. Angles are those of the model's coordinates (`hbm.coordinates`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from hbm.coordinates import INDEX, SIDES
from hbm.numbers import read_numbers
from hbm.spatial import Array
from pipeline.trial.gait.cycles import gait_cycles, normalise
from pipeline.trial.quality import NO_SUPPORT, Quality, frames_within, free_of
from pipeline.trial.residuals import TRIAL_COLUMNS, trial_columns
from pipeline.trial.result import TrialResult

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "joints")


@dataclass(frozen=True, slots=True)
class JointMotion:
    """One direction in which a joint moves.

    Attributes
    ----------
    joint, direction
        Such as "hip" and "flexion"; the angle grows in this direction.
    coordinate
        Of the model, with {} for R or L.
    lateral
        Whether the two sides' gait cycles see it mirrored: of the trunk.
    """

    joint: str
    direction: str
    coordinate: str
    lateral: bool = False

    @property
    def name(self) -> str:
        """Both, as columns are called: "hip_flexion"."""
        return f"{self.joint}_{self.direction}".replace(" ", "_")

    def column(self, side: str) -> tuple[int, float]:
        """Give the number of the coordinate of a side, and the sign that makes it positive."""
        mirrored = self.lateral and side == "left"
        return INDEX[self.coordinate.format(SIDES[side])], -1.0 if mirrored else 1.0


JOINT_MOTIONS: Final = (
    JointMotion("hip", "flexion", "{}HipFlexion"),
    JointMotion("hip", "abduction", "{}HipAbduction"),
    JointMotion("hip", "internal rotation", "{}HipInternalRotation"),
    JointMotion("knee", "flexion", "{}KneeFlexion"),
    JointMotion("ankle", "plantarflexion", "{}AnklePlantarFlexion"),
    JointMotion("ankle", "pronation", "{}FootPronation"),
    JointMotion("trunk", "flexion", "TrunkFlexion"),
    JointMotion("trunk", "ipsilateral bend", "TrunkRightBend", lateral=True),
    JointMotion("trunk", "contralateral rotation", "TrunkLeftTwist", lateral=True),
    JointMotion("shoulder", "flexion", "{}ShoulderFlexion"),
    JointMotion("shoulder", "abduction", "{}ShoulderAbduction"),
    JointMotion("shoulder", "internal rotation", "{}ShoulderInternalRotation"),
    JointMotion("elbow", "flexion", "{}ElbowFlexion"),
)
CURVES: Final = {"angle": "deg", "moment": "N·m/kg", "power": "W/kg"}
"""What is known of each joint motion, and its unit."""


def joint_spans(result: TrialResult) -> dict[str, Array]:
    """Give the gait cycles whose joints are reported: side -> start and stop, (C, 2) [s].

    Those that the condition asks for. Where these are of one side, the cycles of the other side
    are those that begin meanwhile. Without sides that have no gait cycle.
    """
    counted = {s: np.reshape(spans, (-1, 2)) for s, spans in result.cycles.items() if len(spans)}
    if result.unit != "cycle" or not counted:
        return {}
    of_all = np.concatenate([*counted.values()])
    first, last, spans = of_all[:, 0].min(), of_all[:, 1].max(), dict[str, Array]()
    for side in SIDES:
        of_side = counted.get(side)
        if of_side is None:
            # cycles of the side that was not counted, during those of the counted one
            cycles = np.reshape(gait_cycles(result.events, side)[0], (-1, 2))
            of_side = cycles[(cycles[:, 0] >= first) & (cycles[:, 1] <= last)]
        if len(of_side):
            spans[side] = of_side
    return spans


def joint_curves(result: TrialResult) -> dict[str, dict[str, Array]]:
    """Give angles, moments and powers of every gait cycle over 0–100 %.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    dict
        Variant ("measured", "compensated") -> side -> (C, 101, 13, 3), in the order of
        `JOINT_MOTIONS` and `CURVES` [deg, N·m/kg, W/kg], of the cycles of `joint_spans`. NaN where
        the pose is unknown and, of moments and powers, where plates do not carry the subject, it is
        unknown which foot they carry, or filters settle.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> {side: own.shape[1:] for side, own in joint_curves(result)["measured"].items()}
    {'right': (101, 13, 3), 'left': (101, 13, 3)}
    """
    motion, joints = result.motion, {variant: dict[str, Array]() for variant in result.variants}
    # angles need the pose alone, moments and powers the load under the foot too
    posed = free_of(result.quality, Quality.POSE_UNKNOWN | Quality.LIMB_UNSEEN | Quality.SETTLING)
    loaded = posed & free_of(result.quality, NO_SUPPORT)
    for side, spans in joint_spans(result).items():
        columns, signs = map(np.array, zip(*(m.column(side) for m in JOINT_MOTIONS), strict=True))
        # splines need some frames on both sides of a gait cycle: 0.2 s are enough at any rate
        near = np.flatnonzero(frames_within(motion.time, spans + np.array([-0.2, 0.2])))
        place = np.ix_(near, columns)
        table = [np.where(posed[near, None], np.degrees(motion.q[place]) * signs, np.nan)]
        for dynamics in result.variants.values():
            # power is a product of moment and velocity, which change their signs together
            for forces, sign in ((dynamics.tau, signs), (dynamics.power, 1.0)):
                by_mass = forces[place] * sign / result.body.mass
                table.append(np.where(loaded[near, None], by_mass, np.nan))
        # splines through all curves of a side at once
        curves = normalise(motion.time[near], np.stack(table, 1), spans)
        angle, *others = np.moveaxis(curves, 2, 0)
        for variant, moment, power in zip(joints, others[::2], others[1::2], strict=True):
            joints[variant][side] = np.stack([angle, moment, power], axis=3)
    return joints


QUANTITIES: Final = {
    "range of motion": ("angle", "deg"),
    "largest angle": ("angle", "deg"),
    "smallest angle": ("angle", "deg"),
    "largest moment": ("moment", "N·m/kg"),
    "smallest moment": ("moment", "N·m/kg"),
    "largest power": ("power", "W/kg"),
    "smallest power": ("power", "W/kg"),
    "positive work": ("power", "J/kg"),
    "negative work": ("power", "J/kg"),
}
"""What is reported of a joint motion in a gait cycle -> the curve that it is of, and its unit."""
CURVE_COLUMNS: Final = tuple(f"{m.name}_{curve}" for m in JOINT_MOTIONS for curve in CURVES)
"""Of `joint_cycles.parquet`: every joint motion and curve."""
JOINT_COLUMNS: Final = (
    *TRIAL_COLUMNS,
    *("compensated", "side", "joint", "direction", "quantity", "unit"),
    *("value", "sd", "percent", "n_cycles"),
)


def joint_rows(
    result: TrialResult, condition: str, curves: Mapping[str, Mapping[str, Array]]
) -> list[tuple[object, ...]]:
    """Summarise the joints of a trial's gait cycles.

    Parameters
    ----------
    result
        The trial.
    condition
        Name of the condition, for the table.
    curves
        As `joint_curves` gives them.

    Returns
    -------
    list of tuple
        As `joints.csv` holds them (`JOINT_COLUMNS`): subject, condition, recording, session,
        compensated, side, joint, direction, quantity (`QUANTITIES`), unit; value and sd, mean and
        standard deviation over cycles, and the mean percent of the cycle at which a peak is (NaN of
        ranges and work); n_cycles, those in which the quantity is known: of an extreme those
        without unknown instants near that of the mean curve, of work those in
        which unknown instants have little of it.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> rows = joint_rows(result, "level", joint_curves(result))
    >>> [round(row[-4]) for row in rows if {"knee", "range of motion"} <= {*row}]
    [53, 54]
    """
    time_s = {side: np.diff(spans)[:, 0] for side, spans in joint_spans(result).items()}
    return [
        (*trial_columns(result, condition), variant == "compensated", side, *row)
        for variant, of_sides in curves.items()
        for side, of_side in of_sides.items()
        for row in quantities(of_side, time_s[side])
    ]


def quantities(curves: Array, duration_s: Array) -> Iterator[tuple[object, ...]]:
    """Give the rows of a side from the joint on, of curves (C, 101, 13, 3)."""
    of_motions = dict(zip(CURVES, np.transpose(curves, (3, 2, 0, 1)), strict=True))
    extremes = {
        curve: (_largest(of_curve), _largest(-of_curve)) for curve, of_curve in of_motions.items()
    }
    for quantity, (curve, unit) in QUANTITIES.items():
        # the smallest value is that of the curve with the opposite sign
        (largest, percent), (negative, percent_of_smallest) = extremes[curve]
        values = largest
        if quantity.startswith("smallest"):
            values, percent = -negative, percent_of_smallest
        elif not quantity.startswith("largest"):
            percent = np.full(largest.shape, np.nan)
        if quantity == "range of motion":
            values = largest + negative
        elif quantity.endswith("work"):
            # work is the integral of the positive, or of the negative part of power over time
            limit = np.maximum if quantity.startswith("positive") else np.minimum
            values = _mean_power(limit(of_motions[curve], 0)) * duration_s
        for motion, row in zip(JOINT_MOTIONS, _over_cycles(values, percent), strict=True):
            if row[-1]:
                yield motion.joint, motion.direction, quantity, unit, *row


@np.errstate(invalid="ignore", divide="ignore")
def _over_cycles(values: Array, percent: Array) -> Iterator[tuple[float, float, float, int]]:
    """Give mean, SD, mean percent and number of known values of each row, (J, C) each."""
    is_known = np.isfinite(values)
    count = is_known.sum(axis=1)
    mean, at = (np.where(is_known, x, 0.0).sum(axis=1) / count for x in (values, percent))
    squares = np.where(is_known, values - mean[:, None], 0.0) ** 2
    spread = np.sqrt(squares.sum(axis=1) / (count - 1))  # of one value, 0 / 0
    return zip(mean.tolist(), spread.tolist(), at.tolist(), count.tolist(), strict=True)


def _mean_power(power: Array) -> Array:
    """Give the mean over cycles, (J, C), of power (J, C, 101); NaN where too much is unknown."""
    unknown, usual = np.isnan(power), _mean_curve(power)
    # integrals over the cycle: of the whole, of what is unknown in it, of the mean curve
    filled = np.where(unknown, usual, power), np.where(unknown, usual, 0.0)
    mean, missing = scipy.integrate.trapezoid(filled, dx=1 / (power.shape[2] - 1))
    # unknown instants may hold little of the usual work of this joint
    most = LIMITS.largest_unknown_work * np.abs(
        scipy.integrate.trapezoid(usual, dx=1 / (power.shape[2] - 1))
    )
    return np.asarray(np.where(np.abs(missing) <= most, mean, np.nan))


def _largest(curves: Array) -> tuple[Array, Array]:
    """Give the largest value of cycles, (J, C), NaN where it may be hidden, and its percent."""
    unknown, usual = np.isnan(curves), _mean_curve(curves)
    spread = np.ptp(usual, axis=2, keepdims=True)
    # instants at which a cycle may have its extreme, by the mean curve
    near = ~(usual < usual.max(axis=2, keepdims=True) - LIMITS.near_extreme * spread)
    values = np.where(unknown, -np.inf, curves)
    hidden = (near & unknown).any(axis=2)
    largest = np.where(hidden, np.nan, values.max(axis=2))
    return largest, values.argmax(axis=2).astype(float)


def _mean_curve(curves: Array) -> Array:
    """Average what is known of cycles, (J, C, 101) to (J, 1, 101); straight over what none knows.

    NaN where nothing is known.
    """
    is_known = np.isfinite(curves)
    count = is_known.sum(axis=1, keepdims=True)
    total = np.where(is_known, curves, 0.0).sum(axis=1, keepdims=True)
    mean: Array = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    for curve, has_mean in zip(mean[:, 0], count[:, 0] > 0, strict=True):
        if has_mean.any() and not has_mean.all():
            curve[:] = np.interp(np.arange(len(curve)), np.flatnonzero(has_mean), curve[has_mean])
    return mean
