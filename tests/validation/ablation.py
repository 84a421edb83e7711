"""What each fault of a laboratory adds to each residual, one fault at a time (ablation.md).

Everything but the fault is known without error: the body, the platform's pose, and the treadmill's
own wrench, unless the case states otherwise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product
from typing import Final, Literal, NamedTuple

import numpy as np
import pandas as pd
from joblib import delayed as task

from compensation import InertiaModel, PlatformPose, commanded_pose, fit_inertia, to_lab
from compensation.protocol import DURATIONS_S, PLATFORM_KINDS
from hbm.body import build_body
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.ik.tracking import solve_ik
from hbm.signals.filtering import Method, butterworth, low_pass
from hbm.signals.resampling import resample
from hbm.spatial import Array, Mask, shift_wrench, transform_wrench
from pipeline.io.recording import Recording
from pipeline.io.units import acceleration_in_mps2
from pipeline.run.processes import in_processes
from pipeline.trial.residuals import AXES, UNITS
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    ANALOG_HZ,
    PITCH_CHANNEL,
    SAMPLES_PER_FRAME,
    SWAY_CHANNEL,
    Clock,
    InstrumentedTreadmill,
    make_treadmill,
    misplaced,
    undergo,
)
from pipeline.virtual_lab.machine.platform import Machine, TreadmillMotion
from pipeline.virtual_lab.machine.structure import Response
from pipeline.virtual_lab.person.walk import Walk
from pipeline.virtual_lab.protocol.walking_protocol import MOTION, ConditionName, Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import (
    person_loads,
    record,
    run_calibration,
    run_walk,
    study_subject,
)
from tests.validation.true_body import true_body

SHORT: Final = Protocol(
    subjects=3, baseline_s=40.0, pitch_s=60.0, waits_s=(12.0, 12.0, 12.0, 12.0), beside_s=0.0
)
"""Shorter trials of three subjects: enough of every condition to compare instruments."""
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
    """Record a walk with a case's instruments, process it, and give the residual, (T, 6) [N, N·m].

    In lab axes about mid-hip, at the markers' times; ``models`` are one per plate, if the removal
    is "calibrated".
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
            plate_clock, unused = Clock(faults.delays_s[k]), np.random.default_rng()
            late = misplaced(plate_clock.sample(known[k], ANALOG_HZ, unused), faults)
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


TRANSPARENT_HZ: Final = 30.0
"""Cut-off frequency that passes all of walking: what it leaves is below 0.1 N."""
EDGE_S: Final = 1.0
"""Time at both ends of steady walking that is not counted: the settling of the filters."""
DELAYS_S: Final = (0.010, 0.030)
PIVOT_ERROR_M: Final = 0.05
"""Delays of the plates and of the platform's pose, and error of the height of its axis, that are
compared: one and three frames, and an error of measurement; assumed."""
NOISE_STREAM: Final = 9
"""Number of the random numbers of the noise, which is the same in all cases."""
FILTER: Final = "filter"
"""The group of cases that are compared with `TRANSPARENT_HZ`."""


def _with(**parts: dict[str, float]) -> Faults:
    """Give a perfect laboratory but for some values, by table."""
    perfect = Faults.none()
    return perfect.model_copy(
        update={
            table: getattr(perfect, table).model_copy(update=values)
            for table, values in parts.items()
        }
    )


