"""What is left of a trial's residual when the truth of everything but one thing is known."""

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from compensation import InertiaModel, PlatformPose, commanded_pose, fit_inertia, to_lab
from hbm.body import Body, build_body
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.kinematics import solve_ik
from hbm.signals.filtering import Method, butterworth, low_pass
from hbm.signals.resampling import resample
from hbm.spatial import Array, shift_wrench, transform_wrench
from pipeline.io.recording import Recording
from pipeline.io.units import acceleration_in_mps2
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.artefacts import treadmill_wrenches
from pipeline.virtual_lab.machine.instruments.sampling import ANALOG_HZ, SAMPLES_PER_FRAME, delayed
from pipeline.virtual_lab.machine.treadmill import TreadmillMotion
from pipeline.virtual_lab.person.walk import Walk
from pipeline.virtual_lab.protocol.instrumented_treadmill import (
    PITCH_CHANNEL,
    SWAY_CHANNEL,
    InstrumentedTreadmill,
    record,
)

FIT_CUTOFF_HZ: Final = 20.0
Removal = Literal["known", "none", "calibrated"]


@dataclass(frozen=True, slots=True)
class Case:
    """What is wrong in the laboratory, and what the processing knows.

    Attributes
    ----------
    faults
        Of the instruments.
    cutoff_hz, method
        The filter.
    built_body
        Whether the body is built from the T-pose; else it is the true one.
    told_pose
        Whether the platform's pose is taken from its channels; else it is the true one.
    removal
        How the treadmill's own wrench is taken off the plates.
    calibration
        Signal that a compensation is calibrated on; None for the protocol's.
    """

    faults: Faults = field(default_factory=Faults.none)
    cutoff_hz: float = 6.0
    method: Method = "zero_phase"
    built_body: bool = False
    told_pose: bool = False
    removal: Removal = "known"
    calibration: str | None = None


def residual_of(
    case: Case,
    walk: Walk,
    motion: TreadmillMotion,
    treadmill: InstrumentedTreadmill,
    rng: np.random.Generator,
    models: tuple[InertiaModel, ...] = (),
) -> Array:
    """Record a walk with a case's instruments and give the residual that processing leaves.

    Parameters
    ----------
    case
        What is wrong, and what is known.
    walk, motion
        What really happened.
    treadmill
        The instruments, with the case's faults.
    rng
        Source of noise.
    models
        One per plate, where the removal is "calibrated".

    Returns
    -------
    Array
        Lab axes about mid-hip, at the markers' times, (T, 6) [N, N·m].
    """
    recording = record(treadmill, motion, walk, "trial.c3d", rng)
    time, person = recording.markers.time, walk.subject.person
    body: Body = walk.subject.body
    if case.built_body:
        body = build_body(
            recording.markers,
            mass=person.mass_kg,
            sex=person.sex,
            height_m=person.height_m,
            marker_set=body.marker_set,
            window_s=(0.0, 1.0),
        )
    filtered = filter_motion(
        solve_ik(body, recording.markers), cutoff=case.cutoff_hz, method=case.method
    )
    pose = _pose(case, motion, recording)
    plates = _without_treadmill(case, treadmill, motion, recording, models)
    ground = {
        f"{side}_foot": butterworth(to_lab(wrench, pose), time, case.cutoff_hz, case.method).value
        for side, wrench in zip(("left", "right"), plates, strict=True)
    }
    return inverse_dynamics(body, filtered, ground).residual


def fit_models(treadmill: InstrumentedTreadmill, recording: Recording) -> tuple[InertiaModel, ...]:
    """Calibrate both plates on a recording of the empty, moving treadmill."""
    felt = low_pass(_felt(treadmill, recording), ANALOG_HZ, FIT_CUTOFF_HZ, "zero_phase")
    return tuple(
        fit_inertia(felt, low_pass(plate.wrench_in_plate, ANALOG_HZ, FIT_CUTOFF_HZ, "zero_phase"))
        for plate in recording.plates
    )


def _pose(case: Case, motion: TreadmillMotion, recording: Recording) -> PlatformPose:
    true = motion.platform.pose
    if not case.told_pose:
        return PlatformPose(true.rotation[::SAMPLES_PER_FRAME], true.position[::SAMPLES_PER_FRAME])
    assert recording.analog is not None
    sway, pitch = (
        recording.analog.channel(c)[::SAMPLES_PER_FRAME] for c in (SWAY_CHANNEL, PITCH_CHANNEL)
    )
    stated = motion.platform.pivot + np.array([0.0, 0.0, case.faults.platform.pivot_error_m])
    return commanded_pose(sway / 1000, np.radians(pitch), stated)


def _without_treadmill(
    case: Case,
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    recording: Recording,
    models: tuple[InertiaModel, ...],
) -> list[Array]:
    """Give the plates' wrenches in the platform frame about its origin at the markers' times."""
    time = recording.markers.time
    own = [resample(p.time, p.wrench_in_plate, time) for p in recording.plates]
    if case.removal == "calibrated":
        clock = recording.plates[0].time
        felt = resample(clock, _felt(treadmill, recording), time)
        own = [model.compensate(felt, wrench) for model, wrench in zip(models, own, strict=True)]
    elif case.removal == "known":
        for k, (plate, true) in enumerate(
            zip(recording.plates, treadmill_wrenches(treadmill.machine, motion), strict=True)
        ):
            late = delayed(true, case.faults.plates.delay_s, plate.time)
            own[k] -= resample(plate.time, shift_wrench(late, plate.center), time)
    return [
        transform_wrench(wrench, plate.rotation, plate.center)
        for wrench, plate in zip(own, recording.plates, strict=True)
    ]


def _felt(treadmill: InstrumentedTreadmill, recording: Recording) -> Array:
    assert recording.analog is not None
    names = [f"{sensor.name}.{axis}" for sensor in treadmill.sensors for axis in "XYZ"]
    return acceleration_in_mps2("g") * np.column_stack(
        [recording.analog.channel(name) for name in names]
    )
