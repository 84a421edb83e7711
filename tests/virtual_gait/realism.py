"""Whether the simulated gait is realistic: beside published norms and measured forces.

Run as ``python -m tests.virtual_gait.realism NORMS.csv FOLDER OUT`` with the norms of Pinzone et
al. (2014) as published, the folder of the treadmill recording of Moore, Hnat and van den Bogert
(2015), and the figure's name without ending. Prints the rows of the table of docs/realism.md.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hbm.coordinates import INDEX
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.figures.style import COLOURS, STYLE, draw_band, save_figure
from pipeline.trial.gait.cycles import normalise
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.platform import Machine
from pipeline.virtual_lab.person.balance import in_lab, pressure_on_platform
from pipeline.virtual_lab.person.body import COLUMN, segment_poses
from pipeline.virtual_lab.person.feet import SIDES
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
FORCES: Final = {"forward": 0, "medial": 1, "vertical": 2}
FORCE_COLUMNS: Final = ("RightGRF_x", "RightGRF_z", "RightGRF_y")
"""Title -> component of the force on the right foot, and the recording's columns in this order."""
NORMS_MPS: Final = 1.3
RECORDED_MPS: Final = 0.8
"""Walking speeds to which norms and recording are compared."""
BASELINE_S: Final = 30.0
PITCH_S: Final = 36.0
WAITS_S: Final = (12.0, 14.0)
STEADY_S: Final = 12.0
END_S: Final = 1.0
"""Durations of simulated walks, waits before a sway, and the times at the beginning and the end
that do not count."""
STANCE_PERCENT: Final = slice(10, 50)
"""Where the sign of the medial force is determined."""
PERCENT: Final = np.arange(101.0)
SOURCES: Final = (
    "Blue: {subjects} simulated subjects, mean ± SD between them, at 1.3 m/s (angles) and 0.8 m/s "
    "(forces). Grey: angles of healthy subjects on level ground at self-selected speed, mean ± SD, "
    "average of two centres (Pinzone et al. 2014, Gait Posture 40:286); forces on one man on a "
    "split-belt treadmill at 0.8 m/s, mean ± SD over strides (Moore, Hnat and van den Bogert "
    "2015, PeerJ 3:e918)."
)


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


def force_curves(walk: Walk) -> dict[str, Array]:
    """Give a subject's mean ground reaction on the right foot over the gait cycle, (101,) [BW]."""
    time = np.arange(STEADY_S * 100, walk.motion.duration * 100) / 100
    force = foot_wrenches(walk, time)["right"][:, :3] / (walk.subject.person.mass_kg * GRAVITY_MPS2)
    curves = normalise(time, force, _cycles(walk)).mean(axis=0)
    return {title: curves[:, k] for title, k in FORCES.items()}


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


def read_forces(folder: Path) -> dict[str, Band]:
    """Read a treadmill recording: right foot, title -> band over the gait cycle [BW]."""
    table = pd.read_csv(folder / "UnpertPre_data.csv")
    events = pd.read_csv(folder / "UnpertPre__event.csv")
    person = pd.read_csv(folder / "SubjectInfo.csv")
    weight = float(person["mass"].iloc[0]) * GRAVITY_MPS2
    force = table[list(FORCE_COLUMNS)].to_numpy() / weight
    strikes = events["rhs"].dropna().to_numpy()
    spans = np.column_stack([strikes[:-1], strikes[1:]])
    curves = normalise(table["time"].to_numpy(), force, spans)
    force_mean, force_sd = np.nanmean(curves, axis=0), np.nanstd(curves, axis=0)
    inward = np.sign(np.mean(force_mean[STANCE_PERCENT, 1]))
    force_mean[:, 1] *= inward
    return {title: Band(force_mean[:, k], force_sd[:, k]) for title, k in FORCES.items()}


def force_peaks(walk: Walk) -> dict[str, float]:
    """Give the extremes of a subject's mean ground reaction on the right foot [BW]."""
    curves = force_curves(walk)
    vertical, forward = curves["vertical"], curves["forward"]
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


