"""What a trial leaves on disk: whole or not at all, and read back as it was."""

import errno
import os
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from hbm.coordinates import HBM_ORDER, INDEX
from pipeline.io.write import remove_leftovers, require_writable, whole_file, write_csv
from pipeline.run import store as trial_files
from pipeline.run.store import read_summary, write_trial
from pipeline.trial.residuals import reported, residual_table
from pipeline.trial.summary import summarise


@pytest.fixture(scope="module")
def written(processed, tmp_path_factory):
    path = tmp_path_factory.mktemp("trials") / "sub01_pitch.parquet"
    write_trial(processed, "pitch", "a key", path)
    return path


def test_every_frame_is_read_back_as_it_was(processed, written):
    frames = pd.read_parquet(written)
    motion = processed.motion
    np.testing.assert_array_equal(frames["time_s"], motion.time)
    for name in HBM_ORDER:
        np.testing.assert_array_equal(frames[f"q.{name}"], motion.q[:, INDEX[name]])
        np.testing.assert_array_equal(frames[f"a.{name}"], motion.a[:, INDEX[name]])
        tau = processed.compensated.tau[:, INDEX[name]]
        np.testing.assert_array_equal(frames[f"tau.compensated.{name}"], tau)
    expected = reported(processed.measured.residual)
    np.testing.assert_array_equal(frames["residual.measured.Fy"], expected[:, 1])
    np.testing.assert_array_equal(frames["residual.measured.My"], expected[:, 4])
    for k, name in enumerate(motion.markers):
        np.testing.assert_array_equal(frames[f"marker_error.{name}"], motion.marker_error[:, k])


def test_events_stand_on_the_frame_nearest_to_them(processed, written):
    frames = pd.read_parquet(written, columns=["time_s", "event"])
    said = frames[frames["event"] != ""]
    assert len(said) > 8
    for event in processed.events:
        row = frames.iloc[(frames["time_s"] - event.time).abs().argmin()]
        assert f"{event.side} {event.label}" in row["event"]


def test_the_summary_is_read_without_the_frames(processed, written):
    summary = read_summary(written)
    assert summary == summarise(processed, "pitch", "a key")
    assert (summary.key, summary.condition, summary.subject.id) == ("a key", "pitch", "sub01")
    assert summary.settings == processed.settings
    assert summary.body_mass_kg == processed.body.mass
    assert summary.notes == processed.notes
    assert summary.frames == len(processed.motion.time)
    assert summary.versions["pyarrow"] == version("pyarrow")
    pd.testing.assert_frame_equal(
        pd.DataFrame(summary.residuals), residual_table(processed, "pitch"), check_exact=True
    )
    for side, spans in processed.cycles.items():
        np.testing.assert_array_equal(summary.cycles[side], spans)


def rewrite_summary(source, target, change):
    """Copy a stored trial with other bytes for its summary."""
    table = pq.read_table(source)
    text = change(table.schema.metadata[trial_files.SUMMARY])
    metadata = table.schema.metadata | {trial_files.SUMMARY: text}
    pq.write_table(table.replace_schema_metadata(metadata), target)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (b'"version":1', b'"version":2', "written by another version of hbm .format 2"),
        (b'"version":1,', b"", "written by another version of hbm .format unknown"),
        (b'"key":"a key",', b"", "key: field required"),
        (
            b'"unsolved_frames":',
            b'"sex":"male","unsolved_frames":',
            "sex: unexpected keyword argument",
        ),
        (b'"frames":1200', b'"frames":"1200"', "frames: input should be a valid integer"),
        (b'"peak":', b'"largest":', r"residuals\.0\.peak: field required"),
        (b"{", b"", "not valid JSON"),
    ],
)
def test_a_summary_of_another_version_or_shape_is_one_line(written, tmp_path, before, after, said):
    path = tmp_path / "other.parquet"
    rewrite_summary(written, path, lambda text: text.replace(before, after, 1))
    with pytest.raises(ValueError, match=rf"^other\.parquet: {said}.*'hbm run' makes it again$"):
        read_summary(path)


