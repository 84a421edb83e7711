"""Small valid files of every format that the program reads, and how a damaged one is judged."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from compensation.inertia.calibration import Calibration, to_json
from compensation.inertia.fit import fit_inertia
from compensation.inertia.model import Setup
from pipeline.config.plate_study import read_plates_study
from pipeline.config.toml_file import read_segments
from pipeline.io.read import read_recording
from pipeline.io.recording import Recording
from pipeline.run.failures import read_failures
from pipeline.run.load import collect
from pipeline.run.one_trial import process_request, read_requested
from pipeline.run.request import TrialRequest
from pipeline.run.store import read_trial, recorded_study_folder, write_trial
from pipeline.trial.ground.laboratory import read_laboratory
from pipeline.trial.result import TrialResult
from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
from tests.campaign.judgement import (
    attempted,
    commanded,
    data_changed,
    noted,
    numbers_changed,
    printed_raw,
    refusal,
)
from tests.campaign.mutations import Damage
from tests.campaign.outcome import MAX_MESSAGE_CHARACTERS, Outcome
from tests.pipeline.lab import save
from tests.pipeline.other_formats import (
    excerpt,
    write_dflow,
    write_mox,
    write_nexus,
    write_opensim,
)

STANDING = (0, 120)
WALKING = (600, 850)
"""Frames of the simulated trial: the calibration pose; three gait cycles at full speed."""
STUDY = """name = "Small"
[settings]
cutoff_hz = 6.0
filter = "zero_phase"
[rename]
LASI = "LASIS"
[conditions.level]
cycles = 3
[conditions.again]
cycles = 2
skip_s = 0.2
"""
SUBJECT = """id = "{id}"
sex = "male"
height_m = 1.78
age_years = 30
static = "static.c3d"
segments = "own_segments.toml"
[trials.level]
file = "walk.c3d"
[[trials.level.contacts]]
plate = 1
time_s = 1.2
foot = "left"
[trials.again]
file = "walk.c3d"
"""
SEGMENTS = """[left_shank]
mass_kg = 1.9
center_m = [0.0, 0.0, -0.11]
inertia_kg_m2 = [0.021, 0.021, 0.002]
[right_foot.worn]
mass_kg = 0.3
center_m = [0.05, 0.0, -0.03]
"""
PLATES = """axes = "forward,left,up"
[[weights]]
file = "walk.c3d"
mass_kg = 20.0
speed_mps = 0.5
profile = "sine"
position_m = 0.1
belt = "left"
[[static]]
file = "static.c3d"
belt = "left"
"""


@dataclass(frozen=True)
class Format:
    """A format with a valid file of it.

    Attributes
    ----------
    name
        As in the table.
    file
        The valid file.
    judge
        Path of a damaged file of that name, alone in a folder, and its damage -> the outcome.
    text
        Whether it is text.
    request
        Path -> how ``hbm residuals`` is asked to process it; None where it is no recording.
    """

    name: str
    file: Path
    judge: Callable[[Path, Damage], Outcome]
    text: bool = True
    request: Callable[[Path], TrialRequest] | None = None

    @cached_property
    def content(self) -> bytes:
        return self.file.read_bytes()


@dataclass(frozen=True)
class Trial:
    """A recording's format: how a trial of it is requested, and what it says undamaged.

    ``lines`` says that it is text whose length is stated nowhere: cut between two lines it is a
    shorter recording.
    """

    request: Callable[[Path], TrialRequest]
    file: Path
    lines: bool = False

    @cached_property
    def recording(self) -> Recording:
        return read_requested(self.request(self.file))

    @cached_property
    def result(self) -> TrialResult:
        return process_request(self.request(self.file))

    def judge(self, path: Path, damage: Damage) -> Outcome:
        return attempted(lambda: self._accepted(path, damage), _names(self.request(path), path))

    def _accepted(self, path: Path, damage: Damage) -> Outcome:
        found = read_requested(self.request(path))
        if outcome := noted(found.notes, self.recording.notes):
            return outcome
        shorter = damage.cut and self.lines and damage.content.endswith(b"\n")
        changed = data_changed(found, self.recording, gaps=shorter)
        lost = _lost(found, self.recording)
        if damage.cut and (changed or (lost and not shorter)):
            return Outcome("silent", f"{changed:g} values differ, lost: {lost or 'nothing'}")
        if not changed and not lost:
            return Outcome("fine")
        if changed <= damage.data and not lost:
            return Outcome("one datum", f"{changed:g} values")
        result = process_request(self.request(path))
        if outcome := noted(result.notes, self.result.notes):
            return outcome
        return numbers_changed(result, self.result) or Outcome("fine", f"{changed:g} values")


def _names(request: TrialRequest, path: Path) -> tuple[str, ...]:
    """Give the files of a trial that a refusal may name: they may contradict each other."""
    return (path.name, request.trial.name)


def _lost(found: Recording, known: Recording) -> str:
    """Say of what there are fewer samples."""
    counts = {"frames": len(known.markers.time) - len(found.markers.time)}
    for one, other in zip(found.plates, known.plates, strict=False):
        counts[f"plate {other.number}"] = len(other.time) - len(one.time)
    if known.analog is not None:
        analog = 0 if found.analog is None else len(found.analog.time)
        counts["analog"] = len(known.analog.time) - analog
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count)


def make_formats(folder: Path) -> list[Format]:
    """Write a valid file of every format; equal in every run."""
    folder.mkdir(parents=True, exist_ok=True)
    simulate_trial(folder / "whole.c3d", duration_s=9.0)
    whole = read_recording(folder / "whole.c3d")
    static = save(
        replace(excerpt(whole, *STANDING), metadata=whole.metadata), folder / "static.c3d"
    )
    walk = replace(excerpt(whole, *WALKING), metadata=whole.metadata)
    save(walk, folder / "walk.c3d")
    write_opensim(walk, folder / "walk.trc", folder / "walk.mot")
    write_dflow(walk, folder / "walk.txt")
    _write_record(walk, folder / "record.txt")
    write_mox(walk, folder / "walk.mox")
    write_nexus(walk, folder / "walk.csv")
    known = TrialRequest(folder / "walk.c3d", static=static, sex="male")
    trials = {
        "C3D": ("walk.c3d", lambda path: replace(known, trial=path)),
        "TRC": (
            "walk.trc",
            lambda path: replace(known, trial=path, forces=folder / "walk.mot"),
        ),
        "MOT": (
            "walk.mot",
            lambda path: replace(known, trial=folder / "walk.trc", forces=path),
        ),
        "D-Flow": ("walk.txt", lambda path: replace(known, trial=path)),
        "D-Flow record": (
            "record.txt",
            lambda path: replace(known, trial=folder / "walk.txt", record=path),
        ),
        "MOX": ("walk.mox", lambda path: replace(known, trial=path)),
        "Nexus": ("walk.csv", lambda path: replace(known, trial=path)),
    }
    formats = []
    for name, (file, request) in trials.items():
        trial = Trial(request, folder / file, lines=name.startswith("D-Flow"))
        formats.append(Format(name, folder / file, trial.judge, name != "C3D", request))
    return [*formats, *_study_files(folder), *_results(folder, known)]


def _write_record(walk: Recording, path: Path) -> None:
    time = np.arange(200.0, 200.0 + len(walk.markers.time) / 100, 1 / 60)
    rows = [f"{t:.6f}\t{1.3 + 0.001 * k:.6f}\t1.300000" for k, t in enumerate(time)]
    rows.insert(60, "#\n# EVENT A - COUNT 1\n#")
    rows.append("# EVENT A occured 1 time")
    path.write_text("\n".join(["Time\tLeft.Speed\tRight.Speed", *rows]) + "\n", encoding="utf-8")


def write_study(folder: Path, source: Path, subjects: tuple[str, ...] = ("sub01",)) -> Path:
    """Write a small study on the recordings in ``source``."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("walk.c3d", "static.c3d"):
        (folder / name).symlink_to(source / name)
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "own_segments.toml").write_text(SEGMENTS, encoding="utf-8")
    for name in subjects:
        (folder / f"{name}.toml").write_text(SUBJECT.format(id=name), encoding="utf-8")
    return folder


