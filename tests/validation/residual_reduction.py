"""What the smallest change of the motion that removes residuals repairs, and hides.

The prototype changes the filtered coordinates by cubic splines until the equations of motion close,
as tools that reduce residuals do (residual_reduction.md). The truth is simulated: people whose
bodies the processing does not know, on true ground forces with one planted fault.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from itertools import chain, combinations, product
from multiprocessing import Pool
from pathlib import Path
from typing import Any, Final

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pinocchio as pin
from scipy.linalg import solveh_banded

from compensation import PlatformPose, to_lab
from hbm.body import build_body
from hbm.coordinates import N_Q
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.ik.tracking import solve_ik
from hbm.model import Body
from hbm.motion import Motion
from hbm.poses import marker_positions
from hbm.signals.filtering import low_pass
from hbm.spatial import Array
from pipeline.virtual_lab.machine.instrumented_treadmill import SAMPLES_PER_FRAME, make_treadmill
from pipeline.virtual_lab.person.walk import foot_wrenches, leg_moments
from pipeline.virtual_lab.protocol.walking_protocol import CONDITIONS, Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import WalkingTrial, run_trial, study_subject

RATE_HZ: Final = 100.0
FRAMES: Final = 3
"""Of an interval between two knots, which are 30 ms apart."""
RESIDUAL_SD: Final = np.repeat([15.0, 6.0], 3)
"""[N, N·m] that weigh as much as `MARKER_SD_M`, chosen on one trial to remove about 75 %."""
MARKER_SD_M: Final = 0.001
STEPS: Final = 3
SPLINES: Final = np.array([[1, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]]) / 6
"""Powers of the share of an interval that has passed, of the four cubic splines in it."""
WIDTH: Final = 4 * N_Q


def spline_values() -> Array:
    """Give the four splines of an interval, their rates and accelerations, (frames, 3, 4)."""
    u, step_s = np.arange(FRAMES) / FRAMES, FRAMES / RATE_HZ
    powers = [
        [u**0, u, u**2, u**3],
        [0 * u, u**0, 2 * u, 3 * u**2],
        [0 * u, 0 * u, 2 * u**0, 6 * u],
    ]
    scale = step_s ** -np.arange(3.0)
    return np.asarray(np.einsum("rpf,r,kp->frk", powers, scale, SPLINES))


def balance(model: Any, q: Array, v: Array, a: Array, ground: Array) -> tuple[Array, Array]:
    """Give the pelvis' generalized forces (T, 6), and their derivatives by q, v, a (T, 3, 6, 46).

    ``ground`` is the sum of what acts on the feet, about the lab origin, (T, 6).
    """
    data, frames = model.createData(), len(q)
    force, slopes = np.empty((frames, 6)), np.empty((frames, 3, 6, N_Q))
    rates = np.empty((frames, 6, 6))  # motion of the lab's origin per rate of each coordinate
    for t, state in enumerate(zip(q, v, a, strict=True)):
        by_q, by_v, mass = pin.computeRNEADerivatives(model, data, *state)
        slopes[t] = by_q[:6], by_v[:6], np.triu(mass)[:6] + np.triu(mass, 1).T[:6]
        force[t] = data.tau[:6]
        rates[t] = pin.computeJointJacobians(model, data, state[0])[:, :6].T
    force -= np.einsum("tci,ti->tc", rates, ground)
    linear, angular = rates[:, :, :3], rates[:, :, 3:]
    for later, before in combinations(range(5, -1, -1), 2):
        # a coordinate turns the axes of those after it: d rate = rate before x rate after
        turned = np.hstack(
            [
                np.cross(angular[:, before], linear[:, later])
                + np.cross(linear[:, before], angular[:, later]),
                np.cross(angular[:, before], angular[:, later]),
            ]
        )
        slopes[:, 0, later, before] -= np.einsum("ti,ti->t", turned, ground)
    return force, slopes


def marker_metric(body: Body, q: Array) -> Array:
    """Give the mean square motion of markers per change of coordinates, (T, 46, 46) [m²]."""
    size, here = 1e-6, marker_positions(body, q)
    slopes = np.stack(
        [(marker_positions(body, q + size * unit) - here) / size for unit in np.eye(N_Q)], axis=-1
    )
    return np.einsum("tmai,tmaj->tij", slopes, slopes) / here.shape[1]


def reduced(body: Body, motion: Motion, ground: Mapping[str, Array]) -> Motion:
    """Change a motion as little as nearly closes the equations of motion.

    Gauss–Newton over the whole trial: residuals by `RESIDUAL_SD`, motion of markers by
    `MARKER_SD_M`. The number of frames is a multiple of `FRAMES`.
    """
    frames, total, values = len(motion.q), sum(ground.values()), spline_values()
    intervals = frames // FRAMES
    at = np.arange(intervals)[:, None] + np.arange(4)
    change = np.zeros((intervals + 3, N_Q))
    # what a change of the splines costs in motion of markers, (intervals, 4 * 46, 4 * 46)
    metric = marker_metric(body, motion.q) / MARKER_SD_M**2 + 1e-2 * np.eye(N_Q)
    shape = values[:, 0]
    stiff = np.einsum("gfij,fk,fl->gkilj", metric.reshape(-1, FRAMES, N_Q, N_Q), shape, shape)
    stiff = stiff.reshape(-1, WIDTH, WIDTH)

    def moved() -> list[Array]:
        parts = np.einsum("frk,gki->rgfi", values, change[at]).reshape(3, frames, N_Q)
        return [x + part for x, part in zip((motion.q, motion.v, motion.a), parts, strict=True)]

    for _ in range(STEPS):
        force, slopes = balance(body.model, *moved(), total)
        by_state = (slopes / RESIDUAL_SD[:, None]).reshape(-1, FRAMES, 3, 6, N_Q)
        rows = np.einsum("gfrsi,frk->gfski", by_state, values).reshape(-1, 6 * FRAMES, WIDTH)
        error = (force / RESIDUAL_SD).reshape(-1, 6 * FRAMES, 1)
        pull = rows.mT @ error + stiff @ change[at].reshape(-1, WIDTH, 1)
        change = change - solve(rows.mT @ rows + stiff, pull[..., 0])
    q, v, a = moved()
    return replace(motion, q=q, v=v, a=a)


def solve(normal: Array, pull: Array) -> Array:
    """Solve the equations of overlapping intervals, (G, 184, 184) and (G, 184), as banded ones."""
    intervals = len(pull)
    right = np.zeros((intervals + 3, N_Q))
    banded = np.zeros((WIDTH, intervals + 3, N_Q))
    for part in range(4):
        own = slice(part * N_Q, (part + 1) * N_Q)
        right[part : part + intervals] += pull[:, own]
        for below in range(WIDTH):
            diagonal = np.diagonal(normal, -below, axis1=1, axis2=2)[:, own]
            banded[below, part : part + intervals, : diagonal.shape[1]] += diagonal
    found = solveh_banded(banded.reshape(WIDTH, -1), right.ravel(), lower=True)
    return np.asarray(found.reshape(right.shape))


FAULTS: Final = (
    "no fault planted",
    "plates 20 ms late",
    "left plate 5 % too much",
    "left plate 2 cm off",
    "mass 5 % too large",
    "trunk markers 2 cm off",
    "treadmill not compensated",
)
TRUNK: Final = ("C7", "T10", "JN", "XYPH", "STRN", "T2", "T8")
JOINTS: Final = {
    "hip": ("HipFlexion", "HipAbduction", "HipInternalRotation"),
    "knee": ("KneeFlexion",),
    "ankle": ("AnklePlantarFlexion",),
}
STEADY: Final = slice(1200, 2700)
"""Frames of steady walking, in which filters have settled: 15 s, with a perturbation in sway."""
PROTOCOL: Final = Protocol(baseline_s=22.0, pitch_s=22.0, waits_s=(12.0,), beside_s=0.0)


def with_fault(trial: WalkingTrial, fault: str) -> tuple[Body, Motion, dict[str, Array]]:
    """Give body, motion and wrenches on the feet, as processed from a trial with one fault."""
    markers, subject = trial.recording.markers, trial.walk.subject
    time, person, forward = markers.time, subject.person, np.array([0.02, 0.0, 0.0])
    mass_kg = person.mass_kg * (1.05 if fault == "mass 5 % too large" else 1.0)
    stated = {"sex": person.sex, "height_m": person.height_m, "marker_set": subject.marker_set}
    body = build_body(markers, mass=mass_kg, window_s=(0.0, 1.0), **stated)
    if fault == "trunk markers 2 cm off":
        off = np.isin(markers.names, TRUNK)[:, None] * forward
        markers = replace(markers, position=markers.position + off)
    at = time - (0.02 if fault == "plates 20 ms late" else 0.0)
    feet = {f"{side}_foot": w for side, w in foot_wrenches(trial.walk, at).items()}
    left = feet["left_foot"]
    if fault == "left plate 5 % too much":
        feet["left_foot"] = 1.05 * left
    if fault == "left plate 2 cm off":
        feet["left_foot"] = left + np.hstack([0 * left[:, :3], np.cross(forward, left[:, :3])])
    if fault == "treadmill not compensated":
        pose, step = trial.motion.platform.pose, slice(None, None, SAMPLES_PER_FRAME)
        pose = PlatformPose(pose.rotation[step], pose.position[step])
        for side, own in zip(("left", "right"), trial.response.artefacts, strict=True):
            feet[f"{side}_foot"] = feet[f"{side}_foot"] + to_lab(own[step], pose)
    motion = filter_motion(solve_ik(body, markers))
    return body, motion, {foot: low_pass(w, time, 6.0, "zero_phase") for foot, w in feet.items()}


def within(motion: Motion, frames: slice) -> Motion:
    """Give some frames of a motion."""
    names = {field.name for field in fields(motion)} - {"markers"}
    return replace(motion, **{name: getattr(motion, name)[frames] for name in names})


def errors(trial: WalkingTrial, body: Body, motion: Motion, ground: dict[str, Array]) -> Array:
    """Give what is wrong with a motion's dynamics, RMS, in the order of `MEASURES`."""
    time, mass = trial.recording.markers.time, trial.walk.subject.skeleton.mass
    true = {
        n: low_pass(m, time, 6.0, "zero_phase") for n, m in leg_moments(trial.walk, time).items()
    }
    force = low_pass(trial.walk.ground.at(time)[:, :3], time, 6.0, "zero_phase")[STEADY]
    dynamics = inverse_dynamics(body, motion, ground)
    parts = [dynamics.residual[:, :3], dynamics.residual[:, 3:]]
    for names in JOINTS.values():
        coordinates = [side + name for side in "LR" for name in names]
        wrong = [dynamics.force(name) - true[name][STEADY] for name in coordinates]
        parts.append(np.stack(wrong, axis=1) / mass / np.sqrt(2))  # of one leg
    # the centre of mass accelerates by all forces that the motion needs
    needed = dynamics.residual[:, :3] + sum(ground.values())[:, :3]
    parts.append(needed / sum(part.mass for part in body.segments.values()) - force / mass)
    # largest moments of each second, which is about a gait cycle
    seconds = np.arange(100, len(motion.q) - 100, 100)
    peaks = [
        np.maximum.reduceat(dynamics.force(name), seconds)[:-1]
        - np.maximum.reduceat(true[name][STEADY], seconds)[:-1]
        for name in ("LHipFlexion", "RHipFlexion")
    ]
    inside = [part[100:-100] for part in parts] + [np.stack(peaks, axis=1) / mass / np.sqrt(2)]
    return np.array([np.sqrt(np.mean(np.sum(part**2, axis=1))) for part in inside])


