"""``hbm check``: what a run will use, leave out or refuse, known before it."""

import re
import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest

from hbm.markers import Markers
from hbm.notes import Note
from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.io.c3d import data as c3d_data
from pipeline.io.c3d.read import preview_c3d, read_c3d
from pipeline.io.c3d.second_reader import SecondReading, installed
from pipeline.io.c3d.write import write_c3d
from pipeline.io.recording import Metadata
from pipeline.io.stated import Stated
from pipeline.run import check
from pipeline.run.check import Findings, check_study, read_twice
from pipeline.run.run import run_study
from pipeline.trial.ground.calibration_recording import read_empty
from pipeline.trial.process import process_trial
from tests.pipeline import lab

TRIALS = ("sub01_baseline", "sub01_pitch", "sub01_sway")


@pytest.fixture
def study(moving_study, tmp_path):
    """A copy of the study with one subject; tests may change it."""
    folder = shutil.copytree(moving_study, tmp_path / "study")
    for path in folder.glob("sub02*"):
        path.unlink()
    return folder


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


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


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


def shorter(seconds):
    def cut(folder, name):
        path = folder / f"{name}.c3d"
        recording = read_c3d(path)
        frames, samples = round(100 * seconds), round(1000 * seconds)
        markers = recording.markers
        markers = Markers(markers.time[:frames], markers.names, markers.position[:frames])
        plates = tuple(
            replace(p, time=p.time[:samples], wrench_in_plate=p.wrench_in_plate[:samples])
            for p in recording.plates
        )
        analog = recording.analog
        analog = replace(analog, time=analog.time[:samples], values=analog.values[:samples])
        lab.save(replace(recording, markers=markers, plates=plates, analog=analog), path)

    return cut


def test_a_valid_study_has_no_fault_and_its_remarks_list_what_will_be_used(moving_study):
    found = findings(moving_study)
    assert found.faults == []
    for name in TRIALS:
        remarks = [r.removeprefix(f"{name}.c3d: ") for r in found.remarks if r.startswith(name)]
        assert remarks[0].startswith("12.0 s, 50 markers at 100 Hz, 2 plates at 1000 Hz, channels ")
        assert "Acc1.X [g]" in remarks[0]
        assert "Pulse [V]" in remarks[0]
        assert remarks[0].endswith("no gait events")
        assert any("axes point left, back, up" in line for line in remarks)
        assert any(re.fullmatch(r"body mass 74\.\d kg by the plates, .*", line) for line in remarks)
        assert "46 of the 46 markers of hbm2" in remarks
        assert any("held near neutral" in line and "RToeFlexion" in line for line in remarks)
        assert any("by the markers PF1, PF2, PF3, PF4" in line for line in remarks)
    assert "empty.c3d: compensates plate 1, plate 2" in found.remarks


def test_what_a_check_predicts_is_what_processing_finds(study, tmp_path):
    """Locked coordinates and weighed mass."""
    arm = [f"R{name}" for name in ("LEE", "MEE", "FRM", "LW", "MW", "FIN")]
    change(study, "sub01_pitch", markers=without_markers(*arm))
    found = findings(study)
    assert found.faults == []
    notes = process_trial(read_study(study), "sub01", "pitch").notes
    predicted = found.notes["sub01_pitch.c3d"]
    locked = next(note for note in notes if note.code == "coordinates_held")
    assert locked in predicted
    assert "RElbowFlexion" in locked.values["coordinates"]
    assert next(note for note in notes if note.code == "mass_weighed") in predicted
    assert f"sub01_pitch.c3d: 40 of the 46 markers of hbm2; missing: {', '.join(arm)}" in (
        found.remarks
    )


def test_markers_that_are_often_missing_are_named(study):
    def gaps(recording):
        position = recording.markers.position.copy()
        position[600:, recording.markers.names.index("LHEAD")] = np.nan
        position[700:760, recording.markers.names.index("RHEAD")] = np.nan
        return replace(recording.markers, position=position)

    change(study, "sub01_sway", markers=gaps)
    found = findings(study)
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
            lambda f: change(f, "sub01_sway", analog=without_channels("Pulse")),
            "sub01_sway.c3d: no analog channel 'Pulse'",
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
            lambda f: edit(f / "study.toml", "front_right = ['A2X'", "front_right = ['A2Q'"),
            "empty.c3d: no analog channel 'A2Q'; present: Acc1.X",
        ),
        (
            lambda f: (f / "sub01_sway.c3d").write_bytes(b"no c3d"),
            "sub01_sway.c3d: not a C3D file",
        ),
        (
            lambda f: (f / "empty.c3d").write_bytes(b""),
            "empty.c3d: the file is empty",
        ),
        (lambda f: shorter(3.0)(f, "sub01_sway"), "sub01_sway.c3d: there are no foot strikes"),
        (
            lambda f: shorter(0.1)(f, "sub01_sway"),
            "sub01_sway.c3d: this needs at least 17 samples at 100 Hz, got 10",
        ),
    ],
)
def test_what_a_run_would_refuse_is_a_fault(study, tmp_path, change_study, fault):
    for other in ("baseline", "pitch"):
        edit(study / "sub01.toml", f'file = "sub01_{other}.c3d"', 'exclude = "not needed here"')
    change_study(study)
    found = findings(study)
    assert any(line.startswith(fault) for line in found.faults), found.faults
    outcomes = list(run_study(read_study(study), tmp_path / "out", conditions=["sway"]))
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


