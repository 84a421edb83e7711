"""A TRC file gives markers in metres and axes of the lab, or one line that says what is wrong."""

import re

import numpy as np
import pytest

from pipeline.io.read import read_recording


@pytest.fixture
def trc_file(tmp_path, subject):
    """Write the standing subject as a TRC file, x forward, y up, z right, with any faults."""

    def write(unit="mm", per_metre=1000.0, *, edit=lambda text: text, position=None):
        lab = subject.position if position is None else position
        placed = lab[..., [0, 2, 1]] * [1, 1, -1] * per_metre
        n_frames, n_markers, _ = placed.shape
        lines = [
            "PathFileType\t4\t(X/Y/Z)\tsubject.trc",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate",
            f"100.00\t100.00\t{n_frames}\t{n_markers}\t{unit}\t100.00",
            "Frame#\tTime\t" + "\t\t\t".join(subject.names) + "\t\t",
            "\t\t" + "\t".join(f"{a}{k + 1}" for k in range(n_markers) for a in "XYZ"),
            "",
        ]
        for k, frame in enumerate(placed):
            fields = ["" if np.isnan(value) else f"{value:.6f}" for value in frame.ravel()]
            lines.append("\t".join([str(k + 7), f"{2 + k / 100:.3f}", *fields]))
        path = tmp_path / "subject.trc"
        path.write_text(edit("\n".join(lines)), encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize(("unit", "per_metre"), [("mm", 1e3), ("m", 1.0)])
def test_markers_arrive_in_metres_and_lab_axes(trc_file, subject, unit, per_metre):
    recording = read_recording(trc_file(unit, per_metre))
    assert recording.markers.names == subject.names
    np.testing.assert_allclose(recording.markers.position, subject.position, atol=1e-6)
    np.testing.assert_allclose(recording.markers.time, subject.time, atol=1e-12)
    assert recording.first_frame == 7
    assert recording.notes[0].values["axes"] == ("forward", "up", "right")


def test_empty_fields_and_zeros_are_gaps(trc_file, subject):
    position = subject.position.copy()
    position[3, 2] = np.nan
    position[4, 1] = 0
    gaps = np.isnan(read_recording(trc_file(position=position)).markers.position).all(axis=-1)
    assert np.argwhere(gaps).tolist() == [[3, 2], [4, 1]]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda text: "", "is empty"),
        (lambda text: text.replace("Units", "Unit"), "Units"),
        (lambda text: text.replace("RASIS\t\t\t", "", 1), "5 markers, .*line 7 .* 6"),
        (lambda text: text.replace("2.030", "2.040"), "line 11: time 2.04 "),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(trc_file, edit, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_recording(trc_file(edit=edit))
    assert str(caught.value).startswith("subject.trc: ")
    assert "\n" not in str(caught.value)


def test_a_trimmed_file_is_read_as_far_as_it_goes_with_a_warning(trc_file, subject):
    recording = read_recording(
        trc_file(edit=lambda text: text[: len(text) // 2].rpartition("\n")[0])
    )
    frames = len(recording.markers.time)
    assert 20 < frames < 30
    np.testing.assert_allclose(recording.markers.position, subject.position[:frames], atol=1e-6)
    assert re.search(rf"NumFrames 50\b.* {frames}\b", " ".join(map(str, recording.facts)))


def rounded_times(text, rate_hz, decimals, first=0):
    """The same file with another rate, and times rounded to so many decimals."""
    *head, names, axes, blank = text.split("\n")[:6]
    rows = [line.split("\t") for line in text.split("\n")[6:]]
    head[2] = head[2].replace("100.00", f"{rate_hz:.2f}")
    times = (f"{(first + k) / rate_hz:.{decimals}f}" for k in range(len(rows)))
    lines = ("\t".join([row[0], time, *row[2:]]) for row, time in zip(rows, times, strict=True))
    return "\n".join([*head, names, axes, blank, *lines])


@pytest.mark.parametrize(("rate_hz", "decimals"), [(250, 2), (240, 3), (120, 2)])
def test_rounded_times_are_the_regular_times_of_the_rate(trc_file, rate_hz, decimals):
    path = trc_file(edit=lambda text: rounded_times(text, rate_hz, decimals))
    recording = read_recording(path)
    np.testing.assert_allclose(recording.markers.time, np.arange(50) / rate_hz, atol=1e-9)


def test_rounded_times_begin_where_all_of_them_say_not_where_the_first_one_does(trc_file):
    """Frame 1 is at 0.004 s: rounded, it is at 0, a whole frame before."""
    trc = trc_file(edit=lambda text: rounded_times(text, 250, 2, first=1))
    names = [f"ground_{name}{axis}" for name in ("force_v", "force_p", "torque_") for axis in "xyz"]
    rows = (f"{k / 1000} 0 {100 + k} 0 0 0 0 0 0 0" for k in range(300))
    mot = trc.with_suffix(".mot")
    mot.write_text("\n".join(["loads", "endheader", " ".join(["time", *names]), *rows]))
    (plate,) = read_recording(trc, forces=mot).plates
    assert np.interp(0, plate.time, plate.wrench[:, 2]) == pytest.approx(104, abs=0.5)
