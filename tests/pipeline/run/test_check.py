"""``hbm check`` says before a run what it will use, leave out or refuse."""

import re
import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest

from compensation import to_json
from hbm.markers import Markers
from hbm.notes import Note
from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.io.c3d.read import read_c3d
from pipeline.io.c3d.second_reader import SecondReading, installed
from pipeline.io.recording import Fact, Metadata, saying
from pipeline.run import check
from pipeline.run.check import check_study
from pipeline.run.run import run_study
from pipeline.trial.process import process_trial
from pipeline.trial.study_files import read_study_laboratory
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.hbm.motions import without
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
        half = without(recording.markers, ["LHEAD"], slice(600, None))
        return without(half, ["RHEAD"], slice(700, 760))

    change(sway, "sub01_sway", markers=gaps)
    found = findings(sway)
    assert found.faults == []
    assert any(re.match("sub01_sway.c3d: .*LHEAD 50 %", remark) for remark in found.remarks)


@pytest.mark.parametrize(
    ("change_study", "fault"),
    [
        (
            lambda f: change(f, "sub01_sway", plates=lambda r: ()),
            "sub01_sway.c3d: .*no force plates",
        ),
        (
            lambda f: change(
                f, "sub01_sway", analog=lambda r: lab.without_channels(r, "Acc1.X").analog
            ),
            "sub01_sway.c3d: .*'Acc1.X'; .*Acc1.Y",
        ),
        (
            lambda f: change(f, "sub01_sway", markers=without_markers("PF1", "PF2")),
            "sub01_sway.c3d: platform markers PF1, PF2 ",
        ),
        (
            lambda f: change(f, "sub01_sway", markers=without_markers("LHEE")),
            "sub01_sway.c3d: .*left foot .*LHEE",
        ),
        (
            lambda f: (f / "sub01_sway.c3d").write_bytes(b"no c3d"),
            "sub01_sway.c3d: not a C3D file",
        ),
        (lambda f: shorten(f, "sub01_sway", 300), "sub01_sway.c3d: .*no foot strikes"),
    ],
)
def test_what_a_run_would_refuse_is_a_fault(sway, tmp_path, change_study, fault):
    change_study(sway)
    found = findings(sway)
    assert any(re.match(fault, line) for line in found.faults), found.faults
    outcomes = list(run_study(read_study(sway), tmp_path / "out", conditions=["sway"]))
    assert [outcome.state for outcome in outcomes] == ["failed"]


IN_BASELINE = "[conditions.baseline]\ncycles = 4\nskip_s = 6.0\n"
SWAY = 'pulse_channel = "Pulse"\n'


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        (IN_BASELINE, f"[settings]\ncutoff_hz = 50\n{IN_BASELINE}", "cut-off must lie between 0"),
        (SWAY, 'pulse_channel = "Pitch"\n', "no perturbation"),
        (SWAY, 'pulse_channel = "Puls"\n', "'Puls', .*'Pulse'"),
        (SWAY, f"{SWAY}skip_s = 10.0\n", "none of the"),
        (SWAY, f"{SWAY}window = [0.0, 3.3]\n", "next one at 9.7"),
        (SWAY, f"{SWAY}window = [0.0, 3.0]\n", "ends beyond all"),
    ],
)
def test_what_settings_make_a_run_refuse_is_a_fault(sway, tmp_path, old, new, fault):
    """The sway trial at 100 Hz has pulses at 6.5 and 9.7 s, none in pitch, and no gait events."""
    edit(sway / "study.toml", old, new)
    faults = findings(sway).faults
    assert len([line for line in faults if re.search(fault, line)]) == 1, faults
    (outcome,) = run_study(read_study(sway), tmp_path / "out", conditions=["sway"])
    assert outcome.failure is not None


