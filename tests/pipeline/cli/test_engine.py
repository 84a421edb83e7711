"""The engine of the inverse dynamics on the command line: named, chosen, and without effect."""

import sys

import pytest

from pipeline.cli.app import main
from pipeline.run.store import read_trial
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.pipeline.without_pinocchio import assert_only_the_engine_differs


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    path = tmp_path_factory.mktemp("trial") / "walk.c3d"
    simulate_trial(path, duration_s=8.0)
    return path


@pytest.mark.slow
def test_without_pinocchio_the_engine_that_results_name_changes_and_nothing_else(trial, tmp_path):
    assert_only_the_engine_differs(trial, tmp_path)


def test_a_stated_engine_runs_and_is_stored_with_the_result(trial, tmp_path, capsys):
    assert (
        main(["residuals", str(trial), "--engine", "kernels", "--verbose", "--out", str(tmp_path)])
        == 0
    )
    assert "inverse dynamics by kernels (casadi" in " ".join(capsys.readouterr().out.split())
    path = tmp_path / "walk.parquet"
    assert read_trial(path, frames=False).settings.engine == "kernels"
    assert read_trial(path).measured.engine == read_trial(path, frames=False).engine


@pytest.mark.parametrize(
    ("engine", "message"),
    [
        ("opensim", "--engine: input should be 'pinocchio' or 'kernels'"),
        ("pinocchio", 'engine = "pinocchio" is set, but Pinocchio cannot be imported here'),
    ],
)
def test_an_engine_that_cannot_run_gives_one_line(
    trial, tmp_path, capsys, monkeypatch, engine, message
):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    assert main(["residuals", str(trial), "--engine", engine, "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
