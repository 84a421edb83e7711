"""What the published compensation and ours leave of an empty plate (published_compensation.md).

Two judges that share no mechanics with what compensates: a treadmill of point masses on springs,
and the virtual laboratory. Nobody is on the left plate, so that all that is left is error.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import chain, product
from multiprocessing import Pool
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.signal import butter, lfilter, sosfiltfilt
from scipy.stats import binom

from compensation import Calibration, fit_belt
from hbm.signals.samples import mean_rate_hz
from hbm.spatial import Array, Mask, transform_wrench
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import accelerations, find_accelerometers
from pipeline.trial.ground.calibrations import fit_calibration, plate_samples
from pipeline.virtual_lab.machine import instrumented_treadmill as instruments
from pipeline.virtual_lab.machine.belts import identified_drive
from pipeline.virtual_lab.machine.platform import Machine
from pipeline.virtual_lab.person.body import segment_poses
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_walk, study_subject
from tests import flexible_treadmill
from tests.campaign.inertia_intervals import Session, session
from tests.virtual_gait.realism import steady
from tests.virtual_machine import belt_recording as belt

SEEDS: Final = range(9200, 9220)
"""Reserved for the page: never used while anything was developed."""
MACHINES: Final = ("stiff", "soft")
FLEXIBILITY: Final = {
    "point masses on springs": dict(zip(MACHINES, (0.25, 1.0), strict=True)),
    "virtual laboratory": dict(zip(MACHINES, (1.0, 4.0), strict=True)),
}
"""By judge; the lowest natural frequencies are then about 13 and 6.5 Hz in both."""
SENSORS: Final = (2, 4)
NONE, PUBLISHED, PUBLISHED_20, STATIC, DYNAMIC, CHOSEN = METHODS = (
    "no compensation",
    "published, fitted below 6 Hz",
    "published, fitted below 20 Hz",
    "ours, static, signal alone",
    "ours, dynamic, people recorded",
    "ours, automatic, people recorded",
)
TRIALS: Final = ("sway", "pitch", "running", "boarding")
"""The first two with a walker beside the empty plate."""
CUTOFF_HZ: Final = 6.0
RATE_HZ: Final = 100.0
"""Of the virtual laboratory's recordings, as of the published ones, and of the walker."""
SIZES: Final = ["force", "moment", "pelvis_moment", "hip", "ankle"]
SETUP: Final = ["judge", "machine", "zeros", "sensors", "trial"]


def flexible(seed: int, flexibility: float, drifts: bool) -> Session:
    """Record the treadmill of point masses on springs, with zeros that shift and drift, or not."""
    machine = flexible_treadmill.FlexibleTreadmill(seed, flexibility)
    rng = np.random.default_rng((seed, 1))
    # of the zero: from recording to recording [N, N·m], and within one [N/s, N·m/s]
    scale = drifts * instruments.ERROR_SCALE
    drift = instruments.PLATE.drift / 60 * scale * rng.normal(size=6)

    def record(name: str, **motion: Any) -> Recording:
        one = machine.record(int(rng.integers(2**31)), **motion)
        time = np.arange(len(one.left)) / flexible_treadmill.RATE_HZ
        shift = instruments.PLATE.zero_shift * scale * rng.normal(size=6)
        drifted = replace(one, left=one.left + shift + drift * time[:, None])
        return flexible_treadmill.as_recording(f"{name}.c3d", drifted)

    walking, running, boards = people = ("walking", "running", "boards")
    return Session(
        record("signal", sway=0.7, pitch=2.2, highest_hz=5.0, seconds=60.0),
        [record(person, person=person) for person in people],
        {
            "sway": record("sway", sway=0.5, person=walking),
            "pitch": record("pitch", pitch=1.0, person=walking),
            "running": record("other running", person=running),
            "boarding": record("other boards", person=boards),
        },
    )


def virtual(seed: int, flexibility: float, drifts: bool) -> Session:
    """Record the virtual laboratory, whose zeros shift and drift, or not."""
    return session(seed, RATE_HZ, flexibility, zero_scale=float(drifts))


JUDGES: Final[dict[str, Callable[[int, float, bool], Session]]] = {
    "point masses on springs": flexible,
    "virtual laboratory": virtual,
}


