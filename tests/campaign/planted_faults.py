"""Is a planted fault named, and does the correction that is printed mend it?

    python -m tests.campaign.planted_faults [--short] [--data ../shared/data] [--virtual 2]

Every fault is put into walks over plates, virtual and real ones, before anything else reads them,
and the trial is processed as a user would. What is printed beyond the healthy trial's warnings is
judged: "right" where it names the fault and its plate alone, "tied" where it names the fault and
others, "wrong" where it names others, "silent" where it names none though the residual of an axis
is more than a quarter larger than in the healthy trial, "unseen" where it is not.

Every correction that is printed is stated as printed, and the trial processed again. It "mends"
where the residual of an axis falls by more than 5 %, is "worse" where one grows by as much and
beyond that of the healthy trial, and does "nothing" else. Prints one table per kind and the
totals, as Markdown; ends with 1 where a healthy trial is accused or a correction makes it worse.
"""

import argparse
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from hbm.notes import Note, warnings_of
from hbm.spatial import WRENCH_COMPONENTS, Array, shift_wrench
from pipeline.config.schema import Settings
from pipeline.io.mended_plates import mended_plates
from pipeline.io.recording import Plate, Recording
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import counted
from pipeline.trial.result import TrialResult
from tests.campaign.plate_doubts import (
    Base,
    along_walk,
    exchanged,
    moved,
    real,
    turned,
    virtual,
    with_plate,
)
from tests.hbm.motions import relabelled

NAMES = {
    "gain": {"plate_gain"},
    "place": {"plate_elsewhere"},
    "turn": {"plate_turned", "plate_askew"},
    "exchange": {"plates_exchanged"},
    "sign": {"plate_reversed"},
    "clip": {"plate_clipped"},
    "wrap": {"plate_wraps"},
    "late": {"plate_late"},
    "all late": {"plates_late"},
    "labels": {"sides_exchanged", "labels_exchanged", "marker_distances_changed"},
    "static": {"static_of_another"},
    "mass": {"mass_differs"},
    "sex": set[str](),
}
"""Kind of fault -> codes of the notes that name it."""
OF_CHANNELS = ("gain", "sign", "clip", "wrap")
"""Kinds of which the channel has to be named too."""
ACCUSATIONS = set[str]().union(*NAMES.values()) | {
    *("plate_jumps", "plate_dead", "plate_constant", "plates_not_zeroed", "load_jumps"),
    *("stature_differs", "metatarsals_swapped", "forces_reversed", "platform_moves"),
    *("legs_differ", "plate_samples_zero"),
}
"""What else says that something certain is wrong."""
VISIBLE = 1.25
WORSE = 1.05
"""Of the RMS residual of an axis."""
VERDICTS = ("right", "tied", "wrong", "silent", "unseen", "refused")
EFFECTS = ("mends", "nothing", "worse")
Change = Callable[[Array], Array]


@dataclass(frozen=True)
class Trial:
    """What a trial is processed from."""

    recording: Recording
    known: dict
    delay_s: float = 0.0

    def processed(self) -> TrialResult:
        settings = Settings(plate_delay_s=self.delay_s)
        return process_recording(self.recording, settings=settings, **self.known)

    def of_subject(self, **what) -> "Trial":
        subject = self.known["subject"].model_copy(update=what)
        return replace(self, known={**self.known, "subject": subject})

    def with_(self, recording: Recording) -> "Trial":
        return replace(self, recording=recording)

    def corrected(self, note: Note) -> "Trial | None":
        """The trial with what a note's advice says typed as printed; None without any."""
        words = " ".join((note.advice, *(v for v in note.values.values() if isinstance(v, str))))
        mendings = [*dict.fromkeys(re.findall(r'--mend-plates "([^"]+)"', words))]
        trial = self
        if mendings:
            # of the calibration pose too, as both are read with what a study states
            trial = trial.with_(_mended(trial.recording, mendings))
            if static := self.known.get("static"):
                trial = replace(trial, known={**self.known, "static": _mended(static, mendings)})
        if delay := re.search(r"--plate-delay-ms (-?[\d.]+)", words):
            trial = replace(trial, delay_s=float(delay[1]) / 1000)
        if mass := re.search(r"--mass-kg ([\d.]+)", words):
            trial = trial.of_subject(mass_kg=float(mass[1]))
        pairs = re.findall(r'--rename "?([\w.:-]+)=([\w-]+)"?', words)
        if pairs and not any(":" in old for old, _ in pairs):
            names = dict(pairs)
            markers = trial.recording.markers
            labels = tuple(names.get(name, name) for name in markers.names)
            trial = trial.with_(replace(trial.recording, markers=replace(markers, names=labels)))
        return None if trial is self else trial


