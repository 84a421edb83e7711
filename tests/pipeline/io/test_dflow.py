"""A D-Flow file is read on its frames, with what lacks as gaps and what contradicts refused."""

import re

import numpy as np
import pytest

from pipeline.io.dflow import read_record
from pipeline.io.read import read_recording
from tests.pipeline.other_formats import excerpt, write_dflow


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.fixture(scope="module")
def trial(walker):
    """Three seconds of walking without gaps."""
    return excerpt(walker, 500, 800)


def write_record(folder, time, change=lambda text: text):
    """Write a record at uneven times, with two events between its rows."""
    rows = [f"{t:.6f}\t{1 + 0.1 * t:.6f}\t{2 - 0.1 * t:.6f}" for t in time]
    rows[7:7] = ["#", "# EVENT A - COUNT 1", "#"]
    text = "\n".join(["Time\tLeftBelt.Speed\tRightBelt.Speed", *rows, "# EVENT A occured 1 time"])
    path = folder / "record.txt"
    path.write_text(change(text + "\n"), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:70], "truncated"),
        (lambda text: text.replace("Time", "Date", 1), "not a D-Flow record file"),
        (lambda text: text.replace("0.05", "9.05", 1), "with increasing times"),
    ],
)
def test_a_broken_record_is_refused_in_one_line(tmp_path, change, message):
    path = write_record(tmp_path, np.arange(12) / 100, change)
    with pytest.raises(ValueError, match=rf"^record\.txt: .*{message}"):
        read_record(path)


def test_time_follows_the_frame_number_whatever_the_time_stamps(trial, tmp_path, rng):
    late = np.abs(rng.normal(0, 0.002, 300))
    late[100:110] += np.linspace(0.1, 0.01, 10)
    stamps = np.arange(300) / 100 + late
    read = read_recording(write_dflow(trial, tmp_path / "t.txt", stamps=stamps))
    np.testing.assert_allclose(read.markers.time, np.arange(300) / 100, atol=1e-12)


def test_dropped_frames_are_gaps_in_markers_plates_and_channels(trial, tmp_path):
    def drop(lines):
        return [line for k, line in enumerate(lines) if k not in (51, 52, 200)]

    channel = {"Channel13.Anlg": np.sin(np.arange(300))}
    read = read_recording(write_dflow(trial, tmp_path / "t.txt", edit=drop, extra=channel))
    gone = [50, 51, 199]
    empty = np.isnan(read.markers.position).all(axis=(1, 2))
    assert np.flatnonzero(empty).tolist() == gone
    assert np.flatnonzero(np.isnan(read.plates[0].wrench).all(axis=1)).tolist() == gone
    assert np.flatnonzero(np.isnan(read.analog.channel("Channel13.Anlg"))).tolist() == gone
    (fact,) = read.facts
    assert fact.kind == "missing"
    assert re.match(r"3 rows .*line 51\b", fact.reason)
    kept = np.delete(np.arange(300), gone)
    np.testing.assert_allclose(read.markers.position[kept], trial.markers.position[kept], atol=1e-6)


def test_moments_about_another_point_are_located_by_the_centres_of_pressure(trial, tmp_path):
    """Though the plates' centres are not stated."""
    at_centres = write_dflow(trial, tmp_path / "c.txt", about=lambda plate: plate.center)
    read = read_recording(at_centres)
    for ours, true in zip(read.plates, trial.plates, strict=True):
        np.testing.assert_allclose(ours.wrench, true.wrench[::10], atol=0.01)


def test_moments_that_no_centre_of_pressure_explains_are_refused(trial, tmp_path):
    def doubled(lines):
        header = lines[0].split("\t")
        wrong = [header.index(f"FP1.Mom{a}") for a in "XZ"]
        rows = [line.split("\t") for line in lines[1:]]
        for row in rows:
            for k in wrong:
                row[k] = f"{2 * float(row[k]):.6f}"
        return [lines[0], *("\t".join(row) for row in rows)]

    path = write_dflow(trial, tmp_path / "t.txt", edit=doubled)
    with pytest.raises(ValueError, match=r"plate 1: moments .*disagree"):
        read_recording(path)


