"""Calibrations of treadmills and plates, sound ones and the same with planted faults."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from compensation import (
    Delay,
    PlateCalibration,
    agreed_delay,
    fit_inertia,
    force_delay,
    hammer_delay,
    marker_plate_delay,
)
from compensation.accuracy import fit_plate_alignment, linearity, orthogonal_rmse, wrench_of_weight
from compensation.belts import belt_acceleration, fit_belt
from compensation.delay import sensor_delays
from compensation.force_delay import soft_tissue
from compensation.inertia import quality
from compensation.inertia.calibration import Calibration
from compensation.inertia.choice import choose, weigh_beside
from compensation.inertia.fit import fit_trials
from compensation.inertia.model import Setup
from compensation.inertia.quality import check_another_day, refuse_unusable
from compensation.inertia.sensors import Sensor, check_trial, noise_for_fit
from compensation.platform import check_pose, commanded_pose, fit_pose, neutral_markers, pose_delay
from hbm.signals.filtering import low_pass
from hbm.spatial import Array, rotation_about
from pipeline.virtual_lab.protocol.known_weights import strike_belt
from tests.compensation.conftest import PLACES, MovingPlatform
from tests.compensation.inertia.test_dynamic import SETUP as DYNAMIC
from tests.compensation.inertia.test_dynamic import trial as bending

Acts = dict[str, Callable[[], object]]
"""Name of a trial -> what says something of it."""
Trials = tuple[Acts, Acts]
"""Sound ones, and those with a fault."""
TIME = np.arange(2000) / 100
REAR, FRONT = slice(0, 3), slice(3, 6)
SETUP = Setup(("rear", "front"), rate_hz=100.0, cutoff_hz=20.0)


def acts(function: Callable[..., object], **given: tuple) -> Acts:
    """A trial for each list of arguments."""
    return {name: lambda a=arguments: function(*a) for name, arguments in given.items()}


def with_noise(values: Array, size: float, seed: int = 0) -> Array:
    return values + size * np.random.default_rng(seed).normal(size=np.shape(values))


def accuracy() -> Trials:
    """Plates under weights of known place and size."""
    loads = np.repeat([13.44, 22.56, 36.0, 45.08], 6) * 9.81
    plate, other = with_noise(1.02 * loads, 2.0), with_noise(loads[::-1], 2.0)
    fx, fx_true = with_noise(8 * np.sin(3 * TIME), 1.0), 8 * np.sin(3 * TIME)
    # a weight that a belt carries back and forth, on 12 places, and on a line
    path = np.column_stack([0.3 * np.sin(2 * TIME), 0.25 + 0 * TIME, 0.4 + 0 * TIME])
    seen = low_pass(with_noise(path, 0.0005), 100.0, 6.0, "zero_phase")
    places = np.array([[x, y] for x in (-0.6, -0.2, 0.2, 0.6) for y in (0.1, 0.3, 0.5)])
    found, in_line = with_noise(places, 0.003), with_noise(places * [1, 0], 0.0005)
    sound = acts(linearity, linearity=(loads, plate), rough=(loads, with_noise(loads, 40.0)))
    sound |= acts(orthogonal_rmse, vertical=(plate, loads), forward=(fx, fx_true))
    sound |= acts(wrench_of_weight, weight=(22.56, seen, 100.0, 0.2))
    sound |= acts(fit_plate_alignment, places=(found, places), line=(in_line, places * [1, 0]))
    faulty = acts(
        linearity, kN=(loads, plate / 1000), grams=(loads * 102, plate), mV=(loads, plate * 30)
    )
    faulty |= acts(linearity, weak=(loads, plate / 3), double=(loads, 2 * plate))
    faulty |= acts(
        orthogonal_rmse,
        another=(other, loads),
        newton_mm=(1000 * fx, fx_true),
        gone=(fx / 1000, fx),
    )
    faulty |= acts(
        wrench_of_weight,
        millimetres=(22.56, 1000 * seen, 100.0, 0.2),
        raw=(22.56, with_noise(path, 0.003), 100.0, 0.2),
        fast=(22.56, path, 1000.0, 0.2),
    )
    faulty |= acts(
        fit_plate_alignment,
        moments_a_third_too_large=(4 / 3 * found, places),
        moments_half=(found / 2, places),
        mm=(1000 * found, places),
        both_mm=(1000 * found, 1000 * places),
        inches=(found, places / 0.0254),
        mirrored=(found * [1, -1], places),
        shuffled=(found[::-1] * [1, 0.9], places),
        mirrored_line=(in_line * [1, -1], places * [1, 0]),
    )
    return sound, faulty


def belts(data: Path) -> Trials:
    """Belts that accelerate under an empty plate: two real recordings."""

    def fitted(moment: Array, speed: Array, seconds: float = 15.0) -> Array:
        felt = belt_acceleration(speed, 100.0, 6.0, "realtime")
        samples = slice(100, 100 + int(100 * seconds))
        model = fit_belt(felt[samples], low_pass(moment, 100.0, 6.0, "realtime")[samples])
        return model.theta.round(9)

    folder = data / "belt_acceleration"
    read = [np.loadtxt(folder / f"RandomFastSpeed{n}.txt", skiprows=1).T[1:] for n in (1, 2)]
    moment, speed = read[0]
    return acts(fitted, first=(moment, speed), second=tuple(read[1])), acts(
        fitted,
        short=(moment, speed, 6.0),
        shorter=(moment, speed, 1.0),
        km_per_h=(moment, 3.6 * speed),
        mm_per_s=(moment, 1000 * speed),
        cm_per_s=(moment, 100 * speed),
        newton_mm=(1000 * moment, speed),
        kilonewton_m=(moment / 1000, speed),
        both_mm=(1000 * moment, 1000 * speed),
    )


def plate_calibration() -> Trials:
    """Corrections of plates, as people type them."""

    def made(plate: int = 1, matrix: Array | float = 1.0, **changed: object) -> object:
        typed = {"offset": np.array([3.0, -2, 15, 1, 2, 0.5]), "standard_error": np.zeros((6, 6))}
        typed |= {"center": np.array([0.5, -0.3, 0.0]), "examined": ("Fz",), "delay_s": 0.007}
        return PlateCalibration(plate, matrix * np.eye(6), **(typed | changed))

    skew = np.eye(6)
    skew[3:, :3] = 0.3
    singular = np.diag([1, 1, 1, 1, 1, 1e-6])
    sound = {
        "plate 1": made,
        "plate 8": lambda: made(8),
        "far": lambda: made(center=[8, 3, 0.0]),
        "weak": lambda: made(matrix=np.diag([1.1, 0.9, 1, 1, 1, 1.05])),
        "not zeroed": lambda: made(offset=[80, 50, 900.0, 40, 300, 20]),
        "late": lambda: made(delay_s=0.06),
    }
    sound |= {"skew": lambda: PlateCalibration(1, skew, np.zeros(6), skew, np.zeros(3), ())}
    return sound, {
        "plate of no laboratory": lambda: made(4311),
        "plate 0": lambda: made(0),
        "from N to N·mm": lambda: made(matrix=np.diag([1, 1, 1, 1000, 1000, 1000.0])),
        "from V": lambda: made(matrix=500.0),
        "singular": lambda: made(matrix=singular),
        "offset in raw counts": lambda: made(offset=[2e6, 1e6, 3e6, 0, 0, 0]),
        "centre in mm": lambda: made(center=[500.0, -300, 0]),
        "delay in ms": lambda: made(delay_s=7.0),
    }


def hammer() -> Trials:
    """Fifteen blows on a plate with a hammer that carries a marker."""

    def blows(contact_s: float, noise_n: float = 1.0, seed: int = 0) -> list[Array]:
        rng = np.random.default_rng(seed)
        height, force = strike_belt(contact_s, contact_s, 0.007, rng)
        time, height = np.arange(len(force)) / 1000, height[::10]
        return [time[::10], with_noise(height, 1e-4), time, with_noise(force, noise_n, 1)]

    def changed(blows: list[Array], change: Callable[[Array, Array], Array]) -> tuple:
        *marker, time, force = blows
        return (*marker, time, change(time, force))

    steel, soft = blows(0.003), blows(0.008, seed=1)
    time, force = steel[2:]
    first = np.flatnonzero(force > 100)
    two = first[np.flatnonzero(np.diff(first) > 500)][1] + 200
    kernel = np.exp(-np.arange(400) / 20) * np.cos(2 * np.pi * np.arange(400) / 1000 * 35)
    rings = 0.02 * np.convolve(force * (force > 30), kernel)[: len(force)]
    sound = acts(hammer_delay, steel=tuple(steel), soft=tuple(soft), noisy=tuple(blows(0.003, 6)))
    sound |= acts(hammer_delay, rings=(*steel[:3], force + rings), slow=tuple(blows(0.02)))
    # beside a delay in motion, of more or less doubt
    by_hammer = hammer_delay(*steel)
    doubts_s = {"sure": 0.0002, "less_sure": 0.0004, "doubtful": 0.0008, "unsure": 0.003}
    by_motion = {name: (by_hammer, Delay(0.0075, doubt)) for name, doubt in doubts_s.items()}
    sound |= acts(agreed_delay, **by_motion)
    return sound, acts(
        hammer_delay,
        two_blows=(*(x[: two // 10] for x in steel[:2]), time[:two], force[:two]),
        of_100_hz=(*steel[:2], time[::10], force[::10]),
        of_300_hz=(*steel[:2], time[::3], force[::3]),
        filtered=changed(steel, lambda t, f: low_pass(f, 1000.0, 10.0, "zero_phase")),
        pressed=changed(steel, lambda t, f: f + 60 * (np.sin(3 * t) > 0)),
        rings_long=(*steel[:3], force + 20 * rings),
        late_clock=(steel[0] + 0.3, *steel[1:]),
        upside_down=(steel[0], -steel[1], *steel[2:]),
        smooth_marker=(steel[0], low_pass(steel[1], 100.0, 4.0, "zero_phase"), *steel[2:]),
    )


@cache
def platform_recordings() -> tuple[Array, Array, Array, Array]:
    """Accelerations and wrench of an empty plate under a platform that moves, on two days."""
    lab = MovingPlatform(PLACES["two"])
    days = [lab.random_trial(k, noise=k, cutoff_hz=20, duration=30) for k in (1, 2)]
    (a, w), (b, v) = ((day.accelerations, day.wrench) for day in days)
    return a, w, b, v


def smaller(values: Array, factor: float) -> Array:
    """The same with less motion about the mean."""
    return values.mean(axis=0) + factor * (values - values.mean(axis=0))


def calibrations() -> dict[str, tuple[Array, Array]]:
    """Recordings to calibrate with, sound until "g"."""
    a, w, b, v = platform_recordings()
    at = np.arange(len(a)) / 100
    step = 700 * np.maximum(np.sin(2 * np.pi * 0.9 * at), 0)
    vertical, pitching = np.eye(6)[2], np.eye(6)[4]
    lone = smaller(a, 0.02), smaller(w, 0.02)
    return {
        "sound": (a, w),
        "another day": (b, v),
        "gentle": (smaller(a, 0.4), with_noise(smaller(w, 0.4), 1.0)),
        "noisy": (with_noise(a, 0.05), with_noise(w, 3.0)),
        "light plate": (a, w / 10),
        "g": (a / 9.81, w),
        "mm/s2": (1000 * a, w),
        "V": (a / 30, w),
        "kN": (a, w / 1000),
        "lb": (a, w / 4.45),
        "raw counts": (a, 300 * w),
        "kN m": (a, w / np.repeat([1.0, 1000], 3)),
        "N mm": (a, w * np.repeat([1.0, 1000], 3)),
        "tared": (a - a.mean(axis=0), w),
        "dead": (np.hstack([a[:, REAR], 0.02 + 0 * a[:, FRONT]]), w),
        "wrong axes": (np.hstack([a[:, REAR], a[::-1, FRONT]]), w),
        "late": (np.roll(a, 4, axis=0), w),
        "hardly moved": lone,
        "at rest": (with_noise(smaller(a, 0), 0.02), with_noise(smaller(w, 0), 1.0)),
        "shaken by people": (smaller(a, 0.08), with_noise(smaller(w, 0.08), 2.0)),
        "somebody on the boards": (a, w + step[:, None] * vertical),
        "somebody leans": (a, with_noise(w, 15.0)),
        "moving belt": (a, w + 30 * np.sin(6 * at)[:, None] * pitching),
        "weight on it": (a, w + 200 * vertical),
        "of another recording": (a, v[: len(a)]),
        "60 samples": (a[:60], w[:60]),
        "100 samples": (a[:100], w[:100]),
        "200 samples": (a[:200], w[:200]),
        "very noisy sensors": (with_noise(a, 1.0), w),
    }


def fitted(accelerations: Array, wrench: Array, noise: float = 0.0) -> tuple:
    """A calibration and its verdict."""
    quality.MAX_LEFT = quality._max_left()  # which is read once
    model = fit_inertia(accelerations, wrench, SETUP, noise)
    refuse_unusable({"the plate": model})
    calibration = Calibration({"the plate": model})
    return (
        [[f"{gain:.2g}" for gain in row] for row in model.gain],
        calibration.notes,
        {
            name: [(row.verdict, f"{row.left:.2g}") for row in rows]
            for name, rows in calibration.verdict.items()
        },
    )


def split(given: Acts, sound: int) -> Trials:
    """The first ones are sound."""
    names = list(given)
    return {n: given[n] for n in names[:sound]}, {n: given[n] for n in names[sound:]}


def fits() -> Trials:
    trials = acts(fitted, **calibrations())
    a, w, *_ = platform_recordings()
    for noise in (0.01, 0.1, 0.3, 0.7, 1.5, 3.0):
        trials[f"noise of {noise} m/s² stated"] = lambda n=noise: fitted(a, w, n)
    return split(trials, 5)


def days() -> Trials:
    """A calibration, and empty recordings of another day."""
    a, w, b, v = platform_recordings()
    model = fit_inertia(a, w, SETUP)
    at = np.arange(len(b)) / 100
    shift, rattle = np.eye(6)[2], np.sin(2 * np.pi * 3 * at)[:, None] * np.eye(6)[4]
    turn = rotation_about(np.eye(3)[2], np.radians(6)).T
    turned = np.hstack([b[:, REAR], b[:, FRONT] @ turn])
    sound, faulty = fits()

    def said(*of: Array) -> object:
        quality.MAX_LEFT = quality._max_left()
        found = check_another_day(model, *of)
        return found.leaves_much.tolist(), found.moved.tolist()

    sound |= acts(said, same_day=(a, w), later=(b, v))
    # rollers out of balance, in the calibration and more and more of them later
    unbalanced = 6 * np.sin(2 * np.pi * 4 * np.arange(len(a)) / 100)[:, None] * np.eye(6)[4]
    rolling = fit_trials([(a, w), (a, w + unbalanced)], SETUP, belts_mps=(0.0, 1.3))
    for times in (1, 2, 4, 8, 16):
        faulty[f"{times} times as unbalanced rollers"] = lambda k=times: check_another_day(
            rolling, a, w + k * unbalanced, belts_mps=1.3
        ).leaves_much.tolist()
    faulty |= acts(
        said,
        zero_of_2_newtons=(b, v + 2 * shift),
        zero_of_5_newtons=(b, v + 5 * shift),
        turned_by_6_degrees=(turned, v),
        gain=(b, v * [1, 1, 1, 1, 1.3, 1]),
        rollers=(b, v + 4 * rattle),
        loose=(b, v + 8 * rattle),
        rattles=(b, v + 20 * rattle),
        walker=(b, v + 300 * np.maximum(np.sin(6 * at), 0)[:, None] * shift),
        at_rest=(smaller(b, 0.05), smaller(v, 0.05)),
    )
    return sound, faulty


def sensors() -> Trials:
    """Accelerometers in trials after a calibration, and their noise in it."""
    a, w, b, _ = platform_recordings()
    brisk = smaller(b, 0.6)
    lab = MovingPlatform(PLACES["two"])
    slow = lab.slow_pitch_trial(noise=3, cutoff_hz=20, duration=20).accelerations
    model = fit_inertia(a, w, SETUP)
    at = np.arange(len(brisk)) / 100

    def turned(degrees: float, axis: int = 0) -> Array:
        turn = rotation_about(np.eye(3)[axis], np.radians(degrees)).T
        return np.hstack([brisk[:, REAR], brisk[:, FRONT] @ turn])

    def rear(values: Array, start: int = 0) -> Array:
        changed = brisk.copy()
        changed[start:, REAR] = values[start:]
        return changed

    def noise(size: float, bends: float = 0.0) -> object:
        bent = (
            bends * np.sin(2 * np.pi * 9 * np.arange(len(a)) / 100)[:, None] * [0, 1, 0, 0, -1, 0]
        )
        known = tuple(Sensor(n, noise_mps2=float(np.hypot(size, 0.02))) for n in SETUP.sensors)
        return noise_for_fit(known, with_noise(a, size) + bent)

    swapped = np.hstack([brisk[:, FRONT], brisk[:, REAR]])
    spike = brisk + 11.5 * (np.abs(at - 5) < 0.1)[:, None] * np.eye(6)[2]
    sound = acts(
        lambda *of: check_trial(model, *of),
        brisk=(brisk,),
        slow=(slow,),
        at_rest=(np.tile(brisk[0], (100, 1)),),
        drifted=(brisk + 0.03,),
        tilted_by_10_degrees=(turned(10.0),),
    )
    sound |= {f"noise of {n} m/s²": lambda n=n: noise(n) for n in (0.02, 0.1)}
    faulty = acts(
        lambda *of: check_trial(model, *of),
        dead=(rear(0 * brisk[:, REAR] + 0.02),),
        stuck=(rear(np.tile([0.1, 0, 9.8], (len(brisk), 1))),),
        in_g=(brisk / 9.81,),
        half_gain=(rear(0.6 * brisk[:, REAR]),),
        tenth_too_much=(rear(1.1 * brisk[:, REAR]),),
        clipped=(np.clip(spike, -19.62, 19.62),),
        clipped_low=(np.clip(spike, -19.1, 19.1),),
        swapped=(swapped,),
        swapped_at_slow_pitch=(slow[:, [3, 4, 5, 0, 1, 2]],),
        turned_by_30_degrees=(turned(30.0),),
        turned_by_60_degrees=(turned(60.0),),
        upside_down=(turned(180.0),),
        turned_about_the_vertical=(turned(90.0, 2),),
        drifted_much=(rear(brisk[:, REAR] + [0.2, -0.2, 0.1]),),
        tenth_more_motion=(smaller(brisk, 1.1),),
        twice_the_motion=(smaller(brisk, 2.0),),
    )
    bends = {f"bends by {b} m/s²": lambda b=b: noise(0.02, b) for b in (0.02, 0.05, 0.2)}
    return sound, faulty | bends


def delays() -> Trials:
    """Accelerometers and cameras that are late."""
    lab = MovingPlatform(PLACES["two"], crooked=False)

    def recorded(late_s: tuple[float, float], seed: int = 1) -> tuple[Array, Array]:
        options = {"duration": 20.0, "rate_hz": 200.0, "noise": seed}
        trials = [lab.random_trial(seed, late_s=late, **options) for late in late_s]
        parts = [t.accelerations[:, s] for t, s in zip(trials, (REAR, FRONT), strict=True)]
        return np.hstack(parts), lab.random_trial(seed, **options).wrench

    def found(accelerations: Array, wrench: Array) -> object:
        delays = sensor_delays(accelerations, wrench, 200.0)
        return [(round(d.seconds, 4), f"{d.standard_error:.0e}") for d in delays]

    (a, w), (_, of_other) = recorded((0.0, 0.0)), recorded((0.0, 0.0), 2)
    vibrates = w + 200 * np.sin(2 * np.pi * 27 * np.arange(len(w)) / 200)[:, None]
    sound = acts(found, in_time=(a, w), rear_5_ms=recorded((0.005, 0.0)))
    sound |= acts(found, both_20_ms=recorded((0.02, 0.02)), noisy=(with_noise(a, 0.5), w))
    return sound, acts(
        found,
        tenth_of_a_second=recorded((0.09, 0.09)),
        quarter_of_a_second=recorded((0.26, 0.26)),
        another_recording=(a, of_other),
        nothing_but_noise=(with_noise(0 * a, 1.0), w),
        somebody_walks=(a, with_noise(w, 600.0)),
        vibrates=(a, vibrates),
        slow=(low_pass(a, 200.0, 1.0, "zero_phase"), low_pass(w, 200.0, 1.0, "zero_phase")),
        hardly_moves=(with_noise(smaller(a, 0.01), 0.05), smaller(w, 0.01)),
        short=(a[:700], w[:700]),
        very_noisy=(with_noise(a, 8.0), w),
    )


def platform() -> Trials:
    """The platform's pose by commands and by markers."""
    markers = np.array(
        [[0.9, 0.7, 0.02], [-1.0, 0.75, 0.03], [-0.95, -0.7, 0], [1, -0.72, 0.05], [0.1, 0.8, 0.3]]
    )
    time = np.arange(1000) / 100
    sway, pitch, pivot = 0.05 * np.sin(3 * time), 0.17 * np.sin(2 * time + 0.4), (0.15, 0.0, -0.4)

    def seen(pose: object, at: Array = markers, noise_m: float = 0.0005) -> Array:
        return with_noise(np.stack([pose.to_lab(m) for m in at], axis=1), noise_m)

    def posed(position: Array, neutral: Array = markers) -> object:
        fit = fit_pose(position, neutral, 0.01)
        names = tuple(f"PF{k}" for k in range(position.shape[1]))
        return fit.used.tobytes(), check_pose(fit, names, 0.01)

    def commanded(*of: object) -> object:
        return commanded_pose(*of).position.round(9).tobytes()

    def delayed(size: float, noise: float) -> object:
        late = commanded_pose(size * np.roll(sway, 3), size * np.roll(pitch, 3), pivot)
        fit = fit_pose(seen(late, noise_m=noise), markers, 0.05)
        found = pose_delay(commanded_pose(size * sway, size * pitch, pivot), fit.pose, 100.0)
        return round(found.seconds, 5), round(found.standard_error, 5)

    def loose(share: float) -> Array:
        position = seen(pose)
        position[: int(share * len(position)), 1] += 0.1
        return position

    pose = commanded_pose(sway, pitch, pivot)
    narrow = markers * [1, 0.05, 0.3]
    rest = np.tile(markers, (100, 1, 1))
    sound = acts(commanded, thesis=(sway, pitch, pivot), pivot_ahead=(sway, pitch, (3.0, 0, -1.0)))
    sound |= acts(posed, markers=(seen(pose),), once_hidden=(loose(0.01),))
    sound |= acts(
        neutral_markers, rest=(with_noise(rest, 0.0005),), rough=(with_noise(rest, 0.002),)
    )
    sound |= acts(delayed, late=(1.0, 0.0005), small=(0.1, 0.0005))
    faulty = acts(
        commanded,
        sway_in_mm=(1000 * sway, pitch, pivot),
        sway_in_cm=(100 * sway, pitch, pivot),
        pitch_in_degrees=(sway, np.degrees(pitch), pivot),
        pivot_in_mm=(sway, pitch, (150.0, 0.0, -400.0)),
    )
    faulty |= acts(
        posed,
        loose_in_3_percent=(loose(0.03),),
        loose_in_8_percent=(loose(0.08),),
        loose_in_20_percent=(loose(0.2),),
        in_line=(seen(pose, markers * [1, 0, 0]), markers * [1, 0, 0]),
        nearly_in_line=(seen(pose, narrow), narrow),
        millimetres=(1000 * seen(pose), markers),
    )
    faulty |= acts(
        neutral_markers,
        platform_moves=(seen(pose),),
        platform_creeps=(rest + 0.02 * np.linspace(0, 1, 100)[:, None, None],),
        sways_a_little=(rest + 0.004 * np.sin(TIME[:100] * 9)[:, None, None],),
    )
    return sound, faulty | acts(delayed, at_rest=(0.0, 0.0005), trembles=(0.005, 0.0005))


