"""What each fault of a laboratory adds to each residual, one fault at a time."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import product
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from compensation import InertiaModel
from compensation.protocol import DURATIONS_S, PLATFORM_KINDS
from hbm.markers import did_you_mean
from hbm.spatial import Array, Mask
from pipeline.residuals import AXES, UNITS
from pipeline.virtual_lab.assess import Case, fit_models, residual_of
from pipeline.virtual_lab.bench import PER_FRAME, Bench, make_bench
from pipeline.virtual_lab.course import Course
from pipeline.virtual_lab.experiment import run_calibration, run_walk, walker_of
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.machine import Machine
from pipeline.virtual_lab.protocol import ONSET, SHORT, Condition, Protocol, Setting
from pipeline.virtual_lab.walk import Walk

CONDITIONS: Final[tuple[Condition, ...]] = ("baseline", "sway", "pitch")
TRANSPARENT_HZ: Final = 30.0
EDGE_S: Final = 1.0
CALIBRATED: Final = "calibrated on "
Progress = Callable[[str, int, int], None]


def _with(**parts: dict[str, float]) -> Faults:
    """Give a perfect laboratory but for the values named, table by table."""
    perfect = Faults.none()
    return perfect.model_copy(
        update={
            table: getattr(perfect, table).model_copy(update=values)
            for table, values in parts.items()
        }
    )


def cases() -> dict[str, Case]:
    """Give the cases in the order of the table; the sizes of faults are their defaults."""
    usual = Faults()
    plates, sensors = usual.plates, usual.accelerometers
    late = {
        ms: _with(plates={"delay_s": ms / 1000}, accelerometers={"delay_s": ms / 1000})
        for ms in (10, 30)
    }
    noisy = _with(
        plates={"force_noise_n": plates.force_noise_n, "moment_noise_nm": plates.moment_noise_nm}
    )
    table = {
        f"nothing, filter {TRANSPARENT_HZ:g} Hz": Case(cutoff_hz=TRANSPARENT_HZ),
        "filter 6 Hz": Case(),
        "filter 6 Hz, real time": Case(method="realtime"),
        "body from markers": Case(faults=_with(body=dict(usual.body)), built_body=True),
        "skin": Case(faults=_with(cameras={"skin_scale": usual.cameras.skin_scale})),
        "camera noise": Case(faults=_with(cameras={"noise_m": usual.cameras.noise_m})),
        "plate noise": Case(faults=noisy),
        "plate cross-talk": Case(faults=_with(plates={"cross_talk": plates.cross_talk})),
        "plate zero": Case(
            faults=_with(
                plates={"offset_n": plates.offset_n, "drift_n_per_min": plates.drift_n_per_min}
            )
        ),
        "plates 10 ms late": Case(faults=late[10]),
        "plates 30 ms late": Case(faults=late[30]),
        "pose 10 ms late": Case(faults=_with(platform={"delay_s": 0.010}), told_pose=True),
        "pose 30 ms late": Case(faults=_with(platform={"delay_s": 0.030}), told_pose=True),
        "pivot 5 cm off": Case(faults=_with(platform={"pivot_error_m": 0.05}), told_pose=True),
    }
    accelerometer = dict(sensors) | {"delay_s": 0.0}
    unsure = noisy.model_copy(update={"accelerometers": sensors.model_copy(update=accelerometer)})
    for seconds, kind in product(DURATIONS_S, PLATFORM_KINDS):
        name = f"{CALIBRATED}{kind}_{seconds}s_3mps"
        table[name] = Case(faults=unsure, removal="calibrated")
    return table | {
        "no compensation": Case(removal="none"),
        "all faults, compensated": Case(faults=usual, built_body=True, removal="calibrated"),
        "all faults, no compensation": Case(faults=usual, built_body=True, removal="none"),
    }


def ablation(
    setting: Setting | None = None,
    subjects: int = 3,
    names: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Find what each fault adds to each residual in each condition.

    Parameters
    ----------
    setting
        Protocol and seed; by default short trials of the thesis' protocol. Its faults are not
        used: every case has its own.
    subjects
        How many people walk.
    names
        Which of the `cases`; by default all.
    progress
        Told the case, how many are done, and how many there are.

    Returns
    -------
    pandas.DataFrame
        Long: ``case, condition, axis, unit, rms, added``; both in N or N·m, root mean squares over
        samples and subjects. ``added`` is the RMS of the difference from the residual of the same
        walk in a perfect laboratory with the zero-phase filter at 6 Hz; for filters, with one that
        passes all of walking.

    Raises
    ------
    ValueError
        If a name is none of the cases.

    Notes
    -----
    In every case but the named one the true body, the true pose and the true wrench of the
    treadmill are known. Sway counts the gait cycles of the perturbations.
    """
    setting = setting or Setting(protocol=SHORT)
    table = _chosen(names)
    squares: dict[tuple[str, str], list[tuple[Array, Array]]] = {}
    for done, (name, case) in enumerate(table.items()):
        for subject in range(subjects):
            for condition, (rms, added) in _one(setting, name, case, subject).items():
                key = name, condition
                squares.setdefault(key, []).append((rms**2, added**2))
        if progress is not None:
            progress(name, done + 1, len(table))
    rows = [
        (name, condition, axis, unit, rms[k], added[k])
        for (name, condition), found in squares.items()
        for rms, added in [np.sqrt(np.mean(found, axis=0))]
        for k, (axis, unit) in enumerate(zip(AXES, UNITS, strict=True))
    ]
    return pd.DataFrame(rows, columns=["case", "condition", "axis", "unit", "rms", "added"])


