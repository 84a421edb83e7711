"""Markers, bodies and channels of plates, sound ones and the same with planted faults."""

from collections.abc import Callable, Sequence
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np

from hbm.body import build_body
from hbm.calibration_pose.functional import functional_hips
from hbm.markers import Markers, marker_sets, recognise_marker_set
from hbm.model import Body
from hbm.motion import Motion
from hbm.plausibility import labels, motion, outliers
from hbm.segments import SegmentOverride
from hbm.signals.converters import find_jumps, find_limits, find_wraps
from hbm.signals.filtering import low_pass
from hbm.spatial import Array, shift_wrench
from tests.campaign.calibration_faults import Acts, Trials, acts, with_noise
from tests.campaign.plants import clipped, overflowing
from tests.campaign.walks import real
from tests.hbm.calibration_pose.test_functional import HBM2, star_arc
from tests.hbm.motions import displaced, exchanged, held, relabelled, without
from tests.synthetic import synthetic_t_pose

Change = Callable[[Markers], Markers]
WALKS = ("treadmill", "overground", "generated", "HC030A05", "two plates", "steps")
SOLVED = ("treadmill", "generated")
"""Those whose inverse kinematics is solved again for each number."""
FRAMES = 240


@cache
def walks(data: Path) -> dict[str, tuple[Body, Markers]]:
    """Bodies of real walks, and their markers over some seconds."""
    chosen = {}
    for base in real(data):
        if base.name in WALKS:
            markers = base.recording.markers
            seen = np.flatnonzero(np.isfinite(markers.position).mean(axis=(1, 2)) > 0.8)
            part = slice(seen[0], seen[0] + FRAMES)
            chosen[base.name] = (
                base.chain().body,
                Markers(markers.time[part], markers.names, markers.position[part]),
            )
    return chosen


def faults(body: Body, labels: Sequence[str], first: int = 60) -> dict[str, Change]:
    """What may go wrong with those markers of a body that a trial has."""
    names = [name for name in body.markers if name in labels]
    on = {s: [m for m in names if body.segment_of[m] == s] for s in set(body.marker_segment)}
    shank, foot = on["right_shank"], on["right_foot"]
    thigh, other = on["right_thigh"], on["left_thigh"]
    pelvis, leg = on["pelvis"], [*on["right_shank"], *on["right_foot"]]
    single, wide = slice(first, first + 1), slice(first, first + 100)
    arms = [m for m in names if body.segment_of[m].endswith(("arm", "hand"))]

    def noisy(names: list[str], size_m: float) -> Change:
        def change(markers: Markers) -> Markers:
            columns = [markers.names.index(name) for name in names]
            position = markers.position.copy()
            position[wide, columns] = with_noise(position[wide, columns], size_m)
            return Markers(markers.time, markers.names, position)

        return change

    def far(markers: Markers) -> Markers:
        return displaced(markers, foot[0], [7.0, 0, 0], single)

    def mirrored(markers: Markers) -> Markers:
        return Markers(markers.time, markers.names, markers.position * [1, -1, 1])

    def gaps(markers: Markers) -> Markers:
        for k in range(5):
            lost = slice(first + 20 * k, first + 20 * k + 4)
            markers = without(exchanged(markers, slice(lost.stop, None), pair), pair, lost)
        return markers

    pair = (thigh[0], other[0])
    changes: dict[str, Change] = {
        f"{foot[0]} {cm} cm off": lambda m, cm=cm: displaced(m, foot[0], [0, 0, cm / 100])
        for cm in (1, 2.5, 5)
    }
    changes |= {
        f"{foot[-1]} jumps by {cm} cm": lambda m, cm=cm: displaced(
            m, foot[-1], [0, cm / 100, 0], single
        )
        for cm in (4, 12, 30, 80)
    }
    return changes | {
        "two markers of a leg jump": lambda m: displaced(
            displaced(m, foot[0], [0, 0.4, 0], single), shank[0], [0, 0.3, 0], single
        ),
        "thighs exchanged for a second": lambda m: exchanged(m, wide, pair),
        "exchanged over gaps": gaps,
        "within the foot exchanged": lambda m: exchanged(m, wide, (foot[0], foot[-1])),
        "sides exchanged": lambda m: relabelled(m, *zip(thigh, other, strict=False)),
        "pelvis exchanged": lambda m: relabelled(m, (pelvis[0], pelvis[1])),
        "all held for 40 ms": lambda m: held(m, slice(first, first + 4)),
        "all held for a second": lambda m: held(m, wide),
        "most of it held": lambda m: held(m, slice(20, 200)),
        "one held for 0.3 s": lambda m: held(m, slice(first, first + 30), [foot[0]]),
        "one held for a second": lambda m: held(m, wide, [shank[0]]),
        "a leg of noise of 5 cm": noisy(leg, 0.05),
        "a leg of noise of 20 cm": noisy(leg, 0.2),
        "a leg hidden": lambda m: without(m, leg, wide),
        "a foot hidden": lambda m: without(m, foot, wide),
        "no arms": lambda m: without(m, arms),
        "one marker on the shank": lambda m: without(m, shank[1:]),
        "one far away": far,
        "mirrored": mirrored,
    }


