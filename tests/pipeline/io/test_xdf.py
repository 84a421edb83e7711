"""A trial recorded as XDF is the trial; damaged files are refused in one line or say so."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.io.read import file_format, read_recording
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Analog, Fact
from tests.pipeline import xdf_file as xdf
from tests.pipeline.other_formats import excerpt, in_file


@pytest.fixture(scope="module")
def trial(walker):
    """Two seconds of walking on two plates, and two channels of another device."""
    time = np.arange(500) / 250
    values = np.column_stack([np.sin(time), np.cos(3 * time)])
    analog = Analog(time, ("Belt.Speed", "Acc1.X"), ("m/s", "g"), values)
    return replace(excerpt(walker, 500, 700), analog=analog)


@pytest.fixture(scope="module")
def whole(trial, tmp_path_factory):
    return xdf.write_xdf(tmp_path_factory.mktemp("xdf") / "trial.dat", xdf.recorded(trial))


def codes(recording):
    return [note.code for note in recording.notes]


def refused(path, *, match):
    with pytest.raises(ValueError, match=rf"^a\.xdf: .*{match}"):
        read_recording(path)


def test_an_xdf_file_is_recognised_by_content_and_holds_the_trial(trial, whole):
    assert file_format(whole) == "XDF"
    read = read_recording(whole)
    assert read.markers.names == trial.markers.names
    np.testing.assert_allclose(read.markers.time, trial.markers.time, atol=1e-9)
    np.testing.assert_array_equal(read.markers.position, trial.markers.position)
    for ours, true in zip(read.plates, trial.plates, strict=True):
        assert ours.number == true.number
        np.testing.assert_allclose(ours.time, true.time, atol=1e-9)
        np.testing.assert_allclose(ours.wrench, true.wrench, atol=1e-12)
        np.testing.assert_array_equal(ours.corners, true.corners)
    assert read.analog.names == trial.analog.names
    assert read.analog.units == trial.analog.units
    np.testing.assert_array_equal(read.analog.values, trial.analog.values)


def test_streams_of_devices_with_clocks_of_their_own_are_on_one_clock(trial, tmp_path):
    """A clock that is 900 s behind and loses 50 ppm."""
    cameras, plates, analog = xdf.recorded(trial)
    at = np.linspace(0, 2, 9)
    own = (plates["stamps"] - 900) * (1 - 5e-5)
    behind = list(zip(own[::250], (plates["stamps"] - own)[::250], strict=True))
    plates |= {"stamps": own, "offset": behind}
    cameras |= {"offset": [(5000 + t, 0.0) for t in at]}
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", [cameras, plates, analog]))
    np.testing.assert_allclose(read.plates[0].time, trial.plates[0].time, atol=2e-5)
    np.testing.assert_allclose(read.plates[0].wrench, trial.plates[0].wrench, atol=1e-9)


def test_jitter_of_time_stamps_changes_no_sample_and_is_told(trial, tmp_path):
    rng = np.random.default_rng(7)

    def late(count):
        return np.abs(rng.normal(0, 3e-4, count)) + 4e-3 * (rng.uniform(size=count) < 0.01)

    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", xdf.recorded(trial, jitter=late)))
    np.testing.assert_array_equal(read.markers.position, trial.markers.position)
    assert read.markers.rate_hz == pytest.approx(100, rel=1e-4)
    np.testing.assert_allclose(np.diff(read.markers.time), 0.01, atol=1e-6)
    np.testing.assert_allclose(read.plates[0].time, trial.plates[0].time, atol=1e-3)


def test_lost_frames_are_gaps_and_counted_and_short_losses_of_signals_are_interpolated(
    trial, tmp_path
):
    cameras, plates, analog = xdf.recorded(trial)
    gone, long, short = [40, 41, 42, 110], range(700, 745), range(1500, 1509)
    for of, lost in ((cameras, gone), (plates, [*long, *short])):
        kept = np.delete(np.arange(len(of["stamps"])), list(lost))
        of |= {"stamps": of["stamps"][kept], "values": of["values"][kept]}
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", [cameras, plates, analog]))
    empty = np.isnan(read.markers.position).all(axis=(1, 2))
    assert np.flatnonzero(empty).tolist() == gone
    wrench, true = (each.plates[1].wrench for each in (read, trial))
    assert np.flatnonzero(np.isnan(wrench[:, 0])).tolist() == [*long]
    share = np.arange(1, 10)[:, None] / 10
    between = (1 - share) * true[1499] + share * true[1509]
    np.testing.assert_allclose(wrench[short], between, atol=1e-9)
    assert Fact("missing", "stream Cameras", f"{len(gone)} of 200 samples") in read.facts


def test_a_marker_at_the_origin_and_one_that_is_nan_were_not_seen(trial, tmp_path):
    cameras, *others = xdf.recorded(trial)
    cameras["values"][5, 3:6] = 0
    cameras["values"][9, 6] = np.nan
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", [cameras, *others]))
    unseen = np.argwhere(np.isnan(read.markers.position).any(axis=-1)).tolist()
    assert unseen == [[5, 1], [9, 2]]


@pytest.mark.parametrize("label", ["{}_{}", "{}.Pos{}"])
def test_markers_are_found_by_labels_where_no_type_is_stated(trial, tmp_path, label):
    cameras, *_ = xdf.recorded(trial)
    channels = [
        {"label": label.format(name, axis), "unit": "m"}
        for name in trial.markers.names
        for axis in "XYZ"
    ]
    cameras["desc"] = xdf.described(channels)
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", [cameras]))
    assert read.markers.names == trial.markers.names
    np.testing.assert_allclose(read.markers.position, trial.markers.position, atol=1e-12)


def test_plates_named_as_in_dflow_are_about_the_origin_of_its_axes(trial, tmp_path):
    axes = "right,up,back"
    position, plates = in_file(trial, axes)
    channels = [
        {"label": f"FP{number}.{what}{axis}", "unit": unit}
        for number in (1, 2)
        for what, unit in (("For", "N"), ("Mom", "Nm"), ("Cop", "m"))
        for axis in "XYZ"
    ]
    values = [vector for plate in plates for vector in plate]
    time = trial.plates[0].time
    streams = [
        xdf.stream(
            "D-Flow",
            "MoCap",
            trial.markers.time,
            position.reshape(200, -1),
            xdf.described(xdf.marker_channels(trial.markers.names)),
            rate=100,
        ),
        xdf.stream("Plates", "", time, np.hstack(values), xdf.described(channels), rate=1000),
    ]
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", streams), axes)
    for ours, true in zip(read.plates, trial.plates, strict=True):
        np.testing.assert_allclose(ours.wrench, true.wrench, atol=1e-9)


def test_a_plate_whose_place_is_not_stated_is_left_out_with_a_warning(trial, tmp_path):
    cameras, plates, analog = xdf.recorded(trial)
    channels = [c for plate in trial.plates for c in xdf.plate_channels(plate.number)]
    plates["desc"] = xdf.described(channels, f"<plates>{xdf.plate_place(trial.plates[1])}</plates>")
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", [cameras, plates, analog]))
    assert [plate.number for plate in read.plates] == [2]
    assert "FP1.FX" in read.analog.names
    assert "left_out" in codes(read)


def test_kilonewtons_and_newton_millimetres_are_converted(trial, tmp_path):
    cameras, plates, _ = xdf.recorded(trial)
    channels = [c for p in trial.plates for c in xdf.plate_channels(p.number, ("kN", "Nmm"))]
    places = "".join(map(xdf.plate_place, trial.plates))
    plates["desc"] = xdf.described(channels, f"<plates>{places}</plates>")
    plates["values"] = plates["values"] * np.tile([1e-3] * 3 + [1e3] * 3, 2)
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", [cameras, plates]))
    np.testing.assert_allclose(read.plates[0].wrench, trial.plates[0].wrench, atol=1e-9)


def test_signals_of_other_rates_are_interpolated_and_texts_left_out(trial, tmp_path):
    cameras, plates, analog = xdf.recorded(trial)
    slow = xdf.stream("Motor", "", 5000 + np.arange(20) / 10, np.arange(20.0)[:, None], rate=10)
    words = xdf.stream("Events", "Markers", [5001.0], [["go"]], rate=0, kind="string")
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", [cameras, plates, analog, slow, words]))
    known = read.analog.time <= 1.9
    np.testing.assert_allclose(
        read.analog.channel("Motor.1")[known], 10 * read.analog.time[known], atol=1e-9
    )
    assert np.isnan(read.analog.channel("Motor.1")[~known]).all()


def test_faults_of_streams_are_one_line(trial, tmp_path):
    cameras, plates, _ = xdf.recorded(trial)
    path = tmp_path / "a.xdf"
    refused(xdf.write_xdf(path, [plates]), match="no stream holds markers.*streams there: 'Plates'")
    second = cameras | {"name": "B", "values": cameras["values"] + 0.001}
    refused(
        xdf.write_xdf(path, [cameras, second]),
        match="2 streams hold markers; .*: 'Cameras', 'B'; choose one, .*--marker-stream 'Cameras'",
    )
    chosen = read_recording(path, ReadOptions(marker_stream="B")).markers.position
    np.testing.assert_allclose(chosen, trial.markers.position + 0.001, atol=1e-9)
    unitless = xdf.described(xdf.marker_channels(trial.markers.names, ""))
    refused(xdf.write_xdf(path, [cameras | {"desc": unitless}]), match="no length unit is given")
    fewer = xdf.described(xdf.marker_channels(trial.markers.names[1:]))
    refused(xdf.write_xdf(path, [cameras | {"desc": fewer}]), match="describes 135 channels")
    still = cameras | {"stamps": np.full(200, 5.0)}
    refused(xdf.write_xdf(path, [still]), match="time stamps do not advance")
    path.write_bytes(b"XDF:")
    refused(path, match="holds no streams")


def test_plates_named_as_in_dflow_that_are_described_too_are_read_once(trial, tmp_path):
    cameras, plates, analog = xdf.recorded(trial)
    names = [f"{q}{axis}" for q in ("For", "Mom") for axis in "XYZ"]
    channels = [
        {**channel, "label": f"FP{plate.number}.{name}"}
        for plate in trial.plates
        for channel, name in zip(xdf.plate_channels(plate.number), names, strict=True)
    ]
    places = "".join(map(xdf.plate_place, trial.plates))
    plates["desc"] = xdf.described(channels, f"<plates>{places}</plates>")
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", [cameras, plates, analog]))
    for ours, true in zip(read.plates, trial.plates, strict=True):
        np.testing.assert_allclose(ours.wrench, true.wrench, atol=1e-9)


def part(of, order, **others):
    """A stream of these samples of another one, in this order."""
    return of | {"stamps": of["stamps"][order], "values": of["values"][order]} | others


def test_samples_sent_twice_swapped_and_late_are_the_trial(trial, tmp_path):
    rng = np.random.default_rng(2)
    streams = []
    for of in xdf.recorded(trial):
        count = len(of["stamps"])
        order = np.repeat(np.arange(count), 1 + (rng.random(count) < 0.1))
        behind = 1.5 * (rng.random(len(order)) < 0.05) + 9.5 * (rng.random(len(order)) < 0.02)
        order = order[np.argsort(np.arange(len(order)) + behind, kind="stable")]
        again = slice(len(order) // 3, len(order) // 2)
        streams.append(part(of, np.r_[order[: again.stop], order[again.start :]]))
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", streams))
    np.testing.assert_array_equal(read.markers.position, trial.markers.position)
    np.testing.assert_allclose(read.plates[0].wrench, trial.plates[0].wrench, atol=1e-12)
    np.testing.assert_array_equal(read.analog.values, trial.analog.values)
    assert [(fact.kind, fact.of) for fact in read.facts] == [
        (kind, f"stream {of['name']}") for of in streams for kind in ("joined", "corrected")
    ]


@pytest.mark.parametrize("name", ["Cameras", "Plates"])
def test_streams_of_a_sender_that_was_restarted_are_one_with_a_gap(trial, tmp_path, name):
    streams = xdf.recorded(trial)
    restarted = next(of for of in streams if of["name"] == name)
    count = len(restarted["stamps"])
    gap = np.arange(count // 2, count // 2 + count // 10)
    halves = [part(restarted, np.arange(gap[-1] + 1, count)), part(restarted, np.arange(gap[0]))]
    others = [of for of in streams if of is not restarted]
    read = read_recording(xdf.write_xdf(tmp_path / "a.xdf", [*halves, *others]))
    joined = next(fact for fact in read.facts if fact.kind == "joined")
    assert joined.of == f"stream {name}"
    assert "0.00 to " in joined.reason
    if name == "Cameras":
        values, true = (r.markers.position.reshape(200, -1) for r in (read, trial))
    else:
        values, true = (r.plates[0].wrench for r in (read, trial))
    empty = np.isnan(values).all(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(empty), gap)
    np.testing.assert_allclose(values[~empty], true[~empty], atol=1e-9)


def test_streams_of_one_name_that_overlap_or_differ_are_refused_with_both_named(trial, tmp_path):
    cameras, plates, _ = xdf.recorded(trial)
    path, count = tmp_path / "a.xdf", len(plates["stamps"])
    halves = [part(plates, np.arange(count - 9)), part(plates, np.arange(count - 10, count))]
    match = r"2 streams called 'Plates' \(0.00 to .* s and 1.99 to .* s\) overlap .*; rename one"
    refused(xdf.write_xdf(path, [cameras, *halves]), match=match)
    halves[1] = part(plates, np.arange(count - 9, count), rate=500)
    refused(xdf.write_xdf(path, [cameras, *halves]), match=match)


def test_a_component_that_is_described_twice_is_no_plate_and_both_channels_are_named(
    trial, tmp_path
):
    cameras, plates, _ = xdf.recorded(trial)
    path, place = tmp_path / "a.xdf", f"<plates>{xdf.plate_place(trial.plates[0])}</plates>"
    values = np.column_stack([plates["values"][:, :6], 2 * plates["values"][:, 2]])
    components = xdf.plate_channels(1)
    forces = [{"label": f"FP1.For{axis}", "unit": "N"} for axis in "XYZ"]
    dflow = [*forces, *({"label": f"FP1.Mom{axis}", "unit": "Nm"} for axis in "XYZ")]
    for channels in [*components, components[2]], [*dflow, dflow[2]]:
        xdf.write_xdf(path, [cameras, plates | {"values": values, "desc": xdf.described(channels)}])
        refused(path, match="channels 3 and 7 have the label 'FP1.F.*Z'; rename one")
    desc = xdf.described([*components, components[2] | {"label": "Other"}], place)
    xdf.write_xdf(path, [cameras, plates | {"values": values, "desc": desc}])
    read = read_recording(path)
    assert not read.plates
    (fact,) = (fact for fact in read.facts if fact.of == "plate 1")
    assert fact.kind == "left_out"
    assert "ForceZ: 3, 7, " in fact.reason


def test_a_coordinate_that_is_described_twice_is_refused_with_its_marker(trial, tmp_path):
    cameras = xdf.recorded(trial)[0]
    channels = xdf.marker_channels(trial.markers.names)
    values = np.column_stack([cameras["values"], cameras["values"][:, 4]])
    desc = xdf.described([*channels, channels[4]], xdf.tags(axes="forward,left,up"))
    path = xdf.write_xdf(tmp_path / "a.xdf", [cameras | {"values": values, "desc": desc}])
    refused(path, match=f"marker '{trial.markers.names[1]}' has several channels, but one for X")