def slow(signal: Array, rate_hz: float, cutoff_hz: float = CUTOFF_HZ) -> Array:
    """Low-pass without delay, and leave out a second at both ends."""
    passed = sosfiltfilt(butter(2, cutoff_hz, fs=rate_hz, output="sos"), signal, axis=0)
    return np.asarray(passed[round(rate_hz) : -round(rate_hz)])


def published_samples(
    recording: Recording, stated: Treadmill, cutoff_hz: float = CUTOFF_HZ
) -> tuple[Array, Array, float]:
    """Give readings with a constant (N, k + 1), the left plate's wrench (N, 6), and their rate.

    Low-passed, at the instants that their stamps say, whatever their delays.
    """
    plate, (clock, readings) = recording.plates[0], accelerations(recording, stated)
    rate_hz = mean_rate_hz(plate.time)
    felt = np.column_stack([np.interp(plate.time, clock, channel) for channel in readings.T])
    felt, wrench = (slow(x, rate_hz, cutoff_hz) for x in (felt, plate.wrench_in_plate))
    return np.column_stack([felt, np.ones(len(felt))]), wrench, rate_hz


def published_matrix(felt: Array, wrench: Array) -> Array:
    """Solve ``C = A \\ F`` (van de Loosdrecht 2018, eq. 2; Hnat et al. 2018, with a constant)."""
    return np.asarray(np.linalg.lstsq(felt, wrench)[0])


def with_people(signal: Recording, stated: Treadmill, beside: Sequence[Recording]) -> Calibration:
    """Fit ours to people too, but for recordings that the program refuses, which are printed."""
    try:
        return fit_calibration(signal, stated, None, beside)
    except ValueError as error:
        print(error)
        kept = [one for one in beside if not str(error).startswith(str(one.source))]
        if len(kept) == len(beside):
            raise
        return with_people(signal, stated, kept)


def left_over(made: Session, sensors: int) -> dict[tuple[str, str], tuple[Array, float]]:
    """Give what each method leaves of the empty plate, by trial: (N, 6) in its axes, and rate."""
    signal, beside, trials = made
    stated = Treadmill(accelerometers=dict(list(find_accelerometers(signal).items())[:sensors]))
    published = {
        method: published_matrix(*published_samples(signal, stated, cutoff_hz)[:2])
        for method, cutoff_hz in ((PUBLISHED, CUTOFF_HZ), (PUBLISHED_20, 20.0))
    }
    chosen, static = with_people(signal, stated, beside), fit_calibration(signal, stated)
    dynamic = stated.model_copy(update={"inertia_model": "dynamic"})
    forced = chosen if chosen.dynamic else with_people(signal, dynamic, beside)
    ours = {STATIC: static, DYNAMIC: forced, CHOSEN: chosen}
    left = {}
    for trial, recording in trials.items():
        felt, wrench, rate_hz = published_samples(recording, stated)
        left[trial, NONE] = wrench, rate_hz
        for method, matrix in published.items():
            left[trial, method] = wrench - felt @ matrix, rate_hz
        for method, calibration in ours.items():
            model = calibration.in_use["plate 1"]
            samples = plate_samples(recording, stated, calibration.sensors, None, model.lags_s)
            left[trial, method] = slow(model.compensate(*samples["plate 1"]), rate_hz), rate_hz
    return left


class Walker(NamedTuple):
    """A simulated walker: mid-hip, left hip and left ankle (T, 3) [m] at 100 Hz, stance (T,)."""

    mass_kg: float
    pelvis: Array
    hip: Array
    ankle: Array
    stance: Mask


@cache
def walker() -> Walker:
    """Give 17 s of level walking of the first simulated subject."""
    subject = study_subject(Setting(), 0)
    setting = Setting(protocol=Protocol(baseline_s=30.0))
    walk, _ = run_walk(setting, Machine(), subject, 0, "baseline")
    time = steady(walk)
    names = ["pelvis", "left_thigh", "left_foot"]
    joints = [
        origin for _, origin in segment_poses(subject.skeleton, walk.motion.at(time).T, names)
    ]
    return Walker(subject.person.mass_kg, *joints, walk.placement.left_share(time) > 0)


