"""A subject's body is as its files state, with functional hips, segments and clinical angles."""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from hbm.markers import Markers
from hbm.motion import ANKLE_IN_LINE_RAD
from hbm.poses import marker_positions
from pipeline.cli.app import main
from pipeline.config.schema import Settings, Subject, TrialName
from pipeline.config.study import read_study
from pipeline.config.toml_file import read_segments
from pipeline.io.opensim import read_sto
from pipeline.run.check import check_study
from pipeline.run.job import trial_key
from pipeline.trial.process import process_trial
from pipeline.trial.subject import subject_body
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.campaign.study_files import SEGMENTS
from tests.hbm.calibration_pose.test_functional import swings
from tests.pipeline import lab
from tests.pipeline.lab import edit

PITCH = TrialName("sub01", "pitch")


@pytest.fixture
def study(moving_study, tmp_path):
    """A copy of a study that a test may change."""
    return shutil.copytree(moving_study, tmp_path / "study")


def test_a_prosthesis_and_a_shoe_stated_in_a_file_are_in_the_body(study, processed):
    (study / "sub01_segments.toml").write_text(SEGMENTS, encoding="utf-8")
    before = trial_key(read_study(study), PITCH)
    edit(study / "sub01.toml", 'id = "sub01"', 'id = "sub01"\nsegments = "sub01_segments.toml"')
    read = read_study(study)
    result = process_trial(read, "sub01", "pitch")
    shank = result.body.segments["left_shank"]
    assert shank.mass == pytest.approx(1.9)
    np.testing.assert_allclose(np.diag(shank.tensor), [0.021, 0.021, 0.002])
    assert result.body.mass == processed.body.mass
    whole = sum(part.mass for part in result.body.segments.values())
    assert whole == pytest.approx(result.body.mass)
    assert result.overridden_segments == ("left_shank", "right_foot")
    changed = np.nanmax(abs(result.compensated.residual - processed.compensated.residual))
    assert changed > 1.0
    after = trial_key(read, PITCH)
    (study / "sub01_segments.toml").write_text(SEGMENTS.replace("1.9", "2.0"), encoding="utf-8")
    assert len({before, after, trial_key(read, PITCH)}) == 3


def test_functional_hips_come_from_the_trial_that_is_named(study):
    read = read_study(study)
    usual = process_trial(read, "sub01", "baseline").body
    write_c3d(study / "star.c3d", swinging(usual))
    edit(study / "study.toml", "[treadmill]", '[settings]\nhip = "functional"\n[treadmill]')
    for name in ("sub01", "sub02"):
        edit(study / f"{name}.toml", f'id = "{name}"', f'id = "{name}"\nhip_trial = "star.c3d"')
    body = process_trial(read_study(study), "sub01", "baseline").body
    for side in ("right", "left"):
        off = body.offsets[f"{side}_thigh"] - usual.offsets[f"{side}_thigh"]
        assert np.linalg.norm(off) < 0.002
    write_c3d(study / "star.c3d", swinging(usual, sideways=0.0))
    found = check_study(read_study(study))
    assert any("rotates too little" in str(fault) for fault in found.faults)


def swinging(body, sideways=30.0):
    """Star and arc movements of a body."""
    time, q = swings(sideways=sideways)
    return Markers(time, body.markers, marker_positions(body, q))


def test_clinical_angles_are_exported_with_either_zero_of_the_ankle(walker, tmp_path):
    tables = {}
    for zero in ("right_angle", "in_line"):
        folder = tmp_path / zero
        asked = ["export", str(walker.source), "--ankle-zero", zero]
        asked += ["--format", "tables", "--out", str(folder)]
        assert main(asked) == 0
        tables[zero] = pd.read_csv(folder / f"{walker.source.stem}_angles.csv")
    usual, original = tables["right_angle"], tables["in_line"]
    shift = original["RAnklePlantarFlexion_deg"] - usual["RAnklePlantarFlexion_deg"]
    np.testing.assert_allclose(shift, np.degrees(ANKLE_IN_LINE_RAD), atol=1e-3)
    assert usual["RKneeFlexion_deg"].max() > 50
    changed = (original - usual).abs().max() > 1e-3
    assert set(changed.index[changed]) == {"RAnklePlantarFlexion_deg", "LAnklePlantarFlexion_deg"}


def test_functional_hips_far_from_the_regression_are_refused(walker, tmp_path):
    body = subject_body(walker, Subject(), Settings(), 74.6)
    functional = Settings(hip="functional")
    stray = swinging(body)
    thigh = [segment == "right_thigh" for segment in body.marker_segment]
    position = stray.position.copy()
    position[:, thigh] += 0.1 * np.sin(np.arange(len(stray.time)) / 25)[:, None, None]
    loose = replace(walker, markers=Markers(stray.time, stray.names, position))
    with pytest.raises(ValueError, match="swing both thighs"):
        subject_body(walker, Subject(), functional, 74.6, hip_trial=loose)
    sound = replace(walker, markers=stray)
    found = subject_body(walker, Subject(), functional, 74.6, hip_trial=sound)
    (note,) = [note for note in found.notes if note.code == "functional_hips"]
    assert max(note.values["distance_m"].values()) < 0.0025


def test_implausible_segments_are_refused(tmp_path):
    line = "[left_shank]\ncenter_m = [0.0, 0.0, -150.0]\n"
    (tmp_path / "legs.toml").write_text(line, encoding="utf-8")
    with pytest.raises(ValueError, match="looks like millimetres"):
        read_segments(tmp_path / "legs.toml")


def test_exported_forces_are_compensated_where_a_calibration_is_given(
    study, processed, tmp_path, capsys
):
    asked = ["export", str(study / "sub01_pitch.c3d"), "--mass-kg", "74.6"]
    calibration = tmp_path / "lab.json"
    assert main(["calibration", "fit", str(study / "empty.c3d"), "-o", str(calibration)]) == 0
    markers = ",".join(lab.PLATFORM_MARKERS_M)
    asked += [
        "--format",
        "tables",
        "--out",
        str(tmp_path / "compensated"),
        "--calibration",
        str(calibration),
    ]
    assert main([*asked, "--platform-markers", markers]) == 0
    printed = capsys.readouterr().out
    assert "compensated plate forces" in printed
    forces = read_sto(tmp_path / "compensated" / "sub01_pitch_forces.sto")
    measured = np.nanstd(processed.measured.residual[:, 0])
    assert np.nanstd(forces.columns["PelvisX_force"]) < 0.2 * measured


@pytest.mark.parametrize("factor", [0.1, 2.0])
def test_legs_that_nobody_has_are_refused_with_the_option_of_the_unit(walker, factor):
    """The stature that the file states does not hide them."""
    markers = replace(walker.markers, position=factor * walker.markers.position)
    wrong = replace(walker, markers=markers)
    with pytest.raises(ValueError, match=rf"{walker.source.name}: .*unit is wrong.*--units"):
        subject_body(wrong, Subject(height_m=1.75), Settings(), 74.6)
