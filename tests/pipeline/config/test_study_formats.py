"""A study takes files other than C3D, with forces or records in accompanying files."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import TrialName
from pipeline.config.study import read_study
from pipeline.run.check import check_study
from pipeline.run.job import trial_key
from pipeline.run.provenance import input_digests
from pipeline.trial.process import process_trial
from tests.pipeline.other_formats import (
    write_dflow,
    write_forces,
    write_opensim,
    write_qualisys,
)

STUDY = """
[settings]
marker_set = "hbm2"

[conditions.trc]
[conditions.dflow]
[conditions.cortex]
[conditions.qualisys]
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

[trials.cortex]
file = "walk.trc"
forces = "walk.forces"

[trials.qualisys]
file = "walk.tsv"
"""


@pytest.fixture(scope="module")
def folder(walker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("formats")
    plain = replace(walker, analog=None, events=())
    write_opensim(plain, folder / "walk.trc", folder / "walk.mot")
    write_dflow(plain, folder / "walk.txt")
    write_forces(plain, folder / "walk.forces")
    write_qualisys(plain, folder / "walk.tsv")
    time = walker.markers.time[::7] + 200
    rows = "".join(f"{t:.3f}\t{1.3:.3f}\n" for t in time)
    (folder / "record.txt").write_text(f"Time\tBelt.Speed\n{rows}", encoding="utf-8")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "sub01.toml").write_text(SUBJECT, encoding="utf-8")
    return folder


EXACT = {"cortex": 0.1, "qualisys": 1e-4, "dflow": 0.1}
"""Format -> how much of the residual may differ: .forces lacks the moments of plates that carry
less than 20 N, D-Flow has the plates at the markers' rate only."""


def test_all_formats_give_the_same_residuals(folder):
    study = read_study(folder)
    found = check_study(study)
    assert found.faults == []
    assert any("Belt.Speed" in str(remark) for remark in found.remarks)
    trc = process_trial(study, "sub01", "trc")
    assert len(trc.cycles["right"]) > 3
    size = np.sqrt(np.nanmean(trc.measured.residual**2, axis=0))
    for name, share in EXACT.items():
        other = process_trial(study, "sub01", name)
        assert {side: len(cycles) for side, cycles in other.cycles.items()} == {
            side: len(cycles) for side, cycles in trc.cycles.items()
        }
        change = (trc.measured.residual - other.measured.residual)[100:-100]
        assert (np.sqrt(np.nanmean(change**2, 0)) < share * size + 0.1 * share).all(), name


def test_a_change_in_an_accompanying_file_changes_the_trials_key(folder):
    study = read_study(folder)
    beside = {"trc": "walk.mot", "dflow": "record.txt", "qualisys": "walk_f_2.tsv"}
    assert {*beside.values()} <= set(input_digests(study))
    before = [trial_key(study, TrialName("sub01", name)) for name in beside]
    for name in beside.values():
        path = folder / name
        path.write_bytes(path.read_bytes() + b"\n")
    after = [trial_key(study, TrialName("sub01", name)) for name in beside]
    assert all(a != b for a, b in zip(before, after, strict=True))