MEASURES: Final = ["force", "moment", *JOINTS, "acceleration", "hip_peak"]


def judge(number: int, condition: str, faults: tuple[str, ...] = FAULTS) -> list[dict[str, Any]]:
    """Give a row per fault of one trial: errors before and after, and how far markers moved."""
    setting, rows = Setting(protocol=PROTOCOL), []
    treadmill = make_treadmill(setting.faults, setting.seed)
    trial = run_trial(setting, treadmill, study_subject(setting, number), number, condition)
    for fault in faults:
        body, motion, ground = with_fault(trial, fault)
        motion, ground = within(motion, STEADY), {n: w[STEADY] for n, w in ground.items()}
        changed = reduced(body, motion, ground)
        before, after = (errors(trial, body, m, ground) for m in (motion, changed))
        moved = marker_positions(body, changed.q) - marker_positions(body, motion.q)
        row = {"subject": number, "condition": condition, "fault": fault}
        for when, sizes in (("before", before), ("after", after)):
            row |= {f"{n}_{when}": x for n, x in zip(MEASURES, sizes, strict=True)}
        rows.append(row | {"markers_mm": 1000 * np.sqrt(np.mean(np.sum(moved**2, axis=-1)))})
    return rows


def reduction(jobs: int, subjects: int = 9) -> pd.DataFrame:
    """Judge all trials of the thesis' subjects; a row per trial and fault."""
    with Pool(jobs) as pool:
        cases = product(range(subjects), CONDITIONS)
        return pd.DataFrame(chain(*pool.starmap(judge, cases, 1)))


def draw(rows: pd.DataFrame, path: Path) -> None:
    """Draw medians over trials before and after, by fault of plates, body and markers."""
    median = rows[rows.fault != FAULTS[-1]].groupby("fault", sort=False).median(numeric_only=True)
    titles = ["residual force [N]", "error of hip moment [N·m/kg]", "of ankle moment [N·m/kg]"]
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.2), sharey=True)
    for axis, name, title in zip(axes, ("force", "hip", "ankle"), titles, strict=True):
        for when, marker in (("before", "o"), ("after", "x")):
            axis.plot(median[f"{name}_{when}"], median.index, marker, label=f"{when} reduction")
        axis.set(title=title, xlim=(0, None))
    axes[0].invert_yaxis()
    axes[2].legend()
    figure.tight_layout()
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": path.stem}):
        figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