def test_what_a_run_would_refuse_of_a_variant_is_a_fault(sway, tmp_path):
    refused = {
        "slow]\ncutoff_hz = 50.0": "variant slow: cut-off must",
        'own]\nevents = "file"': "variant own: .*no foot strikes",
        'pig]\nmarker_set = "pig"': "variant pig: .*pelvis needs",
        'x.treadmill.accelerometers]\nx = ["a", "b", "c"]': "variant x: empty.c3d: .*'a'",
    }
    stated = "".join(f"[variants.{variant}\n" for variant in refused)
    edit(sway / "study.toml", IN_BASELINE, stated + IN_BASELINE)
    faults = findings(sway).faults
    for fault in refused.values():
        assert len([line for line in faults if re.search(fault, line)]) == 1, faults
    (outcome,) = run_study(read_study(sway), tmp_path / "out", conditions=["sway"])
    assert {*outcome.failed_variants} == {"slow", "own", "pig", "x"}


def test_a_variant_that_contradicts_its_fitted_calibration_is_a_fault(sway):
    calibration = read_study_laboratory(read_study(sway)).calibration
    (sway / "e.json").write_text(to_json(calibration))
    edit(sway / "study.toml", '"empty.c3d"', '"e.json"')
    assert findings(sway).faults == []
    stated = "[variants.a.treadmill]\naccelerometer_delay_s = 0.1\n"
    stated += "[variants.b.treadmill]\ncutoff_hz = 10.0\n"
    edit(sway / "study.toml", IN_BASELINE, stated + IN_BASELINE)
    of_model, of_cutoff = findings(sway).faults
    assert of_model.startswith("study.toml: variant a: e.json: ")
    assert of_cutoff.startswith("variant b: sub01_sway.c3d: plate 1: ")


