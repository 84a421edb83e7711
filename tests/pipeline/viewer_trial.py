"""A processed trial for the viewer's tests: a synthetic walk on a platform that sways and pitches.

The plate of one foot adds a lateral force, as a faulty plate would; compensation removes it.
"""

from pathlib import Path

import numpy as np

from compensation.platform import PlatformPose, commanded_pose
from hbm.dynamics import inverse_dynamics_variants
from hbm.motion import Motion
from hbm.notes import Note
from hbm.poses import marker_positions
from pipeline.config.schema import Settings, Subject
from pipeline.io.recording import Event, Plate
from pipeline.trial.gait.cycles import cut_cycles, found_cycles
from pipeline.trial.quality import Quality
from pipeline.trial.result import TrialResult
from tests.benchmarks.walker import STRIDE_HZ, Walk, walk
from tests.synthetic import synthetic_body

FIRST_FRAME = 45
ONSETS_S = np.array([1.0, 3.0])
LIFT_M = 0.06
CORNERS = ((0.85, -0.25), (-0.85, -0.25), (-0.85, 0.25), (0.85, 0.25))


def viewer_trial(
    frames: int, *, compensated: bool = True, moving: bool = True, lost: slice | None = None
) -> TrialResult:
    """Give a trial; ``lost`` frames could not be solved and miss markers."""
    body, made = synthetic_body(), walk(frames)
    time, q, position = made.time, made.q.copy(), made.markers.position.copy()
    if lost is not None:
        q[lost], position[lost, :5] = np.nan, np.nan
    markers = type(made.markers)(time, made.markers.names, position)
    error = np.linalg.norm(marker_positions(body, q) - position, axis=-1)
    solved = np.isfinite(q)
    motion = Motion(time, q, made.v, made.a, body.markers, error, solved.all(axis=1), solved)
    ground = {"measured": _faulty(made)} | ({"compensated": made.wrenches} if compensated else {})
    dynamics = dict(
        zip(ground, inverse_dynamics_variants(body, motion, list(ground.values())), strict=True)
    )
    events = _events(np.arange(0.2, time[-1], 1 / STRIDE_HZ))
    known = np.all([np.isfinite(each.residual).all(axis=1) for each in dynamics.values()], axis=0)
    quality = np.where(known, 0, int(Quality.POSE_UNKNOWN))
    cycles, _ = cut_cycles(events, time, quality, min_valid_share=0.5)
    return TrialResult(
        source=Path("walk.c3d"),
        subject=Subject(id="sub07", sex="male", mass_kg=body.mass),
        settings=Settings(),
        body=body,
        markers=markers,
        first_frame=FIRST_FRAME,
        plates=tuple(_plate(k + 1, y) for k, y in enumerate((0.25, -0.25))),
        motion=motion,
        solved=q,
        variants=dynamics,
        ground=ground,
        platform=sway_and_pitch(time) if moving else None,
        events=events,
        cycles=cycles,
        found_cycles=found_cycles(events, cycles),
        span=None,
        quality=quality,
        onsets=ONSETS_S,
        delay_s=0.0,
        delay_uncertainty_s=0.001,
        notes=(
            Note.of("mass_stated", mass_kg=70.0),
            Note.of("plate_dead", plate=2, channels=["Fx"]),
        ),
    )


def sway_and_pitch(time) -> PlatformPose:
    return commanded_pose(0.05 * np.sin(2 * time), np.radians(4) * np.sin(1.5 * time), (0, 0, -0.3))


def _faulty(made: Walk) -> dict[str, np.ndarray]:
    push = np.outer(60 * np.sin(3 * made.time), [0, 1, 0, -1, 0, 0.4])
    return made.wrenches | {"left_foot": made.wrenches["left_foot"] + push}


def _events(strikes) -> tuple[Event, ...]:
    half = 0.5 / STRIDE_HZ
    return tuple(
        Event(float(strike + later), label, side)
        for strike in strikes
        for later, label, side in (
            (0, "foot_strike", "right"),
            (0.1, "foot_off", "left"),
            (half, "foot_strike", "left"),
            (half + 0.1, "foot_off", "right"),
        )
    )


def _plate(number: int, y: float) -> Plate:
    corners = [(x, y + dy, LIFT_M) for x, dy in CORNERS]
    place = np.eye(3), np.array([0, y, LIFT_M]), np.array(corners)
    return Plate(number, np.empty(0), np.empty((0, 6)), *place)