def _mended(recording: Recording, mendings: list[str]) -> Recording:
    if not recording.plates:
        return recording
    return replace(recording, plates=mended_plates(recording.plates, mendings))


@dataclass(frozen=True)
class Fault:
    """A fault, the numbers of the plates that it is of, and the trial with it."""

    kind: str
    size: str
    plates: frozenset[int]
    trial: Trial

    def named_by(self, note: Note) -> bool:
        """Whether a note names it, alone or as one of several that nothing can tell apart."""
        codes = {note.code, *map(str, note.values.get("rivals", ()))}
        if not codes & NAMES[self.kind] or plates_of(note) != self.plates:
            return False
        channel = self.size.split()[0]
        return self.kind not in OF_CHANNELS or channel in channels_of(note)


def plates_of(note: Note) -> frozenset[int]:
    """Numbers of the plates that a note is of."""
    values = (note.values[key] for key in ("plate", "first", "second") if key in note.values)
    return frozenset(int(str(value)) for value in values)


def channels_of(note: Note) -> set[str]:
    """Channels that a note is of."""
    values = (note.values.get(key, ()) for key in ("component", "what", "sizes", "limits"))
    return set[str]().union(*({v} if isinstance(v, str) else set(v) for v in values))


def raw(recording: Recording, index: int, component: int, change: Change) -> Recording:
    """The same recording with one channel of a transducer changed, as its converter would."""

    def changed(plate: Plate) -> Plate:
        # channels hold moments about the transducer, a plate those about its surface
        channels = shift_wrench(plate.wrench_in_plate, plate.transducer)
        channels[:, component] = change(channels[:, component])
        return replace(plate, wrench_in_plate=shift_wrench(channels, -plate.transducer))

    return with_plate(recording, index, changed)


def clipped(share: float) -> Change:
    """A channel that stays at a share of its largest value."""

    def change(values: Array) -> Array:
        limit = share * np.abs(values).max()
        return np.clip(values, -limit, limit)

    return change


def overflowing(share: float) -> Change:
    """A channel that starts anew at a share of its largest value."""

    def change(values: Array) -> Array:
        limit = share * np.abs(values).max()
        return (values + limit) % (2 * limit) - limit

    return change


def later(recording: Recording, delay_s: float, *indices: int) -> Recording:
    """The same recording with plates that are later."""
    for index in indices:
        recording = with_plate(recording, index, lambda p: replace(p, time=p.time + delay_s))
    return recording


def of_plate(healthy: Trial, base: Base, index: int) -> Iterator[tuple[str, str, Recording]]:
    """Kind, size and recording of all faults of one plate alone."""
    recording = healthy.recording
    for components, gains in (((0, 1), (0.7, 1.3)), ((2,), (0.9, 1.1)), ((3,), (1.1, 1.3))):
        for component in components:
            for gain in gains:
                size = f"{WRENCH_COMPONENTS[component]} × {gain}"
                yield "gain", size, raw(recording, index, component, lambda v, g=gain: g * v)
    for component, name in enumerate(WRENCH_COMPONENTS):
        yield "clip", f"{name} at 60 %", raw(recording, index, component, clipped(0.6))
        yield "wrap", f"{name} at 60 %", raw(recording, index, component, overflowing(0.6))
        yield "sign", name, raw(recording, index, component, np.negative)
    reverse = f"{recording.plates[index].number}: reverse all"
    yield "sign", "all", _mended(recording, [reverse])
    yield "late", "20 ms", later(recording, 0.02, index)
    if not np.isfinite(recording.plates[index].corners).all():
        return
    ahead = along_walk(base)
    ways = {"along": ahead, "across": np.array([-ahead[1], ahead[0], 0.0])}
    for shift_m in (0.02, 0.04, 0.08):
        for way, direction in ways.items():
            shift = shift_m * direction
            yield "place", f"{100 * shift_m:.0f} cm {way}", moved(recording, index, shift)
    for degrees in (10, 90, 180):
        yield "turn", f"{degrees}°", turned(recording, index, degrees, corners=degrees == 10)


