"""Is a planted fault named, does its correction mend it, and is a sound plate left in peace?

    python -m tests.campaign.planted_faults [--short] [--data ../shared/data] [--jobs 2]

Every fault is put into walks over plates, virtual and real ones, before anything else reads them,
and the trial is processed as a user would. What is found beyond the healthy trial is judged:
"right" where it is the fault and its plate alone; "tied" where several faults are named of which
the trial cannot tell one, and it is among them; "more" where others are named beside it; "wrong"
where others are named; "silent" where none is, though the residual of an axis is more than a
quarter larger than in the healthy trial; "unseen" where it is not.

Every correction that is printed is stated as printed, and the trial processed again. It "mends"
where the residual of an axis falls by more than 5 %, is "worse" where one grows by as much and
beyond that of the healthy trial, and does "nothing" else.

Walks without a fault, with all their markers and with those of pelvis and legs alone, are accused
where anything of plates, labels or mass is named. Prints tables as Markdown; ends with 1 where more
than 2 % are accused, a correction makes a trial worse, or a quarter of the faults that are seen is
not named.
"""

import argparse
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hbm.notes import Note, warnings_of
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.schema import Settings
from pipeline.io.mended_plates import mended_plates
from pipeline.io.recording import Recording
from pipeline.trial.chain import Chain
from pipeline.trial.corrections import find_faults
from pipeline.trial.findings.judge import Fitted, View, fit, hypotheses, instead_of_mass
from pipeline.trial.inputs import Inputs
from pipeline.trial.plate_units import reversed_plates
from pipeline.trial.process import result_of
from tests.campaign.plants import clipped, exchanged, later, moved, overflowing, raw, turned
from tests.campaign.walks import Base, legs_only, opencap, real, virtual
from tests.hbm.motions import relabelled

NAMES = {
    "gain": {"gain"},
    "place": {"moved"},
    "turn": {"turned", "askew"},
    "exchange": {"exchanged"},
    "sign": {"reversed"},
    "clip": {"clipped"},
    "wrap": {"wraps"},
    "late": {"late"},
    "all late": {"all_late"},
    "labels": {"sides_exchanged", "labels_exchanged", "marker_distances_changed"},
    "static": {"static_of_another"},
    "mass": {"mass_differs", "mass"},
    "sex": set[str](),
}
"""Kind of fault -> kinds of findings, or codes of notes, that name it."""
OF_CHANNELS = ("gain", "sign", "clip", "wrap")
"""Kinds of which the channel has to be named too."""
CODES = (
    *("sides_exchanged", "labels_exchanged", "marker_distances_changed", "static_of_another"),
    *("mass_differs", "stature_differs", "metatarsals_swapped", "forces_reversed", "legs_differ"),
    *("plate_constant", "plate_samples_zero", "plates_not_zeroed", "plate_drifts"),
    *("platform_moves", "pressure_far_from_feet"),
)
"""Notes that accuse without a finding of plates."""
NOT_ZEROED = ("two plates", "steps")
"""Real walks over plates that read 16 and 36 N with nobody on them."""
VISIBLE = 1.25
WORSE = 1.05
"""Of the RMS residual of an axis."""
VERDICTS = ("right", "tied", "more", "wrong", "silent", "unseen", "refused")
EFFECTS = ("mends", "nothing", "worse")
MAX_ACCUSED = 0.02
MIN_NAMED = 0.75


class Accusation(NamedTuple):
    """Something that is said to be wrong: kind, numbers of plates, and channel or angle."""

    kind: str
    plates: frozenset[int] = frozenset()
    what: str = ""

    def __str__(self) -> str:
        plates = " and ".join(map(str, sorted(self.plates)))
        return " ".join(filter(None, (self.kind, plates, self.what)))


Named = frozenset[Accusation]
"""One finding, with its rivals."""


def in_numbers(chain: Chain, fitted: Fitted) -> Accusation:
    """Give a hypothesis with the numbers of its plates."""
    kind, indices, what = fitted.hypothesis
    plates = chain.ground.plates
    return Accusation(kind, frozenset(plates[k].number for k in indices), what)


