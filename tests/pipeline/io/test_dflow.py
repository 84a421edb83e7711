import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.notes import Note
from pipeline.io.dflow import read_dflow, read_record
from pipeline.io.read import read_recording
from tests.pipeline.other_formats import excerpt, write_dflow

ROOT = Path(__file__).parents[3]


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.fixture(scope="module")
def trial(walker):
    """Three seconds of walking without gaps."""
    return excerpt(walker, 500, 800)


RECORD = """Time\tLeftBelt.Speed\tRightBelt.Speed
{rows}# EVENT A occured 2 time
# EVENT B occured 1 time
"""


def record_rows(time, events):
    """Rows at uneven times, and events between them: the row after which, and the letter."""
    lines, counts = [], {}
    for k, t in enumerate(time):
        lines.append(f"{t:.6f}\t{1 + 0.1 * t:.6f}\t{2 - 0.1 * t:.6f}\n")
        if k in events:
            letter = events[k]
            counts[letter] = counts.get(letter, 0) + 1
            lines.append(f"#\n# EVENT {letter} - COUNT {counts[letter]}\n#\n")
    return "".join(lines)


def test_time_follows_the_frame_number_whatever_the_time_stamps(trial, tmp_path, rng):
    late = np.abs(rng.normal(0, 0.002, 300))
    late[100:110] += np.linspace(0.1, 0.01, 10)
    read = read_dflow(write_dflow(trial, tmp_path / "t.txt", stamps=np.arange(300) / 100 + late))
    np.testing.assert_allclose(read.markers.time, np.arange(300) / 100, atol=1e-12)
    (clock,) = (note for note in read.notes if note.code == "frame_clock")
    assert clock.values["rate_hz"] == 100.0


def test_dropped_frames_are_gaps_in_markers_plates_and_channels(trial, tmp_path):
    def drop(lines):
        return [line for k, line in enumerate(lines) if k not in (51, 52, 200)]

    channel = {"Channel13.Anlg": np.sin(np.arange(300))}
    read = read_dflow(write_dflow(trial, tmp_path / "t.txt", edit=[drop], extra=channel))
    gone = [50, 51, 199]
    empty = np.isnan(read.markers.position).all(axis=(1, 2))
    assert np.flatnonzero(empty).tolist() == gone
    assert np.flatnonzero(np.isnan(read.plates[0].wrench).all(axis=1)).tolist() == gone
    assert np.flatnonzero(np.isnan(read.analog.channel("Channel13.Anlg"))).tolist() == gone
    assert Note.of("frames_dropped", dropped=3, frames=300) in read.notes
    kept = np.delete(np.arange(300), gone)
    np.testing.assert_allclose(read.markers.position[kept], trial.markers.position[kept], atol=1e-6)


def test_rows_that_repeat_a_frame_count_once(trial, tmp_path):
    def twice(lines):
        return [*lines[:80], lines[79], *lines[80:]]

    read = read_dflow(write_dflow(trial, tmp_path / "t.txt", edit=[twice]))
    assert len(read.markers.time) == 300


@pytest.mark.parametrize("way", ["zero", "held"])
def test_markers_that_no_camera_saw_are_gaps_with_their_count(trial, tmp_path, way):
    position = trial.markers.position.copy()
    position[20:27, 4] = np.nan
    position[90, 0] = np.nan
    gappy = replace(trial, markers=replace(trial.markers, position=position))
    read = read_dflow(write_dflow(gappy, tmp_path / "t.txt", missing=way))
    assert np.array_equal(np.isnan(read.markers.position), np.isnan(position))
    names = trial.markers.names
    code = "markers_written_as_zero" if way == "zero" else "markers_held"
    assert Note.of(code, samples=8, markers=(names[0], names[4])) in read.notes


def test_moments_about_another_point_are_located_by_the_centres_of_pressure(trial, tmp_path):
    """Though the plates' centres are not stated."""
    at_centres = write_dflow(trial, tmp_path / "c.txt", about=lambda plate: plate.center)
    read = read_dflow(at_centres)
    for ours, true in zip(read.plates, trial.plates, strict=True):
        np.testing.assert_allclose(ours.wrench, true.wrench[::10], atol=0.01)
        located = [note.values["plate"] for note in read.notes if note.code == "moments_located"]
        assert f"plate {true.number}" in located


def test_moments_that_no_centre_of_pressure_explains_are_refused(trial, tmp_path):
    def doubled(lines):
        header = lines[0].split("\t")
        wrong = [header.index(f"FP1.Mom{a}") for a in "XZ"]
        rows = [line.split("\t") for line in lines[1:]]
        for row in rows:
            for k in wrong:
                row[k] = f"{2 * float(row[k]):.6f}"
        return [lines[0], *("\t".join(row) for row in rows)]

    path = write_dflow(trial, tmp_path / "t.txt", edit=[doubled])
    with pytest.raises(ValueError, match=r"plate 1: moments and centres of pressure disagree by"):
        read_dflow(path)