def _study_files(folder: Path) -> list[Format]:
    study = write_study(folder / "study", folder)
    plates = folder / "plates"
    plates.mkdir()
    (plates / "plates.toml").write_text(PLATES, encoding="utf-8")
    for name in ("walk.c3d", "static.c3d"):
        (plates / name).symlink_to(folder / name)
    laboratory = folder / "laboratory.json"
    laboratory.write_text(to_json(_calibration()), encoding="utf-8")

    def check(path: Path, damage: Damage) -> Outcome:
        content = path.read_bytes()
        shutil.copytree(study, path.parent / "study", symlinks=True)
        (path.parent / "study" / path.name).write_bytes(content)
        return checked(path.parent / "study", path.name)

    def read_plates(path: Path, damage: Damage) -> Outcome:
        for file in plates.glob("*.c3d"):
            (path.parent / file.name).symlink_to(file)
        return _read(lambda: read_plates_study(path.parent), path)

    return [
        Format("study TOML", study / "study.toml", check),
        Format("subject TOML", study / "sub01.toml", check),
        Format(
            "segments TOML",
            study / "own_segments.toml",
            lambda path, damage: _read(lambda: read_segments(path), path),
        ),
        Format("plates TOML", plates / "plates.toml", read_plates),
        Format(
            "calibration JSON",
            laboratory,
            lambda path, damage: _read(lambda: read_laboratory(path, ()), path),
        ),
    ]