def test_a_trial_with_none_of_the_markers_of_its_pose_is_a_fault(sway):
    edit(sway / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nstatic = "pose.c3d"')
    shutil.copy(sway / "sub01_baseline.c3d", sway / "pose.c3d")
    platform = tuple(lab.PLATFORM_MARKERS_M)

    def renamed(recording):
        markers = recording.markers
        names = tuple(n if n in platform else f"{n}_2" for n in markers.names)
        return replace(markers, names=names)

    change(sway, "sub01_sway", markers=renamed)
    faults = findings(sway).faults
    assert any("none of the body's" in fault for fault in faults), faults


@pytest.mark.parametrize(
    ("copy", "windows", "repeated"),
    [
        ("sub01_baseline", ("", ""), True),
        ("again", ("", ""), True),
        ("again", ("window = [6.0, 8.0]", "window = [8.0, 10.0]"), False),
        ("again", ("window = [6.0, 8.0]", "window = [7.0, 9.0]"), True),
    ],
)
def test_a_recording_that_counts_twice_is_named_whatever_its_name(study, copy, windows, repeated):
    """Pitch is the baseline once more: by the same name, or written anew with another header."""
    change_header = {"metadata": lambda recording: Metadata(mass_kg=74.6)}
    shutil.copy(study / "sub01_baseline.c3d", study / "again.c3d")
    change(study, "again", **change_header)
    edit(study / "sub01.toml", "sub01_pitch.c3d", f"{copy}.c3d")
    for condition, window in zip(("baseline", "pitch"), windows, strict=True):
        edit(study / "sub01.toml", f"[trials.{condition}]", f"[trials.{condition}]\n{window}")
    found = findings(study)
    text = "sub01 baseline: the same recording as sub01 pitch; "
    assert found.faults == []
    assert any(line.startswith(text) for line in found.remarks) == repeated


def test_many_copies_of_a_recording_are_one_warning(study):
    for condition in ("sway", "pitch"):
        edit(study / "sub01.toml", f"sub01_{condition}.c3d", "sub01_baseline.c3d")
    (line,) = [line for line in findings(study).remarks if "the same recording" in line]
    assert re.match("sub01 baseline: .* sub01 sway, sub01 pitch;", line)


@pytest.mark.parametrize("as_static", [True, False])
def test_a_recording_of_two_subjects_is_a_fault(study, as_static):
    shutil.copy(study / "sub01_baseline.c3d", study / "sub02.c3d")
    static = 'static = "sub02.c3d"\n' if as_static else ""
    trial = 'exclude = "fell"' if as_static else 'file = "sub02.c3d"'
    (study / "sub02.toml").write_text(f'id = "sub02"\n{static}[trials.pitch]\n{trial}')
    found, other = findings(study), "sub02" if as_static else "sub02 pitch"
    (fault,) = found.faults
    assert re.match(f"sub01 baseline: .*same recording.* {other};", fault)


def test_what_is_not_stated_of_subjects_is_one_line_with_what_is_used_instead(study):
    (line,) = [line for line in findings(study).remarks if line.startswith("subjects: not stated:")]
    assert "height_m of sub01" in line
    edit(study / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nheight_m = 1.77\nmass_kg = 74.6')
    assert not [line for line in findings(study).remarks if "not stated" in line]


def test_a_recording_in_a_folder_is_named_with_it(sway):
    """Recordings of several subjects may have one name."""
    (sway / "sub01").mkdir()
    (sway / "sub01_sway.c3d").rename(sway / "sub01" / "sway.c3d")
    edit(sway / "sub01.toml", "sub01_sway.c3d", "sub01/sway.c3d")
    assert "sub01/sway.c3d" in findings(sway).notes


def test_where_all_trials_are_excluded_a_check_ends_as_a_run(sway, tmp_path, capsys):
    edit(sway / "sub01.toml", 'file = "sub01_sway.c3d"', 'exclude = "fell"')
    assert main(["run", str(sway), "--out", str(tmp_path / "out")]) == 2
    reason = capsys.readouterr().err.strip().removeprefix("hbm: error: ")
    assert main(["check", str(sway)]) == 2
    assert f"FAULT {reason}\n" in capsys.readouterr().out


def test_a_stature_that_the_legs_contradict_is_a_warning_before_a_run_and_in_it(sway):
    edit(sway / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nheight_m = 1.2')
    (before,) = [n for n in findings(sway).notes["sub01_sway.c3d"] if n.code == "stature_differs"]
    assert before in process_trial(read_study(sway), "sub01", "sway").notes
    assert before.values == {"height_m": 1.2, "by_legs_m": pytest.approx(1.77, abs=0.005)}


needs_ezc3d = pytest.mark.skipif(not installed(), reason="no ezc3d wheel for this system")


@needs_ezc3d
def test_a_study_in_which_both_readers_agree_says_so(study, capsys):
    edit(study / "sub01.toml", 'file = "sub01_pitch.c3d"', 'exclude = "fell"')
    assert main(["check", str(study), "--second-reader"]) == 0
    assert "3 of 3 files" in capsys.readouterr().out


def test_a_disagreement_of_readers_is_a_fault_with_channel_frame_and_values(
    study, capsys, monkeypatch
):
    line = "channel Force.Fz1, frame 120: 1.5 here, 2.5 by ezc3d 1.7.2, and 1 further"
    reading = SecondReading("ezc3d 1.7.2", "", (line,))
    monkeypatch.setattr(check, "compare_readers", lambda _: reading)
    assert main(["check", str(study), "--second-reader"]) == 2
    out = capsys.readouterr().out
    assert f"FAULT sub01_sway.c3d: {line}\n" in out
    assert "0 of 4 files" in out


def test_a_trial_without_the_belts_speed_is_a_fault(sway):
    belt = '[treadmill.belt]\ncalibration = "empty.c3d"\nspeed_channels = ["Belt.L"]\n'
    edit(sway / "study.toml", "[treadmill.platform]", belt + "[treadmill.platform]")
    assert any(re.match("sub01_sway.c3d: .*'Belt.L'", f) for f in findings(sway).faults)


def test_faults_of_all_files_are_listed_at_once(study):
    fewer = lambda r: lab.without_channels(r, "Pulse", "A2X").analog  # noqa: E731
    change(study, "sub01_sway", analog=fewer, plates=lambda r: ())
    change(study, "sub01_pitch", markers=without_markers("PF1", "PF2", "LASIS", "RASIS"))
    faults = findings(study).faults
    for name in ("sub01_sway", "sub01_pitch"):
        assert len([fault for fault in faults if fault.startswith(name)]) >= 2, faults


def test_a_mass_that_only_steps_can_weigh_is_remarked(sway):
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
    found = findings(sway)
    assert found.faults == []
    (remark,) = [remark for remark in found.remarks if "mass missing" in remark]
    assert "steps weigh" in remark
    edit(sway / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nmass_kg = 74.6')
    assert not any("mass missing" in remark for remark in findings(sway).remarks)


def test_people_whom_nothing_but_steps_weighs_are_no_fault(shared_data, tmp_path):
    """A real walk with markers on pelvis and legs, over two plates in the floor."""
    shutil.copy(shared_data / "legs_only" / "Qualisys.c3d", tmp_path)
    (tmp_path / "study.toml").write_text("[conditions.walk]")
    (tmp_path / "a.toml").write_text('id = "a"\n[trials.walk]\nfile = "Qualisys.c3d"')
    (outcome,) = run_study(read_study(tmp_path), tmp_path / "out")
    assert outcome.failure is None
    assert findings(tmp_path).faults == []


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
        "sub01 baseline: the same recording as sub01 sway; frames that several use count more than "
        "once",
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
    assert fault.startswith("pose.c3d: not a")


def test_a_pose_that_is_refused_says_which_label_it_has_twice(sway):
    edit(sway / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nstatic = "pose.c3d"')
    pose = read_c3d(sway / "sub01_baseline.c3d").markers
    position = np.concatenate([pose.position, pose.position[:, [pose.names.index("RLM")]]], axis=1)
    position[:, pose.names.index("RLM"), 1] += 0.5
    write_c3d(sway / "pose.c3d", replace(pose, names=(*pose.names, "RLN"), position=position))
    (sway / "pose.c3d").write_bytes((sway / "pose.c3d").read_bytes().replace(b"RLN", b"RLM"))
    (fault,) = (str(fault) for fault in findings(sway).faults if "medial side" in str(fault))
    assert "marker RLM: trajectories" in fault


def test_a_marker_hidden_at_the_beginning_is_not_a_fault(sway):
    """LASIS is hidden for 3 s."""
    change(sway, "sub01_sway", markers=lambda r: without(r.markers, ["LASIS"], slice(300)))
    assert findings(sway).faults == []


def test_hbm_check_prints_everything_and_what_to_do_next(moving_study, capsys):
    assert main(["check", str(moving_study)]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert re.match(r"2 subjects, 6 trials, 0 faults\b", last)
    assert last.endswith(f" hbm run {moving_study}")


def test_a_check_of_the_template_lists_what_is_missing(tmp_path, capsys):
    assert main(["init", str(tmp_path)]) == 0
    capsys.readouterr()
    assert main(["check", str(tmp_path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all("no file 'sub01_" in line for line in lines)


def test_where_a_static_pose_has_no_plates_the_trial_weighs(sway):
    pose = read_c3d(sway / "sub01_baseline.c3d")
    write_c3d(sway / "pose.c3d", pose.markers)
    edit(sway / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nstatic = "pose.c3d"')
    found = findings(sway)
    assert found.faults == []
    weighed = [note for note in found.notes["sub01_sway.c3d"] if note.code == "mass_weighed"]
    assert [note.values["file"] for note in weighed] == ["sub01_sway.c3d"]


def test_what_was_found_on_reading_stands_with_the_fault_that_follows():
    found, plate = check.Findings(), Fact("left_out", "plate 2", "no TYPE")

    def read():
        with saying([plate]):
            raise ValueError("axes unknown")

    assert found.attempt("walk.c3d", read) is None
    (fault,) = found.faults
    assert str(plate) in str(fault)
