"""Text files that were cut short change no number without a refusal or a warning."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.io.read import read_recording
from tests.pipeline.other_formats import (
    excerpt,
    write_dflow,
    write_forces,
    write_mox,
    write_nexus,
    write_opensim,
    write_qualisys,
)

FEET_AND_PELVIS = ("LASIS", "RASIS", "LPSIS", "RPSIS", "LHEE", "RHEE", "LMT2", "RMT2")
COUNTED = ("TRC", "MOT", "forces", "MOX", "Nexus", "Qualisys")
"""Formats that state how many rows they have, or hold two blocks of the same frames."""
NOTED = {"cut_short", "in_doubt"}
RECORD = """Time\tBelt.Speed\tPitch
199.99\t1.25\t0.5
# EVENT A - COUNT 1
200.02\t1.3125\t0.25
200.04\t1.5\t0.125
# EVENT B - COUNT 1
200.08\t1.75\t0.0625
# EVENT A occurred 1 times
# EVENT B occurred 1 times
"""


@pytest.fixture(scope="module")
def trial(walker):
    """Six frames of eight markers on two plates."""
    short = excerpt(walker, 400, 406)
    columns = [short.markers.names.index(name) for name in FEET_AND_PELVIS]
    position = short.markers.position[:, columns]
    return replace(short, markers=replace(short.markers, names=FEET_AND_PELVIS, position=position))


@pytest.fixture(scope="module")
def files(trial, tmp_path_factory):
    """Format -> the file to cut, and what else is read with it."""
    folder = tmp_path_factory.mktemp("whole")
    trc, mot, mocap = folder / "a.trc", folder / "a.mot", folder / "a.txt"
    write_opensim(trial, trc, mot)
    write_dflow(trial, mocap)
    write_mox(trial, folder / "a.mox")
    write_nexus(trial, folder / "a.csv")
    write_forces(trial, folder / "a.forces")
    write_qualisys(trial, folder / "a.tsv")
    (folder / "record.txt").write_text(RECORD, encoding="utf-8")
    return {
        "TRC": (trc, lambda path: read_recording(path, forces=mot)),
        "MOT": (mot, lambda path: read_recording(trc, forces=path)),
        "forces": (folder / "a.forces", lambda path: read_recording(trc, forces=path)),
        "Qualisys": (
            folder / "a.tsv",
            lambda path: read_recording(path, forces=folder / "a_f_1.tsv"),
        ),
        "D-Flow": (mocap, read_recording),
        "record": (folder / "record.txt", lambda path: read_recording(mocap, record=path)),
        "MOX": (folder / "a.mox", read_recording),
        "Nexus": (folder / "a.csv", read_recording),
    }


def numbers(recording):
    """Every series of numbers that was read."""
    plates = [plate.wrench_in_plate for plate in recording.plates]
    analog = [recording.analog.values] if recording.analog is not None else []
    return [recording.markers.position, *plates, *analog]


def same(some, others):
    return len(some) == len(others) and all(
        np.array_equal(one, other, equal_nan=True) for one, other in zip(some, others, strict=True)
    )


def first_frames(recording, count):
    """What a recording holds of its first frames; the plates have the markers' rate."""
    return [series[:count] for series in numbers(recording)]


def read_or_none(read, path):
    try:
        return read(path)
    except ValueError:
        return None


@pytest.mark.parametrize("name", [*COUNTED, "D-Flow", "record"])
def test_no_cut_changes_a_number_without_a_refusal_or_a_warning(files, tmp_path, name):
    """Only where nothing states the number of rows may a cut at a line end go unnoticed."""
    path, read = files[name]
    content, whole = path.read_bytes(), read(path)
    cut_path = tmp_path / path.name
    step = 1 + len(content) // 40
    ends = [k + 1 for k, byte in enumerate(content) if byte == ord("\n")]
    noticed = 0
    for size in sorted({*range(0, len(content), step), *ends, *(end - 1 for end in ends)}):
        cut_path.write_bytes(content[:size])
        found = read_or_none(read, cut_path)
        if found is None or NOTED & {note.code for note in found.notes}:
            noticed += 1
        elif not same(numbers(found), numbers(whole)):
            assert name not in COUNTED, size
            assert content[:size].endswith(b"\n") or content[size : size + 1] == b"\n", size
            if name == "D-Flow":
                assert same(numbers(found), first_frames(whole, len(found.markers.time)))
    assert noticed > 20


@pytest.mark.parametrize("end", ["0.12", "0.1", "0", ""])
def test_a_number_with_fewer_decimals_than_those_above_it_is_doubtful(files, tmp_path, end):
    _, read = files["record"]
    lines = [*RECORD.splitlines()[:2], "200.02\t1.3125\t0.2", f"200.04\t1.5\t{end}"]
    cut = tmp_path / "cut.txt"
    cut.write_text("\n".join(lines), encoding="utf-8")
    doubtful = "cut_short" in {note.code for note in read(cut).notes}
    assert doubtful == (end != "0.1")


def test_a_last_line_without_end_that_is_like_those_above_it_is_no_doubt(files, tmp_path):
    path, read = files["D-Flow"]
    for ending in ("\n", "\r\n", "\r"):
        text = path.read_text(encoding="utf-8").replace("\n", ending).rstrip()
        whole = tmp_path / "whole.txt"
        whole.write_bytes(text.encode())
        assert "cut_short" not in {note.code for note in read(whole).notes}
