"""Made-up results of a study, in the format that `hbm run` writes.

Residuals of walking, artefacts and what compensation leaves of them are sines, scaled to the size
of those of a study. Nothing here is measured or simulated.
"""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.coordinates import INDEX
from hbm.dynamics import Dynamics
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note
from pipeline.config.schema import Settings, Subject
from pipeline.io.recording import Event
from pipeline.run.store import write_trial
from pipeline.trial.residuals import reported
from pipeline.trial.result import Procedure, TrialResult
from tests.synthetic import synthetic_body

ENGINE = "Pinocchio 4.1.0"
RATE_HZ = 100.0
CYCLE_S = 1.1
WALKING = np.array([50.0, 40.0, 85.0, 15.0, 27.0, 6.0])
"""Amplitude of each residual within a gait cycle, Fx … Mz [N, N·m]."""
LATERAL = np.array([1, -1, 1, -1, 1, -1])
"""Signs of a mirror image in the sagittal plane."""
SWAY = np.array([0.0, 600.0, 0.0, 650.0, 0.0, 280.0])
PITCH = np.array([480.0, 0.0, 60.0, 0.0, 500.0, 0.0])
UNCOMPENSATED_SHARE = 0.02
COMPENSATION = np.array([1.0, -1.0, 0.5, 0.4, -0.4, 0.3])
"""What compensation adds to walking itself: the accelerometers' noise."""


