"""``hbm check``: what a run will use, leave out or refuse, known before it."""

import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest

from hbm.markers import Markers
from hbm.notes import Note
from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.io.c3d.read import preview_c3d, read_c3d
from pipeline.io.c3d.second_reader import SecondReading, installed
from pipeline.io.c3d.write import write_c3d
from pipeline.io.recording import Metadata
from pipeline.io.stated import Stated
from pipeline.run import check
from pipeline.run.check import check_study
from pipeline.run.run import run_study
from pipeline.trial.process import process_trial
from tests.pipeline import lab
from tests.pipeline.lab import edit


@pytest.fixture
def study(moving_study, tmp_path):
    """A copy of the study with one subject; tests may change it."""
    folder = shutil.copytree(moving_study, tmp_path / "study")
    for path in folder.glob("sub02*"):
        path.unlink()
    return folder


@pytest.fixture
def sway(study):
    """The same with one trial."""
    for other in ("baseline", "pitch"):
        edit(study / "sub01.toml", f'file = "sub01_{other}.c3d"', 'exclude = "not needed here"')
    return study


@dataclass
class Found:
    """Faults and remarks as a person reads them, and the remarks' notes."""

    faults: list[str]
    remarks: list[str]
    notes: dict[str, list[Note]]


def findings(folder):
    found = check_study(read_study(folder))
    notes = {}
    for remark in found.remarks:
        if isinstance(remark.said, Note):
            notes.setdefault(remark.place, []).append(remark.said)
    return Found(list(map(str, found.faults)), list(map(str, found.remarks)), notes)


def change(folder, name, **parts):
    """Write a recording of the study anew with other parts."""
    path = folder / f"{name}.c3d"
    recording = read_c3d(path)
    lab.save(replace(recording, **{k: make(recording) for k, make in parts.items()}), path)


def without_markers(*names):
    def markers(recording):
        kept = [k for k, name in enumerate(recording.markers.names) if name not in names]
        names_kept = tuple(recording.markers.names[k] for k in kept)
        return Markers(recording.markers.time, names_kept, recording.markers.position[:, kept])

    return markers


def without_channels(*names):
    def analog(recording):
        kept = [k for k, name in enumerate(recording.analog.names) if name not in names]
        return replace(
            recording.analog,
            names=tuple(recording.analog.names[k] for k in kept),
            units=tuple(recording.analog.units[k] for k in kept),
            values=recording.analog.values[:, kept],
        )

    return analog


def shorten(folder, name, frames):
    path = folder / f"{name}.c3d"
    lab.save(lab.cropped(read_c3d(path), 0, frames - 1), path)


def test_what_a_check_predicts_is_what_processing_finds(study, tmp_path):
    """Locked coordinates and weighed mass."""
    arm = [f"R{name}" for name in ("LEE", "MEE", "FRM", "LW", "MW", "FIN")]
    change(study, "sub01_pitch", markers=without_markers(*arm))
    found = findings(study)
    assert found.faults == []
    notes = process_trial(read_study(study), "sub01", "pitch").notes
    predicted = found.notes["sub01_pitch.c3d"]
    for code in ("coordinates_held", "mass_weighed"):
        assert next(note for note in notes if note.code == code) in predicted


def test_markers_that_are_often_missing_are_named(sway):
    def gaps(recording):
        position = recording.markers.position.copy()
        position[600:, recording.markers.names.index("LHEAD")] = np.nan
        position[700:760, recording.markers.names.index("RHEAD")] = np.nan
        return replace(recording.markers, position=position)

    change(sway, "sub01_sway", markers=gaps)
    found = findings(sway)
    assert found.faults == []
    assert "sub01_sway.c3d: often missing: LHEAD 50 %" in found.remarks


