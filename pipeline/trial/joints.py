"""Joint angles, moments and powers over gait cycles.

A moment is the net internal one, the generalised force of a coordinate by body mass: positive in
the direction in which the angle grows, so that moment times angular velocity is the power that the
joint gives to the body. Angles are those of the model's coordinates (`hbm.coordinates`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd

from hbm.coordinates import INDEX, SIDES
from hbm.spatial import Array
from pipeline.trial.gait.cycles import gait_cycles, normalise
from pipeline.trial.quality import NO_SUPPORT, Quality, free_of
from pipeline.trial.residuals import with_name
from pipeline.trial.result import TrialResult


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
JOULES: Final = "J/kg"
MIN_KNOWN: Final = 0.8
"""Of a gait cycle that is summarised: where a stumble makes it uncertain whose foot is on a plate,
moments of some instants are unknown."""


def joint_spans(result: TrialResult) -> dict[str, Array]:
    """Give the gait cycles whose joints are reported: side -> start and stop, (C, 2) [s].

    Those that the condition asks for. Where these are of one side, the cycles of the other side
    are those that begin meanwhile. Empty where no gait cycles count.
    """
    counted = {side: np.reshape(own, (-1, 2)) for side, own in result.cycles.items() if len(own)}
    if result.unit != "cycle" or not counted:
        return {}
    every = np.concatenate([*counted.values()])
    first, last, spans = every[:, 0].min(), every[:, 1].max(), dict[str, Array]()
    for side in SIDES:
        own = counted.get(side)
        if own is None:
            found = np.reshape(gait_cycles(result.events, side)[0], (-1, 2))
            own = found[(found[:, 0] >= first) & (found[:, 1] <= last)]
        spans[side] = own
    return spans


def joint_curves(result: TrialResult, variant: str) -> dict[str, Array]:
    """Give angles, moments and powers of every gait cycle over 0–100 %.

    Parameters
    ----------
    result
        The trial.
    variant
        "measured" or "compensated": of moments and powers.

    Returns
    -------
    dict[str, Array]
        Side -> (C, 101, 13, 3), in the order of `JOINT_MOTIONS` and `CURVES` [deg, N·m/kg, W/kg],
        of the cycles of `joint_spans`. NaN where the pose is unknown and, of moments and powers,
        where plates do not carry the subject, it is unknown which foot they carry, or filters
        settle.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> {side: curves.shape[1:] for side, curves in joint_curves(result, "measured").items()}
    {'right': (101, 13, 3), 'left': (101, 13, 3)}
    """
    dynamics, motion = result.variants[variant], result.motion
    posed = free_of(result.quality, Quality.POSE_UNKNOWN | Quality.LIMB_UNSEEN | Quality.SETTLING)
    loaded = free_of(result.quality, NO_SUPPORT)
    angle = np.where(posed[:, None], np.degrees(motion.q), np.nan)
    forces = [
        np.where((posed & loaded)[:, None], values / result.body.mass, np.nan)
        for values in (dynamics.tau, dynamics.power)
    ]
    found = {}
    for side, spans in joint_spans(result).items():
        columns, signs = map(np.array, zip(*(m.column(side) for m in JOINT_MOTIONS), strict=True))
        moments, powers = (values[:, columns] for values in forces)
        of_each = (angle[:, columns] * signs, moments * signs, powers)
        curves = [normalise(motion.time, values, spans) for values in of_each]
        found[side] = np.stack(curves, axis=3)
    return found


QUANTITIES: Final = {
    "range of motion": ("angle", "deg"),
    "largest angle": ("angle", "deg"),
    "smallest angle": ("angle", "deg"),
    "largest moment": ("moment", "N·m/kg"),
    "smallest moment": ("moment", "N·m/kg"),
    "largest power": ("power", "W/kg"),
    "smallest power": ("power", "W/kg"),
    "positive work": ("power", JOULES),
    "negative work": ("power", JOULES),
}
"""What is reported of a joint motion in a gait cycle -> the curve that it is of, and its unit."""
CYCLE_COLUMNS: Final = (
    *("compensated", "side", "cycle", "percent"),
    *(f"{motion.name}_{curve}" for motion in JOINT_MOTIONS for curve in CURVES),
)
COLUMNS: Final = (
    *("compensated", "side", "joint", "direction", "quantity", "unit"),
    *("value", "sd", "percent", "n_cycles"),
)


def joint_tables(result: TrialResult, condition: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Lay out the joints of a trial's gait cycles.

    Parameters
    ----------
    result
        The trial.
    condition
        Name of the condition, for the tables.

    Returns
    -------
    summary
        As `joints.csv` holds it: subject, condition, recording, session, compensated, side, joint,
        direction, quantity (`QUANTITIES`), unit; value and sd, mean and standard deviation over
        cycles, and the mean percent of the cycle at which a peak is (NaN of ranges and work);
        n_cycles, the cycles of which at least `MIN_KNOWN` is known.
    cycles
        As `joint_cycles.parquet` holds it: subject, condition, recording, session, compensated,
        side, cycle (from 1 for each side), percent, and a column for every joint motion and curve,
        such as hip_flexion_angle [deg], hip_flexion_moment [N·m/kg] and hip_flexion_power [W/kg].

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> summary, cycles = joint_tables(result, "level")
    >>> summary.query("joint == 'knee' and quantity == 'range of motion'")["value"].round().tolist()
    [61.0, 61.0]
    """
    rows, parts = [], [pd.DataFrame(columns=CYCLE_COLUMNS)]
    time_s = {side: np.diff(spans)[:, 0] for side, spans in joint_spans(result).items()}
    for variant in result.variants:
        for side, curves in joint_curves(result, variant).items():
            of_side = variant == "compensated", side
            rows += [(*of_side, *row) for row in _quantities(curves, time_s[side])]
            count, percents = curves.shape[:2]
            values = curves.reshape(count * percents, len(CYCLE_COLUMNS) - 4).astype(np.float32)
            part = pd.DataFrame(values, columns=CYCLE_COLUMNS[4:])
            part["compensated"], part["side"] = of_side
            part["cycle"] = np.repeat(np.arange(1, count + 1), percents)
            part["percent"] = np.tile(np.arange(percents), count)
            parts.append(part[[*CYCLE_COLUMNS]])
    summary = pd.DataFrame(rows, columns=COLUMNS)
    cycles = pd.concat(parts[1:] or parts, ignore_index=True)
    return with_name(summary, result, condition), with_name(cycles, result, condition)