def simulated_walks(
    subjects: int, speed_mps: float, seed: int = 1, condition: ConditionName = "baseline"
) -> list[Walk]:
    """Simulate half a minute of walking of the study's subjects."""
    protocol = Protocol(
        baseline_s=BASELINE_S, pitch_s=PITCH_S, waits_s=WAITS_S, speed_mps=speed_mps
    )
    setting = Setting(seed=seed, protocol=protocol, faults=Faults())
    return [
        run_walk(setting, Machine(), study_subject(setting, k), k, condition)[0]
        for k in range(subjects)
    ]


def realism_rows(
    level: Sequence[Walk], norms: Mapping[str, Band]
) -> Iterator[tuple[str, float, float]]:
    """Give the rows of docs/realism.md: what, and its minimum and maximum over the subjects."""
    peaks = pd.DataFrame([force_peaks(walk) for walk in level])
    for name in peaks:
        yield f"{name}, body weights", peaks[name].min(), peaks[name].max()
    swaying, pitching = (
        simulated_walks(len(level), NORMS_MPS, condition=name) for name in ("sway", "pitch")
    )
    inside = [100 * pressure_inside_foot(walk) for walk in (*level, *swaying, *pitching)]
    yield "centre of pressure inside the foot's outline, %", min(inside), max(inside)
    curves = [angle_curves(walk) for walk in level]
    for title, band in norms.items():
        shares = 100 * share_within_band(np.stack([own[title] for own in curves]), band)
        yield f"share within ± 2 SD of the norms, {title}, %", shares.min(), shares.max()
    changes = [lean_change(walk) for walk in pitching]
    yield "change of the trunk's inclination on a slope of ± 10°, °", min(changes), max(changes)


def realism_figure(norms: Path | None, forces: Path | None, subjects: int = 9) -> Figure:
    """Draw the simulated gait with published norms and a treadmill recording.

    Parameters
    ----------
    norms
        Table of Pinzone et al. (2014) as published; None leaves the norms out.
    forces
        Folder of the treadmill recording; None leaves it out.
    subjects
        Number of simulated subjects.

    Returns
    -------
    matplotlib.figure.Figure
        Eight joint angles at 1.3 m/s and three forces at 0.8 m/s over the right gait cycle, with
        the sources.
    """
    angles = [angle_curves(walk) for walk in simulated_walks(subjects, NORMS_MPS)]
    forces_of = [force_curves(walk) for walk in simulated_walks(subjects, RECORDED_MPS)]
    bands = read_norms(norms) if norms is not None else {}
    bands |= read_forces(forces) if forces is not None else {}
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10, 7.5), layout="constrained")
        panels = figure.subplots(3, 4, sharex=True).ravel()
        for panel, title in zip(panels, (*ANGLES, *FORCES), strict=False):
            curves = forces_of if title in FORCES else angles
            _draw(
                panel,
                title,
                np.stack([of_subject[title] for of_subject in curves]),
                bands.get(title),
            )
        panels[-1].set_axis_off()
        for panel in panels[7:11]:
            panel.set_xlabel("% of gait cycle")
        figure.supxlabel(SOURCES.format(subjects=subjects), fontsize=7, wrap=True)
    return figure


def _draw(panel: Axes, title: str, curves: Array, band: Band | None) -> None:
    if band is not None:
        draw_band(panel, PERCENT, band.mean, band.sd, COLOURS["baseline"])
    mean, sd = curves.mean(axis=0), curves.std(axis=0)
    draw_band(panel, PERCENT, mean, sd, COLOURS["compensated"])
    unit = "BW" if title in FORCES else "°"
    panel.set_title(f"{title.capitalize()}{' force' if title in FORCES else ''} [{unit}]")


def _cycles(walk: Walk) -> Array:
    """Give the right gait cycles of steady walking, (C, 2) [s]."""
    contact = walk.placement.steps.contact[1::2]
    inside = (contact > STEADY_S) & (contact < walk.motion.duration - END_S)
    own = contact[inside]
    return np.column_stack([own[:-1], own[1:]])


if __name__ == "__main__":
    norms, forces, out = map(Path, sys.argv[1:])
    save_figure(realism_figure(norms, forces), out)
    for name, least, most in realism_rows(simulated_walks(9, NORMS_MPS), read_norms(norms)):
        print(f"{name}: {least:.2f} to {most:.2f}")