def test_a_vertical_moment_that_was_not_exported_is_refused(trial, tmp_path):
    zero = {"FP1.MomY": np.zeros(300)}
    path = write_dflow(trial, tmp_path / "t.txt", extra=zero)
    with pytest.raises(ValueError, match="plate 1: the vertical moment is zero"):
        read_dflow(path)


def test_other_columns_are_channels_and_the_failed_body_model_is_a_gap(trial, tmp_path):
    angle, moment = np.linspace(1, 2, 300), np.linspace(3, 4, 300)
    angle[7] = moment[7] = -0.0
    extra = {
        "Channel1.Anlg": np.linspace(0, 5, 300),
        "LHipFlex.Ang": angle,
        "LHipFlex.Mom": moment,
        "HBM.COM.X": np.ones(300),
        "pelvis.PosX": np.ones(300),
    }
    read = read_dflow(write_dflow(trial, tmp_path / "t.txt", extra=extra))
    assert read.analog.names == tuple(extra)
    assert read.analog.units == ("V", "deg", "N·m", "", "")
    assert np.flatnonzero(np.isnan(read.analog.channel("LHipFlex.Ang"))).tolist() == [7]
    assert read.markers.names == trial.markers.names


def test_a_record_is_interpolated_onto_the_markers_clock(trial, tmp_path, rng):
    stamps = np.arange(300) / 100 + 208.1 + rng.uniform(-0.002, 0.002, 300)
    mocap = write_dflow(trial, tmp_path / "t.txt", stamps=stamps)
    time = 208.5 + np.cumsum(rng.uniform(0.003, 0.02, 150))
    events = {10: "A", 60: "B", 100: "A"}
    record = tmp_path / "record.txt"
    record.write_text(RECORD.format(rows=record_rows(time, events)))
    read = read_dflow(mocap, record=record)
    speed = read.analog.channel("LeftBelt.Speed")
    clock = read.markers.time + 208.1
    inside = (clock > time[0] + 0.005) & (clock < time[-1] - 0.005)
    np.testing.assert_allclose(speed[inside], 1 + 0.1 * clock[inside], atol=2e-4)
    assert np.isnan(speed[(clock < time[0] - 0.01) | (clock > time[-1] + 0.01)]).all()
    found = read.metadata.dflow_events
    middle = {k: (time[k] + time[k + 1]) / 2 - 208.1 for k in events}
    np.testing.assert_allclose(found["A"], [middle[10], middle[100]], atol=2e-3)
    np.testing.assert_allclose(found["B"], [middle[60]], atol=2e-3)


def test_a_record_without_the_counts_of_its_events_was_cut_short(tmp_path):
    path = tmp_path / "record.txt"
    whole = RECORD.format(rows=record_rows(np.arange(300) / 100, {10: "A", 60: "A", 70: "B"}))
    path.write_text(whole)
    assert read_record(path).notes == ()
    path.write_text(whole[: whole.index("# EVENT A occured")])
    (note,) = read_record(path).notes
    assert (note.code, note.values["events"]) == ("record_unended", ("A", "B"))


@pytest.mark.parametrize(("rows", "short"), [(310, False), (280, False), (200, True)])
def test_a_record_that_ends_long_before_the_markers_is_named(trial, tmp_path, rows, short):
    mocap = write_dflow(trial, tmp_path / "t.txt", stamps=np.arange(300) / 100)
    record = tmp_path / "record.txt"
    text = RECORD.format(rows=record_rows(np.arange(rows) / 100, {10: "A", 60: "A", 70: "B"}))
    record.write_text(text)
    notes = [note for note in read_dflow(mocap, record=record).notes if note.code == "record_short"]
    assert bool(notes) == short
    for note in notes:
        assert "record.txt covers only 0.00 to 1.99 s" in note.text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("# EVENT A occured 2", "# EVENT A occured 3"), "counts 3"),
        (lambda text: text.replace("\t1.", "\t1,", 1), "decimal comma"),
        (lambda text: text[:80], "truncated"),
        (lambda text: text.replace("Time", "Date", 1), "not a D-Flow record file"),
        (lambda text: text.replace("0.05", "9.05", 1), "do not increase"),
    ],
)
def test_a_broken_record_is_refused_in_one_line(tmp_path, change, message):
    rows = record_rows(np.arange(12) / 100, {3: "A", 5: "A", 7: "B"})
    path = tmp_path / "record.txt"
    path.write_text(change(RECORD.format(rows=rows)))
    with pytest.raises(ValueError, match=rf"^record\.txt: .*{message}"):
        read_record(path)


def test_a_record_of_another_time_is_refused(trial, tmp_path):
    mocap = write_dflow(trial, tmp_path / "t.txt")
    record = tmp_path / "record.txt"
    rows = record_rows(3600 + np.arange(12) / 100, {3: "A", 5: "A", 7: "B"})
    record.write_text(RECORD.format(rows=rows))
    with pytest.raises(ValueError, match=r"^record\.txt: its times .* do not overlap"):
        read_dflow(mocap, record=record)