def felt_by(person: Walker, error: Array, rate_hz: float) -> dict[str, float]:
    """Give what an error of the left plate, (N, 6) about the lab origin, adds, RMS.

    The residual takes it as it is, about mid-hip [N·m]. The left hip and ankle take it in stance,
    by body mass [N·m/kg]: inverse dynamics is linear in the ground's wrench.
    """
    at = np.arange(0, (len(error) - 1) / rate_hz, 1 / RATE_HZ)
    stamps = np.arange(len(error)) / rate_hz
    wrench = np.column_stack([np.interp(at, stamps, component) for component in error.T])
    frame = np.arange(len(at)) % len(person.stance)
    about = {  # moment about a joint: M - r x F
        name: wrench[:, 3:] - np.cross(getattr(person, name)[frame], wrench[:, :3])
        for name in ("pelvis", "hip", "ankle")
    }
    standing = person.stance[frame]
    return {
        "pelvis_moment": size(about["pelvis"]),
        "hip": size(about["hip"][standing]) / person.mass_kg,
        "ankle": size(about["ankle"][standing]) / person.mass_kg,
    }


def size(vectors: Array) -> float:
    """Give the root mean square of the length of vectors, (N, 3)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def judge(judge_name: str, machine: str, drifts: bool, seed: int) -> list[dict[str, Any]]:
    """Give a row per number of accelerometers, trial and method for one laboratory."""
    made, rows = JUDGES[judge_name](seed, FLEXIBILITY[judge_name][machine], drifts), []
    plate, zeros = made.signal.plates[0], "drift" if drifts else "stay"
    for sensors in SENSORS:
        for (trial, method), (left, rate_hz) in left_over(made, sensors).items():
            in_lab = transform_wrench(left, plate.rotation, plate.center)
            key = dict(zip(SETUP, (judge_name, machine, zeros, sensors, trial), strict=True))
            sizes = {"force": size(left[:, :3]), "moment": size(left[:, 3:])}
            felt = felt_by(walker(), in_lab, rate_hz)
            rows.append({**key, "method": method, "seed": seed} | sizes | felt)
    return rows


def median_and_interval(values: pd.Series) -> pd.Series:
    """Give the median over machines and its 95 % interval, by the order of the values."""
    ordered, count = np.sort(values), len(values)
    rank = max(int(binom.ppf(0.025, count, 0.5)), 1)
    ends = {"low": ordered[rank - 1], "high": ordered[count - rank]}
    return pd.Series({"median": np.median(ordered)} | ends)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Summarise machines: medians, intervals, share removed, how often less than the published."""
    by_method = rows.set_index([*SETUP, "seed", "method"])["force"].unstack("method")
    removed = 100 * (1 - by_method.div(by_method[NONE], axis=0))
    less = 100.0 * by_method.lt(by_method[PUBLISHED], axis=0)
    keyed = rows.groupby([*SETUP, "method"], sort=False)
    table = keyed[SIZES].median()
    for name in SIZES:
        spread = keyed[name].apply(median_and_interval).unstack()
        table[[f"{name}_low", f"{name}_high"]] = spread[["low", "high"]]
    table["force_removed"] = removed.groupby(SETUP).median().stack()
    table["less_than_published"] = less.groupby(SETUP).mean().stack()
    return table.reset_index()


def published_belt(acceleration: Array, moment: Array) -> Array:
    """Give the coefficients (5,) of a second-order model of free-running output.

    Hnat and van den Bogert 2014: one start, coefficients within 10, a second left out at both ends.
    """

    def misfit(theta: Array) -> float:
        with np.errstate(all="ignore"):
            error = belt_moment(theta, acceleration)[100:-100] - moment[100:-100]
            return float(np.nan_to_num(np.sqrt(np.mean(error**2)), nan=1e6, posinf=1e6))

    return np.asarray(minimize(misfit, [0.001] * 5, method="SLSQP", bounds=[(-10, 10)] * 5).x)


def belt_moment(theta: Array, acceleration: Array) -> Array:
    """Run the belt model: ``M[k] = -t1 M[k-1] - t2 M[k-2] + t3 a[k] + t4 a[k-1] + t5 a[k-2]``."""
    return np.asarray(lfilter(theta[2:], [1, *theta[:2]], acceleration))


