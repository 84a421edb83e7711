"""A library that crashes, hangs, takes all memory or is absent costs one line, not the program."""

import sys

import numpy as np
import pytest

from pipeline.io.c3d.second_reader import process
from pipeline.io.c3d.second_reader.agreement import compare_readers
from pipeline.io.c3d.second_reader.process import installed, read_with
from pipeline.io.c3d.second_reader.reading import Refusal

SEGFAULT = "import ctypes; ctypes.string_at(0)"
HANG = "import time; time.sleep(60)"
SILENCE = ""
NO_RESULT = "open(sys.argv[3] + '/description.json', 'w').write('{')"
HALF_A_RESULT = "open(sys.argv[3] + '/description.json', 'w').write('{\"reader\": \"ezc3d\"}')"


@pytest.fixture
def file(raw_c3d):
    """A file that every library reads."""
    return raw_c3d(np.full((4, 2, 4), 500.0), np.ones((4, 3, 2)), POINT={"LABELS": ["A", "B"]})


@pytest.fixture
def instead_of_ezc3d(monkeypatch, tmp_path):
    """Run another program in ezc3d's place; c3d stays as it is."""

    def replace(code):
        original = process.PROGRAM.read_text(encoding="utf-8")
        program = tmp_path / "program.py"
        program.write_text(
            f"import sys\nif sys.argv[1] == 'ezc3d':\n    {code or 'pass'}\n    raise SystemExit\n"
            + original,
            encoding="utf-8",
        )
        monkeypatch.setattr(process, "PROGRAM", program)
        monkeypatch.setattr(process, "installed", lambda _: True)
        monkeypatch.setattr(process, "version", lambda _: "0")

    return replace


@pytest.mark.skipif(sys.platform == "win32", reason="a process ends by a signal only on POSIX")
def test_a_crash_is_named_and_the_other_library_reads_the_file(file, instead_of_ezc3d):
    instead_of_ezc3d(SEGFAULT)
    found = compare_readers(file)
    assert list(map(str, found.refusals)) == [
        "ezc3d 0 does not read it: its process ends with SIGSEGV"
    ]
    assert found.reader.startswith("c3d ")
    assert found.disagreements == ()


def test_a_process_that_hangs_is_ended(file, instead_of_ezc3d, monkeypatch):
    instead_of_ezc3d(HANG)
    monkeypatch.setattr(process, "SECONDS", 1.0)
    assert read_with("ezc3d", file).reason == "it takes more than 1 s"


@pytest.mark.parametrize("code", [SILENCE, NO_RESULT, HALF_A_RESULT])
def test_a_process_without_a_whole_result_is_named(file, instead_of_ezc3d, code):
    instead_of_ezc3d(code)
    assert read_with("ezc3d", file).reason == "its process ends without a result"


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited only on Linux")
def test_memory_is_limited(shared_data):
    """Without a limit, ezc3d 1.7.2 takes 12.6 GB and half a minute for this file."""
    if not installed("ezc3d"):
        pytest.skip("ezc3d has no wheel for this system")
    path = shared_data / "c3d_samples" / "bad_parameter_section.c3d"
    assert read_with("ezc3d", path).reason == "it needs more than 1.1 GB of memory"


@pytest.mark.parametrize("library", ["ezc3d", "c3d"])
def test_a_library_whose_import_is_blocked_is_not_installed(file, monkeypatch, library):
    monkeypatch.setitem(sys.modules, library, None)
    refusal = read_with(library, file)
    assert refusal == Refusal(library, "it is not installed", installed=False)


def test_without_ezc3d_the_other_library_checks(file, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    found = compare_readers(file)
    assert found.reader.startswith("c3d ")
    assert found.disagreements == ()


@pytest.mark.parametrize("library", ["ezc3d", "c3d"])
def test_what_a_library_refuses_is_told_in_its_words_in_one_line(tmp_path, library):
    path = tmp_path / "empty.c3d"
    path.write_bytes(b"")
    refusal = read_with(library, path)
    assert refusal.reason
    assert "\n" not in str(refusal)
    assert len(refusal.reason) <= process.MAX_REASON


def test_nothing_stays_in_the_folder_for_temporary_files(file, monkeypatch, tmp_path):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    read_with("c3d", file)
    assert list(folder.iterdir()) == []
