"""Text tables as people have them are read alike, or refused in one line."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from hbm.markers import Markers
from pipeline.io.opensim import forces_beside
from pipeline.io.qualisys import plate_files
from pipeline.io.read import read_recording
from pipeline.io.recording import Fact
from pipeline.io.text_table import TextTable
from tests.pipeline.other_formats import excerpt, write_forces, write_opensim, write_qualisys

FEW = settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
LABELS = ("LASIS", "RASIS", "LPSIS", "RPSIS", "LHEE", "RHEE", "LMT2", "RMT2")
HEADER_LINES = 4
"""Of a MOT file as `write_opensim` writes it, before the names."""


@pytest.fixture(scope="module")
def trial(walker):
    """Forty frames of eight markers on two plates, one of them with a gap."""
    short = excerpt(walker, 400, 440)
    position = short.markers.position[:, [short.markers.names.index(name) for name in LABELS]]
    position = np.nan_to_num(position, nan=0.7)
    position[10:14, 3] = np.nan
    return replace(short, markers=Markers(short.markers.time, LABELS, position))


@pytest.fixture(scope="module")
def plain(trial, tmp_path_factory):
    """The trial as TRC and MOT, and what is read from them."""
    folder = tmp_path_factory.mktemp("plain")
    trc, mot = folder / "walk.trc", folder / "walk.mot"
    write_opensim(trial, trc, mot)
    return trc, mot, read_recording(trc, forces=mot)


def written(path, lines, end="\n"):
    path.write_text(end.join([*lines, ""]), encoding="utf-8", newline="")
    return path


def lines_of(path):
    return path.read_text(encoding="utf-8").split("\n")[:-1]


def same_markers(read, plain):
    np.testing.assert_allclose(read.markers.position, plain.markers.position, atol=1e-9)
    assert read.markers.names == plain.markers.names


# Times


def regular_rows(file, numbers, values, column, rate_hz=0.0):
    """Times, values and facts of rows with these numbers of lines."""
    table = TextTable(Path(file), [(k, "") for k in numbers], [])
    return *table.regular(values, column, rate_hz), table.remarks


RATES_HZ = st.one_of(
    st.sampled_from([50.0, 59.94, 100.0, 119.88, 120.0, 239.17, 240.0, 250.0, 300.0, 1000.0]),
    st.floats(40, 1200),
)


@given(
    rate_hz=RATES_HZ,
    digits=st.integers(2, 6),
    first=st.integers(0, 500),
    rows=st.integers(200, 900),
)
def test_times_that_are_rounded_are_the_regular_ones_of_their_rate(rate_hz, digits, first, rows):
    true = (first + np.arange(rows)) / rate_hz
    values = np.column_stack([np.round(true, digits), np.arange(rows)])
    steps = np.diff(values[:, 0])
    assume(np.ptp(steps) > 1e-9 or abs(steps[0] * rate_hz - 1) < 1e-6)  # else they show another
    assume(np.count_nonzero(steps == 0) != 1 or steps[-1] > 0)  # else the last row is there twice
    time, kept, facts = regular_rows("t", range(rows), values, 0, rate_hz)
    np.testing.assert_allclose(time, true, atol=0.5 * 10.0**-digits + 1e-9)
    np.testing.assert_allclose(np.diff(time), 1 / rate_hz, rtol=1e-6)
    np.testing.assert_array_equal(kept, values)
    assert all("rounded to" in fact.reason for fact in facts)


@given(
    rate_hz=RATES_HZ,
    error=st.sampled_from([-0.01, -0.003, 0.003, 0.01, 0.3]),
    rows=st.integers(400, 900),
)
def test_a_wrong_rate_gives_way_to_the_times(rate_hz, error, rows):
    values = np.column_stack([np.round(np.arange(rows) / rate_hz, 5), np.arange(rows)])
    stated_hz = rate_hz * (1 + error)
    time, kept, (fact, *_) = regular_rows("t", range(rows), values, 0, stated_hz)
    np.testing.assert_allclose(np.diff(time), 1 / rate_hz, rtol=1e-4)
    assert len(kept) == rows
    assert fact.kind == "corrected"
    assert f"its header says {stated_hz:g} Hz" in fact.reason


@given(
    rows=st.integers(30, 200),
    at=st.integers(1, 18),
    count=st.integers(1, 9),
    same=st.booleans(),
    digits=st.sampled_from([3, 4, 6]),
)
def test_rows_written_twice_are_left_out_only_if_they_are_the_same(rows, at, count, same, digits):
    values = np.column_stack([np.round(np.arange(rows) / 500, digits), np.arange(rows)])
    doubled = np.concatenate([values[: at + count], values[at:]])
    doubled[at + count, 1] += not same
    numbers = range(10, 10 + rows + count)
    if not same:
        with pytest.raises(
            ValueError, match=f"^line {10 + at + count}: time {values[at, 0]:.9g} occurs"
        ):
            regular_rows("t.mot", numbers, doubled, 0)
        return
    time, kept, (fact,) = regular_rows("t.mot", numbers, doubled, 0)
    np.testing.assert_array_equal(kept, values)
    np.testing.assert_allclose(time, values[:, 0], atol=1e-9)
    assert fact.kind == "left_out"
    assert fact.of.startswith(f"t.mot, line {10 + at + count}")


@given(rows=st.integers(20, 200))
def test_a_last_row_at_the_time_of_the_one_before_it_is_left_out(rows):
    values = np.column_stack([np.arange(rows) / 500, np.arange(rows)])
    values[-1, 0] = values[-2, 0]
    _, kept, (fact,) = regular_rows("t.mot", range(rows), values, 0)
    np.testing.assert_array_equal(kept, values[:-1])
    assert fact.of == f"t.mot, line {rows - 1}"


@given(
    rows=st.integers(400, 1500),
    at=st.integers(1, 190),
    lost=st.integers(1, 120),
    rate_hz=st.sampled_from([100.0, 600.0]),
)
def test_rows_that_are_missing_are_gaps_also_where_times_are_rounded(rows, at, lost, rate_hz):
    values = np.column_stack([np.round(np.arange(rows) / rate_hz, 4), np.arange(rows)])
    less = np.delete(values, slice(at, at + lost), axis=0)
    time, kept, (fact,) = regular_rows("t.mot", range(len(less)), less, 0)
    np.testing.assert_allclose(time, values[:, 0], atol=0.1 / rate_hz)
    assert np.flatnonzero(np.isnan(kept[:, 1])).tolist() == [*range(at, at + lost)]
    assert (fact.kind, fact.reason.split()[0]) == ("missing", str(lost))


@given(rows=st.integers(20, 200), seed=st.integers(0, 999))
def test_times_of_no_rate_are_refused_with_their_line(rows, seed):
    time = np.cumsum(np.random.default_rng(seed).uniform(0.001, 0.003, rows))
    with pytest.raises(ValueError, match=r"^line \d+: time .*expected"):
        regular_rows("t.mot", range(rows), np.column_stack([time, time]), 0)


def test_times_of_forces_in_milliseconds_are_recognised_by_those_of_the_markers(plain, tmp_path):
    trc, mot, read = plain
    head, rows = lines_of(mot)[: HEADER_LINES + 1], lines_of(mot)[HEADER_LINES + 1 :]
    fields = (row.split("\t") for row in rows)
    in_ms = ["\t".join([f"{1000 * float(t):.3f}", *others]) for t, *others in fields]
    again = read_recording(trc, forces=written(tmp_path / "ms.mot", [*head, *in_ms]))
    np.testing.assert_allclose(again.plates[0].time, read.plates[0].time, atol=1e-6)
    assert ("corrected", "ms.mot") in [(fact.kind, fact.of) for fact in again.facts]


@pytest.mark.parametrize("shift_s", [-100.0, 0.5, 1000.0])
def test_forces_of_another_time_are_refused_with_both_files_and_ranges(plain, tmp_path, shift_s):
    trc, mot, _ = plain
    head, rows = lines_of(mot)[: HEADER_LINES + 1], lines_of(mot)[HEADER_LINES + 1 :]
    fields = (row.split("\t") for row in rows)
    later = ["\t".join([f"{float(t) + shift_s:.3f}", *others]) for t, *others in fields]
    path = written(tmp_path / "late.mot", [*head, *later])
    seen = rf"^late\.mot: .*{shift_s:.2f}–.*not overlap .*0\.00–0\.39 s of walk\.trc"
    with pytest.raises(ValueError, match=seen):
        read_recording(trc, forces=path)


# Separators, quotes, labels, counts

SEPARATED = {"tabs": "\t", "semicolons": ";", "commas": ",", "two spaces": "  ", "a space": " "}


@given(
    separator=st.sampled_from([*SEPARATED]),
    comma=st.booleans(),
    quoted=st.booleans(),
    padded=st.booleans(),
    end=st.sampled_from(["\n", "\r\n"]),
    gap=st.sampled_from(["nan", "NaN", "0", "0.00000", "NULL"]),
)
@FEW
def test_a_table_reads_alike_whatever_separates_its_columns(
    plain, tmp_path, separator, comma, quoted, padded, end, gap
):
    """As spreadsheets and scripts save it; gaps are words where spaces would swallow them."""
    sign = SEPARATED[separator]
    spaces = sign.isspace() and sign != "\t"
    assume(not (comma and separator == "commas") and not (quoted and spaces))
    trc, mot, read = plain
    variants = []
    for path, missing in ((trc, gap), (mot, "0")):
        rows = [line.split("\t") for line in lines_of(path)]
        width = max(map(len, rows))
        first = next(k for k, row in enumerate(rows) if re.match("(1|0)$", row[0]))
        for k, row in enumerate(rows):
            rows[k] = [field or missing for field in row] if k >= first else row
            if comma and (k >= first or k == 2):
                rows[k] = [field.replace(".", ",") for field in rows[k]]
        if spaces:
            rows = [[field for field in row if field] for row in rows]
        if padded and not spaces:
            rows = [row + [""] * (width - len(row)) for row in rows] + [[""] * width] * 2
        if quoted:
            rows = [[f'"{field}"' if field else "" for field in row] for row in rows]
        text = [sign.join(row) for row in rows]
        variants.append(written(tmp_path / f"case{path.suffix}", text, end))
    again = read_recording(variants[0], forces=variants[1])
    same_markers(again, read)
    for ours, true in zip(again.plates, read.plates, strict=True):
        np.testing.assert_allclose(ours.wrench, true.wrench, atol=1e-9)
    said = " ".join(map(str, again.facts))
    assert ("expected tabs" in said) == (separator != "tabs")
    assert ("decimal commas" in said) == comma


@pytest.mark.parametrize("between", ["   ", " ", "\t"])
def test_labels_may_be_separated_and_padded_by_spaces(plain, tmp_path, between):
    lines = lines_of(plain[0])
    lines[3] = "Frame#\tTime   " + between.join(
        f" {name} " if "\t" in between else name for name in LABELS
    )
    lines[3] = lines[3].replace("Time   ", f"Time{between}")
    same_markers(read_recording(written(tmp_path / "case.trc", lines)), plain[2])


@given(
    markers=st.integers(0, 90),
    frames=st.integers(0, 900),
    keys=st.sampled_from([5, 7, 8]),
    first=st.integers(0, 400),
)
@FEW
def test_counts_of_a_header_give_way_to_the_rows(plain, tmp_path, markers, frames, keys, first):
    lines = lines_of(plain[0])
    values = lines[2].split("\t")
    values[2:4] = str(frames), str(markers)
    lines[1:3] = ("\t".join(row[:keys]) for row in (lines[1].split("\t"), values))
    row = next(k for k, line in enumerate(lines) if line.startswith("1\t"))
    lines[row:] = (f"{first + k}\t{line.split(chr(9), 1)[1]}" for k, line in enumerate(lines[row:]))
    read = read_recording(written(tmp_path / "case.trc", lines))
    same_markers(read, plain[2])
    assert read.first_frame == first
    said = " ".join(map(str, read.facts))
    assert (bool(re.search(rf"NumMarkers {markers}\b.* 8\b", said))) == (markers != 8)
    assert (bool(re.search(rf"NumFrames {frames}\b.* 40\b", said))) == (frames != 40)


@pytest.mark.parametrize(
    ("sign", "frames"),
    [("9999999", 2), ("-9999999.00000", 3), ("99999.9", 40), ("-0.7777", 2), ("-0.7777", 1)],
)
def test_one_number_in_three_axes_stands_for_a_gap_where_it_occurs_twice(
    plain, tmp_path, sign, frames
):
    trc, _, read = plain
    lines = lines_of(trc)
    rows = [line.split("\t") for line in lines[-frames:]]
    for row in rows:
        row[5:8] = [sign] * 3
    lines[-frames:] = map("\t".join, rows)
    again = read_recording(written(tmp_path / "case.trc", lines), "forward,left,up")
    expected = read.markers.position.copy()
    expected[-frames:, 1] = np.nan if frames > 1 else float(sign)
    np.testing.assert_allclose(again.markers.position, expected, atol=1e-9)
    reason = f"samples at {float(sign):.7g} in x, y and z, a code of missing ones: RASIS {frames}"
    codes = [fact.reason for fact in again.facts if fact.kind == "missing"]
    assert codes == [reason] * (frames > 1)


@pytest.mark.parametrize(
    "labels", [("V_Mid_ASIS",), ("V_LASIS", "V_RASIS"), ("V_L.ASIS", "V_R.ASIS")]
)
def test_computed_points_disturb_neither_sides_nor_markers(trial, plain, tmp_path, labels):
    """Left and right exchanged, as no marker would be."""
    right, left = trial.markers.position[:, [1]], trial.markers.position[:, [0]]
    more = np.hstack([right, left] if labels[1:] else [(right + left) / 2])
    names = (*LABELS, *labels)
    markers = Markers(trial.markers.time, names, np.hstack([trial.markers.position, more]))
    write_opensim(replace(trial, markers=markers), tmp_path / "v.trc", tmp_path / "v.mot")
    read = read_recording(tmp_path / "v.trc", forces=tmp_path / "v.mot")
    assert read.markers.names == names
    np.testing.assert_allclose(read.markers.position[:, :8], plain[2].markers.position, atol=1e-9)
    assert read.notes[0] == plain[2].notes[0]


# Columns of forces

ADAPTER = {
    "f1_vx, f1_px, m1_x": ("f{}_v{}", "f{}_p{}", "m{}_{}", "xyz"),
    "f1_x, p1_x, m1_x": ("f{}_{}", "p{}_{}", "m{}_{}", "xyz"),
    "f1x, p1x, m1x": ("f{}{}", "p{}{}", "m{}{}", "xyz"),
    "f1_1, p1_1, m1_1": ("f{}_{}", "p{}_{}", "m{}_{}", "123"),
    "f1_vx, p1_px, m1_mx": ("f{}_v{}", "p{}_p{}", "m{}_m{}", "xyz"),
}


@pytest.mark.parametrize("names", ADAPTER)
def test_forces_are_found_under_the_names_of_the_c3d_adapter(plain, tmp_path, names):
    trc, mot, read = plain
    lines, (*forms, axes) = lines_of(mot), ADAPTER[names]
    columns = [form.format(k, axis) for k in (1, 2) for form in forms for axis in axes]
    lines[HEADER_LINES] = "\t".join(["time", *columns])
    again = read_recording(trc, forces=written(tmp_path / "case.mot", lines))
    for ours, true in zip(again.plates, read.plates, strict=True):
        np.testing.assert_array_equal(ours.wrench, true.wrench)


def test_codes_of_missing_centres_of_pressure_are_gaps(plain, tmp_path):
    """A gap under load; without force the centre has no meaning."""
    trc, mot, read = plain
    lines = lines_of(mot)
    rows = [line.split("\t") for line in lines[HEADER_LINES + 1 :]]
    for row in rows:
        row[4:7] = "0.3", "0", "0.5"
    for k in range(5):
        rows[k][4:7] = ["-9999"] * 3
        rows[k][1:4] = ["0" if k < 2 else "700"] * 3
    lines[HEADER_LINES + 1 :] = map("\t".join, rows)
    again = read_recording(trc, forces=written(tmp_path / "case.mot", lines))
    wrench = again.plates[0].wrench
    assert np.flatnonzero(np.isnan(wrench).any(axis=1)).tolist() == [2, 3, 4]
    (fact,) = (fact for fact in again.facts if fact not in read.facts)
    assert (fact.kind, fact.of) == ("missing", "centres of pressure")
    assert "-9999" in fact.reason


def test_a_header_written_twice_is_refused_with_both_columns(plain, tmp_path):
    trc, mot, _ = plain
    lines = lines_of(mot)
    names = lines[HEADER_LINES].split("\t")
    lines[HEADER_LINES] = "\t".join([*names[:10], *names[1:10]])
    with pytest.raises(ValueError, match=r"columns 2 and 11 .*1_ground_force_vx"):
        read_recording(trc, forces=written(tmp_path / "case.mot", lines))


@given(column=st.integers(1, 18))
@FEW
def test_a_column_written_twice_counts_once(plain, tmp_path, column):
    trc, mot, read = plain
    head, rows = lines_of(mot)[:HEADER_LINES], lines_of(mot)[HEADER_LINES:]
    doubled = [f"{row}\t{row.split(chr(9))[column]}" for row in rows]
    again = read_recording(trc, forces=written(tmp_path / "case.mot", [*head, *doubled]))
    for ours, true in zip(again.plates, read.plates, strict=True):
        np.testing.assert_array_equal(ours.wrench, true.wrench)
    assert [fact.of for fact in again.facts if fact.kind == "left_out"] == ["case.mot, column 20"]


def test_the_file_of_forces_beside_a_trc_file_is_named_if_there_is_one(plain, trial, tmp_path):
    for name in ("walk1", "walk10", "walk2_markers"):
        write_opensim(trial, tmp_path / f"{name}.trc", tmp_path / f"{name.split('_')[0]}_grf.mot")
    (tmp_path / "walk1_ik.mot").write_text("x\nendheader\ntime hip\n0 1\n1 1\n")
    read = read_recording(tmp_path / "walk1.trc")
    assert read.why_no_plates.endswith(" --forces walk1_grf.mot")
    assert forces_beside(tmp_path / "walk2_markers.trc").name == "walk2_grf.mot"
    write_forces(trial, tmp_path / "walk1.forces")
    assert "no force plates" in read_recording(tmp_path / "walk1.trc").why_no_plates


def test_a_row_that_is_left_out_is_no_plate(trial):
    row = Fact("left_out", "walk.trc, line 9", "time occurs twice")
    assert "no force plates" in replace(trial, plates=(), facts=(row,)).why_no_plates


# Cortex and Qualisys


@pytest.mark.parametrize(("sign", "first"), [(1, 1), (-1, 1), (1, 1001)])
def test_forces_on_the_plate_or_the_subject_begin_with_the_markers(
    trial, plain, tmp_path, sign, first
):
    path = write_forces(trial, tmp_path / "walk.forces", sign=sign, first=first)
    read = read_recording(plain[0], forces=path)
    for ours, true in zip(read.plates, trial.plates, strict=True):
        loaded = true.wrench[:, 2] > 20
        np.testing.assert_allclose(ours.time, true.time, atol=1e-9)
        np.testing.assert_allclose(ours.wrench[loaded], true.wrench[loaded], atol=1e-5)


@pytest.mark.parametrize(
    ("key", "value", "doubt"),
    [
        ("NumberOfForcePlates=2", "3", "NumberOfForcePlates 3, .* 2$"),
        ("SampleRate=1000.000000", "240", r"[\d.]+ s by its SampleRate"),
    ],
)
def test_a_wrong_header_of_forces_is_a_doubt(trial, plain, tmp_path, key, value, doubt):
    path = write_forces(trial, tmp_path / "walk.forces")
    path.write_text(path.read_text().replace(key, f"{key.partition('=')[0]}={value}"))
    (fact,) = read_recording(plain[0], forces=path).facts
    assert fact.kind == "in_doubt"
    assert re.search(doubt, fact.reason)


def test_forces_in_other_axes_than_the_markers_are_refused(trial, plain, tmp_path):
    path = write_forces(trial, tmp_path / "walk.forces")
    head, rows = lines_of(path)[:5], [row.split("\t") for row in lines_of(path)[5:]]
    turned = [[r[0], *(r[7 * p + k] for p in (0, 1) for k in (2, 3, 1, 5, 6, 4, 7))] for r in rows]
    written(path, [*head, *map("\t".join, turned)])
    with pytest.raises(ValueError, match=r"forces .*different axes"):
        read_recording(plain[0], forces=path)


@given(
    frames=st.booleans(),
    titles=st.booleans(),
    local=st.booleans(),
    missing=st.sampled_from(["", "0.000", "NULL", "nan"]),
    first=st.sampled_from([1, 17, 301]),
)
@FEW
def test_every_export_of_qualisys_holds_the_same_trial(
    trial, tmp_path, frames, titles, local, missing, first
):
    options = {"frames": frames, "titles": titles, "local": local, "missing": missing}
    event = ("Left Foot Strike", first + 9, f"{(first + 8) / 100:.5f}")
    numbered = replace(trial, first_frame=first)
    path = write_qualisys(
        numbered, tmp_path / "walk.tsv", **options, events=[event] if frames else []
    )
    read = read_recording(path)
    np.testing.assert_allclose(read.markers.position, trial.markers.position, atol=1e-8)
    for ours, true in zip(read.plates, trial.plates, strict=True):
        np.testing.assert_allclose(ours.wrench, true.wrench, atol=1e-5)
        np.testing.assert_allclose(ours.time, true.time, atol=1e-5)
        assert ours.rotation[2, 2] == -1
    assert [fact.kind for fact in read.facts] == ["joined"]
    if frames:
        assert read.first_frame == first
        (strike,) = read.events
        assert (strike.label, strike.side, round(strike.time, 9)) == ("foot_strike", "left", 0.09)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("in local (force plate)", "in some", "which axes"),
        ("CORNER_POSX_POSY_X\t", "CORNER_POSX_POSY_X\t9", "states no rectangle"),
        ("Moment_Y", "Torque_Y", "Moment_Y is absent"),
    ],
)
def test_a_plate_of_qualisys_that_is_not_described_is_left_out(trial, tmp_path, old, new, message):
    path = write_qualisys(trial, tmp_path / "walk.tsv")
    file = plate_files(path)[1]
    file.write_text(file.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    read = read_recording(path)
    assert [plate.number for plate in read.plates] == [1]
    (fact,) = (fact for fact in read.facts if fact.kind == "left_out")
    assert fact.of.startswith("plate 2")
    assert message in fact.reason


@pytest.mark.parametrize(("per_mm", "corrected"), [(1e-3, True), (1 / 25.4, False)])
def test_corners_in_another_unit_are_those_of_the_plate_or_none(trial, tmp_path, per_mm, corrected):
    path = write_qualisys(trial, tmp_path / "walk.tsv")
    file = plate_files(path)[1]
    lines = [
        f"{key}\t{float(text) * per_mm:.6f}" if "CORNER" in key else line
        for line in file.read_text(encoding="utf-8").splitlines()
        for key, _, text in [line.partition("\t")]
    ]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    read = read_recording(path)
    (fact,) = (fact for fact in read.facts if fact.kind in ("corrected", "left_out"))
    assert fact.kind == ("corrected" if corrected else "left_out")
    for ours, true in zip(read.plates, trial.plates, strict=corrected):
        np.testing.assert_allclose(ours.wrench, true.wrench, atol=1e-3)


def test_corners_in_another_order_are_refused(trial, tmp_path):
    path = write_qualisys(trial, tmp_path / "walk.tsv")
    for file in plate_files(path):
        text = (
            file.read_text(encoding="utf-8")
            .replace("POSX_POSY", "#")
            .replace("NEGX_POSY", "POSX_POSY")
        )
        text = text.replace("#", "NEGX_POSY").replace("POSX_NEGY", "#")
        text = text.replace("NEGX_NEGY", "POSX_NEGY").replace("#", "NEGX_NEGY")
        file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"corners .*order.*: z is up"):
        read_recording(path)


def test_forces_alone_name_the_file_that_they_need(trial, tmp_path):
    path = write_qualisys(trial, tmp_path / "walk.tsv")
    with pytest.raises(ValueError, match=r"walk_f_1\.tsv: .*trajectories"):
        read_recording(plate_files(path)[0])
    with pytest.raises(ValueError, match=r"no markers; .*TRC"):
        read_recording(write_forces(trial, tmp_path / "walk.forces"))
    moved = tmp_path / "plates"
    moved.mkdir()
    for file in plate_files(path):
        file.rename(moved / file.name)
    assert read_recording(path).plates == ()
    assert len(read_recording(path, forces=moved / "walk_f_2.tsv").plates) == 2