def faults(base: Base, others: list[Base], plates: int) -> Iterator[Fault]:
    """All faults of a walk; those of single plates on so many of its loaded ones."""
    healthy, loaded = Trial(base.recording, base.known), base.loaded
    recording, none = base.recording, frozenset[int]()
    for index in loaded[:plates]:
        number = recording.plates[index].number
        for kind, size, faulty in of_plate(healthy, base, index):
            yield Fault(kind, size, frozenset({number}), healthy.with_(faulty))
    if len(loaded) > 1 and np.isfinite(recording.plates[loaded[0]].corners).all():
        one, other = loaded[:2]
        pair = frozenset(recording.plates[index].number for index in (one, other))
        swapped = exchanged(recording, one, other)
        yield Fault("exchange", "two plates", pair, healthy.with_(swapped))
    for delay_s in (0.01, 0.02):
        late = later(recording, delay_s, *range(len(recording.plates)))
        yield Fault("all late", f"{1000 * delay_s:.0f} ms", none, healthy.with_(late))
    for size, pair in label_pairs(healthy).items():
        relabelling = replace(recording, markers=relabelled(recording.markers, pair))
        yield Fault("labels", size, none, healthy.with_(relabelling))
    static = base.known.get("static")
    for other in others:
        strange = other.known.get("static")
        if static and strange and {*static.markers.names} <= {*strange.markers.names}:
            known = {**base.known, "static": strange}
            yield Fault("static", f"of {other.name}", none, replace(healthy, known=known))
            break
    for factor in (0.85, 0.92, 1.08, 1.15):
        person = healthy.of_subject(mass_kg=factor * base.mass_kg)
        yield Fault("mass", f"× {factor}", none, person)
    sex = base.known["subject"].sex
    if sex is not None:
        person = healthy.of_subject(sex="female" if sex == "male" else "male")
        yield Fault("sex", "the other", none, person)


def label_pairs(trial: Trial) -> dict[str, tuple[str, str]]:
    """A label and that of the other side, and two neighbours, of markers on shank and thigh."""
    body, names = trial.processed().body, trial.recording.markers.names
    of = {
        segment: [name for name in names if body.segment_of.get(name) == f"left_{segment}"]
        for segment in ("thigh", "shank")
    }
    pairs = {}
    for name in (*of["shank"], *of["thigh"]):
        mirrored = name.replace("L", "R", 1) if "L" in name else name.replace("l", "r", 1)
        if mirrored in names and mirrored != name:
            pairs.setdefault("left and right", (name, mirrored))
    if of["thigh"] and of["shank"]:
        pairs["neighbours"] = of["thigh"][0], of["shank"][0]
    return pairs


@dataclass(frozen=True)
class Outcome:
    """What a trial prints, and its RMS residual in the frames that count, (6,) [N, N·m]."""

    warnings: list[Note] = field(default_factory=list)
    rms: Array = field(default_factory=lambda: np.full(6, np.nan))
    refused: str = ""


def outcome(trial: Trial) -> Outcome:
    """Process a trial."""
    try:
        result = trial.processed()
    except ValueError as error:
        return Outcome(refused=" ".join((str(error), *getattr(error, "__notes__", ()))))
    best = result.compensated or result.measured
    residual = best.residual[counted(result)]
    rms = np.sqrt(np.mean(residual**2, axis=0)) if len(residual) else np.full(6, np.nan)
    return Outcome([*warnings_of(result.notes)], rms)


def verdict(fault: Fault, healthy: Outcome, faulty: Outcome, new: list[Note]) -> str:
    """Judge what the faulty trial prints beyond the healthy one."""
    if faulty.refused:
        return "refused"
    accused = [note for note in new if note.code in ACCUSATIONS]
    if any(fault.named_by(note) for note in new):
        return "right" if all(fault.named_by(note) for note in accused) else "tied"
    if accused:
        return "wrong"
    grown = ~(faulty.rms <= VISIBLE * healthy.rms)
    return "silent" if grown.any() else "unseen"


def effect(healthy: Outcome, before: Outcome, after: Outcome) -> str:
    """Give what a correction does to the residual; one that is not known is as large as any."""
    was, usual = (np.where(np.isfinite(o.rms), o.rms, np.inf) for o in (before, healthy))
    worse = ~(after.rms <= WORSE * np.maximum(was, usual)) | ~np.isfinite(after.rms)
    if worse.any():
        return "worse"
    return "mends" if (after.rms < was / WORSE).any() else "nothing"


