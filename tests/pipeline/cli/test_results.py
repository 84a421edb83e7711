"""A study's results stand for themselves on the command line, without the recordings."""

import shutil

import pandas as pd
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
    assert main([*command, "--save", str(saved), "--at", "3"]) == 2  # no file holds the instant
    assert not saved.exists()
    assert main([*command, "--save", str(saved)]) == 0
    assert "recording:" in capsys.readouterr().out
    onsets = read_trial(moved / "trials" / "sub02_sway.parquet").onsets
    chunks = [
        chunk.to_record_batch()
        for chunk in RrdReader(saved).stream().filter(content="/perturbation")
        if not chunk.is_static
    ]
    assert len(onsets) > 0
    assert sum(chunk.num_rows for chunk in chunks) == 2 * len(onsets)


@pytest.fixture(scope="module")
def stored(walker, tmp_path_factory):
    """The result of the walker's trial, as ``hbm residuals`` leaves it."""
    out = tmp_path_factory.mktemp("stored")
    assert main(["residuals", str(walker.source), "--sex", "female", "--out", str(out)]) == 0
    return out / f"{walker.source.stem}.parquet"


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_result_is_exported_as_its_recording_is_without_processing_it_again(
    walker, stored, tmp_path, monkeypatch
):
    def export(folder, *trial):
        forms = ["--format", "osim", "--format", "urdf", "--format", "tables"]
        assert main(["export", *map(str, trial), *forms, "--out", str(folder)]) == 0

    export(tmp_path / "recording", walker.source, "--sex", "female")
    monkeypatch.setattr("pipeline.cli.trial.process", None)
    export(tmp_path / "result", stored)
    # numbers of frames are rounded where they are stored
    rounded = (".mot", ".sto", ".parquet")
    exact, other = (
        {n: text for n, text in contents(tmp_path / of).items() if not n.endswith(rounded)}
        for of in ("recording", "result")
    )
    assert exact == other
    frames = [next(tmp_path.glob(f"{of}/*_frames.parquet")) for of in ("recording", "result")]
    pd.testing.assert_frame_equal(*map(pd.read_parquet, frames), rtol=1e-6, atol=1e-6)


def test_of_an_unknown_format_the_known_ones_are_named(moving_study, capsys):
    assert main(["export", str(moving_study / "sub01_pitch.c3d"), "--format", "ozim"]) == 2
    assert "osim" in capsys.readouterr().err
