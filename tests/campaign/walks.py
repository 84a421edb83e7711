"""Recordings without a fault of their plates, real and virtual ones, with what is known of them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hbm.markers import Markers
from hbm.model import Body
from hbm.spatial import Array
from pipeline.config.schema import Settings, Subject
from pipeline.io.read import read_recording
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Recording
from pipeline.trial.chain import Chain
from pipeline.trial.inputs import Inputs
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS
from tests.overground_walk import simulate_overground
from tests.recordings import recorded

SPEEDS_MPS = (1.0, 1.2, 1.4, 1.6)
UPPER = re.compile("thorax|head|trunk|shoulder|arm|hand")


@dataclass(frozen=True)
class Base:
    """A recording without a fault, and what is known of its subject."""

    name: str
    recording: Recording
    known: dict

    def chain(self) -> Chain:
        """The trial, as a user has it processed."""
        return Chain(Inputs(recording=self.recording, **self.known), Settings())

    @property
    def loaded(self) -> list[int]:
        """Plates that carry a foot, by index."""
        forces = [np.abs(p.wrench[:, 2]).max() for p in self.recording.plates]
        return [k for k, force in enumerate(forces) if force > 0.6 * max(forces)]

    @property
    def ahead(self) -> Array:
        """Direction of walking, or of the feet, horizontal."""
        position = self.recording.markers.position
        seen = np.isfinite(position).any(axis=(1, 2))
        middle = np.nanmean(position[seen], axis=1)[:, :2]
        way = middle[-1] - middle[0]
        way = way if np.linalg.norm(way) > 0.5 else np.array([1.0, 0.0])
        return np.append(way / np.linalg.norm(way), 0.0)

    def with_legs_alone(self) -> "Base":
        """The same without the markers of trunk, head and arms."""
        body = self.chain().body
        fewer = with_legs_alone(self.recording, body)
        return Base(self.name, fewer, known_with_legs_alone(self.known, body))


def real(data: Path) -> Iterator[Base]:
    """Healthy recordings of laboratories."""
    for read in (recorded.treadmill, recorded.overground, recorded.generated):
        yield Base(read.__name__, *read(data))
    folder = data / "overground_walks"
    for child, trials in {"HC030": ("A05", "A22"), "HC031": ("A06", "A23")}.items():
        pose = folder / f"{child}A01.c3d"
        for trial in trials:
            walk = read_recording(folder / f"{child}{trial}.c3d", ReadOptions(), static=pose)
            known = {"subject": Subject(), "static": read_recording(pose, ReadOptions())}
            yield Base(child + trial, walk, known)
    walk, known = recorded.two_plates(data)
    yield Base("two plates", walk, known | {"subject": Subject(mass_kg=63.7)})
    steps, known = recorded.steps(data)
    chosen = recorded.marker_set(recorded.TESTS / "recordings" / "plug_in_gait.toml")
    yield Base("steps", steps, known | {"marker_set": chosen})


def legs_only(data: Path) -> Base:
    """A healthy walk of a laboratory that used no markers of trunk, head and arms."""
    walk = read_recording(data / "legs_only" / "Qualisys.c3d", ReadOptions())
    return Base("legs only", walk, {"subject": Subject()})


def opencap(data: Path) -> Base:
    """A healthy walk in a table of markers without plates' corners."""
    folder = data / "opencap_subject4"
    walk = read_recording(folder / "walking1.trc", forces=folder / "walking1_grf.mot")
    known = {"subject": Subject(sex="male"), "static": read_recording(folder / "static1.trc")}
    return Base("opencap", walk, known)


def virtual(count: int, first: int = 0) -> Iterator[Base]:
    """Virtual walks over three plates, of nine persons at four speeds."""
    for seed in range(first, first + count):
        person = PERSONS[seed % len(PERSONS)]
        speed_mps = SPEEDS_MPS[seed % len(SPEEDS_MPS)]
        plates = 2 + (seed % 5 > 0)
        walk = simulate_overground(person, speed_mps=speed_mps, plates=plates, seed=seed)
        known = {"subject": Subject(sex=person.sex), "static": walk.static}
        yield Base(f"virtual {seed}", walk.walk, known)


def with_legs_alone(recording: Recording, body: Body) -> Recording:
    """Leave out the markers of trunk, head and arms."""
    markers, segment_of = recording.markers, body.segment_of
    legs = [name for name in markers.names if not UPPER.search(segment_of.get(name, ""))]
    columns = [markers.names.index(name) for name in legs]
    fewer = Markers(markers.time, tuple(legs), markers.position[:, columns])
    return replace(recording, markers=fewer)


def known_with_legs_alone(known: dict, body: Body) -> dict:
    """What is known of a subject, with the calibration pose of the legs alone, mass and stature."""
    sizes = {"mass_kg": body.mass, "height_m": body.height_m}
    changed = {"subject": known["subject"].model_copy(update=sizes)}
    if known.get("static") is not None:
        changed["static"] = with_legs_alone(known["static"], body)
    return {**known, **changed}
