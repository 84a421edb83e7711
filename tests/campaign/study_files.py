"""What people state in TOML, and the calibration of a treadmill."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from compensation.inertia.calibration import Calibration, to_json
from compensation.inertia.fit import fit_inertia
from compensation.inertia.model import Setup
from pipeline.config.plate_study import read_plates_study
from pipeline.config.toml_file import read_segments
from pipeline.io.read import read_recording
from pipeline.trial.ground.calibrations import read_laboratory
from tests.campaign.formats import Format, read_alone
from tests.campaign.judgement import commanded, printed_raw, refusal
from tests.campaign.mutations import Damage
from tests.campaign.outcome import MAX_MESSAGE_CHARACTERS, Outcome
from tests.pipeline.lab import save

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
static = "{id}_static.c3d"
segments = "own_segments.toml"
[trials.level]
file = "{id}_walk.c3d"
[[trials.level.contacts]]
plate = 1
time_s = 1.2
foot = "left"
[trials.again]
file = "{id}_again.c3d"
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


def write_study(folder: Path, source: Path, subjects: tuple[str, ...] = ("sub01",)) -> Path:
    """Write a small study on the recordings in ``source``."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, name in enumerate(subjects):
        write_recordings(folder, source, name, 0.01 * number)
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "own_segments.toml").write_text(SEGMENTS, encoding="utf-8")
    for name in subjects:
        (folder / f"{name}.toml").write_text(SUBJECT.format(id=name), encoding="utf-8")
    return folder


def write_recordings(folder: Path, source: Path, subject: str, shift_m: float = 0.0) -> None:
    """Write those of a subject, whose markers are shifted: no recording is one of another's."""
    for name, original, own_shift_m in (
        ("static", "static", shift_m),
        ("walk", "walk", shift_m),
        ("again", "walk", shift_m + 0.001),
    ):
        recording = read_recording(source / f"{original}.c3d")
        markers = replace(recording.markers, position=recording.markers.position + own_shift_m)
        save(replace(recording, markers=markers), folder / f"{subject}_{name}.c3d")


def study_files(folder: Path) -> list[Format]:
    """Write a study with segments, a study of plates and a calibration."""
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
        return read_alone(lambda: read_plates_study(path.parent), path)

    return [
        Format("study TOML", study / "study.toml", check),
        Format("subject TOML", study / "sub01.toml", check),
        Format(
            "segments TOML",
            study / "own_segments.toml",
            lambda path, damage: read_alone(lambda: read_segments(path), path),
        ),
        Format("plates TOML", plates / "plates.toml", read_plates),
        Format(
            "calibration JSON",
            laboratory,
            lambda path, damage: read_alone(lambda: read_laboratory(path, ()), path),
        ),
    ]


def checked(study: Path, name: str) -> Outcome:
    """Judge ``hbm check``: its faults are lines of its findings, or errors that name the file."""
    ended = commanded("check", study)
    if ended.err:
        return refusal(ended, (name, "_walk.c3d", "_again.c3d", "_static.c3d", "own_segments.toml"))
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
