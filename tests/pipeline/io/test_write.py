"""Files are written whole or not at all, whatever stops the writing."""

import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline.cli.app import main
from pipeline.io.write import (
    HOST,
    read_csv,
    remove_leftovers,
    require_writable,
    whole_file,
    write_csv,
)

PIPELINE = Path(__file__).resolve().parents[3] / "pipeline"
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
from pipeline.cli.app import main
sys.exit(main(sys.argv[2:]))
"""


def hbm_with_files_up_to(size, *arguments):
    pytest.importorskip("resource")
    command = [sys.executable, "-B", "-c", LIMITED, str(size), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=PIPELINE.parent)


def test_a_study_that_does_not_fit_on_the_disk_can_be_begun_again(tmp_path):
    folder = tmp_path / "study"
    failed = hbm_with_files_up_to(100, "init", folder)
    assert failed.returncode == 2
    assert failed.stderr.startswith(f"hbm: error: {folder / 'study.toml'}: ")
    assert failed.stderr.count("\n") == 1
    assert list(folder.iterdir()) == []
    assert main(["init", str(folder)]) == 0


def test_a_file_is_never_seen_half_written(tmp_path):
    path = tmp_path / "table.csv"
    with whole_file(path) as temporary:
        temporary.write_text("half")
        assert not path.exists()
    assert path.read_text() == "half"


KILLED = """
import os, signal, sys
from pathlib import Path
from pipeline.io.write import whole_file
with whole_file(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_what_a_killed_process_left_is_removed_by_the_next_writer_but_not_what_another_writes(
    tmp_path,
):
    command = [sys.executable, "-c", KILLED, tmp_path / "a.csv"]
    assert subprocess.run(command, cwd=PIPELINE.parent).returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    foreign = f".a.csv.{(int(HOST, 16) + 1) % 65536:04x}"  # of another machine on a shared disk
    names = (".a.csv.notes", ".hidden.part", "b.csv.deadbeef.part", f"{foreign}beef.part")
    others = [tmp_path / name for name in names]
    old = tmp_path / f"{foreign}dead.part"
    for other in (*others, old):
        other.touch()
    os.utime(old, (time.time() - 7200,) * 2)
    with whole_file(tmp_path / "a.csv") as running:
        remove_leftovers(tmp_path)
        running.write_text("whole")
        assert not left.exists()
        assert not old.exists()
    assert (tmp_path / "a.csv").read_text() == "whole"
    assert all(other.exists() for other in others)


@given(st.lists(st.text(st.characters(exclude_categories=["Cs", "Cc"])), min_size=1))
@example(["01", "1e5", "NA", "null", "None", "TRUE", "2024-05-03", "nan", "-3.2", "", "'=x", "''"])
@example(["=1+1", "+1", "-x", "@x", "\tx", "\rx", "\nx", 'a,"b"', "-", "="])
def test_text_comes_back_from_a_table_as_text_and_no_spreadsheet_computes_it(texts):
    with TemporaryDirectory() as folder:
        path = Path(folder, "table.csv")
        table = pd.DataFrame({"=name": texts, "value": -3.25, "valid": True})
        write_csv(table, path)
        pd.testing.assert_frame_equal(read_csv(path), table, check_dtype=False)
        cells = pd.read_csv(path, dtype=str, keep_default_na=False).drop(columns="value")
        shown = [*cells, *cells.to_numpy().ravel()]
        assert not [text for text in shown if text.startswith(("=", "+", "-", "@", "\t", "\r"))]


def test_a_folder_that_cannot_be_written_to_is_refused_before_the_work(tmp_path):
    require_writable(tmp_path / "new" / "folder")
    assert list((tmp_path / "new" / "folder").iterdir()) == []
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "results"):
        with pytest.raises(ValueError, match=r"File exists|Not a directory"):
            require_writable(path)
    if Path("/proc/self").is_dir():
        with pytest.raises(ValueError, match="--out /proc/results: "):
            require_writable(Path("/proc/results"))


def test_a_pipe_or_a_device_is_not_replaced_by_a_file(tmp_path):
    """As root, the new file would take the place of the device itself."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="device or pipe"), whole_file(pipe):
        pass
    assert stat.S_ISFIFO(pipe.stat().st_mode)