def force_delays() -> Trials:
    """Plates that are later than markers, under a walker with soft tissue."""
    long_before = np.arange(-500, 1500) / 100
    time = np.arange(1500) / 100

    def force(at: Array) -> Array:
        phase = 2 * np.pi * 0.9 * np.asarray(at)[:, None]
        forward = 50 * np.sin(2 * phase) + 15 * np.sin(4 * phase + 1)
        left = 25 * np.sin(phase + 0.3) + 8 * np.sin(3 * phase)
        return np.hstack([forward, left, 589 + 70 * np.cos(2 * phase + 0.5)])

    carried = force(long_before) + soft_tissue(force(long_before), long_before)

    def late(*by_s: float) -> Array:
        axes = enumerate(by_s if len(by_s) == 3 else by_s * 3)
        return np.column_stack([np.interp(time - s, long_before, carried[:, k]) for k, s in axes])

    def error(size_n: float, seed: int = 0) -> Array:
        smooth = low_pass(with_noise(np.zeros((1500, 3)), 1.0, seed), time, 6.0, "zero_phase")
        return size_n * smooth / smooth.std()

    def found(plate: Array, motion: Array, count: int = 1500) -> object:
        usual = force_delay.LIMITS.tissue_deviation, force_delay.LIMITS.gain_deviation
        force_delay.USUAL[1:] = usual  # which is read once
        delay = marker_plate_delay(plate[:count], motion[:count], time[:count])
        return round(delay.seconds, 4), f"{delay.standard_error:.0e}"

    motion = force(time)
    sound = acts(found, in_time=(late(0.0), motion), late=(late(0.02), motion + error(10)))
    sound |= acts(
        found, rigid=(force(time - 0.013), motion), rough=(late(0.01), motion + error(12))
    )
    return sound, acts(
        found,
        heavier=(late(0.013), 1.05 * motion),
        far_heavier=(late(0.013), 1.2 * motion),
        axes_disagree=(late(0.06, 0.01, -0.04), motion),
        axes_differ=(late(0.014, 0.01, 0.006), motion),
        third_of_a_second=(late(0.3), motion),
        standing=(error(3) + error(9.5, 1), error(3)),
        unrelated=(error(40, 1), motion),
        two_steps=(late(0.01), motion + error(20), 120),
        one_step=(late(0.01), motion + error(20), 60),
        quarter_of_a_second=(late(0.01), motion, 25),
        very_rough=(late(0.01), motion + error(60)),
    )


