"""What each fault of a laboratory adds to each residual, one fault at a time."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from joblib import delayed

from compensation import InertiaModel
from compensation.protocol import DURATIONS_S, PLATFORM_KINDS
from hbm.kernels.native import kernels
from hbm.spatial import Array, Mask
from hbm.spelling import did_you_mean
from pipeline.run.processes import in_processes
from pipeline.trial.residuals import AXES, UNITS
from pipeline.virtual_lab.analysis.idealised_processing import Case, fit_models, residual_of
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.machine.instruments.sampling import SAMPLES_PER_FRAME
from pipeline.virtual_lab.machine.treadmill import Machine, TreadmillMotion
from pipeline.virtual_lab.person.walk import Walk
from pipeline.virtual_lab.protocol.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.walking_protocol import (
    ANALYSED_CONDITIONS,
    ONSET_PHASE,
    SHORT,
    ConditionName,
    Protocol,
    Setting,
)
from pipeline.virtual_lab.protocol.walking_study import ProgressCallback
from pipeline.virtual_lab.protocol.walking_trial import run_calibration, run_walk, study_subject

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
SAME_MODEL: Final = ("joint_scale", "axis_deg", "mass_share", "center_m", "gyration_share")
"""Faults of bodies that the Human Body Model can represent: it has the wrong values for them."""
SCALES: Final = ("spine_scale", "knee_scale", "ankle_scale", "wobble_scale")
SHOES: Final = ("shoe_kg", "sole_m", "sole_yield_m")
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
    default = Faults()
    body, cameras, plates = default.body, default.cameras, default.plates
    machine, clocks = default.machine, dict(default.clocks)
    noise = {"force_noise_n": plates.force_noise_n, "moment_noise_nm": plates.moment_noise_nm}
    zero = {"offset_n": plates.offset_n, "drift_n_per_min": plates.drift_n_per_min}
    gaps = {"gaps_per_minute": cameras.gaps_per_minute, "gap_s": cameras.gap_s}
    short, long = ({"delay_s": delay_s} for delay_s in DELAYS_S)
    pivot = {"pivot_error_m": PIVOT_ERROR_M}
    return {
        FILTER: {
            f"zero phase, {TRANSPARENT_HZ:g} Hz": Case(cutoff_hz=TRANSPARENT_HZ),
            "zero phase, 6 Hz": Case(),
            "real time, 6 Hz": Case(method="realtime"),
        },
        "person and cameras": {
            "joints and inertias, same model": _of_body(
                **{key: getattr(body, key) for key in SAME_MODEL}
            ),
            "other segment inertias": _of_body(inertias=body.inertias),
            "trunk that bends": _of_body(spine_scale=body.spine_scale),
            "knees and ankles no hinges": _of_body(
                knee_scale=body.knee_scale, ankle_scale=body.ankle_scale
            ),
            "shoes": _of_body(**{key: getattr(body, key) for key in SHOES}),
            "soft tissue: wobbling masses": _of_body(wobble_scale=body.wobble_scale),
            "soft tissue: skin": Case(faults=_with(cameras={"skin_scale": cameras.skin_scale})),
            "other body": Case(faults=_with(body=dict(body)), body_from_markers=True),
            f"marker noise {1e3 * cameras.noise_m:g} mm": Case(
                faults=_with(cameras={"noise_m": cameras.noise_m})
            ),
            f"{cameras.gaps_per_minute:g} marker gaps a minute": Case(faults=_with(cameras=gaps)),
        },
        "plates": {
            f"noise {plates.force_noise_n:g} N": Case(faults=_with(plates=noise)),
            f"cross-talk {plates.cross_talk:.1%}": Case(
                faults=_with(plates={"cross_talk": plates.cross_talk})
            ),
            f"zero error {plates.offset_n:g} N, and drift": Case(faults=_with(plates=zero)),
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
            "rigid treadmill": _calibrated(machine={}),
            "platform flexes": _calibrated(machine=dict(machine) | {"people_shake": 0.0}),
            "people shake it": _calibrated(),
            "clocks": _calibrated(machine={}, clocks=clocks),
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


def _of_body(**values: float | str) -> Case:
    """Give a case whose body has some properties that a body built from its markers has not."""
    none = {key: value for key, value in dict(Faults.none().body).items() if key in SAME_MODEL}
    absent = dict.fromkeys(SCALES, 0.0) | dict.fromkeys(SHOES, 0.0) | {"inertias": "de_leva"}
    own = BodyFaults(same_body=False, **(none | absent | values))
    faults = Faults.none().model_copy(update={"body": own})
    return Case(faults=faults, body_from_markers=True)


def _calibrated(
    signal: str | None = None,
    sensors: int = 2,
    machine: dict[str, float] | None = None,
    clocks: dict[str, float] | None = None,
) -> Case:
    """Give a case whose plates and accelerometers have noise, and a compensation fitted to them.

    By default the machine is the laboratory's; ``{}`` is a rigid one. All instruments have one
    clock but for ``clocks``, with which they have their own delays too.
    """
    default = Faults()
    plates = {"force_noise_n": default.plates.force_noise_n}
    plates |= {"moment_noise_nm": default.plates.moment_noise_nm}
    accelerometers = dict(default.accelerometers) | {"sensors": sensors}
    if clocks is None:
        accelerometers["delay_s"] = 0.0
    else:
        plates |= {key: getattr(default.plates, key) for key in ("delay_s", "right_later_s")}
    faults = _with(
        plates=plates,
        accelerometers=accelerometers,
        machine=dict(default.machine) if machine is None else machine,
        clocks=clocks or {},
    )
    return Case(faults=faults, removal="calibrated", calibration=signal)


def ablation(
    setting: Setting | None = None,
    subjects: int = 3,
    names: Sequence[str] | None = None,
    progress: ProgressCallback | None = None,
    jobs: int = 1,
) -> pd.DataFrame:
    """Quantify what each fault adds to each residual in each condition.

    Parameters
    ----------
    setting
        Protocol and seed; by default short trials of the thesis' protocol. Its faults are not
        used: every case has its own.
    subjects
        Number of simulated subjects.
    names
        Which of the `cases`; by default all.
    progress
        Called after every case with its name, the number of cases done, and of all cases.
    jobs
        Number of processes.

    Returns
    -------
    pandas.DataFrame
        Long: ``group, case, condition, axis, unit, rms, added``; both in N or N·m, root mean
        squares over samples and subjects. ``added`` is the RMS of the difference from the residual
        of the same steps, with the body that the processing knows, in a perfect laboratory with the
        zero-phase filter at 6 Hz or, for filters, at `TRANSPARENT_HZ`.

    Raises
    ------
    ValueError
        If there is no case of a name.

    Notes
    -----
    The true body, the true pose of the platform and the true wrench of the treadmill are known,
    unless the case states otherwise. In sway, the gait cycles of the perturbations count.
    """
    setting = setting or Setting(protocol=SHORT)
    table = _selected(names)
    kernels()  # compiled once before the processes start
    tasks = [delayed(_of_case)(setting, group, case, subjects) for group, _, case in table]
    found = in_processes(tasks, jobs, ordered=True)
    rows = []
    for done, ((group, name, _), squares) in enumerate(zip(table, found, strict=True), start=1):
        for condition, (rms, added) in squares.items():
            for k, (axis, unit) in enumerate(zip(AXES, UNITS, strict=True)):
                rows.append((group, name, condition, axis, unit, rms[k], added[k]))
        if progress is not None:
            progress(name, done, len(table))
    columns = ["group", "case", "condition", "axis", "unit", "rms", "added"]
    return pd.DataFrame(rows, columns=columns)


def _selected(names: Sequence[str] | None) -> list[tuple[str, str, Case]]:
    table = [(group, name, case) for group, own in cases().items() for name, case in own.items()]
    known = [name for _, name, _ in table]
    for name in names or ():
        if name not in known:
            raise ValueError(f"no case {name!r}{did_you_mean(name, known)}; {', '.join(known)}")
    return [row for row in table if names is None or row[1] in names]


def _of_case(
    setting: Setting, group: str, case: Case, subjects: int
) -> dict[str, tuple[Array, Array]]:
    """Give a case's RMS and added RMS over all subjects, by condition."""
    own = [_of_subject(setting, group, case, number) for number in range(subjects)]
    return {
        condition: tuple(np.sqrt(np.mean([p[condition] for p in own], axis=0)))
        for condition in ANALYSED_CONDITIONS
    }


def _of_subject(
    setting: Setting, group: str, case: Case, number: int
) -> dict[str, tuple[Array, Array]]:
    """Give mean squares of the residual and of what is added, of one subject, by condition."""
    treadmill = make_treadmill(case.faults, setting.seed)
    models = _models(setting, case) if case.removal == "calibrated" else ()
    reference = TRANSPARENT_HZ if group == FILTER else Case().cutoff_hz
    squares: dict[str, tuple[Array, Array]] = {}
    for condition in ANALYSED_CONDITIONS:
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
        since = time[:, None] - motion.onsets + ONSET_PHASE * stride
        inside = inside & ((since >= 0) & (since < stride)).any(axis=1)
    return np.asarray(inside, bool)