@needs_ezc3d
def test_why_a_file_is_read_once_only_is_a_remark(tmp_path, shared_data):
    path, found = tmp_path / "walk.trc", Findings()
    path.write_text("PathFileType\t4\t(X/Y/Z)\twalk.trc\n", encoding="utf-8")
    assert not read_twice(path, found)
    assert not read_twice(shared_data / "c3d_samples" / "type1.C3D", found)
    assert not found.faults
    not_c3d, refused = map(str, found.remarks)
    assert not_c3d == "walk.trc: not a C3D file: there is no second reader for it"
    assert refused.endswith(" does not read it: it reads 0 of 6 analog channels")
    broken = shared_data / "c3d_samples" / "bad_parameter_section.c3d"
    assert not read_twice(broken, found)
    assert not read_twice(tmp_path / "absent.c3d", found)
    assert len(found.faults) == 2


def with_channel(name, unit):
    def analog(recording):
        known = recording.analog
        values = np.column_stack([known.values, np.full(len(known.time), 1.3)])
        return replace(known, names=(*known.names, name), units=(*known.units, unit), values=values)

    return analog


def test_a_speed_of_belts_in_another_unit_is_one_fault_among_all(study):
    belt = '[treadmill.belt]\ncalibration = "empty.c3d"\nspeed_channels = ["Belt.L"]\n'
    edit(study / "study.toml", "[treadmill.platform]", belt + "[treadmill.platform]")
    empty = read_empty(study / "empty.c3d", Stated())
    lab.save(replace(empty, analog=with_channel("Belt.L", "m/s")(empty)), study / "empty.c3d")
    for name in ("sub01_pitch", "sub01_sway"):
        change(study, name, analog=with_channel("Belt.L", "N"))
    faults = [fault for fault in findings(study).faults if "unknown speed unit" in fault]
    assert {fault.split(":")[0] for fault in faults} == {"sub01_pitch.c3d", "sub01_sway.c3d"}
    assert all("channel 'Belt.L'" in fault for fault in faults)


def test_a_trial_without_the_belts_speed_is_a_fault(study):
    belt = '[treadmill.belt]\ncalibration = "empty.c3d"\nspeed_channels = ["Belt.L"]\n'
    edit(study / "study.toml", "[treadmill.platform]", belt + "[treadmill.platform]")
    assert any(f == "sub01_sway.c3d: no analog channel 'Belt.L'" for f in findings(study).faults)


def test_faults_of_all_files_are_listed_at_once(study):
    change(study, "sub01_sway", analog=without_channels("Pulse", "A2X"), plates=lambda r: ())
    change(study, "sub01_pitch", markers=without_markers("PF1", "PF2", "LASIS", "RASIS"))
    found = findings(study)
    faults = "\n".join(found.faults)
    assert main(["check", str(study)]) == 2
    assert "sub01_sway.c3d: the file has no force plates" in faults
    assert "sub01_sway.c3d: no analog channel 'Pulse'" in faults
    assert "sub01_pitch.c3d: platform markers PF1, PF2" in faults
    assert len([f for f in found.faults if f.startswith("sub01_pitch")]) == 2, faults