@dataclass(frozen=True)
class Judged:
    """What was printed of a fault, and what the corrections did."""

    walk: str
    fault: Fault
    verdict: str
    printed: list[str]
    effects: list[str]

    def __str__(self) -> str:
        fault = self.fault
        plates = " and ".join(map(str, sorted(fault.plates)))
        printed = "; ".join(self.printed) or "nothing printed"
        return f"{self.walk}, {fault.kind} {plates}, {fault.size}: {self.verdict}: {printed}"


def judged(base: Base, others: list[Base], plates: int, kinds: list[str]) -> Iterator[Judged]:
    """Plant all faults into one walk, and print what is wrong of it without any."""
    healthy = outcome(Trial(base.recording, base.known))
    for note in healthy.warnings:
        if note.code in ACCUSATIONS:
            print(f"- {base.name}, without a fault: {note.text}")
    usual = {(note.code, plates_of(note)) for note in healthy.warnings}
    for fault in faults(base, others, plates):
        if fault.kind not in kinds:
            continue
        faulty = outcome(fault.trial)
        new = [note for note in faulty.warnings if (note.code, plates_of(note)) not in usual]
        effects, printed = [], [faulty.refused[:60]] if faulty.refused else []
        for note in new:
            numbers = " and ".join(map(str, sorted(plates_of(note))))
            channels = ", ".join(sorted(channels_of(note)))
            printed.append(" ".join(filter(None, (note.code, numbers, channels))))
            corrected = fault.trial.corrected(note)
            if corrected is not None:
                after = outcome(corrected)
                effects.append(effect(healthy, faulty, after))
                printed[-1] += f" ({effects[-1]}: {_sizes(faulty.rms)} → {_sizes(after.rms)})"
        yield Judged(base.name, fault, verdict(fault, healthy, faulty, new), printed, effects)


def _sizes(rms: Array) -> str:
    return " ".join(f"{size:.0f}" if axis < 3 else f"{size:.1f}" for axis, size in enumerate(rms))


def tables(rows: list[Judged]) -> Iterator[str]:
    """Lay out one table per kind, and the totals."""
    for kind in NAMES:
        of_kind = [row for row in rows if row.fault.kind == kind]
        yield f"\n### {kind}\n\n| size | {' | '.join((*VERDICTS, *EFFECTS))} |"
        yield "|---" * (1 + len(VERDICTS) + len(EFFECTS)) + "|"
        for size in dict.fromkeys(row.fault.size for row in of_kind):
            yield _line(size, [row for row in of_kind if row.fault.size == size])
        yield _line("**all**", of_kind)
    yield f"\n### totals\n\n| kind | {' | '.join((*VERDICTS, *EFFECTS))} |"
    yield "|---" * (1 + len(VERDICTS) + len(EFFECTS)) + "|"
    for kind in NAMES:
        yield _line(kind, [row for row in rows if row.fault.kind == kind])
    yield _line("**all**", rows)


def _line(name: str, rows: list[Judged]) -> str:
    verdicts = Counter(row.verdict for row in rows)
    effects = Counter(effect for row in rows for effect in row.effects)
    counts = [*(verdicts[v] for v in VERDICTS), *(effects[e] for e in EFFECTS)]
    return f"| {name} | {' | '.join(map(str, counts))} |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, help="folder of real recordings")
    parser.add_argument("--virtual", type=int, default=2, help="virtual walks")
    parser.add_argument("--plates", type=int, default=2, help="plates with faults in every walk")
    parser.add_argument("--short", action="store_true", help="one plate of one virtual walk")
    parser.add_argument("--details", action="store_true", help="what is printed of every fault")
    parser.add_argument("--only", nargs="+", choices=NAMES, help="kinds of faults")
    parser.add_argument("--walks", nargs="+", help="names of walks; by default all")
    chosen = parser.parse_args()
    if chosen.short:
        chosen.virtual, chosen.plates = 1, 1
    # one walk more, whose calibration pose is another person's
    bases = [*virtual(chosen.virtual + 1)]
    walks = bases[: chosen.virtual]
    if chosen.data:
        walks += real(chosen.data)
        bases += walks[chosen.virtual :]
    rows = []
    for base in walks:
        if chosen.walks and base.name not in chosen.walks:
            continue
        others = [
            other for other in bases if other.name[:5] != base.name[:5] or "virt" in base.name
        ]
        others = [other for other in others if other is not base]
        for row in judged(base, others, chosen.plates, chosen.only or [*NAMES]):
            rows.append(row)
            if chosen.details:
                print(f"- {row}", flush=True)
    print("\n".join(tables(rows)))
    return int(any("worse" in row.effects for row in rows))


if __name__ == "__main__":
    sys.exit(main())
