"""Does a trial name the fault of a plate, and is it silent where there is none?

    python -m tests.campaign.plate_doubts [--short] [--legs] [--virtual 60] [--data ../shared/data]

Every fault is put into recordings at three sizes, real ones and virtual ones over plates in a
floor: into raw channels, corners or the stated mass of the recording, before anything else reads
it. A fault is found if its own note names its own plate. Prints how many are found, by fault and
size, what is said where they are not, and the notes of recordings without a fault; with --legs, of
recordings without the markers of trunk, head and arms. Ends with 1
where more than 2 % of these are doubted, or a large fault is missed in a quarter of virtual walks.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hbm.spatial import GRAVITY_MPS2, rotation_about
from pipeline.config.schema import Settings, Subject
from pipeline.io.read import read_recording
from pipeline.io.recording import Plate, Recording
from pipeline.io.stated import Stated
from pipeline.trial.process import process_recording
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS
from tests.campaign.legs_alone import known_with_legs_alone, with_legs_alone
from tests.overground_walk import simulate_overground
from tests.recordings import recorded

CODES = {
    *("plate_wraps", "plate_jumps", "plates_exchanged", "plate_turned", "plate_reversed"),
    *("plate_elsewhere", "plate_askew", "plate_gain", "plate_late", "plates_unclear"),
    *("mass_differs", "pressure_far_from_feet"),
}
UP = np.array([0.0, 0.0, 1.0])
SPEEDS_MPS = (1.0, 1.2, 1.4, 1.6)


@dataclass(frozen=True)
class Base:
    """A recording without a fault, and what is known of its subject."""

    name: str
    recording: Recording
    known: dict

    def notes(self, recording: Recording | None = None, mass_factor: float = 1.0):
        """The notes of a trial of it, that are of plates."""
        known = dict(self.known)
        if mass_factor != 1.0:
            known["subject"] = known["subject"].model_copy(
                update={"mass_kg": mass_factor * self.mass_kg}
            )
        result = process_recording(recording or self.recording, settings=Settings(), **known)
        return [note for note in result.notes if note.code in CODES]

    @property
    def mass_kg(self) -> float:
        """The true one."""
        return process_recording(self.recording, settings=Settings(), **self.known).body.mass

    @property
    def loaded(self) -> list[int]:
        """Plates that carry a foot, by index."""
        forces = [np.abs(p.wrench[:, 2]).max() for p in self.recording.plates]
        return [k for k, force in enumerate(forces) if force > 0.6 * max(forces)]


def real(data: Path) -> Iterator[Base]:
    """Healthy recordings of laboratories."""
    for read in (recorded.treadmill, recorded.overground, recorded.generated):
        yield Base(read.__name__, *read(data))
    folder = data / "overground_walks"
    for child, trials in {"HC030": ("A05", "A22"), "HC031": ("A06", "A23")}.items():
        pose = folder / f"{child}A01.c3d"
        for trial in trials:
            walk = read_recording(folder / f"{child}{trial}.c3d", Stated(), static=pose)
            known = {"subject": Subject(), "static": read_recording(pose, Stated())}
            yield Base(child + trial, walk, known)
    walk, known = recorded.two_plates(data)
    yield Base("two plates", walk, known | {"subject": Subject(mass_kg=63.7)})
    steps, known = recorded.steps(data)
    chosen = recorded.marker_set(recorded.TESTS / "recordings" / "plug_in_gait.toml")
    yield Base("steps", steps, known | {"marker_set": chosen})


def virtual(count: int, first: int = 0) -> Iterator[Base]:
    """Virtual walks over three plates, of nine persons at four speeds."""
    for seed in range(first, first + count):
        person = PERSONS[seed % len(PERSONS)]
        speed_mps = SPEEDS_MPS[seed % len(SPEEDS_MPS)]
        plates = 2 + (seed % 5 > 0)
        walk = simulate_overground(person, speed_mps=speed_mps, plates=plates, seed=seed)
        known = {"subject": Subject(sex=person.sex), "static": walk.static}
        yield Base(f"virtual {seed}", walk.walk, known)


def legs_alone(bases: Iterator[Base]) -> Iterator[Base]:
    """The same recordings without the markers of trunk, head and arms."""
    for base in bases:
        body = process_recording(base.recording, settings=Settings(), **base.known).body
        fewer = with_legs_alone(base.recording, body)
        yield Base(base.name, fewer, known_with_legs_alone(base.known, body))


def with_plate(recording: Recording, index: int, change: Callable[[Plate], Plate]) -> Recording:
    """The same recording with one plate changed."""
    plates = [*recording.plates]
    plates[index] = change(plates[index])
    return replace(recording, plates=tuple(plates))


def channel(recording, index, component, change):
    """The same recording with one raw channel changed."""

    def changed(plate):
        wrench = np.array(plate.wrench_in_plate)
        wrench[:, component] = change(wrench[:, component])
        return replace(plate, wrench_in_plate=wrench)

    return with_plate(recording, index, changed)


def wrapped(recording, index, component, share):
    """A channel that overflows at a share of its largest value."""

    def overflow(values):
        limit = share * np.abs(values).max()
        return (values + limit) % (2 * limit) - limit

    return channel(recording, index, component, overflow)


def jumping(recording, index, component, size):
    """A channel that changes at once by a size where the plate is loaded most, and stays there."""
    load = np.abs(recording.plates[index].wrench[:, 2])
    at = int(np.argmax(load))
    return channel(recording, index, component, lambda v: v + size * (np.arange(len(v)) >= at))


def amplified(recording, index, component, gain):
    return channel(recording, index, component, lambda values: gain * values)


def moved(recording, index, shift):
    """Corners that are stated elsewhere."""

    def changed(plate):
        return replace(plate, center=plate.center + shift, corners=plate.corners + shift)

    return with_plate(recording, index, changed)


def turned(recording, index, degrees, *, corners=True):
    """A plate that is stated to be turned about its middle."""
    turn = rotation_about(UP, np.radians(degrees))

    def changed(plate):
        around = plate.center + (plate.corners - plate.center) @ turn.T
        rotation = turn @ plate.rotation
        return replace(plate, rotation=rotation, corners=around if corners else plate.corners)

    return with_plate(recording, index, changed)


def exchanged(recording, one, other):
    """Two plates whose channels are connected to each other's place."""
    plates = [*recording.plates]
    first, second = plates[one], plates[other]
    plates[one] = replace(first, wrench_in_plate=second.wrench_in_plate, time=second.time)
    plates[other] = replace(second, wrench_in_plate=first.wrench_in_plate, time=first.time)
    return replace(recording, plates=tuple(plates))