def test_a_vertical_moment_that_was_not_exported_is_refused(trial, tmp_path):
    zero = {"FP1.MomY": np.zeros(300)}
    path = write_dflow(trial, tmp_path / "t.txt", extra=zero)
    with pytest.raises(ValueError, match=r"plate 1: .*vertical moment"):
        read_recording(path)


def test_other_columns_are_channels_and_the_failed_body_model_is_a_gap(trial, tmp_path):
    angle, moment = np.linspace(1, 2, 300), np.linspace(3, 4, 300)
    angle[7] = moment[7] = -0.0
    extra = {
        "Channel1.Anlg": np.linspace(0, 5, 300),
        "LHipFlex.Ang": angle,
        "LHipFlex.Mom": moment,
    }
    read = read_recording(write_dflow(trial, tmp_path / "t.txt", extra=extra))
    assert read.analog.names == tuple(extra)
    assert read.analog.units == ("V", "deg", "N·m")
    assert np.flatnonzero(np.isnan(read.analog.channel("LHipFlex.Ang"))).tolist() == [7]
    assert read.markers.names == trial.markers.names


def test_a_record_is_interpolated_onto_the_markers_clock(trial, tmp_path, rng):
    stamps = np.arange(300) / 100 + 208.1 + rng.uniform(-0.002, 0.002, 300)
    mocap = write_dflow(trial, tmp_path / "t.txt", stamps=stamps)
    time = 208.5 + np.cumsum(rng.uniform(0.003, 0.02, 150))
    record = write_record(tmp_path, time)
    read = read_recording(mocap, record=record)
    speed = read.analog.channel("LeftBelt.Speed")
    clock = read.markers.time + 208.1
    inside = (clock > time[0] + 0.005) & (clock < time[-1] - 0.005)
    np.testing.assert_allclose(speed[inside], 1 + 0.1 * clock[inside], atol=2e-4)
    assert np.isnan(speed[(clock < time[0] - 0.01) | (clock > time[-1] + 0.01)]).all()


def test_a_record_of_another_time_is_refused(trial, tmp_path):
    mocap = write_dflow(trial, tmp_path / "t.txt")
    record = write_record(tmp_path, 3600 + np.arange(12) / 100)
    with pytest.raises(ValueError, match=r"^record\.txt: .*not overlap"):
        read_recording(mocap, record=record)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda lines: [lines[0].replace(".PosY", ".PosQ", 1), *lines[1:]], "PosY is absent"),
        (lambda lines: [lines[0], *lines[5:9], *lines[1:4]], "FrameNumber 1, expected 9 in steps"),
        (lambda lines: [lines[0], *lines[1::9]], "FrameNumber 10, expected 2 "),
    ],
)
def test_a_broken_mocap_file_is_refused_in_one_line(trial, tmp_path, edit, message):
    path = write_dflow(trial, tmp_path / "t.txt", edit=edit)
    with pytest.raises(ValueError, match=rf"^t\.txt: .*{message}"):
        read_recording(path)


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_a_channel_written_twice_counts_once_only_if_it_is_the_same(trial, tmp_path, offset):
    values = np.sin(np.arange(300))

    def renamed(lines):
        return [lines[0].replace("Channel2", "Channel1"), *lines[1:]]

    extra = {"Channel1.Anlg": values, "Channel2.Anlg": values + offset}
    path = write_dflow(trial, tmp_path / "t.txt", edit=renamed, extra=extra)
    if offset:
        with pytest.raises(ValueError, match=r"^t\.txt: columns 159 and 160 .*Channel1"):
            read_recording(path)
        return
    read = read_recording(path)
    assert read.analog.names == ("Channel1.Anlg",)
    assert [fact.of for fact in read.facts] == ["t.txt, column 160"]
