"""Healthy walks, and walks with planted faults, that show what each number of judgement decides.

Real and simulated ones: over plates in a floor, on two belts, and on a platform that moves, of
which the treadmill is calibrated.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from hbm.markers import Markers
from hbm.spatial import rotate_wrench, shift_wrench
from pipeline.config.schema import Condition, Settings, Subject
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Event, Recording
from pipeline.trial.chain import Chain
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.inputs import Inputs
from tests.campaign.planted_faults import Trial, faults
from tests.campaign.plants import (
    Change,
    channel,
    clipped,
    dead,
    drifting,
    jumping,
    later,
    lost,
    moved,
    noisy,
    offset,
    raw,
    until,
    without_load,
)
from tests.campaign.walks import Base, opencap, real, virtual
from tests.hbm.motions import displaced, exchanged, held, without
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import TREADMILL

Make = Callable[[], Chain]
"""Reads what a walk is processed from."""
OF_SAMPLES = "raw", "zeros", "drift", "finding", "corrections"
OF_LOADS = "evidence", "judge", "corrections", "contact", "carried", "quality", "subject", "stages"
OF_UNITS = ("plate_units",)
OF_MARKERS = "checks", "quality", "joints", "carried", "events"
OF_STEPS = "carried", "contact", "detection", "events", "cycles", "subject", "quality", "stages"
OF_PLACES = "contact", "plate_units", "judge", "corrections", "evidence"
OF_EVENTS = "events", "cycles", "detection"
OF_SETTINGS = "drift", "subject", "plate_units"
OF_PLATFORM = "platform", "cycles", "wrenches", "calibrations", "laboratory", "accelerometers"
"""Sections whose numbers each kind of fault concerns."""


class Case(NamedTuple):
    """A walk, and the sections that its fault concerns; none where it is healthy."""

    make: Make
    sections: tuple[str, ...]


BELTS_S, SWAYS_S = 16.0, (8.0, 11.0)
PERSON = Subject(sex="male")


def belts() -> Base:
    """A simulated walk on two belts; the subject stands first."""
    with TemporaryDirectory() as folder:
        walk = lab.walk(folder, duration_s=BELTS_S)
    for index in range(len(walk.plates)):
        for component in range(6):
            walk = channel(walk, index, component, noisy(0.5 if component < 3 else 0.15))
    return Base("belts", walk, {"subject": PERSON})


def on_platform(walk: Recording, motion: lab.PlatformMotion, **how: float) -> Trial:
    """A walk on a platform whose treadmill is calibrated; perturbed where it sways."""
    empty = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0))
    laboratory = Laboratory(TREADMILL, fit_calibration(empty, TREADMILL))
    condition = Condition(perturbed=bool(np.ptp(motion.sway)), cycles=2)
    known = {"subject": PERSON, "laboratory": laboratory, "condition": condition}
    return Trial(lab.on_platform(walk, motion, **how), known)


def swaying() -> lab.PlatformMotion:
    return lab.swaying(BELTS_S, SWAYS_S)


@cache
def walks(data: Path) -> dict[str, Case]:
    """Real and simulated walks, healthy ones first, then with one planted fault each."""
    bases = {base.name: base for base in (*real(data), opencap(data), *virtual(1), belts())}
    walk = bases["belts"].recording
    sound: dict[str, Make] = {name: base.chain for name, base in bases.items()}
    sound["sways"] = lambda: on_platform(walk, swaying()).chain()
    sound["pitches"] = lambda: on_platform(walk, lab.pitching(BELTS_S)).chain()
    cases = {name: Case(make, ()) for name, make in sound.items()}
    for name in ("virtual 0", "HC030A05"):
        for k, fault in enumerate(faults(bases[name], None, 1)):
            if k % 4 == 0:
                cases[f"{name}, {fault}"] = Case(fault.trial.chain, OF_LOADS)
    for base in (bases["belts"], bases["HC030A05"]):
        of_base = {of_samples: OF_SAMPLES, of_units: OF_UNITS, of_markers: OF_MARKERS}
        for planted, of in of_base.items():
            for name, recording in planted(base):
                trial = Trial(recording, base.known)
                cases[f"{base.name}, {name}"] = Case(trial.chain, of)
    for planted, of in {of_belts: OF_STEPS, of_places: OF_PLACES}.items():
        for name, recording in planted(bases["belts"]):
            cases[f"belts, {name}"] = Case(Trial(recording, {"subject": PERSON}).chain, of)
    base = bases["treadmill"]
    for name, events in of_events(base.recording.events):
        trial = Trial(replace(base.recording, events=tuple(events)), base.known)
        cases[f"treadmill, {name}"] = Case(trial.chain, OF_EVENTS)
    other = {**bases["HC030A05"].known, "static": bases["HC031A06"].known["static"]}
    stranger = Trial(bases["HC030A05"].recording, other)
    cases["HC030A05, pose of another"] = Case(stranger.chain, OF_MARKERS)
    for name, make in of_settings(walk, bases["overground"]).items():
        cases[name] = Case(make, OF_SETTINGS)
    return cases | {name: Case(make, OF_PLATFORM) for name, make in of_platform(walk).items()}


def of_settings(walk: Recording, overground: Base) -> dict[str, Make]:
    """Zeros that are followed, functional hips, and free torques of forces at pressures."""
    drifts = replace(
        raw(walk, 0, 2, drifting(30.0)), options=ReadOptions(mend_plates=("1: drift",))
    )
    makes: dict[str, Make] = {}
    for method in ("realtime", "zero_phase"):
        settings = Settings(filter=method)
        makes[f"belts, zero followed, {method}"] = lambda s=settings: Chain(
            Inputs(recording=drifts, subject=PERSON), s
        )
    makes["belts, functional hips"] = lambda: Chain(
        Inputs(recording=walk, subject=PERSON, hip_trial=walk), Settings(hip="functional")
    )
    for factor in (30.0, 100.0, 1000.0):
        torques = overground.recording
        for k in range(len(torques.plates)):
            torques = channel(torques, k, 5, lambda values, f=factor: f * values)
        makes[f"overground, Mz × {factor:g}"] = Trial(torques, overground.known).chain
    return makes


def of_samples(base: Base) -> Iterator[tuple[str, Recording]]:
    """Faults that raw samples of a plate show, and zeros."""
    index, recording = base.loaded[0], base.recording
    most_n = np.abs(recording.plates[index].wrench_in_plate[:, 2]).max()
    changes: dict[str, tuple[int, Change]] = {
        "Fz clipped at 90 %": (2, clipped(0.9)),
        "Mx clipped at 15 %": (3, clipped(0.15)),
        "Fx jumps by 4 %": (0, jumping(0.04 * most_n)),
        "Fx jumps by 10 %": (0, jumping(0.1 * most_n)),
        "Fz jumps by 20 %": (2, jumping(0.2 * most_n)),
        "3 samples of Fz lost": (2, lost(3)),
        "8 samples of Fz lost": (2, lost(8)),
        "2 samples of Fy lost": (1, lost(2)),
        "Fy constant": (1, lambda values: 0 * values),
        "Fx noise alone": (0, dead(0.5)),
        "Mz noise alone": (5, dead(0.2)),
        "Fz 7 N": (2, offset(7.0)),
        "Fz 15 N": (2, offset(15.0)),
        "Fx 7 N": (0, offset(7.0)),
        "Fx 15 N": (0, offset(15.0)),
        "My 8 N·m": (4, offset(8.0)),
        "Fz drifts by 4 N": (2, drifting(4.0)),
        "Fz drifts by 30 N": (2, drifting(30.0)),
        "Mx drifts by 1 N·m": (3, drifting(1.0)),
        "Fz noise of 6 N": (2, noisy(6.0)),
    }
    for name, (component, change) in changes.items():
        yield name, raw(recording, index, component, change)
    ended = (0.93, 0.85, 0.5)
    yield from ((f"plates for {100 * share:.0f} %", until(recording, share)) for share in ended)
    for gain in (0.8, 0.92, 1.12):
        every = recording
        for k in range(len(recording.plates)):
            every = channel(every, k, 2, lambda values, g=gain: g * values)
        yield f"Fz of all × {gain}", every


def of_units(base: Base) -> Iterator[tuple[str, Recording]]:
    """Powers of ten."""
    of = {"all": range(6), "forces": range(3), "moments": range(3, 6), "My": [4]}
    powers = {"all": (-3, 3), "forces": (-1, 1), "moments": (-3, 3), "My": (-3,)}
    for name, components in of.items():
        for power in powers[name]:
            changed = base.recording
            for k in range(len(changed.plates)):
                for component in components:
                    changed = channel(changed, k, component, lambda v, p=power: 10.0**p * v)
            yield f"{name} × 10^{power}", changed


def of_markers(base: Base) -> Iterator[tuple[str, Recording]]:
    """Markers that vanish, are held, exchanged or elsewhere."""
    markers, body = base.recording.markers, base.chain().body
    of = {
        segment: [name for name in markers.names if body.segment_of.get(name) == segment]
        for segment in ("pelvis", "left_shank", "left_foot", "left_forearm")
    }
    seen = np.flatnonzero(np.isfinite(markers.position).all(axis=(1, 2)))
    middle = int(np.median(seen))
    changed: dict[str, Markers] = {}
    for frames in (8, 25):
        part = slice(middle, middle + frames)
        for segment, names in of.items():
            changed[f"{segment} unseen for {frames} frames"] = without(markers, names, part)
        changed[f"markers held for {frames} frames"] = held(markers, part)
    leg = [name for name in markers.names if body.segment_of.get(name, "").startswith("left_")]
    changed["left side unseen for 15 frames"] = without(markers, leg, slice(middle, middle + 15))
    shank = of["left_shank"]
    changed["marker of the shank 5 cm off"] = displaced(markers, shank[0], np.array([0.05, 0, 0]))
    changed["markers of the shank exchanged"] = exchanged(
        markers, slice(middle, middle + 30), shank[:2]
    )
    for name, now in changed.items():
        yield name, replace(base.recording, markers=now)


def of_belts(base: Base) -> Iterator[tuple[str, Recording]]:
    """Steps beside plates, both feet on one, touches, levels that change, and cut recordings."""
    walk = base.recording
    for k, length_s in enumerate((0.06, 0.15, 0.4, 1.0)):
        beside = without_load(walk, k % 2, 10.0, 10.0 + length_s)
        yield f"no load for {length_s} s", beside
    yield "a plate without load", without_load(walk, 0, 0.0, BELTS_S)
    first, load = walk.plates[0], sum(plate.wrench for plate in walk.plates)
    in_plate = rotate_wrench(shift_wrench(load, first.center), first.rotation.T)
    yield (
        "one plate for both feet",
        replace(walk, plates=(replace(first, wrench_in_plate=in_plate),)),
    )
    for size in (8.0, 16.0, 40.0):
        wave = size * np.sin(2 * np.pi * walk.plates[0].time)
        yield f"level waves by {size:g} N", channel(walk, 0, 2, lambda v, w=wave: v + w)
    rate = walk.markers.rate_hz
    for first_s, last_s in ((0.0, 2.3), (8.0, 9.4), (8.0, 12.0), (1.0, 9.0)):
        part = lab.cropped(walk, int(first_s * rate), int(last_s * rate))
        yield f"{first_s:g} to {last_s:g} s alone", part


def of_places(base: Base) -> Iterator[tuple[str, Recording]]:
    """Plates elsewhere, far and near, and late ones."""
    across = np.array([0.0, 1.0, 0.0])
    for shift_m in (0.05, 0.15, 0.35, 0.7, 1.5):
        yield f"plate {shift_m} m off", moved(base.recording, 0, shift_m * across)
        yield f"plate {shift_m} m lower", moved(base.recording, 0, -shift_m * np.array([0, 0, 1.0]))
    for delay_s in (0.005, 0.01, 0.02):
        yield f"a plate {delay_s} s late", later(base.recording, delay_s, 0)
        yield f"plates {delay_s} s late", later(base.recording, delay_s, 0, 1)


def of_events(events: tuple[Event, ...]) -> Iterator[tuple[str, list[Event]]]:
    """Events early or late, of the other side, of every other strike, missing and too many."""
    strikes = [event for event in events if event.label == "foot_strike"]
    for shift_s in (0.06, 0.12, 0.2, 0.4):
        yield f"events {shift_s} s late", [replace(e, time=e.time + shift_s) for e in events]
    yield "every other strike", [e for e in events if e not in strikes[2::4] + strikes[3::4]]
    yield "a strike missing", [e for e in events if e is not strikes[len(strikes) // 2]]
    extra = replace(strikes[5], time=strikes[5].time + 0.3)
    yield "a strike too many", sorted([*events, extra], key=lambda e: e.time)
    yield "half of the events", [*events[: len(events) // 2]]
    rng = np.random.default_rng(0)
    for spread_s in (0.06, 0.15):
        apart = [replace(e, time=e.time + rng.normal(0, spread_s)) for e in events]
        yield f"events {spread_s} s apart", apart


def of_platform(walk: Recording) -> dict[str, Make]:
    """Platforms that move without a word, and faults of those that are known."""
    makes: dict[str, Make] = {}
    known = {"subject": PERSON}
    for size_m in (0.003, 0.008, 0.03):
        motion = replace(swaying(), sway=size_m / lab.STEP_M * swaying().sway)
        trial = Trial(lab.on_platform(walk, motion, assembly=False), known)
        makes[f"belts, sways by {1000 * size_m:g} mm in silence"] = trial.chain
    for degrees in (0.7, 1.5):
        motion = lab.pitching(BELTS_S, degrees=degrees)
        trial = Trial(lab.on_platform(walk, motion, assembly=False), known)
        makes[f"belts, pitches by {degrees:g}° in silence"] = trial.chain
    for delay_s in (0.0015, 0.003, 0.01):
        makes[f"sways, plates {delay_s} s late"] = lambda d=delay_s: on_platform(
            walk, lab.shaken(BELTS_S), plate_delay_s=d, accelerometer_delay_s=d
        ).chain()

    def changed(change: Callable[[Recording], Recording]) -> Make:
        def make() -> Chain:
            trial = on_platform(walk, swaying())
            return trial.with_(change(trial.recording)).chain()

        return make

    for noise in (0.0, 0.3, 0.8):
        makes[f"sways, pulses in noise of {noise:g} V"] = lambda n=noise: pulsing(walk, n).chain()
    for frames in (3, 7, 15):
        makes[f"sways, {frames} frames lost"] = changed(
            lambda r, n=frames: replace(
                r, markers=without(r.markers, r.markers.names, slice(900, 900 + n))
            )
        )
    for offset_m in (0.007, 0.015):
        makes[f"sways, a platform marker {1000 * offset_m:g} mm off"] = changed(
            lambda r, m=offset_m: replace(
                r, markers=displaced(r.markers, "PF1", m * np.ones(3) / 3**0.5, slice(600, 900))
            )
        )
    for shift_m in (0.07, 0.15):
        makes[f"sways, plate {shift_m} m from its calibration"] = changed(
            lambda r, m=shift_m: moved(r, 0, np.array([m, 0, 0]))
        )
    for short_s in (0.3, 0.8):
        makes[f"sways, channels {short_s} s shorter"] = changed(lambda r, s=short_s: shorter(r, s))
    return makes


def pulsing(walk: Recording, noise_v: float) -> Trial:
    """Perturbations that a channel marks."""
    trial = on_platform(walk, swaying(), pulses=SWAYS_S)
    recording = trial.recording
    values = recording.analog.values + noise_v * np.random.default_rng(0).normal(
        size=(len(recording.analog.time), 1)
    ) * (np.array(recording.analog.names) == "Pulse")
    condition = Condition(perturbed=True, cycles=2, pulse_channel="Pulse")
    changed = replace(recording, analog=replace(recording.analog, values=values))
    return replace(trial.with_(changed), known={**trial.known, "condition": condition})


def shorter(recording: Recording, by_s: float) -> Recording:
    """Plates and channels that end before the markers."""
    kept = slice(0, int((BELTS_S - by_s) * 1000))
    analog = recording.analog
    part = replace(analog, time=analog.time[kept], values=analog.values[kept])
    return replace(until(recording, 1 - by_s / BELTS_S), analog=part)
