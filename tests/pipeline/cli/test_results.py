"""A study's results on the command line: they stand for themselves, without the recordings."""

import shutil

import pytest
from rerun.chunk import RrdReader

from pipeline.cli.app import main
from pipeline.run.store import FORMAT_VERSION, read_trial

VERSION = f'"version":{FORMAT_VERSION}'.encode()


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
        models = ["--osim", str(folder / "body.osim"), "--urdf", str(folder / "body.urdf")]
        assert main(["export", *map(str, trial), *models, "--tables", str(folder)]) == 0

    export(tmp_path / "recording", walker.source, "--sex", "female")
    monkeypatch.setattr("pipeline.run.one_trial.process_request", None)
    export(tmp_path / "result", stored)
    assert contents(tmp_path / "result") == contents(tmp_path / "recording")
    assert len(contents(tmp_path / "result")) == 8


def test_bids_needs_the_recording_itself(stored, tmp_path, capsys):
    assert main(["export", str(stored), "--bids", str(tmp_path / "set")]) == 2
    assert (
        "is a result; BIDS holds what was recorded: give the recording" in capsys.readouterr().err
    )
    assert not (tmp_path / "set").exists()


def test_options_of_a_trial_that_is_processed_already_are_refused(stored, tmp_path, capsys):
    asked = ["export", str(stored), "--tables", str(tmp_path), "--mass-kg", "70", "--hip", "bell"]
    assert main(asked) == 2
    assert "leave out --mass-kg, --hip, or give the recording" in capsys.readouterr().err


def test_a_single_result_is_shown_without_a_study(stored, monkeypatch):
    shown = []
    monkeypatch.setattr("pipeline.viewer.serve.view", lambda path, **_: shown.append(path))
    assert main(["view", str(stored)]) == 0
    assert shown == [stored.parent / "viewer" / f"{stored.stem}.rrd"]
    assert shown[0].stat().st_size > 0


def test_a_trial_is_prepared_for_the_viewer_once(moved, monkeypatch):
    times = []
    monkeypatch.setattr(
        "pipeline.viewer.serve.view",
        lambda path, **_: times.append(path.stat().st_mtime_ns),
    )
    for _ in range(2):
        assert main(["view", str(moved), "--subject", "sub01", "--condition", "sway"]) == 0
    assert times[0] == times[1]
    assert (moved / "viewer" / "sub01_sway.rrd").is_file()