@pytest.mark.parametrize(
    ("change_study", "fault"),
    [
        (
            lambda f: change(f, "sub01_sway", plates=lambda r: ()),
            "sub01_sway.c3d: the file has no force plates",
        ),
        (
            lambda f: change(f, "sub01_sway", analog=without_channels("Acc1.X")),
            "sub01_sway.c3d: no analog channel 'Acc1.X'; present: Acc1.Y",
        ),
        (
            lambda f: change(f, "sub01_sway", markers=without_markers("PF1", "PF2")),
            "sub01_sway.c3d: platform markers PF1, PF2 are not in the file",
        ),
        (
            lambda f: change(f, "sub01_sway", markers=without_markers("LHEE")),
            "sub01_sway.c3d: the left foot needs the landmark LHEE",
        ),
        (
            lambda f: (f / "sub01_sway.c3d").write_bytes(b"no c3d"),
            "sub01_sway.c3d: not a C3D file",
        ),
        (lambda f: shorten(f, "sub01_sway", 300), "sub01_sway.c3d: there are no foot strikes"),
    ],
)
def test_what_a_run_would_refuse_is_a_fault(sway, tmp_path, change_study, fault):
    change_study(sway)
    found = findings(sway)
    assert any(line.startswith(fault) for line in found.faults), found.faults
    outcomes = list(run_study(read_study(sway), tmp_path / "out", conditions=["sway"]))
    assert [outcome.state for outcome in outcomes] == ["failed"]


needs_ezc3d = pytest.mark.skipif(not installed(), reason="no ezc3d wheel for this system")


@needs_ezc3d
def test_a_study_in_which_both_readers_agree_says_so(study, capsys):
    edit(study / "sub01.toml", 'file = "sub01_pitch.c3d"', 'exclude = "fell"')
    assert main(["check", str(study), "--second-reader"]) == 0
    assert "both readers read the same in 3 of 3 files" in capsys.readouterr().out


def test_a_disagreement_of_readers_is_a_fault_with_channel_frame_and_values(
    study, capsys, monkeypatch
):
    line = "channel Force.Fz1, frame 120: 1.5 here, 2.5 by ezc3d 1.7.2, and 1 further"
    reading = SecondReading("ezc3d 1.7.2", "", (line,))
    monkeypatch.setattr(check, "compare_readers", lambda _: reading)
    assert main(["check", str(study), "--second-reader"]) == 2
    out = capsys.readouterr().out
    assert f"FAULT sub01_sway.c3d: {line}\n" in out
    assert "both readers read the same in 0 of 4 files" in out


def test_a_trial_without_the_belts_speed_is_a_fault(sway):
    belt = '[treadmill.belt]\ncalibration = "empty.c3d"\nspeed_channels = ["Belt.L"]\n'
    edit(sway / "study.toml", "[treadmill.platform]", belt + "[treadmill.platform]")
    assert any(f == "sub01_sway.c3d: no analog channel 'Belt.L'" for f in findings(sway).faults)


def test_faults_of_all_files_are_listed_at_once(study):
    change(study, "sub01_sway", analog=without_channels("Pulse", "A2X"), plates=lambda r: ())
    change(study, "sub01_pitch", markers=without_markers("PF1", "PF2", "LASIS", "RASIS"))
    faults = findings(study).faults
    for name in ("sub01_sway", "sub01_pitch"):
        assert len([fault for fault in faults if fault.startswith(name)]) >= 2, faults


