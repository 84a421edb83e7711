"""A study of files other than C3D, with forces or records in accompanying files."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import TrialName
from pipeline.config.study import read_study
from pipeline.run.check import check_study
from pipeline.run.job import trial_key
from pipeline.run.provenance import input_digests
from pipeline.trial.process import process_trial
from tests.pipeline.other_formats import write_dflow, write_opensim

STUDY = """
[settings]
marker_set = "hbm2"

[conditions.trc]
[conditions.dflow]
"""
SUBJECT = """
id = "sub01"
mass_kg = 75.0

[trials.trc]
file = "walk.trc"
forces = "walk.mot"

[trials.dflow]
file = "walk.txt"
record = "record.txt"
"""


@pytest.fixture(scope="module")
def folder(walker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("formats")
    plain = replace(walker, analog=None, events=())
    write_opensim(plain, folder / "walk.trc", folder / "walk.mot")
    write_dflow(plain, folder / "walk.txt")
    time = walker.markers.time[::7] + 200
    rows = "".join(f"{t:.3f}\t{1.3:.3f}\n" for t in time)
    (folder / "record.txt").write_text(f"Time\tBelt.Speed\n{rows}", encoding="utf-8")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "sub01.toml").write_text(SUBJECT, encoding="utf-8")
    return folder


def test_trc_and_dflow_files_give_the_same_residuals(folder):
    study = read_study(folder)
    found = check_study(study)
    assert found.faults == []
    assert any("Belt.Speed" in str(remark) for remark in found.remarks)
    trc, dflow = (process_trial(study, "sub01", name) for name in ("trc", "dflow"))
    assert {k: len(v) for k, v in trc.cycles.items()} == {
        k: len(v) for k, v in dflow.cycles.items()
    }
    assert len(trc.cycles["right"]) > 3
    size = np.sqrt(np.nanmean(trc.measured.residual**2, axis=0))
    away = np.sqrt(np.nanmean((trc.measured.residual - dflow.measured.residual)[100:-100] ** 2, 0))
    assert (away < 0.1 * size + 0.01).all()  # D-Flow has the plates at the markers' rate only


def test_a_change_in_an_accompanying_file_changes_the_trials_key(folder):
    study = read_study(folder)
    assert {"walk.mot", "record.txt"} <= set(input_digests(study))
    before = [trial_key(study, TrialName("sub01", name)) for name in ("trc", "dflow")]
    for name in ("walk.mot", "record.txt"):
        path = folder / name
        path.write_bytes(path.read_bytes() + b"\n")
    after = [trial_key(study, TrialName("sub01", name)) for name in ("trc", "dflow")]
    assert all(a != b for a, b in zip(before, after, strict=True))