def filtered_belt(recording: belt.BeltRecording) -> tuple[Array, Array]:
    """Give acceleration by central differences and pitch moment, both through 6 Hz, causally."""
    below = butter(2, CUTOFF_HZ, fs=RATE_HZ)
    acceleration = np.gradient(recording.speed, 1 / RATE_HZ)
    return lfilter(*below, acceleration), lfilter(*below, recording.moment)


def judge_belt(
    name: str, fitted: belt.BeltRecording, judged: belt.BeltRecording
) -> list[dict[str, Any]]:
    """Fit pitch moment by belt acceleration on one recording, give what is left of another."""
    acceleration, moment = filtered_belt(fitted)
    other, truth = filtered_belt(judged)
    constant = np.column_stack([acceleration, np.ones(len(acceleration))])
    gain, offset = published_matrix(constant, moment)
    predicted = {
        "no compensation": np.zeros(len(truth)),
        "static least squares": gain * other + offset,
        "belt model as published": belt_moment(published_belt(acceleration, moment), other),
        "belt model, ours": fit_belt(acceleration, moment).predict(other),
    }
    left = {key: np.sqrt(np.mean((truth - own)[100:-100] ** 2)) for key, own in predicted.items()}
    return [{"recording": name, "method": key, "moment": rms} for key, rms in left.items()]


def simulated_belt(seed: int) -> list[dict[str, Any]]:
    """Judge the belt models on two recordings of a drive within the real one's intervals."""
    drive = identified_drive(np.random.default_rng(seed))
    both = [belt.simulate_recording(drive, belt.COMMAND_SD_MPS2, 2 * seed + n) for n in range(2)]
    return judge_belt("simulated drives", *both)


def belts(recordings: Path | None, jobs: int) -> pd.DataFrame:
    """Give what is left of the pitch moment on both real recordings, if there, and 20 drives."""
    rows = []
    for n in (1, 2) if recordings is not None else ():
        both = (belt.read_recording(recordings, number) for number in (n, 3 - n))
        rows += judge_belt(f"real, fitted to {n}, judged on {3 - n}", *both)
    with Pool(jobs) as pool:
        rows += chain(*pool.map(simulated_belt, SEEDS, 1))
    grouped = pd.DataFrame(rows).groupby(["recording", "method"], sort=False)["moment"]
    return grouped.apply(median_and_interval).unstack().reset_index()


def machines(jobs: int) -> pd.DataFrame:
    """Judge all machines; a row per laboratory, accelerometers, trial and method."""
    with Pool(jobs) as pool:
        cases = product(JUDGES, MACHINES, (False, True), SEEDS)
        return pd.DataFrame(chain(*pool.starmap(judge, cases, 1)))


def draw(table: pd.DataFrame, path: Path) -> None:
    """Draw medians and intervals of the force, with zeros that drift, by judge and trial."""
    drawn, places = table[table.zeros == "drift"], list(product(SENSORS, MACHINES))
    figure, axes = plt.subplots(2, 4, figsize=(11, 5.4), sharex=True, sharey=True)
    for (judge_name, trial), axis in zip(product(JUDGES, TRIALS), axes.flat, strict=True):
        own = drawn[(drawn.judge == judge_name) & (drawn.trial == trial)]
        for n, method in enumerate(METHODS):
            row = own[own.method == method].set_index(["sensors", "machine"]).reindex(places)
            beside = np.arange(len(places)) + 0.12 * (n - 2.5)
            ends = [row.force - row.force_low, row.force_high - row.force]
            axis.errorbar(beside, row.force, ends, fmt="o", ms=4, label=method)
        axis.set(yscale="log", title=trial if axis in axes[0] else "")
        axis.set_xticks(range(len(places)), [f"{count}\n{machine}" for count, machine in places])
        axis.grid(axis="y", alpha=0.3)
    for axis, judge_name in zip(axes[:, 0], JUDGES, strict=True):
        axis.set_ylabel(f"{judge_name}\nforce left below 6 Hz [N]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="lower center", ncols=3)
    figure.supxlabel("accelerometers and machine", y=0.12, fontsize="medium")
    figure.tight_layout(rect=(0, 0.12, 1, 1))
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": path.stem}):
        figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
