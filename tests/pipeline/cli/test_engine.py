"""The engine of the inverse dynamics on the command line: named, not chosen, and without effect."""

import sys

import pytest

from hbm.kernels import native
from pipeline.cli import doctor
from pipeline.cli.app import main
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.pipeline.without_pinocchio import assert_only_the_engine_differs


@pytest.mark.slow
def test_without_pinocchio_the_engine_that_results_name_changes_and_nothing_else(tmp_path):
    trial = tmp_path / "walk.c3d"
    simulate_trial(trial, duration_s=8.0)
    assert_only_the_engine_differs(trial, tmp_path)


def test_doctor_says_which_engine_runs(capsys, monkeypatch):
    pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")
    monkeypatch.setattr(doctor, "speed", lambda _: 1.0)
    monkeypatch.setitem(native._READY, "kernels", native.interpreted_kernels("virtual machine"))
    for engine in ("Pinocchio 4.", "kernels generated with CasADi 3."):
        assert main(["doctor"]) == 0
        assert f"inverse dynamics: {engine}" in capsys.readouterr().out
        monkeypatch.setitem(sys.modules, "pinocchio", None)