def choices() -> Trials:
    """Static and dynamic models of plates on soft and stiff load cells, and people beside."""

    def chosen(hz: float | None, other: Array | None = None) -> object:
        recordings = [(f"{n}.c3d", {"plate 1": bending(n, hz)}) for n in range(2)]
        channels, wrench = recordings[0][1]["plate 1"]
        if other is not None:
            recordings[1] = "other.c3d", {"plate 1": (recordings[1][1]["plate 1"][0], other)}
        static = {"plate 1": fit_inertia(channels[:, :6], wrench, DYNAMIC)}
        reason, models = choose(recordings[:1], static, recordings[1:])
        return reason, list(models)

    def weighed(size: float) -> object:
        (felt, wrench), (_, other) = (bending(n, None) for n in range(2))
        beside = ("beside.c3d", {"plate 1": (felt, wrench + size * (other - wrench))})
        return weigh_beside([("empty.c3d", {"plate 1": (felt, wrench)}), beside], DYNAMIC)

    _, wrench = bending(1, 35.0)
    sound = {f"load cells of {hz} Hz": lambda hz=hz: chosen(hz) for hz in (None, 60.0, 35.0)}
    faulty: Acts = {"noise in the other": lambda: chosen(35.0, with_noise(wrench, 20.0))}
    faulty |= {"another plate": lambda: chosen(35.0, wrench[:, [1, 0, 2, 4, 3, 5]])}
    return sound, faulty | {f"people shake {s}": lambda s=s: weighed(s) for s in (0.01, 0.1, 0.5)}


