"""A study's results on the command line: they stand for themselves, without the recordings."""

import shutil

import pytest
from rerun.chunk import RrdReader

from pipeline.cli.app import main
from pipeline.run.store import read_trial


@pytest.fixture
def moved(finished, tmp_path):
    """Results in a folder of their own, with no study that they could point to."""
    out = shutil.copytree(finished, tmp_path / "elsewhere")
    (out / "run.json").unlink(missing_ok=True)
    return out


def test_a_trial_is_shown_where_the_studys_files_are_gone(moved, capsys):
    saved = moved / "sway.rrd"
    command = ["view", str(moved), "--subject", "sub02", "--condition", "sway"]
    assert main([*command, "--save", str(saved)]) == 0
    assert "recording:" in capsys.readouterr().out
    onsets = read_trial(moved / "trials" / "sub02_sway.parquet").onsets
    chunks = [
        chunk.to_record_batch()
        for chunk in RrdReader(saved).stream().filter(content="/phases/perturbation")
        if not chunk.is_static
    ]
    assert len(onsets) > 0
    assert sum(chunk.num_rows for chunk in chunks) == 2 * len(onsets)


def test_a_result_of_another_version_is_one_line(moved, capsys):
    path = moved / "trials" / "sub01_sway.parquet"
    path.write_bytes(path.read_bytes().replace(b'"version":1', b'"version":9'))
    assert main(["view", str(moved), "--condition", "sway", "--save", str(moved / "x.rrd")]) == 2
    error = capsys.readouterr().err
    assert "sub01_sway.parquet: written by another version of hbm (format 9" in error
    assert "'hbm run' makes it again" in error


def test_a_trial_that_is_not_there_is_named_with_those_that_are(moved, capsys):
    assert main(["view", str(moved), "--subject", "sub09"]) == 2
    assert "there are: sub01 baseline" in capsys.readouterr().err