def test_a_mass_that_cannot_be_weighed_has_to_be_stated(study):
    def restless(recording):
        plates = []
        for plate in recording.plates:
            sway = 1 + 0.3 * np.sin(2 * np.pi * plate.time)[:, None]
            plates.append(replace(plate, wrench_in_plate=plate.wrench_in_plate * sway))
        return tuple(plates)

    change(study, "sub01_sway", plates=restless)
    found = findings(study)
    assert found.faults == []
    assert any(note.code == "mass_of_file" for note in found.notes["sub01_sway.c3d"])
    change(study, "sub01_sway", metadata=lambda recording: Metadata())
    assert any("mass missing: nobody stands still" in fault for fault in findings(study).faults)
    edit(study / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nmass_kg = 74.6')
    assert findings(study).faults == []


def test_a_trial_too_short_for_its_cycles_is_remarked(study):
    edit(study / "study.toml", "cycles = 4", "cycles = 50")
    remark = "sub01_pitch.c3d: too short for 50 gait cycles after 6 s"
    assert remark in findings(study).remarks


def test_excluded_missing_and_repeated_trials_are_remarked(study):
    edit(study / "sub01.toml", 'file = "sub01_pitch.c3d"', 'exclude = "fell"')
    edit(study / "sub01.toml", "sub01_baseline.c3d", "sub01_sway.c3d")
    (study / "sub03.toml").write_text('id = "sub03"\n[trials]\n', encoding="utf-8")
    remarks = findings(study).remarks
    assert "sub01 pitch: excluded: fell" in remarks
    assert "sub01 sway: the same recording as sub01 baseline" in remarks
    assert "sub03: no trial for baseline, sway, pitch" in remarks


def test_nothing_is_compensated_in_a_study_without_calibration(study):
    edit(study / "study.toml", 'calibration = "empty.c3d"', "")
    found = findings(study)
    assert found.faults == []
    assert "study.toml: no treadmill.calibration, so nothing will be compensated" in found.remarks


def test_a_static_recording_is_checked_too(study):
    edit(study / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nstatic = "pose.c3d"')
    shutil.copy(study / "sub01_baseline.c3d", study / "pose.c3d")
    found = findings(study)
    assert found.faults == []
    assert any(re.search(r"standing still from .* of pose\.c3d", line) for line in found.remarks)
    (study / "pose.c3d").write_bytes(b"no c3d")
    (fault,) = findings(study).faults
    assert fault.startswith("pose.c3d: not a C3D file, nor ")


def test_a_marker_hidden_at_the_beginning_is_not_a_fault(study, monkeypatch):
    """Where the beginning alone has a fault, the whole file decides: LASIS is hidden for 3 s."""
    monkeypatch.setattr("pipeline.io.c3d.read.BEGINNING_FRAMES", 300)

    def covered(recording):
        position = recording.markers.position.copy()
        position[:300, recording.markers.names.index("LASIS")] = np.nan
        return replace(recording.markers, position=position)

    change(study, "sub01_sway", markers=covered)
    assert findings(study).faults == []


def test_hbm_check_prints_everything_and_what_to_do_next(moving_study, capsys):
    assert main(["check", str(moving_study)]) == 0
    printed = capsys.readouterr().out
    assert "Acc1.X [g]" in printed
    assert (
        "no [comparison] is stated: sway and pitch are compared with baseline, each with and "
        "without inertia compensation"
    ) in printed
    assert (
        printed.splitlines()[-1] == f"2 subjects, 6 trials, 0 faults; next: hbm run {moving_study}"
    )


def test_a_check_of_the_template_lists_what_is_missing(tmp_path, capsys):
    assert main(["init", str(tmp_path)]) == 0
    capsys.readouterr()
    assert main(["check", str(tmp_path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all("no file 'sub01_" in line for line in lines)


def test_a_preview_reads_a_small_part_of_a_long_file(moving_study, monkeypatch):
    path = moving_study / "sub01_sway.c3d"
    whole = read_c3d(path)
    read = []
    real = c3d_data._decode
    monkeypatch.setattr(
        c3d_data, "_decode", lambda data, *rest: read.append(len(data)) or real(data, *rest)
    )
    monkeypatch.setattr("pipeline.io.c3d.read.BEGINNING_FRAMES", 100)
    monkeypatch.setattr("pipeline.io.c3d.read.SAMPLED_FRAMES", 50)
    preview = preview_c3d(path, Stated())
    assert sum(read) < 0.15 * path.stat().st_size
    assert preview.frames == len(whole.markers.time)
    beginning = preview.beginning
    np.testing.assert_array_equal(beginning.markers.position, whole.markers.position[:100])
    assert len(beginning.plates[0].time) == 1000
    np.testing.assert_array_equal(beginning.analog.values, whole.analog.values[:1000])


def test_missing_shares_are_estimated_from_frames_over_all_of_the_file(study):
    def gaps(recording):
        position = recording.markers.position.copy()
        position[300:900, 0] = np.nan
        position[:, 1] = np.nan
        return replace(recording.markers, position=position)

    change(study, "sub01_sway", markers=gaps)
    names = read_c3d(study / "sub01_sway.c3d").markers.names
    missing = preview_c3d(study / "sub01_sway.c3d", Stated()).missing
    assert missing[names[0]] == pytest.approx(0.5, abs=0.01)
    assert missing[names[1]] == 1.0
    assert missing[names[2]] == 0.0


def test_where_a_static_pose_has_no_plates_the_trial_weighs(study):
    pose = read_c3d(study / "sub01_baseline.c3d")
    write_c3d(study / "pose.c3d", pose.markers)
    edit(study / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nstatic = "pose.c3d"')
    found = findings(study)
    assert found.faults == []
    weighed = [note for note in found.notes["sub01_sway.c3d"] if note.code == "mass_weighed"]
    assert [note.values["file"] for note in weighed] == ["sub01_sway.c3d"]