def named(chain: Chain, notes: Sequence[Note]) -> set[Named]:
    """Give what a trial says to be wrong."""
    findings = find_faults(chain)
    doubted = {f.plate for f in chain.raw_faults}.union(*(f.plates for f in findings))
    pulling = {
        (number, sign[1])
        for number, fact in reversed_plates(chain.trial).items()
        if number not in doubted and (sign := re.search(r"reverse (\w+)", fact.note.text))
    }
    return {
        *(frozenset({Accusation("reversed", frozenset({k}), what)}) for k, what in pulling),
        *(
            frozenset({Accusation(f.kind, frozenset({f.plate}), f.channel)})
            for f in chain.raw_faults
        ),
        *(
            frozenset(
                Accusation(f.kind, frozenset(f.plates), f.component) for f in (one, *one.rivals)
            )
            for one in findings
            # what raw samples show is named above, by channel, and zeros below, by their note
            if one.of_load and not one.channels
        ),
        *(frozenset({Accusation(note.code)}) for note in notes if note.code in CODES),
        *_masses(chain, notes, sum(bool(each.rivals) for each in findings)),
    }


def _masses(chain: Chain, notes: Sequence[Note], ties: int) -> Iterator[Named]:
    """Give a mass that differs, or faults of plates instead: beyond the ties of plates alone."""
    if sum(note.code == "plates_unclear" for note in notes) > ties:
        instead = instead_of_mass(chain.evidence, mass_is_stated=chain.mass.is_stated)
        plates = (in_numbers(chain, each) for each in instead)
        yield frozenset({Accusation("mass_differs"), *plates})


@dataclass(frozen=True)
class Trial:
    """What a trial is processed from."""

    recording: Recording
    known: dict
    delay_s: float | None = None

    def chain(self) -> Chain:
        inputs = Inputs(recording=self.recording, **self.known)
        return Chain(inputs, Settings(plate_delay_s=self.delay_s or 0.0))

    def of_subject(self, **what) -> "Trial":
        subject = self.known["subject"].model_copy(update=what)
        return replace(self, known={**self.known, "subject": subject})

    def with_(self, recording: Recording) -> "Trial":
        return replace(self, recording=recording)

    def corrected(self, note: Note) -> "Trial | None":
        """The trial with what a note's advice says typed as printed; None without any."""
        words = " ".join((note.text, note.advice))
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

    def is_(self, accusation: Accusation) -> bool:
        """Whether an accusation is of it."""
        if accusation.kind not in NAMES[self.kind]:
            return False
        if self.plates and accusation.plates != self.plates:
            return False
        return self.kind not in OF_CHANNELS or accusation.what == self.size.split()[0]

    def __str__(self) -> str:
        plates = " and ".join(map(str, sorted(self.plates)))
        return " ".join(filter(None, (self.kind, plates, self.size)))


def of_plate(base: Base, index: int) -> Iterator[tuple[str, str, Recording]]:
    """Kind, size and recording of all faults of one plate alone."""
    recording = base.recording
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
    ahead = base.ahead
    ways = {"along": ahead, "across": np.array([-ahead[1], ahead[0], 0.0])}
    for shift_m in (0.02, 0.04, 0.08):
        for way, direction in ways.items():
            shift = shift_m * direction
            yield "place", f"{100 * shift_m:.0f} cm {way}", moved(recording, index, shift)
    for degrees in (10, 90, 180):
        yield "turn", f"{degrees}°", turned(recording, index, degrees, corners=degrees == 10)


