"""Whether the simulated gait is realistic: beside published norms.

Run as ``python -m tests.virtual_gait.realism NORMS.csv`` with the norms of Pinzone et al. (2014) as
published. Prints the rows of the table of validation/realism.md.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.coordinates import INDEX
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.trial.gait.cycles import normalise
from pipeline.virtual_lab.machine.platform import Machine
from pipeline.virtual_lab.person.balance import in_lab, pressure_on_platform
from pipeline.virtual_lab.person.body import COLUMN, segment_poses
from pipeline.virtual_lab.person.gait import SIDES
from pipeline.virtual_lab.person.walk import Walk, foot_wrenches
from pipeline.virtual_lab.protocol.walking_protocol import ConditionName, Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_walk, study_subject

ANGLES: Final = {
    "pelvis anterior tilt": ("PelvisForwardPitch", 1, 0.0, "Pelvis Ant/Pst"),
    "pelvis obliquity, up": ("PelvisRightRoll", -1, 0.0, "Pelvic Up/Dn"),
    "pelvis rotation, forward": ("PelvisYaw", 1, 0.0, "Pelvic Int/Ext"),
    "hip flexion": ("RHipFlexion", 1, 0.0, "Hip Flx/Ext"),
    "hip adduction": ("RHipAbduction", -1, 0.0, "Hip Add/Abd"),
    "hip internal rotation": ("RHipInternalRotation", 1, 0.0, "Hip Int/Ext"),
    "knee flexion": ("RKneeFlexion", 1, 0.0, "Knee Flx/Ext"),
    "ankle dorsiflexion": ("RAnklePlantarFlexion", -1, -3.0, "Ankle Dor/Pla"),
}
"""Title -> coordinate, its sign and zero [deg] relative to the norms, and its name there. The zero
of the ankle differs by the height of the second metatarsal head above the heel."""
STEADY_S: Final = 12.0
END_S: Final = 1.0
"""Times at the beginning and the end that do not count."""
PERCENT: Final = np.arange(101.0)


@dataclass(frozen=True, slots=True)
class Band:
    """Mean and standard deviation over the gait cycle, (101,) each."""

    mean: Array
    sd: Array


def angle_curves(walk: Walk) -> dict[str, Array]:
    """Give a subject's mean joint angles of the right leg over the gait cycle.

    Parameters
    ----------
    walk
        A walk on the level; its first 12 s do not count.

    Returns
    -------
    dict[str, Array]
        Title -> (101,) [deg], with the signs and zeros of the norms.
    """
    time = np.arange(STEADY_S * 100, walk.motion.duration * 100) / 100
    curves = normalise(time, np.degrees(walk.motion.at(time)), _cycles(walk)).mean(axis=0)
    return {
        title: sign * curves[:, INDEX[name]] + zero
        for title, (name, sign, zero, _) in ANGLES.items()
    }


def read_norms(path: Path) -> dict[str, Band]:
    """Read the table of norms; title -> band over the gait cycle [deg]."""
    table = pd.read_csv(path)
    table = table[table["quantity"] == "angle"]
    bands = {}
    for title, (*_, name) in ANGLES.items():
        own = table[table["name"] == name]
        mean, sd = (
            np.interp(
                PERCENT, own["percent"], (own[f"centre_one_{k}"] + own[f"centre_two_{k}"]) / 2
            )
            for k in ("mean", "sd")
        )
        bands[title] = Band(np.asarray(mean), np.asarray(sd))
    return bands


def force_peaks(walk: Walk) -> dict[str, float]:
    """Give the extremes of a subject's mean ground reaction on the right foot [BW]."""
    time = np.arange(STEADY_S * 100, walk.motion.duration * 100) / 100
    force = foot_wrenches(walk, time)["right"][:, :3] / (walk.subject.person.mass_kg * GRAVITY_MPS2)
    forward, _, vertical = normalise(time, force, _cycles(walk)).mean(axis=0).T
    return {
        "first peak of the vertical force": float(vertical[5:25].max()),
        "second peak": float(vertical[40:58].max()),
        "minimum between them": float(vertical[20:42].min()),
        "braking": float(-forward[:30].min()),
        "propulsion": float(forward[30:62].max()),
    }


def share_within_band(curves: Array, band: Band) -> Array:
    """Give the share of the cycle in which curves, (…, 101), are within 2 SD of the mean, (…,)."""
    return np.asarray(np.mean(np.abs(curves - band.mean) < 2 * band.sd, axis=-1))


