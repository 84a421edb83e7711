"""Processing of a simulated trial in which everything but one thing is known without error."""

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from compensation import InertiaModel, PlatformPose, commanded_pose, fit_inertia, to_lab
from hbm.body import build_body
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.kinematics import solve_ik
from hbm.signals.filtering import Method, butterworth, low_pass
from hbm.signals.resampling import resample
from hbm.spatial import Array, shift_wrench, transform_wrench
from pipeline.io.recording import Recording
from pipeline.io.units import acceleration_in_mps2
from pipeline.virtual_lab.analysis.true_body import true_body
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instruments.force_plate import misplaced
from pipeline.virtual_lab.machine.instruments.sampling import ANALOG_HZ, SAMPLES_PER_FRAME, delayed
from pipeline.virtual_lab.machine.treadmill import TreadmillMotion
from pipeline.virtual_lab.machine.vibration import Response
from pipeline.virtual_lab.person.walk import Walk
from pipeline.virtual_lab.protocol.instrumented_treadmill import (
    PITCH_CHANNEL,
    SWAY_CHANNEL,
    InstrumentedTreadmill,
    person_loads,
    record,
    undergo,
)

FIT_CUTOFF_HZ: Final = 20.0
"""Low-pass before a calibration is fitted: the thesis'."""
T_POSE_S: Final = (0.0, 1.0)
"""When the subject stands in the T-pose, within `Protocol.standing_s`."""
Removal = Literal["known", "none", "calibrated"]


@dataclass(frozen=True, slots=True)
class Case:
    """The faults of a laboratory, and what its processing knows without error.

    Attributes
    ----------
    faults
        Of body and instruments.
    cutoff_hz, method
        The filter.
    body_from_markers
        Whether the body is built from the recorded markers of the T-pose; else it is the true one
        (`true_body`).
    pose_from_channels
        Whether the platform's pose is taken from its channels; else it is the true one.
    removal
        How the treadmill's own wrench is removed from the plates: its true value is subtracted,
        it is not removed, or it is compensated by a calibrated model.
    calibration
        Signal that the model is calibrated on; None for the protocol's.
    """

    faults: Faults = field(default_factory=Faults.none)
    cutoff_hz: float = 6.0
    method: Method = "zero_phase"
    body_from_markers: bool = False
    pose_from_channels: bool = False
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
    """Record a walk with a case's instruments, process it, and give the residual.

    Parameters
    ----------
    case
        Which faults there are, and what is known.
    walk, motion
        How person and treadmill moved.
    treadmill
        The instruments, with the case's faults.
    rng
        Source of noise.
    models
        One per plate, if the removal is "calibrated".

    Returns
    -------
    Array
        Lab axes about mid-hip, at the markers' times, (T, 6) [N, N·m].
    """
    response = undergo(treadmill, motion, rng.spawn(1)[0], person_loads(walk, motion.time))
    recording = record(treadmill, motion, walk, "trial.c3d", rng, response)
    time, person = recording.markers.time, walk.subject.person
    body = true_body(walk.subject)
    if case.body_from_markers:
        body = build_body(
            recording.markers,
            mass=person.mass_kg,
            sex=person.sex,
            height_m=person.height_m,
            marker_set=walk.subject.marker_set,
            window_s=T_POSE_S,
        )
    filtered = filter_motion(
        solve_ik(body, recording.markers), cutoff=case.cutoff_hz, method=case.method
    )
    pose = _pose(case, motion, recording)
    plates = _without_treadmill(case, treadmill, response, recording, models)
    ground = {
        f"{side}_foot": butterworth(to_lab(wrench, pose), time, case.cutoff_hz, case.method).value
        for side, wrench in zip(("left", "right"), plates, strict=True)
    }
    return inverse_dynamics(body, filtered, ground).residual


def fit_models(treadmill: InstrumentedTreadmill, recording: Recording) -> tuple[InertiaModel, ...]:
    """Calibrate both plates on a recording of the empty, moving treadmill."""
    acceleration, *wrenches = (
        low_pass(signal, ANALOG_HZ, FIT_CUTOFF_HZ, "zero_phase")
        for signal in (
            _accelerations(treadmill, recording),
            *(plate.wrench_in_plate for plate in recording.plates),
        )
    )
    return tuple(fit_inertia(acceleration, wrench) for wrench in wrenches)


def _pose(case: Case, motion: TreadmillMotion, recording: Recording) -> PlatformPose:
    true = motion.platform.pose
    if not case.pose_from_channels:
        return PlatformPose(true.rotation[::SAMPLES_PER_FRAME], true.position[::SAMPLES_PER_FRAME])
    assert recording.analog is not None
    sway, pitch = (
        recording.analog.channel(name)[::SAMPLES_PER_FRAME]
        for name in (SWAY_CHANNEL, PITCH_CHANNEL)
    )
    stated = motion.platform.pivot + np.array([0.0, 0.0, case.faults.platform.pivot_error_m])
    return commanded_pose(sway / 1000, np.radians(pitch), stated)


def _without_treadmill(
    case: Case,
    treadmill: InstrumentedTreadmill,
    response: Response,
    recording: Recording,
    models: tuple[InertiaModel, ...],
) -> list[Array]:
    """Give the plates' wrenches in the platform frame about its origin at the markers' times."""
    time = recording.markers.time
    own = [resample(p.time, p.wrench_in_plate, time) for p in recording.plates]
    if case.removal == "calibrated":
        clock = recording.plates[0].time
        acceleration = resample(clock, _accelerations(treadmill, recording), time)
        own = [m.compensate(acceleration, wrench) for m, wrench in zip(models, own, strict=True)]
    elif case.removal == "known":
        faults = case.faults.plates
        known = response.artefacts
        for k, plate in enumerate(recording.plates):
            late = misplaced(delayed(known[k], faults.delays_s[k], plate.time), faults)
            own[k] -= resample(plate.time, shift_wrench(late, plate.center), time)
    return [
        transform_wrench(wrench, plate.rotation, plate.center)
        for wrench, plate in zip(own, recording.plates, strict=True)
    ]


def _accelerations(treadmill: InstrumentedTreadmill, recording: Recording) -> Array:
    """Give the accelerometers' channels, (N, 3 per sensor) [m/s²]."""
    assert recording.analog is not None
    names = [f"{sensor.name}.{axis}" for sensor in treadmill.sensors for axis in "XYZ"]
    in_g = np.column_stack([recording.analog.channel(name) for name in names])
    return acceleration_in_mps2("g") * in_g