def of_markers(
    data: Path, say: Callable[[Body, Markers], object], names: tuple[str, ...] = WALKS
) -> Trials:
    """Walks as they are, and with each fault in turn."""
    sound: Acts = {}
    faulty: Acts = {}
    for name, (body, markers) in walks(data).items():
        if name in names:
            sound[name] = lambda b=body, m=markers: say(b, m)
            for fault, change in faults(body, markers.names).items():
                faulty[f"{name}: {fault}"] = lambda b=body, m=markers, c=change: say(b, c(m))
    return sound, faulty


def labels_said(body: Body, markers: Markers) -> object:
    """What is said of labels and of positions that were held."""
    return (
        labels.sides_exchanged(body.marker_set, markers, "trial"),
        labels.labels_exchanged(markers, body.markers),
        labels.changed_distances(body, markers),
        labels.repeated_positions(body, markers),
        np.isnan(labels.without_frozen_frames(markers, body.markers).position).sum(),
    )


def solved_said(body: Body, markers: Markers) -> object:
    """What inverse kinematics finds of a walk: coordinates in centiradians, and outliers."""
    _, solved, notes = outliers.solve_motion(body, markers, "zero_phase", 1)
    return np.round(solved.q, 2).tobytes(), solved.converged.tobytes(), notes


def motion_said(body: Body, solved: Motion) -> object:
    """What is said of a solved motion."""
    unseen = motion.unseen_segments(body, solved)
    return (
        motion.implausible(body),
        motion.undetermined_notes(body, solved),
        motion.impossible_angles(body, solved),
        motion.large_marker_errors(body, solved),
        motion.mass_not_shown(body, unseen),
    )


def of_motion(data: Path) -> Trials:
    """Walks that are solved once, and what is said of them."""

    def judged(body: Body, markers: Markers) -> Callable[[], object]:
        solved = outliers.solve_motion(body, markers, "zero_phase", 1)[1]
        return lambda: motion_said(body, solved)

    sound, faulty = of_markers(data, judged)
    return tuple({name: make() for name, make in of.items()} for of in (sound, faulty))


def live_said(body: Body, markers: Markers) -> object:
    """The same frame by frame."""
    _, solved, notes = outliers.track_motion(body, markers)
    return np.round(solved.q, 2).tobytes(), solved.converged.tobytes(), notes