def pressure_inside_foot(walk: Walk) -> float:
    """Give the share of single support with the centre of pressure inside the foot's outline."""
    time = steady(walk)
    pose = walk.platform.pose(time)
    pressure = in_lab(pressure_on_platform(walk.ground.at(time), pose), pose)
    share, q = walk.placement.left_share(time), walk.motion.at(time).T
    inside = []
    for side, alone in zip(SIDES, (share == 1, share == 0), strict=True):
        sole = walk.placement.soles[side]
        rotation, ankle = segment_poses(walk.subject.skeleton, q, [sole.segment])[0]
        sole_rotation, origin = sole.from_foot(rotation, ankle)
        on_sole = (np.swapaxes(sole_rotation, 1, 2) @ (pressure - origin)[..., None])[..., 0]
        inside.append(_within(sole.outline, on_sole[alone, :2]).mean())
    return float(min(inside))


def trunk_lean(walk: Walk, time: Array) -> Array:
    """Give the forward inclination of the trunk, (N,) [deg]."""
    names = ("PelvisForwardPitch", "TrunkFlexion", "MidTrunkFlexion")
    return np.degrees(walk.motion.at(time)[:, [COLUMN[name] for name in names]].sum(axis=1))


def lean_change(walk: Walk) -> float:
    """Give by how much the trunk's inclination, its mean over a gait cycle, changes [deg]."""
    time = steady(walk)
    lean = normalise(time, trunk_lean(walk, time), _cycles(walk)).mean(axis=1)
    return float(np.ptp(lean))


def steady(walk: Walk, rate_hz: float = 100.0) -> Array:
    """Give the times of steady walking, (N,) [s]."""
    return np.arange(STEADY_S * rate_hz, (walk.motion.duration - END_S) * rate_hz) / rate_hz


def _within(polygon: Array, points: Array) -> Array:
    """Find which points are in a convex polygon with counter-clockwise corners."""
    sides = np.roll(polygon, -1, axis=0) - polygon
    away = points[:, None] - polygon
    return np.all(sides[:, 0] * away[..., 1] >= sides[:, 1] * away[..., 0], axis=1)


def simulated_walks(subjects: int, condition: ConditionName = "baseline") -> list[Walk]:
    """Simulate half a minute of walking of the study's subjects."""
    setting = Setting(protocol=Protocol(baseline_s=30.0, pitch_s=36.0, waits_s=(12.0, 14.0)))
    return [
        run_walk(setting, Machine(), study_subject(setting, k), k, condition)[0]
        for k in range(subjects)
    ]


def realism_rows(
    level: Sequence[Walk], norms: Mapping[str, Band]
) -> Iterator[tuple[str, float, float]]:
    """Give the rows of validation/realism.md: what, minimum and maximum over the subjects."""
    peaks = pd.DataFrame([force_peaks(walk) for walk in level])
    for name in peaks:
        yield f"{name}, body weights", peaks[name].min(), peaks[name].max()
    swaying, pitching = (simulated_walks(len(level), name) for name in ("sway", "pitch"))
    inside = [100 * pressure_inside_foot(walk) for walk in (*level, *swaying, *pitching)]
    yield "centre of pressure inside the foot's outline, %", min(inside), max(inside)
    curves = [angle_curves(walk) for walk in level]
    for title, band in norms.items():
        shares = 100 * share_within_band(np.stack([own[title] for own in curves]), band)
        yield f"share within ± 2 SD of the norms, {title}, %", shares.min(), shares.max()
    changes = [lean_change(walk) for walk in pitching]
    yield "change of the trunk's inclination on a slope of ± 10°, °", min(changes), max(changes)


def _cycles(walk: Walk) -> Array:
    """Give the right gait cycles of steady walking, (C, 2) [s]."""
    contact = walk.placement.steps.contact[1::2]
    inside = (contact > STEADY_S) & (contact < walk.motion.duration - END_S)
    own = contact[inside]
    return np.column_stack([own[:-1], own[1:]])


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.virtual_gait.realism", description=__doc__
    )
    parser.add_argument("norms", type=Path, help="CSV file of the norms as published")
    norms = read_norms(parser.parse_args().norms)
    for name, least, most in realism_rows(simulated_walks(9), norms):
        print(f"{name}: {least:.2f} to {most:.2f}")


if __name__ == "__main__":
    main()