@dataclass(frozen=True)
class Case:
    """A fault in a recording, and the note that names it."""

    fault: str
    size: str
    code: str
    recording: Recording
    plates: tuple[int, ...] = ()
    mass_factor: float = 1.0

    def found_in(self, notes) -> bool:
        named = (note for note in notes if note.code == self.code)
        return any(self._of_plates(note.values) for note in named)

    def _of_plates(self, values) -> bool:
        numbers = {values[key] for key in ("plate", "first", "second") if key in values}
        return numbers == {*self.plates}


def along_walk(base: Base) -> np.ndarray:
    """Direction of walking, or of the feet, horizontal."""
    markers = base.recording.markers
    middle = np.nanmean(markers.position, axis=1)[:, :2]
    way = middle[-1] - middle[0]
    way = way if np.linalg.norm(way) > 0.5 else np.array([1.0, 0.0])
    return np.append(way / np.linalg.norm(way), 0.0)


def cases(base: Base, index: int) -> Iterator[Case]:
    """All faults of one plate."""
    recording, plate = base.recording, base.recording.plates[index]
    number, weight_n = (plate.number,), base.mass_kg * GRAVITY_MPS2
    ahead = along_walk(base)
    across = np.array([-ahead[1], ahead[0], 0.0])
    cornered = bool(np.isfinite(plate.corners).all())
    shear = int(np.argmax(np.abs(plate.rotation[:, :2].T @ ahead)))

    for share in (0.8, 0.6, 0.4):
        yield Case(
            "wrap of Mx",
            f"{share:.0%} of peak",
            "plate_wraps",
            wrapped(recording, index, 3, share),
            number,
        )
    for size in (0.03, 0.06, 0.12):
        yield Case(
            "jump of My",
            f"{size:.0%} BW·m",
            "plate_jumps",
            jumping(recording, index, 4, size * weight_n),
            number,
        )
    for factor in (0.95, 1.08, 0.85):
        yield Case("mass", f"× {factor}", "mass_differs", recording, (), factor)
    for gain in (0.7, 0.5, 0.3, 1.6, 2.0):
        yield Case(
            "gain of forward force",
            f"× {gain}",
            "plate_gain",
            amplified(recording, index, shear, gain),
            number,
        )
    for gain in (0.94, 0.88, 0.8, 1.1):
        yield Case(
            "gain of vertical force",
            f"× {gain}",
            "plate_gain",
            amplified(recording, index, 2, gain),
            number,
        )
    for component, name in enumerate(("Fx", "Fy", "Fz", "Mx", "My", "Mz")):
        if component in (shear, 2) or cornered:
            yield Case(
                "reversed",
                name,
                "plate_reversed",
                amplified(recording, index, component, -1.0),
                number,
            )
    if not cornered:
        return
    for shift_m in (0.02, 0.04, 0.08):
        for name, direction in (("along", ahead), ("across", across)):
            yield Case(
                f"elsewhere {name}",
                f"{100 * shift_m:.0f} cm",
                "plate_elsewhere",
                moved(recording, index, shift_m * direction),
                number,
            )
    for degrees in (10, 20, 40):
        yield Case("askew", f"{degrees}°", "plate_askew", turned(recording, index, degrees), number)
    for degrees in (90, 180, 270):
        yield Case(
            "turned",
            f"{degrees}°",
            "plate_turned",
            turned(recording, index, degrees, corners=False),
            number,
        )
    for other in base.loaded:
        if other > index:
            pair = (plate.number, recording.plates[other].number)
            yield Case(
                "exchanged", "pair", "plates_exchanged", exchanged(recording, index, other), pair
            )