def faults(base: Base, static: Recording | None, plates: int) -> Iterator[Fault]:
    """All faults of a walk; those of single plates on so many of its loaded ones."""
    healthy, loaded = Trial(base.recording, base.known), base.loaded
    recording, none = base.recording, frozenset[int]()
    for index in loaded[:plates]:
        number = recording.plates[index].number
        for kind, size, faulty in of_plate(base, index):
            yield Fault(kind, size, frozenset({number}), healthy.with_(faulty))
    if len(loaded) > 1 and np.isfinite(recording.plates[loaded[0]].corners).all():
        one, other = loaded[:2]
        pair = frozenset(recording.plates[index].number for index in (one, other))
        swapped = exchanged(recording, one, other)
        yield Fault("exchange", "two plates", pair, healthy.with_(swapped))
    for delay_s in (0.01, 0.02):
        late = later(recording, delay_s, *range(len(recording.plates)))
        yield Fault("all late", f"{1000 * delay_s:.0f} ms", none, healthy.with_(late))
    for size, labels in label_pairs(base).items():
        relabelling = replace(recording, markers=relabelled(recording.markers, labels))
        yield Fault("labels", size, none, healthy.with_(relabelling))
    if static is not None:
        known = {**base.known, "static": static}
        yield Fault("static", "of another", none, replace(healthy, known=known))
    mass_kg, sex = base.chain().body.mass, base.known["subject"].sex
    for factor in (0.85, 0.92, 1.08, 1.15):
        person = healthy.of_subject(mass_kg=factor * mass_kg)
        yield Fault("mass", f"× {factor}", none, person)
    if sex is not None:
        person = healthy.of_subject(sex="female" if sex == "male" else "male")
        yield Fault("sex", "the other", none, person)


@cache
def all_walks(data: Path | None, count: int) -> tuple[Base, ...]:
    """Virtual and real walks, once in every process."""
    if data is None:
        return tuple(virtual(count))
    return (*virtual(count), *real(data), opencap(data), legs_only(data))


def static_of_another(base: Base, bases: Sequence[Base]) -> Recording | None:
    """The calibration pose of another person with the same labels; None without any."""
    static = base.known.get("static")
    for other in bases:
        strange = other.known.get("static")
        if (other.name[:5] == base.name[:5] and "virtual" not in base.name) or other is base:
            continue
        if static and strange and {*static.markers.names} <= {*strange.markers.names}:
            return strange
    return None


def label_pairs(base: Base) -> dict[str, tuple[str, str]]:
    """A label and that of the other side, and two neighbours, of markers on shank and thigh."""
    body, names = base.chain().body, base.recording.markers.names
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
    """What a trial says to be wrong and prints, and its RMS residual in the frames that count."""

    chain: Chain
    named: set[Named] = field(default_factory=set)
    warnings: list[Note] = field(default_factory=list)
    rms: Array = field(default_factory=lambda: np.full(6, np.nan))
    refused: str = ""

    @classmethod
    def of(cls, trial: Trial | Base) -> "Outcome":
        """Process a trial."""
        chain = trial.chain()
        try:
            result = result_of(chain)
        except ValueError as error:
            said = " ".join((str(error), *getattr(error, "__notes__", ())))
            return cls(chain, refused=said)
        best = result.compensated or result.measured
        residual = best.residual[result.counted]
        rms = np.sqrt(np.mean(residual**2, axis=0)) if len(residual) else np.full(6, np.nan)
        return cls(chain, named(chain, result.notes), [*warnings_of(result.notes)], rms)


def verdict(fault: Fault, healthy: Outcome, faulty: Outcome) -> str:
    """Judge what the faulty trial says beyond the healthy one."""
    if faulty.refused:
        return "refused"
    new = faulty.named - healthy.named
    true = [each for each in new if any(map(fault.is_, each))]
    if true:
        if len(true) < len(new):
            return "more"
        return "right" if all(fault.is_(one) for each in true for one in each) else "tied"
    if new:
        return "wrong"
    grown = ~(faulty.rms <= VISIBLE * healthy.rms)
    return "silent" if grown.any() else "unseen"