def bodies(data: Path) -> Trials:
    """Calibration poses, and typed masses and inertias."""
    pose = synthetic_t_pose()

    def built(markers: Markers, **options: object) -> object:
        options = {"mass": 74.6, "sex": "male"} | options
        body = build_body(markers, **options)
        at = np.round(body.marker_position, 5).tobytes()
        return body.mass, at, body.notes, motion.implausible(body)

    def moved(markers: Markers, size_m: float, hz: float = 0.5) -> Markers:
        sway = size_m * np.sin(2 * np.pi * hz * markers.time)
        return Markers(markers.time, markers.names, markers.position + sway[:, None, None])

    def jumps(count: int, size_m: float) -> Markers:
        return displaced(pose, "RHEE", [0, size_m, 0], slice(10, 10 + count))

    def bent(cm: float) -> Markers:
        markers = pose
        for side in "LR":
            names = [side + m for m in ("LW", "MW", "FIN", "FRM")]
            for name in names:
                markers = displaced(markers, name, [cm / 100, 0, 0])
            markers = without(markers, [side + "MEE"])
        return markers

    def override(**typed: object) -> object:
        return SegmentOverride(**typed)

    sound = {f"{kg} kg": lambda kg=kg: built(pose, mass=kg) for kg in (15.0, 74.6, 180.0)}
    sound |= {f"sways by {v} m/s": lambda v=v: built(moved(pose, v / 3)) for v in (0.015, 0.03)}
    sound |= {
        name: lambda b=b, m=m: (b.notes, labels_said(b, m)) for name, (b, m) in walks(data).items()
    }
    sound |= {
        "thigh": lambda: override(center_m=[0.0, 0.0, -0.25], inertia_kg_m2=0.2 * np.eye(3)),
        "heavy trunk": lambda: override(center_m=[0, 0, 0.4], inertia_kg_m2=2.5 * np.eye(3)),
    }
    sound |= {
        f"hips, swings of {d}°": lambda d=d: functional_hips(star_arc(0.001, d, d), HBM2)
        for d in (30, 40)
    }
    faulty = {f"{kg:g} kg": lambda kg=kg: built(pose, mass=kg) for kg in (2.0, 74600.0, 735.0)}
    faulty |= {f"moves by {v} m/s": lambda v=v: built(moved(pose, v / 3)) for v in (0.1, 0.3, 1.0)}
    faulty |= {
        f"{n} positions jump by {cm} cm": lambda n=n, cm=cm: built(jumps(n, cm / 100))
        for n in (1, 2)
        for cm in (3, 8, 15, 50)
    }
    faulty |= {
        f"a marker is elsewhere every {k}th time": lambda k=k: built(
            displaced(pose, "RHEE", [0, 0.5, 0], slice(None, None, k))
        )
        for k in (3, 4, 8)
    }
    faulty |= {
        f"elbows bent by {cm} cm, no medial markers": lambda cm=cm: built(bent(cm))
        for cm in (0, 5, 12, 20)
    }
    faulty |= {
        f"hips, swings of {d}° and {e}°": lambda d=d, e=e: functional_hips(
            star_arc(0.001, d, e), HBM2
        )
        for d, e in ((10, 10), (20, 5), (30, 0), (40, 8))
    }
    faulty |= {
        "centre in mm": lambda: override(center_m=[0.0, 0.0, -250.0]),
        "centre in cm": lambda: override(center_m=[0.0, 0.0, -25.0]),
        "inertia in kg·cm²": lambda: override(inertia_kg_m2=2000 * np.eye(3)),
        "inertia in lb·ft²": lambda: override(inertia_kg_m2=30 * np.eye(3)),
    }
    return sound, faulty


def sets(data: Path) -> Trials:
    """Labels of every set, whole, in part, and beside those of others."""
    known = marker_sets()

    def recognised(names: tuple[str, ...]) -> object:
        return recognise_marker_set(names).name

    def labels_of(name: str) -> tuple[str, ...]:
        return tuple(marker.labels[0] for marker in known[name].markers)

    sound: Acts = {name: lambda n=name: recognised(labels_of(n)) for name in known}
    sound |= {name: lambda n=m.names: recognised(n) for name, (_, m) in walks(data).items()}
    rng, faulty = np.random.default_rng(0), {}
    for name in known:
        every = labels_of(name)
        for share in (0.8, 0.6, 0.4, 0.2):
            kept = tuple(rng.permutation(every)[: int(share * len(every))])
            faulty[f"{share:.0%} of {name}"] = lambda n=kept: recognised(n)
    for one, other in list(combinations(known, 2))[::4]:
        both = labels_of(one)[::2] + labels_of(other)[1::2]
        faulty[f"half {one}, half {other}"] = lambda n=both: recognised(n)
    return sound, faulty