def _quantities(curves: Array, duration_s: Array) -> Iterator[tuple[object, ...]]:
    """Give the rows of a side from the joint on, of curves (C, 101, 13, 3)."""
    for k, motion in enumerate(JOINT_MOTIONS):
        for quantity, (curve, unit) in QUANTITIES.items():
            own = curves[:, :, k, [*CURVES].index(curve)]
            known = np.isfinite(own).mean(axis=1) >= MIN_KNOWN
            if known.any():
                values, at = _quantity(quantity, own[known], duration_s[known])
                spread = values.std(ddof=1) if len(values) > 1 else np.nan
                of_cycles = values.mean(), spread, at, len(values)
                yield motion.joint, motion.direction, quantity, unit, *of_cycles


def _quantity(quantity: str, curves: Array, duration_s: Array) -> tuple[Array, float]:
    """Give a quantity of each cycle, of curves (C, 101), and the mean percent at which it is."""
    measure: Mapping[str, Array] = {
        "range of motion": np.nanmax(curves, axis=1) - np.nanmin(curves, axis=1),
        "positive work": np.nanmean(np.maximum(curves, 0), axis=1) * duration_s,
        "negative work": np.nanmean(np.minimum(curves, 0), axis=1) * duration_s,
    }
    if quantity in measure:
        return measure[quantity], np.nan
    peak = np.nanargmax if quantity.startswith("largest") else np.nanargmin
    at = peak(curves, axis=1)
    return curves[np.arange(len(curves)), at], float(at.mean())
