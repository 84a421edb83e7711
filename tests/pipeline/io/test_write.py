"""Files that are written whole or not at all, whatever stops the writing."""

import os
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.cli.app import main
from pipeline.io.write import remove_leftovers, require_writable, whole_file

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
    assert failed.stderr == f"hbm: error: {folder / 'study.toml'}: file too large\n"
    assert list(folder.iterdir()) == []
    assert main(["init", str(folder)]) == 0


def test_a_file_is_never_seen_half_written(tmp_path):
    path = tmp_path / "table.csv"
    with whole_file(path) as temporary:
        temporary.write_text("half")
        assert not path.exists()
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


def test_a_pipe_or_a_device_is_not_replaced_by_a_file(tmp_path):
    """As root, the new file would take the place of the device itself."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="is a device or a pipe"), whole_file(pipe):
        pass
    assert stat.S_ISFIFO(pipe.stat().st_mode)