def errors() -> Trials:
    """What models leave by the speed of the belts, and by the energy of the motion."""
    a, w, b, v = platform_recordings()
    at = np.arange(len(a)) / 100

    def left(speeds: tuple, zero: float, *, shakes: float = 0.0) -> object:
        trials = []
        for k, speed in enumerate(speeds):
            rumble = 2 * speed**2 * np.sin(2 * np.pi * 5 * at + k)[:, None]
            bursts = shakes * (np.sin(at) > 0.9) * np.sin(2 * np.pi * 4 * at)
            accelerations, wrench = (a, w) if k % 2 == 0 else (b[: len(a)], v[: len(a)])
            trials.append((accelerations, wrench + rumble + bursts[:, None] + zero * k))
        model = fit_trials(trials, SETUP, belts_mps=speeds)
        expected = model.uncertainty(a, slow=True, belts_mps=1.3).mean(axis=0)
        return [f"{size:.1g}" for size in expected]

    sound = acts(left, belts_at_rest=((0.0, 0.0), 0.0), one_speed=((0.0, 1.3), 0.5))
    sound |= acts(left, two_speeds=((0.0, 1.0, 1.5), 0.2), near=((1.2, 1.5), 0.1))
    faulty = acts(left, zeros_wander=((0.0, 1.3), 8.0), fast=((1.0, 2.5), 0.1))
    return sound, faulty | {"bursts": lambda: left((0.0, 1.3), 0.1, shakes=40.0)}


@cache
def trials(section: str, data: Path) -> Trials:
    """Trials that a section of `compensation/thresholds.toml` may change."""
    made = {
        "accuracy": accuracy,
        "belts": lambda: belts(data),
        "plate_calibration": plate_calibration,
        "hammer": hammer,
        "inputs": fits,
        "platform": platform,
        "delay": delays,
        "force_delay": force_delays,
        "choice": choices,
        "sensors": sensors,
        "quality": days,
        "model_error": errors,
        "fit": fits,
    }
    return made[section]()
