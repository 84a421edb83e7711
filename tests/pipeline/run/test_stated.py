"""What a person states about files reaches whatever reads them: one trial, a study, its checks."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.markers import Markers
from pipeline.cli.app import main
from pipeline.cli.request import TrialRequest, chain_of, process
from pipeline.config.schema import TrialName
from pipeline.config.study import read_study
from pipeline.config.toml_file import check_options
from pipeline.export.compensated_c3d import write_compensated
from pipeline.io.c3d.data import read_header
from pipeline.io.c3d.parameters import parameter_records, values_of
from pipeline.io.c3d.read import read_c3d
from pipeline.run.check import check_study
from pipeline.run.job import trial_key
from pipeline.trial.process import process_trial
from pipeline.trial.study_files import read_study_file, read_study_laboratory
from tests.pipeline import lab

PITCH = TrialName("sub01", "pitch")
DISGUISED = {"LASIS": "hip_l_front", "RASIS": "hip_r_front", "LHEE": "heel_l", "PF1": "corner"}
"""The set's labels -> those of the files."""
RENAME = {new: old for old, new in DISGUISED.items()}
STATED = f"""
units = "mm"
plate_units = "N,Nmm"
label_prefix = "S01"
rename = {{{", ".join(f'{new} = "{old}"' for new, old in RENAME.items())}}}
"""
OPTIONS = {
    "rename": tuple(f"{new}={old}" for new, old in RENAME.items()),
    "label_prefix": "S01",
    "units": "mm",
    "plate_units": "N,Nmm",
}


def overwrite_texts(path, group, name, new):
    """Write other texts into a parameter of a C3D file, padded to the width that it has."""
    header = read_header(path)
    content = bytearray(path.read_bytes())
    start = 512 * (header.parameter_block - 1) + 4
    section = bytes(content[start : header.data_start])
    records = list(parameter_records(section, header.byte_order))
    owner = next(-record.identity for record in records if record.name == group)
    record = next(r for r in records if (r.identity, r.name) == (owner, name))
    _, (width, *_), where = values_of(section, record)
    texts = [section[k : k + width].decode() for k in range(where.start, where.stop, width)]
    written = b"".join(new(text.strip()).ljust(width).encode() for text in texts)
    content[start + where.start : start + where.stop] = written
    path.write_bytes(content)


def disguise(path):
    """Write a recording with another laboratory's labels and without the units of its plates."""
    recording = read_c3d(path, "left,back,up")
    names = tuple(f"S01:{DISGUISED.get(n, n)}" for n in recording.markers.names)
    position = recording.markers.position
    if names:  # another person, who carries some of the same labels
        names += ("S02:LPSIS", "S02:RPSIS")
        position = np.concatenate([position, position[:, :2] + [0, 2.0, 0]], axis=1)
    markers = Markers(recording.markers.time, names, position)
    lab.save(replace(recording, markers=markers), path)
    overwrite_texts(path, "POINT", "UNITS", lambda _: "in")
    overwrite_texts(path, "ANALOG", "UNITS", lambda unit: "V" if unit in ("N", "Nmm") else unit)


@pytest.fixture(scope="module")
def plain(moving_study, tmp_path_factory):
    """The study with one subject."""
    folder = shutil.copytree(moving_study, tmp_path_factory.mktemp("plain") / "study")
    for path in folder.glob("sub02*"):
        path.unlink()
    return folder


@pytest.fixture(scope="module")
def disguised(plain, tmp_path_factory):
    """The same study in another laboratory's files, and what says so in study.toml."""
    folder = shutil.copytree(plain, tmp_path_factory.mktemp("disguised") / "study")
    for path in folder.glob("*.c3d"):
        disguise(path)
    text = (folder / "study.toml").read_text(encoding="utf-8")
    (folder / "study.toml").write_text(STATED + text, encoding="utf-8")
    return folder


def test_a_study_of_disguised_files_gives_the_residuals_of_the_plain_ones(plain, disguised):
    """Trials, static pose and calibration are all read as study.toml states."""
    expected = process_trial(read_study(plain), "sub01", "pitch")
    found = process_trial(read_study(disguised), "sub01", "pitch")
    for name in ("measured", "compensated"):
        np.testing.assert_allclose(
            getattr(found, name).residual, getattr(expected, name).residual, atol=2e-3
        )
    assert "in any file" not in " ".join(map(str, found.notes))