def effect(healthy: Outcome, before: Outcome, after: Outcome) -> str:
    """Give what a correction does to the residual; one that is not known is as large as any."""
    was, now, usual = (
        np.where(np.isfinite(o.rms), o.rms, np.inf) for o in (before, after, healthy)
    )
    if (now > WORSE * np.maximum(was, usual)).any():
        return "worse"
    return "mends" if (now < was / WORSE).any() else "nothing"


@dataclass(frozen=True)
class Judged:
    """What was said of a fault, what the corrections did, and the evidence."""

    walk: str
    kind: str
    size: str
    verdict: str
    effects: tuple[str, ...]
    lines: tuple[str, ...]


def judged(walks: Callable, plates: int, kinds: Sequence[str], index: int) -> list[Judged]:
    """Plant all faults into one walk."""
    base, static = walks()[index], static_of_another(walks()[index], walks())
    healthy, rows = Outcome.of(base), []
    usual = {note.text for note in healthy.warnings}
    for fault in faults(base, static, plates):
        if fault.kind not in kinds:
            continue
        faulty = Outcome.of(fault.trial)
        found = verdict(fault, healthy, faulty)
        sizes = f"{_sizes(healthy.rms)} → {_sizes(faulty.rms)}"
        lines = [f"{base.name}, {fault}: {found} (residual {sizes})"]
        effects = []
        if faulty.refused:
            lines.append(faulty.refused[:100])
        for note in faulty.warnings:
            corrected = None if note.text in usual else fault.trial.corrected(note)
            if corrected is not None:
                after = Outcome.of(corrected)
                effects.append(effect(healthy, faulty, after))
                lines.append(f"{note.code}, {effects[-1]} ({_sizes(after.rms)}): {note.advice}")
        if found not in ("right", "refused"):
            lines += evidence_of(fault, faulty)
        rows.append(Judged(base.name, fault.kind, fault.size, found, tuple(effects), tuple(lines)))
    return rows


def evidence_of(fault: Fault, outcome: Outcome) -> Iterator[str]:
    """Say what was named, and how likely the judge holds the true fault and the likeliest ones."""
    chain = outcome.chain
    for each in outcome.named:
        yield "named " + " or ".join(sorted(map(str, each)))
    reasons = {
        "ground moves": not chain.stands_still,
        "labels": bool(chain.labels.doubtful),
        "raw": chain.lost_load,
    }
    if any(reasons.values()):
        yield "plates are not judged: " + ", ".join(why for why, holds in reasons.items() if holds)
        return
    view = View.of(chain.evidence, mass_is_stated=chain.mass.is_stated)
    fits = [fit(view, hypothesis) for hypothesis in hypotheses(view)]
    fits.sort(key=lambda each: -each.evidence)
    true = [each for each in fits if fault.is_(in_numbers(chain, each))]
    for what, some in (("true", true[:1]), ("likeliest", fits[:3])):
        yield f"{what}: " + "; ".join(_fitted(chain, each) for each in some)


def _fitted(chain: Chain, fitted: Fitted) -> str:
    size = " ".join(f"{number:.3f}" for number in fitted.size)
    small = "" if fitted.matters else ", too small to be named"
    return f"{in_numbers(chain, fitted)} [{size}] evidence {fitted.evidence:.1f}{small}"


def _sizes(rms: Array) -> str:
    return " ".join(f"{size:.0f}" if axis < 3 else f"{size:.1f}" for axis, size in enumerate(rms))


class Sound(NamedTuple):
    """What a walk without a fault is accused of."""

    walk: str
    group: str
    accused: tuple[str, ...]


def sound(walks: Callable, index: int) -> list[Sound]:
    """Process a walk without a fault, with all its markers and with those of the legs alone."""
    base, rows = walks()[index], list[Sound]()
    of = "virtual" if base.name.startswith("virtual") else "real"
    for group in ("all markers", "legs alone"):
        outcome = Outcome.of(base if group == "all markers" else base.with_legs_alone())
        if base.name in NOT_ZEROED:
            outcome.named.discard(frozenset({Accusation("plates_not_zeroed")}))
        said = [" or ".join(sorted(map(str, each))) for each in outcome.named]
        accused = (*sorted(said), *filter(None, [outcome.refused[:100]]))
        rows.append(Sound(base.name, f"{of}, {group}", accused))
    return rows