def test_equal_results_give_equal_bytes(processed, written, tmp_path):
    again = tmp_path / "again.parquet"
    write_trial(processed, "pitch", "a key", again)
    assert again.read_bytes() == written.read_bytes()


@pytest.mark.parametrize("keep", [0, 1, 100, 0.5, -1])
def test_a_file_cut_short_is_no_result(written, tmp_path, keep):
    whole = written.read_bytes()
    broken = tmp_path / "broken.parquet"
    broken.write_bytes(whole[: int(keep * len(whole)) if isinstance(keep, float) else keep])
    with pytest.raises(ValueError, match=r"broken\.parquet is damaged: .*'hbm run' makes it again"):
        read_summary(broken)


def test_another_parquet_file_is_no_result(tmp_path):
    other = tmp_path / "other.parquet"
    pd.DataFrame({"x": [1]}).to_parquet(other)
    with pytest.raises(ValueError, match=r"other\.parquet is not the result of a trial"):
        read_summary(other)


def test_a_write_that_fails_leaves_what_was_there(processed, written, tmp_path, monkeypatch):
    path = tmp_path / "trial.parquet"
    path.write_bytes(written.read_bytes())

    def full(table, where, **_):
        Path(where).write_bytes(b"half a f")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(trial_files.pq, "write_table", full)
    with pytest.raises(OSError, match="No space left"):
        write_trial(processed, "pitch", "another key", path)
    assert read_summary(path).key == "a key"
    assert [p.name for p in tmp_path.iterdir()] == ["trial.parquet"]


def test_a_file_is_never_seen_half_written(tmp_path):
    path = tmp_path / "table.csv"
    with whole_file(path) as temporary:
        temporary.write_text("half")
        assert not path.exists()
        assert temporary.parent == tmp_path
        assert temporary.suffix != path.suffix
    assert path.read_text() == "half"


def test_what_a_killed_run_left_is_removed_but_not_what_another_writes_now(tmp_path):
    with whole_file(tmp_path / "a.parquet") as running:
        dead = tmp_path / ".a.parquet.deadbeef.part"
        dead.write_text("half")
        two_hours_ago = time.time() - 7200
        os.utime(dead, (two_hours_ago, two_hours_ago))
        others = [
            tmp_path / name for name in (".a.parquet.notes", ".hidden.part", "b.csv.deadbeef.part")
        ]
        for other in others:
            other.touch()
            os.utime(other, (two_hours_ago, two_hours_ago))
        remove_leftovers(tmp_path)
        assert running.exists()
        assert not dead.exists()
        assert all(other.exists() for other in others)
    remove_leftovers(tmp_path / "nowhere")


def test_a_table_is_written_with_names_and_six_digits(tmp_path):
    write_csv(pd.DataFrame({"axis": ["Mx"], "unit": ["N·m"], "rms": [np.pi * 1e3]}), tmp_path / "t")
    assert (tmp_path / "t").read_text(encoding="utf-8") == "axis,unit,rms\nMx,N·m,3141.59\n"


def test_a_folder_that_cannot_be_written_to_is_refused_before_the_work(tmp_path):
    require_writable(tmp_path / "new" / "folder")
    assert list((tmp_path / "new" / "folder").iterdir()) == []
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "results"):
        with pytest.raises(ValueError, match=r"cannot write there: (File exists|Not a directory)"):
            require_writable(path)
    if Path("/proc/self").is_dir():
        with pytest.raises(ValueError, match="--out /proc/results: cannot write there"):
            require_writable(Path("/proc/results"))


def test_metadata_does_not_hide_the_frames_from_other_readers(written):
    assert pq.read_metadata(written).num_rows == 1200


def test_a_folder_in_the_place_of_a_file_is_named_itself(tmp_path):
    with pytest.raises(IsADirectoryError) as caught, whole_file(tmp_path):
        pytest.fail("there is nothing to write to")
    assert caught.value.filename == str(tmp_path)