def cases() -> dict[str, dict[str, Case]]:
    """Give the cases by group, in the order of the table; faults have their default sizes."""
    default, noise = Faults(), {"noise_scale": 1.0}
    short, long = ({"delay_s": delay_s} for delay_s in DELAYS_S)
    pivot = {"pivot_error_m": PIVOT_ERROR_M}
    return {
        FILTER: {
            f"zero phase, {TRANSPARENT_HZ:g} Hz": Case(cutoff_hz=TRANSPARENT_HZ),
            "zero phase, 6 Hz": Case(),
            "real time, 6 Hz": Case(method="realtime"),
        },
        "person and cameras": {
            "joints and inertias, same model": _of_body(joint_scale=1.0, segment_scale=1.0),
            "other segment inertias": _of_body(inertias="dumas"),
            "trunk that bends": _of_body(spine_scale=1.0),
            "knees and ankles no hinges": _of_body(knee_scale=1.0, ankle_scale=1.0),
            "shoes": _of_body(shoe_scale=1.0),
            "soft tissue: wobbling masses": _of_body(wobble_scale=1.0),
            "soft tissue: skin": Case(faults=_with(cameras={"skin_scale": 1.0})),
            "other body": Case(faults=_with(body=dict(default.body)), body_from_markers=True),
            "marker noise 0.3 mm": Case(faults=_with(cameras={"noise_m": 0.0003})),
            "2 marker gaps a minute": Case(faults=_with(cameras={"gaps_per_minute": 2.0})),
        },
        "plates": {
            "noise 1.1 N": Case(faults=_with(plates=noise)),
            "cross-talk and curvature 0.2 %": Case(faults=_with(plates={"gain_scale": 1.0})),
            "zero error 2 N, shift and drift": Case(faults=_with(plates={"zero_scale": 1.0})),
            f"delay {1e3 * DELAYS_S[0]:g} ms": Case(
                faults=_with(plates=short, accelerometers=short)
            ),
            f"delay {1e3 * DELAYS_S[1]:g} ms": Case(faults=_with(plates=long, accelerometers=long)),
        },
        "platform's pose": {
            f"pose delay {1e3 * DELAYS_S[0]:g} ms": Case(
                faults=_with(platform=short), pose_from_channels=True
            ),
            f"pose delay {1e3 * DELAYS_S[1]:g} ms": Case(
                faults=_with(platform=long), pose_from_channels=True
            ),
            f"pivot error {1e2 * PIVOT_ERROR_M:g} cm": Case(
                faults=_with(platform=pivot), pose_from_channels=True
            ),
        },
        "compensation, what it meets": {
            "rigid treadmill": _calibrated(rigid=True),
            "platform flexes, people shake it": _calibrated(),
            "clocks": _calibrated(rigid=True, clocks=True),
        },
        "compensation, number of accelerometers": {
            "1 accelerometer": _calibrated(sensors=1),
            "2 accelerometers": _calibrated(sensors=2),
            "4 accelerometers": _calibrated(sensors=4),
        },
        "compensation, calibrated on": {
            f"{kind.replace('_', ' ')}, {seconds} s": _calibrated(f"{kind}_{seconds}s_3mps")
            for seconds, kind in product(DURATIONS_S, PLATFORM_KINDS)
        },
        "all together": {
            "no compensation, no other fault": Case(removal="none"),
            "all faults, no compensation": Case(
                faults=default, body_from_markers=True, removal="none"
            ),
            "all faults, compensated": Case(
                faults=default, body_from_markers=True, removal="calibrated"
            ),
        },
    }


def _of_body(**scales: float | str) -> Case:
    """Give a case whose body has some properties that a body built from its markers has not."""
    own = dict(Faults.none().body) | {"same_body": False} | scales
    faults = Faults.none().model_copy(update={"body": BodyFaults(**own)})
    return Case(faults=faults, body_from_markers=True)


def _calibrated(
    signal: str | None = None, sensors: int = 2, *, rigid: bool = False, clocks: bool = False
) -> Case:
    """Give a case whose plates and accelerometers have noise, and a compensation fitted to them.

    All instruments have one clock, or with ``clocks`` their own, with their own delays.
    """
    default = Faults()
    plates = {"noise_scale": 1.0}
    accelerometers = dict(default.accelerometers) | {"sensors": sensors}
    if clocks:
        plates |= {key: getattr(default.plates, key) for key in ("delay_s", "right_later_s")}
    else:
        accelerometers["delay_s"] = 0.0
    faults = _with(
        plates=plates,
        accelerometers=accelerometers,
        machine={} if rigid else dict(default.machine),
        clocks={"scale": float(clocks)},
    )
    return Case(faults=faults, removal="calibrated", calibration=signal)