def millimetres(lines):
    header = lines[0].split("\t")
    scale = [1000 if ".Pos" in name else 1 for name in header]
    rows = (
        "\t".join(f"{s * float(x):.6f}" for s, x in zip(scale, line.split("\t"), strict=True))
        for line in lines[1:]
    )
    return [lines[0], *rows]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (millimetres, "correct the unit"),
        (lambda lines: [lines[0].replace("FrameNumber", "Frame"), *lines[1:]], "Nexus"),
        (lambda lines: [lines[0].replace(".PosY", ".PosQ", 1), *lines[1:]], "PosY is absent"),
        (lambda lines: [*lines[:9], lines[9].rpartition("\t")[0], *lines[10:]], "line 10 holds"),
        (lambda lines: [*lines[:9], lines[9] + "\t1", *lines[10:]], "line 10 holds"),
        (lambda lines: [*lines[:9], lines[9].replace(".", ",", 1), *lines[10:]], "line 10.*comma"),
        (lambda lines: [*lines[:9], *lines[2:9]], "does not count upward"),
        (lambda lines: lines[:2], "1 frames"),
        (lambda lines: [lines[0], *lines[1::9]], "FrameNumber spans"),
    ],
)
def test_a_broken_mocap_file_is_refused_in_one_line(trial, tmp_path, edit, message):
    path = write_dflow(trial, tmp_path / "t.txt", edit=[edit])
    with pytest.raises(ValueError, match=rf"^t\.txt: .*{message}"):
        read_recording(path)


def test_axes_that_contradict_the_markers_are_refused(trial, tmp_path):
    path = write_dflow(trial, tmp_path / "t.txt")
    with pytest.raises(ValueError, match="is up by the stated axes, but down by pelvis"):
        read_dflow(path, "forward,down,left")


READ_AND_MEASURE = """
import re, sys
from pathlib import Path
from pipeline.io.read import read_recording

def peak_kib():
    return int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])

read_recording(sys.argv[2])
before = peak_kib()
recording = read_recording(sys.argv[1])
print(peak_kib() - before, len(recording.markers.time))
"""
KIB = 1024


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no /proc")
def test_a_large_file_needs_less_than_four_times_its_size_of_memory(tmp_path):
    """So that 500 MB are read in less than 2 GB; here 24 MB of them."""
    names = ["LASIS", "RASIS", "LHEE", "RHEE", *(f"M{k}" for k in range(60))]
    columns = ["TimeStamp", "FrameNumber", *(f"{n}.Pos{a}" for n in names for a in "XYZ")]
    feet_and_pelvis = ["-0.1", "1.0", "0.0", "0.1", "1.0", "0.0", "-0.1", "0.0", "0.0", "0.1"]
    place = [f"{float(x):.6f}" for x in [*feet_and_pelvis, *[0.0] * 2, *[0.5] * 180]]
    frames = 14_000
    path = tmp_path / "large.txt"
    with path.open("w", encoding="utf-8") as file:
        file.write("\t".join(columns) + "\n")
        for k in range(frames):
            at = [f"{float(x) + k / 1e6:.6f}" if j % 3 else x for j, x in enumerate(place)]
            file.write("\t".join([f"{k / 100:.6f}", str(k), *at]) + "\n")
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    short = tmp_path / "short.txt"
    short.write_text("".join(lines[:100]), encoding="utf-8")
    asked = [sys.executable, "-c", READ_AND_MEASURE, str(path), str(short)]
    done = subprocess.run(asked, capture_output=True, text=True, check=True, cwd=ROOT)
    used_kib, read_frames = map(int, done.stdout.split())
    assert read_frames == frames
    assert used_kib * KIB < 4 * path.stat().st_size


def test_sixty_thousand_columns_are_read_at_once(tmp_path):
    """A hang guard: with a search of the names for every column this took over a minute."""
    names = [f"c{k}" for k in range(20_000)]
    names += [f"m{k}.Pos{a}" for k in range(7_000) for a in "XYZ"]
    names += [f"FP{k}.{q}{a}" for k in range(3_500) for q in ("For", "Mom") for a in "XYZ"]
    body = {"LASIS": (-0.1, 1, 0), "RASIS": (0.1, 1, 0), "LHEE": (-0.1, 0, 0), "RHEE": (0.1, 0, 0)}
    columns = ["TimeStamp", "FrameNumber", *(f"{n}.Pos{a}" for n in body for a in "XYZ"), *names]
    places = [x for place in body.values() for x in place]
    rows = (
        [k / 100, k, *(x + k / 1000 for x in places), *((k + j) / 1e5 for j in range(len(names)))]
        for k in range(3)
    )
    lines = ["\t".join(columns), *("\t".join(f"{x:.6f}" for x in row) for row in rows)]
    path = tmp_path / "wide.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    code = "import sys; from pipeline.io.read import read_recording; read_recording(sys.argv[1])"
    asked = [sys.executable, "-c", code, str(path)]
    subprocess.run(asked, check=True, cwd=ROOT, timeout=60)