def channels(data: Path) -> Trials:
    """Channels of plates about their transducers, as converters give them."""
    sound: dict[str, tuple[Array, float]] = {}
    for base in real(data):
        if base.name in WALKS:
            for k in base.loaded:
                plate = base.recording.plates[k]
                about = shift_wrench(plate.wrench_in_plate, plate.transducer)[:8000]
                step_s = float(np.median(np.diff(plate.time)))
                sound |= {f"{base.name} {k + 1} {c}": (about[:, c], step_s) for c in (0, 2, 4)}
    time = np.arange(4000) / 1000
    phase = np.clip((time[:, None] - [0.4, 1.6, 2.8]) / 0.7, 0, 1)
    for valley in (0.0, 0.12, 0.2, 0.35):
        humps = np.sin(np.pi * phase) + valley * np.sin(3 * np.pi * phase)
        load = 700 * humps @ [1.0, 0.94, 1.05]
        for noise in (0.0, 0.5, 5.0):
            sound[f"valley {valley} noise {noise}"] = with_noise(load, noise), 0.001
    stands = 700 * np.clip((time - 0.2) / 0.1, 0, 1) * (1 + 0.005 * np.sin(7 * time))
    sound |= {
        "stands": (with_noise(stands, 0.5), 0.001),
        "heel": (with_noise(load + 300 * (np.abs(time - 0.42) < 0.004), 1.0), 0.001),
    }

    def coarse(bits: int) -> Callable[[Array], Array]:
        def change(values: Array) -> Array:
            step = 2.6 * np.abs(values).max() / 2**bits
            return np.round(values / step) * step

        return change

    def slip(values: Array) -> Array:
        return values + 0.2 * np.abs(values).max() * (np.arange(len(values)) > len(values) // 3)

    def lost(values: Array) -> Array:
        return np.where(np.arange(len(values)) % 900 < 3, 0.0, values)

    changes = {f"clipped at {s}": clipped(s) for s in (0.6, 0.8, 0.95)}
    changes |= {f"overflows at {s}": overflowing(s) for s in (0.4, 0.6, 0.9)}
    changes |= {
        "clipped, filtered": lambda v: low_pass(
            clipped(0.6)(v)[:, None], 1000.0, 50.0, "zero_phase"
        )[:, 0]
    }
    changes |= {
        "clipped, then noise": lambda v: with_noise(clipped(0.6)(v), 0.001 * np.abs(v).max())
    }
    changes |= {
        "clipped, 9 bits": lambda v: coarse(9)(clipped(0.7)(v)),
        "slips": slip,
        "lost": lost,
    }
    usual = {f"{b} bits": coarse(b) for b in (9, 12, 16)} | {
        "gated": lambda v: np.where(v > 20, v, 0.0),
        "held": lambda v: np.repeat(v, 5),
    }

    def found(values: Array, step_s: float) -> object:
        least = 0.1 * float(np.ptp(values))
        wraps = find_wraps(values, least)
        limits = [(round(x.level, 6), int(x.at.sum())) for x in find_limits(values, step_s)]
        period = None if wraps is None else (round(wraps.period, 6), len(wraps.at))
        return limits, find_jumps(values, least).at.tolist(), period

    base = acts(found, **sound)
    base |= {
        f"{n}, {c}": lambda v=v, s=s, f=f: found(f(v), s)
        for n, (v, s) in sound.items()
        if " " in n and n[0] == "v"
        for c, f in usual.items()
    }
    loaded = {n: x for n, x in sound.items() if x[0].any()}
    return base, {
        f"{n}, {c}": lambda v=v, s=s, f=f: found(f(v), s)
        for n, (v, s) in loaded.items()
        for c, f in changes.items()
    }


def solved(data: Path) -> Trials:
    """Walks at once and frame by frame."""
    at_once, live = of_markers(data, solved_said, SOLVED), of_markers(data, live_said, SOLVED[:1])
    return tuple(
        one | {f"live {name}": act for name, act in other.items()}
        for one, other in zip(at_once, live, strict=True)
    )


@cache
def trials(section: str, data: Path) -> Trials:
    """Trials that a section of `hbm/thresholds.toml` may change."""
    made: dict[str, Callable[[Path], Trials]] = {
        "body": bodies,
        "segments": bodies,
        "calibration_pose": bodies,
        "frozen": lambda data: of_markers(data, labels_said),
        "labels": lambda data: of_markers(data, labels_said),
        "outliers": solved,
        "motion": of_motion,
        "observed": lambda data: of_markers(data, solved_said, SOLVED),
        "marker_sets": sets,
        "converters": channels,
    }
    return made[section](data) if section in made else ({}, {})