def said(notes) -> list[str]:
    """Codes with their plates."""
    return [
        note.code + "".join(f" {note.values[k]}" for k in ("plate", "first") if k in note.values)
        for note in notes
    ]


SURE = {
    *(("wrap of Mx", f"{share}% of peak") for share in (80, 60, 40)),
    ("jump of My", "12% BW·m"),
    *(("mass", f"× {factor}") for factor in (0.95, 1.08, 0.85)),
    *(("gain of forward force", f"× {gain}") for gain in (0.3, 2.0)),
    *(("gain of vertical force", f"× {gain}") for gain in (0.88, 0.8, 1.1)),
    *(("elsewhere along", "8 cm"), ("elsewhere across", "4 cm"), ("elsewhere across", "8 cm")),
    *(("turned", f"{degrees}°") for degrees in (90, 180, 270)),
    *(("exchanged", "pair"), ("reversed", "Fz")),
}
"""Faults and sizes of which three of four have to be found in virtual walks; some walks have too
few frames on plates for it."""
MIN_FOUND = 0.75
MAX_ALARMS = 0.02


def healthy(bases: Iterator[Base]) -> tuple[int, int]:
    """Print what is said of recordings without a fault; how many are doubted, of how many."""
    doubted, count = 0, 0
    for base in bases:
        notes, count = base.notes(), count + 1
        doubted += bool(notes)
        for note in notes:
            print(f"without fault: {base.name}: {note.text}", flush=True)
    print(f"without fault: {doubted} of {count} are doubted", flush=True)
    return doubted, count


def faulty(kind: str, bases: Iterator[Base], every: bool) -> dict[tuple[str, str], list[bool]]:
    """Put every fault into recordings, and print how many are found; also by fault and size."""
    found: dict[tuple[str, str], list[bool]] = {}
    missed: dict[tuple[str, str], list[str]] = {}
    for base in bases:
        for index in base.loaded if every else base.loaded[1:2]:
            for case in cases(base, index):
                if case.mass_factor != 1.0 and index != base.loaded[-1]:
                    continue
                notes = base.notes(case.recording, case.mass_factor)
                row = case.fault, case.size
                found.setdefault(row, []).append(case.found_in(notes))
                if not case.found_in(notes):
                    missed.setdefault(row, []).append(f"{base.name} {case.plates}: {said(notes)}")
    for row, each in found.items():
        print(f"{kind} | {row[0]} | {row[1]} | {sum(each)} of {len(each)}", flush=True)
        for line in missed.get(row, ())[:3]:
            print(f"      {line}")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--virtual", type=int, default=60, help="virtual walks without a fault")
    parser.add_argument("--faulty", type=int, default=5, help="virtual walks with faults")
    parser.add_argument("--data", type=Path, help="folder of real recordings")
    parser.add_argument("--short", action="store_true", help="a minute, of virtual walks")
    parser.add_argument("--legs", action="store_true", help="with markers on the legs alone")
    chosen = parser.parse_args()
    only = legs_alone if chosen.legs else iter
    if chosen.short:
        chosen.virtual, chosen.faulty = 8, 4
    doubted, count = healthy(only(virtual(chosen.virtual)))
    if chosen.data:
        more = healthy(only(real(chosen.data)))
        doubted, count = doubted + more[0], count + more[1]
    found = faulty("virtual", only(virtual(chosen.faulty)), every=not chosen.short)
    if chosen.data:
        faulty("real", only(real(chosen.data)), every=True)
    lost = [row for row in found if row in SURE and np.mean(found[row]) < MIN_FOUND]
    if lost:
        print(f"less than {MIN_FOUND:.0%} found: {lost}")
    return int(bool(lost) or doubted > max(MAX_ALARMS * count, 0))


if __name__ == "__main__":
    sys.exit(main())