def test_a_mass_that_cannot_be_weighed_has_to_be_stated(sway):
    def restless(recording):
        plates = []
        for plate in recording.plates:
            sway = 1 + 0.3 * np.sin(2 * np.pi * plate.time)[:, None]
            plates.append(replace(plate, wrench_in_plate=plate.wrench_in_plate * sway))
        return tuple(plates)

    change(sway, "sub01_sway", plates=restless)
    found = findings(sway)
    assert found.faults == []
    assert any(note.code == "mass_of_file" for note in found.notes["sub01_sway.c3d"])
    change(sway, "sub01_sway", metadata=lambda recording: Metadata())
    assert any("mass missing: nobody stands still" in fault for fault in findings(sway).faults)
    edit(sway / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nmass_kg = 74.6')
    assert findings(sway).faults == []


def test_excluded_missing_repeated_short_and_uncompensated_trials_are_remarked(study):
    edit(study / "study.toml", 'calibration = "empty.c3d"', "")
    edit(study / "study.toml", "cycles = 4", "cycles = 50")
    edit(study / "sub01.toml", 'file = "sub01_pitch.c3d"', 'exclude = "fell"')
    edit(study / "sub01.toml", "sub01_baseline.c3d", "sub01_sway.c3d")
    (study / "sub03.toml").write_text('id = "sub03"\n[trials]\n', encoding="utf-8")
    found = findings(study)
    assert found.faults == []
    for remark in (
        "sub01 pitch: excluded: fell",
        "sub01 sway: the same recording as sub01 baseline",
        "sub03: no trial for baseline, sway, pitch",
        "sub01_sway.c3d: too short for 50 gait cycles after 6 s",
        "study.toml: no treadmill.calibration, so nothing will be compensated",
    ):
        assert remark in found.remarks


def test_a_static_recording_is_checked_too(sway):
    edit(sway / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nstatic = "pose.c3d"')
    shutil.copy(sway / "sub01_baseline.c3d", sway / "pose.c3d")
    found = findings(sway)
    assert found.faults == []
    (sway / "pose.c3d").write_bytes(b"no c3d")
    (fault,) = findings(sway).faults
    assert fault.startswith("pose.c3d: not a C3D file, nor ")


def test_a_marker_hidden_at_the_beginning_is_not_a_fault(sway, monkeypatch):
    """Where the beginning alone has a fault, the whole file decides: LASIS is hidden for 3 s."""
    monkeypatch.setattr("pipeline.io.c3d.read.BEGINNING_FRAMES", 300)

    def covered(recording):
        position = recording.markers.position.copy()
        position[:300, recording.markers.names.index("LASIS")] = np.nan
        return replace(recording.markers, position=position)

    change(sway, "sub01_sway", markers=covered)
    assert findings(sway).faults == []


def test_hbm_check_prints_everything_and_what_to_do_next(moving_study, capsys):
    assert main(["check", str(moving_study)]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == f"2 subjects, 6 trials, 0 faults; next: hbm run {moving_study}"


def test_a_check_of_the_template_lists_what_is_missing(tmp_path, capsys):
    assert main(["init", str(tmp_path)]) == 0
    capsys.readouterr()
    assert main(["check", str(tmp_path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all("no file 'sub01_" in line for line in lines)


def test_a_preview_is_the_beginning_of_a_file(moving_study, monkeypatch):
    path = moving_study / "sub01_sway.c3d"
    whole = read_c3d(path)
    monkeypatch.setattr("pipeline.io.c3d.read.BEGINNING_FRAMES", 100)
    monkeypatch.setattr("pipeline.io.c3d.read.SAMPLED_FRAMES", 50)
    preview = preview_c3d(path, Stated())
    assert preview.frames == len(whole.markers.time)
    beginning = preview.beginning
    np.testing.assert_array_equal(beginning.markers.position, whole.markers.position[:100])
    assert len(beginning.plates[0].time) == 1000
    np.testing.assert_array_equal(beginning.analog.values, whole.analog.values[:1000])


def test_where_a_static_pose_has_no_plates_the_trial_weighs(sway):
    pose = read_c3d(sway / "sub01_baseline.c3d")
    write_c3d(sway / "pose.c3d", pose.markers)
    edit(sway / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nstatic = "pose.c3d"')
    found = findings(sway)
    assert found.faults == []
    weighed = [note for note in found.notes["sub01_sway.c3d"] if note.code == "mass_weighed"]
    assert [note.values["file"] for note in weighed] == ["sub01_sway.c3d"]