def test_without_the_statements_nothing_is_guessed(disguised):
    with pytest.raises(ValueError, match=r"2 subjects .*same labels"):
        read_c3d(disguised / "sub01_pitch.c3d")


def test_one_trial_states_the_same_as_options(plain, disguised):
    options = {"mass_kg": 75.0, "platform_markers": ",".join(lab.PLATFORM_MARKERS_M)}
    typed = (
        TrialRequest(trial=plain / "sub01_pitch.c3d", **options),
        TrialRequest(trial=disguised / "sub01_pitch.c3d", **options, **OPTIONS),
    )
    expected, found = (process(request, chain_of(request)) for request in typed)
    np.testing.assert_allclose(found.measured.residual, expected.measured.residual, atol=2e-3)
    codes = {note.code for note in found.notes}
    assert {"units_stated", "points_of_other_subjects"} < codes


def test_check_reads_a_study_as_a_run_does(disguised):
    found = check_study(read_study(disguised))
    assert found.faults == []


@pytest.mark.parametrize("key", ["plate_units = 'N,Nm'", "rename = {A = 'B'}"])
def test_what_is_stated_about_files_is_part_of_a_trials_key(plain, tmp_path, key):
    folder = shutil.copytree(plain, tmp_path / "study")
    before = trial_key(read_study(folder), PITCH)
    text = (folder / "study.toml").read_text(encoding="utf-8")
    (folder / "study.toml").write_text(f"{key}\n{text}", encoding="utf-8")
    assert trial_key(read_study(folder), PITCH) != before


def test_a_copy_with_compensated_plates_keeps_its_own_labels_and_units(plain, disguised, tmp_path):
    """What is subtracted is computed in the stated unit, and the copy says no other one."""
    for frame in (None, "plate"):
        wrenches = []
        for folder in (plain, disguised):
            study = read_study(folder)
            laboratory = read_study_laboratory(study)
            recording = read_study_file(study, "sub01_pitch.c3d")
            target = tmp_path / f"{frame}_{folder.parent.name}.c3d"
            write_compensated(recording, laboratory, target, frame=frame)
            again = replace(study, folder=tmp_path)
            wrenches.append([p.wrench for p in read_study_file(again, target.name).plates])
            before = read_header(study.path("sub01_pitch.c3d")).parameters
            after = read_header(target).parameters
            for group, name in (("POINT", "UNITS"), ("POINT", "LABELS"), ("ANALOG", "UNITS")):
                assert after.texts(group, name) == before.texts(group, name)
        for ours, expected in zip(*wrenches, strict=True):
            np.testing.assert_allclose(ours, expected, atol=2e-3)


def test_a_misspelt_label_to_rename_is_named_with_the_error_that_it_causes(plain, tmp_path, capsys):
    recording = read_c3d(plain / "sub01_pitch.c3d")
    names = tuple("heel_l" if name == "LHEE" else name for name in recording.markers.names)
    markers = replace(recording.markers, names=names)
    walk = lab.save(replace(recording, markers=markers), tmp_path / "walk.c3d")
    options = ["--mass-kg", "75", "--rename", "hel_l=LHEE", "--out", str(tmp_path / "out")]
    assert main(["residuals", str(walk), *options]) == 2
    assert "no marker hel_l" in capsys.readouterr().err


def test_a_pair_to_rename_that_is_none_is_refused(plain):
    with pytest.raises(ValueError, match=r"--rename: LASI: .*OLD=NEW"):
        check_options(TrialRequest, {"trial": plain / "sub01_pitch.c3d", "rename": ("LASI",)})


def test_calibrations_are_fitted_in_stated_units(plain, disguised, tmp_path, plain_pages, capsys):
    fitted = []
    for folder, options in ((plain, []), (disguised, ["--units", "mm", "--plate-units", "N,Nmm"])):
        out = tmp_path / f"{folder.parent.name}.json"
        command = ["calibration", "fit", str(folder / "empty.c3d"), "-o", str(out)]
        assert main([*command, *options]) == 0
        fitted.append(Path(out).read_text(encoding="utf-8").split('"plates"')[1])
    assert main(["calibration", "fit", str(disguised / "empty.c3d"), "-o", str(out)]) == 2
    assert "--units" in capsys.readouterr().err
    assert fitted[0] == fitted[1]