@contextmanager
def without_figures() -> Iterator[None]:
    """Leave figures and the comparison of curves out of a report: they take most of its time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.report.write.compared_curves", lambda *given: {})
        for figures in ("study_figures", "joint_figures"):
            patch.setattr(f"pipeline.report.write.{figures}", lambda *given: iter(()))
        yield


def write_fake_results(
    folder: Path,
    *,
    subjects: int = 9,
    conditions: Collection[str] = ("baseline", "sway", "pitch"),
    cycles: int = 12,
    compensated: bool = True,
    without: Collection[tuple[str, str]] = (),
    settings: Settings | None = None,
    rest_s: float = 0.0,
    key: Callable[[str, str], str] = "key of {} {}".format,
) -> Path:
    """Write the trials of a made-up study; ``without`` names cells that are missing."""
    for number in range(1, subjects + 1):
        for condition in conditions:
            subject = f"sub{number:02}"
            if (subject, condition) in without:
                continue
            result = fake_trial(number, condition, cycles, compensated, settings, rest_s)
            path = folder / "trials" / f"{subject}_{condition}.parquet"
            write_trial(replace(result, condition=condition, key=key(subject, condition)), path)
    return folder


def fake_trial(
    number: int,
    condition: str,
    cycles: int = 12,
    compensated: bool = True,
    settings: Settings | None = None,
    rest_s: float = 0.0,
) -> TrialResult:
    """Make up one trial; ``rest_s`` adds standing after the walk."""
    rng = np.random.default_rng([number, *condition.encode()])
    frames = round((cycles * CYCLE_S + rest_s) * RATE_HZ) + 50
    time = np.arange(frames) / RATE_HZ
    phase = 2 * np.pi * time / CYCLE_S
    starts = CYCLE_S * np.arange(cycles)
    spans = np.column_stack([starts, starts + CYCLE_S])
    left = np.arange(cycles) % 2 == 1 if condition == "sway" else np.zeros(cycles, bool)

    share = np.random.default_rng(number).uniform(0.8, 1.2, 6) * rng.uniform(0.9, 1.1, 6)
    walking = share * WALKING * np.column_stack([np.sin(phase + k) for k in range(6)])
    walking += rng.normal(0, 2, (frames, 6))
    for start, stop in spans[left]:
        walking[(time >= start) & (time < stop)] *= LATERAL
    artefact = np.zeros((frames, 6))
    if condition == "sway":
        for (start, _), mirrored in zip(spans, left, strict=True):
            pulse = np.exp(-(((time - start - 0.35) / 0.12) ** 2))
            sign = LATERAL if mirrored else 1
            artefact += pulse[:, None] * SWAY * sign
    elif condition != "baseline":
        artefact += np.sin(2 * np.pi * time / 30)[:, None] * PITCH
    artefact *= rng.uniform(0.9, 1.1, 6)
    uncompensated = UNCOMPENSATED_SHARE * rng.uniform(0.5, 2.5, 6) * artefact
    remains = walking + uncompensated + COMPENSATION * rng.normal(1, 1, 6)

    body = synthetic_body()
    person = Subject(
        id=f"sub{number:02}",
        sex="female" if number % 3 == 0 else "male",
        height_m=round(1.62 + 0.03 * number, 2),
        age_years=22 + number,
    )
    zeros = np.zeros((frames, 46))
    q = zeros.copy()
    q[:, INDEX["PelvisZ"]] = 0.95
    error = np.abs(rng.normal(0, 0.005, (frames, len(body.markers))))
    error[10:40, 3] = np.nan
    motion = Motion(
        time=time,
        q=q,
        v=zeros,
        a=zeros,
        markers=body.markers,
        marker_error=error,
        converged=np.arange(frames) != 7,
        observed=np.ones((frames, 46), bool),
    )

    def dynamics(residual):
        return Dynamics(time, zeros, reported(residual), zeros, ENGINE)

    weight = np.zeros((frames, 6))
    weight[:, 2] = 400 + 350 * np.abs(np.sin(phase))
    feet = {"left_foot": weight / 2, "right_foot": weight / 2}
    return TrialResult(
        source=Path(f"{person.id}_{condition}.c3d"),
        subject=person,
        settings=settings or Settings(),
        body=replace(body, mass=58.0 + 3 * number, height_m=person.height_m, sex=person.sex),
        markers=Markers(time, body.markers, np.zeros((frames, len(body.markers), 3))),
        first_frame=1,
        plates=(),
        motion=motion,
        solved=q,
        variants={"measured": dynamics(walking + artefact)}
        | ({"compensated": dynamics(remains)} if compensated else {}),
        ground={"measured": feet} | ({"compensated": feet} if compensated else {}),
        platform=None,
        events=tuple(Event(float(t), "foot_strike", "right") for t in starts),
        cycles={"left": spans[left], "right": spans[~left]},
        found_cycles=len(spans),
        span=None,
        quality=np.zeros(frames, int),
        delay_s=0.004,
        delay_uncertainty_s=0.001,
        notes=(
            Note.of("mass_weighed", mass_kg=70.0, start_s=0.5, stop_s=1.5, file="pose.c3d"),
            Note.of("gaps", unsolved=1, frames=2, samples=0),
            Note.of("events_uncalibrated", left=3, right=3),
            Note.of("legs_differ", difference_m=0.041, left_m=0.843, right_m=0.802),
        ),
        procedure=Procedure(mass="standing on the plates", events="motion"),
    )


def standing(result: TrialResult, span: tuple[float, float] = (1.0, 3.0)) -> TrialResult:
    """Give the trial without gait cycles: a span of the recording counts instead."""
    none = {side: np.empty((0, 2)) for side in ("left", "right")}
    return replace(result, events=(), cycles=none, found_cycles=0, span=span)


STUDY = """
name = "A made-up study"
[settings]
cutoff_hz = 6.0
[treadmill]
calibration = "empty.json"
[treadmill.accelerometers]
rear_left = ["A1", "A2", "A3"]
front_right = ["B1", "B2", "B3"]
[treadmill.platform]
markers = ["P1", "P2", "P3"]
[conditions.baseline]
cycles = 12
skip_s = 10.0
[conditions.sway]
cycles = 12
perturbed = true
[conditions.pitch]
cycles = 12
"""


def write_fake_study(folder: Path, subjects: int = 9) -> Path:
    """Write the study's statements and recordings of a few bytes each."""
    folder.mkdir(parents=True)
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "empty.json").write_text("{}", encoding="utf-8")
    for number in range(1, subjects + 1):
        lines = [f'id = "sub{number:02}"']
        for condition in ("baseline", "sway", "pitch"):
            name = f"sub{number:02}_{condition}.c3d"
            (folder / name).write_bytes(name.encode())
            lines += [f"[trials.{condition}]", f'file = "{name}"']
        (folder / f"sub{number:02}.toml").write_text("\n".join(lines), encoding="utf-8")
    return folder