def tables(rows: Sequence[Judged]) -> Iterator[str]:
    """Lay out one table of all sizes, with the totals of kinds."""
    yield f"\n| fault | {' | '.join((*VERDICTS, *EFFECTS))} |"
    yield "|---" * (1 + len(VERDICTS) + len(EFFECTS)) + "|"
    for kind in NAMES:
        of_kind = [row for row in rows if row.kind == kind]
        for size in dict.fromkeys(row.size for row in of_kind):
            yield _line(f"{kind} {size}", [row for row in of_kind if row.size == size])
        yield _line(f"**{kind}**", of_kind)
    yield _line("**all**", rows)


def _line(name: str, rows: Sequence[Judged]) -> str:
    verdicts = Counter(row.verdict for row in rows)
    effects = Counter(effect for row in rows for effect in row.effects)
    counts = [*(verdicts[v] for v in VERDICTS), *(effects[e] for e in EFFECTS)]
    return f"| {name} | {' | '.join(map(str, counts))} |"


def accused(rows: Sequence[Sound]) -> Iterator[str]:
    """Lay out how many walks without a fault are accused, and of what."""
    for row in rows:
        if row.accused:
            yield f"- {row.walk}, {row.group}: {'; '.join(row.accused)}"
    yield "\n| without a fault | accused | of |\n|---|---|---|"
    for group in dict.fromkeys(row.group for row in rows):
        of_group = [row for row in rows if row.group == group]
        yield f"| {group} | {sum(bool(row.accused) for row in of_group)} | {len(of_group)} |"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.planted_faults", description=__doc__
    )
    parser.add_argument("--data", type=Path, help="folder of real recordings")
    parser.add_argument("--virtual", type=int, default=2, help="virtual walks with faults")
    parser.add_argument("--plates", type=int, default=1, help="plates with faults in every walk")
    parser.add_argument("--sound", type=int, default=50, help="virtual walks without a fault")
    parser.add_argument("--short", action="store_true", help="a few virtual walks, in a minute")
    parser.add_argument("--details", action="store_true", help="what is said of every fault")
    parser.add_argument("--only", nargs="+", choices=NAMES, help="kinds of faults")
    parser.add_argument("--walks", nargs="+", help="names of walks with faults; by default all")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    chosen = parser.parse_args()
    if chosen.short:
        chosen.virtual, chosen.sound = 1, 8
    walks = partial(all_walks, chosen.data, max(chosen.virtual + 1, chosen.sound))
    names = [base.name for base in walks()]
    planted = [
        k
        for k, name in enumerate(names)
        if (name in chosen.walks if chosen.walks else k < chosen.virtual or "virtual" not in name)
    ]
    healthy = [k for k, name in enumerate(names) if k < chosen.sound or "virtual" not in name]
    healthy = healthy if chosen.sound else []
    judge = partial(judged, walks, chosen.plates, chosen.only or [*NAMES])
    rows, untouched = list[Judged](), list[Sound]()
    with ProcessPoolExecutor(chosen.jobs, mp_context=get_context("spawn")) as pool:
        for some in pool.map(judge, planted):
            rows += some
            for row in some if chosen.details else ():
                print("- " + "\n    - ".join(row.lines), flush=True)
        for group in pool.map(partial(sound, walks), healthy):
            untouched += group
    print("\n".join((*accused(untouched), *tables(rows))))
    seen = [row.verdict for row in rows if row.verdict not in ("unseen", "refused")]
    named = sum(found in ("right", "tied") for found in seen)
    too_many = sum(bool(row.accused) for row in untouched) > MAX_ACCUSED * len(untouched)
    worse = any("worse" in row.effects for row in rows)
    return int(too_many or worse or named < MIN_NAMED * len(seen))


if __name__ == "__main__":
    sys.exit(main())