def _read(read: Callable[[], object], path: Path) -> Outcome:
    """Read what a person or a program has stated: any value is taken that can be one."""

    def act() -> Outcome:
        read()
        return Outcome("fine")

    return attempted(act, (path.name,))


def checked(study: Path, name: str) -> Outcome:
    """Judge ``hbm check``: its faults are lines of its findings, or errors that name the file."""
    ended = commanded("check", study)
    if ended.err:
        return refusal(ended, (name, "walk.c3d", "static.c3d", "own_segments.toml"))
    faults = [line for line in ended.out.splitlines() if line.startswith("FAULT")]
    if raw := printed_raw(ended.out):
        return Outcome("leak", raw)
    if long := [line for line in faults if len(line) >= MAX_MESSAGE_CHARACTERS]:
        return Outcome("unclear", f"{len(long[0])} characters: {long[0][:200]}")
    if ended.code != (2 if faults else 0):
        return Outcome("unclear", f"exit code {ended.code} with {len(faults)} faults")
    return Outcome("refused", faults[0]) if faults else Outcome("fine")


def _calibration() -> Calibration:
    rng = np.random.default_rng(3)
    accelerations = rng.normal([0, 0, 9.81, 0, 0, 9.81], 1.0, (600, 6))
    wrench = accelerations @ rng.normal(0, 50, (6, 6)) + rng.normal(0, 1, (600, 6))
    setup = Setup(("rear_left", "front_right"), rate_hz=1000.0, cutoff_hz=20.0)
    model = fit_inertia(accelerations, wrench, setup)
    channels = {"rear_left": ["A1X", "A1Y", "A1Z"], "front_right": ["A2X", "A2Y", "A2Z"]}
    plates = {"plate 1": model, "plate 2": model}
    return Calibration(plates, {"recording": "empty.c3d", "channels": json.dumps(channels)})


def _results(folder: Path, request: TrialRequest) -> list[Format]:
    results = folder / "results"
    stored = results / "trials" / "sub01_level.parquet"
    write_trial(process_request(request), "level", "", stored)
    (results / "failures.json").write_text('{"sub01 again": "no gait cycles"}', encoding="utf-8")
    (results / "run.json").write_text('{"study": "../study"}', encoding="utf-8")

    def judge_stored(path: Path, damage: Damage) -> Outcome:
        trials = path.parent / "trials"
        trials.mkdir()
        shutil.copy(path, trials)
        same = path.read_bytes() == stored.read_bytes()
        outcomes = [
            _read(lambda: read_trial(path), path),
            _read(lambda: collect(path.parent), path),
        ]
        for outcome in outcomes:
            if not outcome.survived:
                return outcome
            if outcome.kind == "fine" and not same:
                return Outcome("silent", "accepted")
        return outcomes[0]

    def judge_failures(path: Path, damage: Damage) -> Outcome:
        def act() -> Outcome:
            failures = read_failures(path.parent)
            texts = all(isinstance(text, str) for item in failures.items() for text in item)
            return Outcome("fine") if texts else Outcome("silent", f"read as {failures!r:.100}")

        return attempted(act, (path.name,))

    return [
        Format("stored trial", stored, judge_stored, text=False),
        Format("failures JSON", results / "failures.json", judge_failures),
        Format(
            "run JSON",
            results / "run.json",
            lambda path, damage: _read(lambda: recorded_study_folder(path.parent), path),
        ),
    ]