def ablation(
    setting: Setting | None = None,
    subjects: int = 3,
    names: Sequence[str] | None = None,
    jobs: int = 1,
) -> pd.DataFrame:
    """Quantify what each fault adds to each residual in each condition.

    Gives ``group, case, condition, axis, unit, rms, added``, both in N or N·m, root mean squares
    over samples and subjects. ``added`` is the RMS of the difference from the residual of the same
    steps, with the body that the processing knows, in a perfect laboratory with the zero-phase
    filter at 6 Hz or, for filters, at `TRANSPARENT_HZ`. In sway, the gait cycles of the
    perturbations count. The setting's faults are not used: every case has its own.
    """
    setting = setting or Setting(protocol=SHORT)
    table = [
        (group, name, case)
        for group, own in cases().items()
        for name, case in own.items()
        if names is None or name in names
    ]
    tasks = [task(_of_case)(setting, group, case, subjects) for group, _, case in table]
    rows = []
    for (group, name, _), squares in zip(
        table, in_processes(tasks, jobs, ordered=True), strict=True
    ):
        for condition, (rms, added) in squares.items():
            for k, (axis, unit) in enumerate(zip(AXES, UNITS, strict=True)):
                rows.append((group, name, condition, axis, unit, rms[k], added[k]))
    columns = ["group", "case", "condition", "axis", "unit", "rms", "added"]
    return pd.DataFrame(rows, columns=columns)


def _of_case(
    setting: Setting, group: str, case: Case, subjects: int
) -> dict[str, tuple[Array, Array]]:
    """Give a case's RMS and added RMS over all subjects, by condition."""
    own = [_of_subject(setting, group, case, number) for number in range(subjects)]
    return {
        condition: tuple(np.sqrt(np.mean([p[condition] for p in own], axis=0)))
        for condition in setting.protocol.conditions
    }


def _of_subject(
    setting: Setting, group: str, case: Case, number: int
) -> dict[str, tuple[Array, Array]]:
    """Give mean squares of the residual and of what is added, of one subject, by condition."""
    treadmill = make_treadmill(case.faults, setting.seed)
    models = _models(setting, case) if case.removal == "calibrated" else ()
    reference = TRANSPARENT_HZ if group == FILTER else Case().cutoff_hz
    squares: dict[str, tuple[Array, Array]] = {}
    for condition in setting.protocol.conditions:
        key = _WalkKey(setting.seed, setting.protocol, case.faults.body, number, condition)
        walk, motion = _walk(key)
        rng = np.random.default_rng((setting.seed, number, NOISE_STREAM))
        residual = residual_of(case, walk, motion, treadmill, rng, models)
        ideal = _ideal_residual(key._replace(body=Faults.none().body), reference)
        counts = _counting_frames(setting.protocol, motion, walk)
        whole, added = (np.nanmean(x[counts] ** 2, axis=0) for x in (residual, residual - ideal))
        squares[condition] = np.asarray(whole), np.asarray(added)
    return squares


class _WalkKey(NamedTuple):
    """What a walk depends on: of the faults, only those of the body."""

    seed: int
    protocol: Protocol
    body: BodyFaults
    number: int
    condition: ConditionName


@lru_cache(maxsize=64)
def _walk(key: _WalkKey) -> tuple[Walk, TreadmillMotion]:
    faults = Faults.none().model_copy(update={"body": key.body})
    setting = Setting(seed=key.seed, protocol=key.protocol, faults=faults)
    return run_walk(
        setting, Machine(), study_subject(setting, key.number), key.number, key.condition
    )


@lru_cache(maxsize=64)
def _ideal_residual(key: _WalkKey, cutoff_hz: float) -> Array:
    """Give the residual of a walk in a perfect laboratory."""
    walk, motion = _walk(key)
    perfect = make_treadmill(Faults.none(), key.seed)
    return residual_of(Case(cutoff_hz=cutoff_hz), walk, motion, perfect, np.random.default_rng(0))


@lru_cache(maxsize=1)
def _models(setting: Setting, case: Case) -> tuple[InertiaModel, ...]:
    """Calibrate on the case's signal, or on the protocol's."""
    if case.calibration is not None:
        named = setting.protocol.model_copy(update={"calibration": case.calibration})
        setting = setting.model_copy(update={"protocol": named})
    treadmill = make_treadmill(case.faults, setting.seed)
    return fit_models(treadmill, run_calibration(setting, treadmill))


def _counting_frames(protocol: Protocol, motion: TreadmillMotion, walk: Walk) -> Mask:
    """Give the frames that count: steady walking, or the perturbed gait cycles, (T,)."""
    time = motion.time[::SAMPLES_PER_FRAME]
    inside = (time > protocol.steady_s + EDGE_S) & (time < time[-1] - EDGE_S)
    if len(motion.onsets):
        stride = 2 * walk.placement.step_s
        since = time[:, None] - motion.onsets + MOTION.onset * stride
        inside = inside & ((since >= 0) & (since < stride)).any(axis=1)
    return np.asarray(inside, bool)