def _chosen(names: Sequence[str] | None) -> dict[str, Case]:
    table = cases()
    for name in names or ():
        if name not in table:
            raise ValueError(f"no case {name!r}{did_you_mean(name, table)}; {', '.join(table)}")
    return {name: case for name, case in table.items() if names is None or name in names}


def _one(setting: Setting, name: str, case: Case, subject: int) -> dict[str, tuple[Array, Array]]:
    """Give RMS and added RMS of one case and person, by condition."""
    bench = make_bench(case.faults, setting.seed)
    models = _models(setting, bench, name) if case.removal == "calibrated" else ()
    of_filter = name.startswith(("nothing", "filter"))
    reference = Case() if not of_filter else Case(cutoff_hz=TRANSPARENT_HZ)
    found: dict[str, tuple[Array, Array]] = {}
    for condition in CONDITIONS:
        who = _Who(setting.seed, setting.protocol, case.faults.body, subject, condition)
        walk, course = _walked(who)
        rng = np.random.default_rng((setting.seed, subject, 9))
        left = residual_of(case, walk, course, bench, rng, models)
        ideal = _ideal(who, reference.cutoff_hz)
        counts = _counted(setting.protocol, course, walk)
        rms, added = (np.sqrt(np.nanmean(x[counts] ** 2, axis=0)) for x in (left, left - ideal))
        found[condition] = np.asarray(rms), np.asarray(added)
    return found


class _Who(NamedTuple):
    """Who walks: only the body's faults change the walk itself."""

    seed: int
    protocol: Protocol
    body: BodyFaults
    subject: int
    condition: Condition


@lru_cache(maxsize=64)
def _walked(who: _Who) -> tuple[Walk, Course]:
    faults = Faults.none().model_copy(update={"body": who.body})
    setting = Setting(seed=who.seed, protocol=who.protocol, faults=faults)
    return run_walk(setting, Machine(), walker_of(setting, who.subject), who.subject, who.condition)


@lru_cache(maxsize=64)
def _ideal(who: _Who, cutoff_hz: float) -> Array:
    """Give the residual of a walk in a perfect laboratory."""
    walk, course = _walked(who)
    perfect = make_bench(Faults.none(), who.seed)
    return residual_of(Case(cutoff_hz=cutoff_hz), walk, course, perfect, np.random.default_rng(0))


def _models(setting: Setting, bench: Bench, name: str) -> tuple[InertiaModel, ...]:
    """Calibrate on the signal that the case names, or on the protocol's."""
    if name.startswith(CALIBRATED):
        named = {"calibration": name.removeprefix(CALIBRATED)}
        protocol = setting.protocol.model_copy(update=named)
        setting = setting.model_copy(update={"protocol": protocol})
    return fit_models(bench, run_calibration(setting, bench))


def _counted(protocol: Protocol, course: Course, walk: Walk) -> Mask:
    """Tell which frames count: steady walking, or the perturbed gait cycles, (T,)."""
    time = course.time[::PER_FRAME]
    inside = (time > protocol.steady_s + EDGE_S) & (time < time[-1] - EDGE_S)
    if len(course.onsets):
        stride = 2 * walk.footing.pace_s
        since = time[:, None] - course.onsets + ONSET * stride
        inside = inside & ((since >= 0) & (since < stride)).any(axis=1)
    return np.asarray(inside, bool)
