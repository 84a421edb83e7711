"""The same trial in each format is the same recording, and other content is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.markers import MarkerSet, marker_sets
from hbm.notes import Note
from pipeline.io.input_file import describe_error, naming
from pipeline.io.read import file_format, read_recording
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Fact, impossible_samples, saying
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.pipeline.other_formats import (
    excerpt,
    write_dflow,
    write_forces,
    write_mox,
    write_nexus,
    write_opensim,
    write_qualisys,
)


@pytest.fixture(scope="module")
def trial(walker):
    """Two seconds and a half of walking with gaps, plates and markers only."""
    whole = excerpt(walker, 400, 650, first_frame=17)
    position = whole.markers.position.copy()
    position[30:42, 3] = np.nan
    position[100, [5, 7]] = np.nan
    position[-3:, 0] = np.nan
    return replace(whole, markers=replace(whole.markers, position=position))


@pytest.fixture(scope="module")
def formats(trial, tmp_path_factory):
    """Format -> the arguments that read the trial from it; the suffixes mean nothing."""
    folder = tmp_path_factory.mktemp("formats")
    write_c3d(folder / "a.dat", trial.markers, trial.plates, first_frame=17)
    write_opensim(trial, folder / "b.dat", folder / "b_forces.dat")
    write_dflow(trial, folder / "c.dat")
    write_dflow(trial, folder / "d.dat", missing="held")
    write_mox(trial, folder / "e.dat")
    write_nexus(trial, folder / "f.dat")
    write_nexus(trial, folder / "g.dat", separator="\t", sign=1, unit=("m", 1.0), subject="")
    write_forces(trial, folder / "b_cortex.dat")
    write_qualisys(trial, folder / "h.dat")
    write_qualisys(trial, folder / "i.dat", local=False, missing="0.000", titles=False)
    return {
        "C3D": {"path": folder / "a.dat"},
        "TRC": {"path": folder / "b.dat", "forces": folder / "b_forces.dat"},
        "TRC and .forces": {"path": folder / "b.dat", "forces": folder / "b_cortex.dat"},
        "Qualisys": {"path": folder / "h.dat"},
        "Qualisys in the lab's axes": {"path": folder / "i.dat"},
        "D-Flow": {"path": folder / "c.dat"},
        "D-Flow held": {"path": folder / "d.dat"},
        "MOX": {"path": folder / "e.dat"},
        "Nexus": {"path": folder / "f.dat"},
        "Nexus tabs": {"path": folder / "g.dat"},
    }


QUALISYS = ("Qualisys", "Qualisys in the lab's axes")
NAMES = ["C3D", "TRC", "TRC and .forces", "D-Flow", "D-Flow held", "MOX", "Nexus", "Nexus tabs"]
NAMES += QUALISYS
PLACES_M = {"C3D": 1e-6, "D-Flow": 1e-6, "D-Flow held": 1e-6}
WRENCHES = {"C3D": 1e-3, "D-Flow": 2e-6, "D-Flow held": 2e-6, "TRC": 1e-5, "TRC and .forces": 1e-5}
LOADED_N = 20.0
"""Where a plate carries less, .forces holds no centre of pressure, and so not all of the moment."""


@pytest.mark.parametrize("name", NAMES)
def test_the_same_trial_in_each_format_is_the_same_recording(formats, trial, name):
    assert file_format(formats[name]["path"]) == name.split(maxsplit=1)[0]
    read = read_recording(**formats[name])
    assert read.markers.names == trial.markers.names
    np.testing.assert_allclose(read.markers.time, trial.markers.time, atol=1e-9)
    places = PLACES_M.get(name, 1e-8)
    np.testing.assert_allclose(read.markers.position, trial.markers.position, atol=places)
    assert len(read.plates) == len(trial.plates) == 2
    for ours, true in zip(read.plates, trial.plates, strict=True):
        step = round(len(true.time) / len(ours.time))
        assert step == (10 if name.startswith("D-Flow") else 1)
        np.testing.assert_allclose(ours.time, true.time[::step], atol=1e-9)
        atol = WRENCHES.get(name, 1e-4)
        wrench = true.wrench[::step]
        loaded = wrench[:, 2] > (LOADED_N if name == "TRC and .forces" else -np.inf)
        np.testing.assert_allclose(ours.wrench[loaded], wrench[loaded], atol=atol)


def one_line(error):
    text = str(error.value)
    assert text.isprintable()
    assert len(text) < 700
    return text


def test_unknown_content_is_refused_with_the_formats_that_are_read(tmp_path):
    path = tmp_path / "trial.c3d"
    for content in (b"time\tLASIS\n0\t1\n", bytes(range(256)) * 40):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"trial\.c3d: .*TRC.*D-Flow"):
            read_recording(path)


def test_a_file_of_forces_or_signals_alone_names_the_file_it_needs(formats, tmp_path):
    with pytest.raises(ValueError, match=r"no markers; .*TRC"):
        read_recording(formats["TRC"]["forces"])
    path = tmp_path / "record.txt"
    path.write_text("Time\tBelt\n0.0\t1.0\n0.1\t1.0\n")
    with pytest.raises(ValueError, match=r"no markers; .*D-Flow"):
        read_recording(path)


@pytest.mark.parametrize("name", ["D-Flow", "MOX", "Nexus", "TRC", "Qualisys"])
def test_line_ends_and_byte_order_marks_change_nothing(formats, tmp_path, name):
    plain = read_recording(formats[name]["path"])
    text = formats[name]["path"].read_text(encoding="utf-8")
    lines = text.splitlines()
    mixed = "".join(line + ("\r\n" if k % 3 else "\n") for k, line in enumerate(lines))
    variants = {"crlf": "\r\n".join(lines).encode(), "mixed": mixed.encode()}
    variants["bom"] = b"\xef\xbb\xbf" + text.encode()
    variants["utf16"] = text.encode("utf-16") if name != "MOX" else variants["bom"]
    path = tmp_path / "variant.x"
    for content in variants.values():
        path.write_bytes(content)
        again = read_recording(path)
        np.testing.assert_array_equal(again.markers.position, plain.markers.position)


def with_decimal_commas(formats, tmp_path, name):
    text = formats[name]["path"].read_text(encoding="utf-8")
    start = {"D-Flow": text.find("\n"), "MOX": text.find("0.")}.get(name, 0)
    if name == "Nexus":
        text = text.replace(",", ";").replace("N.mm", "Nmm")
    path = tmp_path / "comma.txt"
    path.write_text(text[:start] + text[start:].replace(".", ","), encoding="utf-8")
    return path


def test_decimal_commas_in_mox_are_refused(formats, tmp_path):
    with pytest.raises(ValueError, match=r"^comma\.txt: .*'\d+,\d+', expected a number"):
        read_recording(with_decimal_commas(formats, tmp_path, "MOX"))


@pytest.mark.parametrize("name", ["D-Flow", "Nexus", "TRC", "Qualisys"])
def test_decimal_commas_that_separate_no_columns_are_points(formats, tmp_path, name):
    read = read_recording(with_decimal_commas(formats, tmp_path, name))
    plain = read_recording(formats[name]["path"])
    np.testing.assert_array_equal(read.markers.position, plain.markers.position)
    assert any("decimal commas" in fact.reason for fact in read.facts)


@pytest.mark.parametrize(("name", "separator"), [("D-Flow", "\t"), ("Nexus", ","), ("TRC", "\t")])
def test_a_row_with_another_number_of_columns_is_refused_with_its_line(
    formats, tmp_path, name, separator
):
    lines = formats[name]["path"].read_text(encoding="utf-8").splitlines()
    fields = lines[200].split(separator)
    del fields[5]
    lines[200] = separator.join(fields)
    path = tmp_path / "columns.txt"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ValueError, match=r"^columns\.txt: .*line 201 .*fields"):
        read_recording(path)


WRITERS = {
    "C3D": lambda trial, path: write_c3d(path, trial.markers, trial.plates),
    "TRC": lambda trial, path: write_opensim(trial, path, path.with_suffix(".mot")),
    "D-Flow": write_dflow,
    "MOX": write_mox,
    "Nexus": write_nexus,
    "Qualisys": write_qualisys,
}


IN_OTHER_UNITS = {
    "C3D": (0.1, "cm"),
    "TRC": (1000.0, "mm"),
    "Nexus": (0.1, "cm"),
    "Qualisys": (0.1, "cm"),
}
"""Format -> what positions are multiplied with before they are written, unit that makes up for it;
the others write metres as TRC does."""


@pytest.mark.parametrize("name", WRITERS)
def test_stated_units_are_used_in_every_format(trial, tmp_path, name):
    factor, unit = IN_OTHER_UNITS.get(name, IN_OTHER_UNITS["TRC"])
    path = tmp_path / "units.dat"
    markers = replace(trial.markers, position=factor * trial.markers.position)
    WRITERS[name](replace(trial, markers=markers), path)
    read = read_recording(path, ReadOptions(units=unit))
    np.testing.assert_allclose(read.markers.position, trial.markers.position, atol=2e-6)


@pytest.mark.parametrize("name", NAMES)
def test_stated_units_of_plates_are_used_in_every_format(formats, name):
    """A thousand times the forces and moments, at the same places."""
    plain = read_recording(**formats[name])
    millimetres = name in ("C3D", "Nexus", "Nexus tabs", "TRC and .forces")
    units = ReadOptions(plate_units=f"kN,{'kNmm' if millimetres else 'kNm'}")
    read = read_recording(**formats[name], options=units)
    for ours, true in zip(read.plates, plain.plates, strict=True):
        size = np.abs(true.wrench).max(axis=0)
        assert (np.abs(ours.wrench / 1000 - true.wrench) < 1e-6 * size).all()


@pytest.mark.parametrize("name", WRITERS)
def test_the_prefix_of_a_subject_is_chosen_in_every_format(trial, tmp_path, name):
    """Two people carry the same labels; the platform's markers are nobody's."""
    names = trial.markers.names
    both = (*(f"S01:{n}" for n in names), *(f"S02:{n}" for n in names[:5]), "lab:PLAT1")
    position = trial.markers.position
    seen = np.nan_to_num(position, nan=0.5)
    extra = seen[:, :5] + [0, 3.0, 0]
    markers = replace(
        trial.markers, names=both, position=np.hstack([position, extra, seen[:, 5:6] + [0, 0, 1]])
    )
    path = tmp_path / "two.dat"
    options = {"subject": ""} if name == "Nexus" else {}
    WRITERS[name](replace(trial, markers=markers), path, **options)
    with pytest.raises(ValueError, match=r"2 subjects .* \(1, 2\)") as several:
        read_recording(path)
    with pytest.raises(ValueError, match=r"no label begins .* 3, numbered") as none:
        read_recording(path, ReadOptions(label_prefix="S03"))
    read = read_recording(path, ReadOptions(label_prefix="S01"))
    assert read.markers.names == (*names, "PLAT1")
    np.testing.assert_allclose(read.markers.position[:, :-1], position, atol=2e-6)
    said = f"{one_line(several)} {one_line(none)} {' '.join(map(str, read.notes))}"
    assert "S01" not in said


@pytest.mark.parametrize("name", NAMES)
def test_a_table_shows_the_axes_in_every_format_and_has_to_fit(formats, trial, tmp_path, name):
    """Labels that are renamed and mean nothing; another laboratory's table is named as such."""
    labels = {label: f"m{k}" for k, label in enumerate(trial.markers.names)}
    known = marker_sets()["hbm2"]
    markers = known.present(labels).markers
    own = tuple(replace(m, labels=(labels[m.labels[0]],)) for m in markers)
    table = MarkerSet("lab", "a laboratory's own", own)
    plain = read_recording(**formats[name])
    read = read_recording(**formats[name], options=ReadOptions(rename=labels, marker_set=table))
    np.testing.assert_array_equal(read.markers.position, plain.markers.position)
    with pytest.raises(ValueError, match=r"marker set lab \(m0.* LASIS,"):
        read_recording(**formats[name], options=ReadOptions(marker_set=table))


@pytest.mark.parametrize(
    ("name", "scale", "remedy"),
    [
        ("C3D", 1e3, "no unit"),
        ("TRC", 1e3, "give --units mm,"),
        ("D-Flow", 1e3, "give --units mm,"),
        ("MOX", 1e-3, "no unit"),
        ("Nexus", 1e-3, "give --units m,"),
        ("Qualisys", 1e3, "no unit"),
    ],
)
def test_a_length_unit_that_contradicts_the_markers_is_refused_with_the_one_that_does_not(
    trial, tmp_path, name, scale, remedy
):
    markers = replace(trial.markers, position=scale * trial.markers.position)
    path = tmp_path / "unit.dat"
    WRITERS[name](replace(trial, markers=markers), path)
    with pytest.raises(ValueError, match=rf"^unit\.dat: .*{remedy}"):
        read_recording(path)


@pytest.mark.parametrize(
    "name", ["axes_flipped_by_one_bit_53172_3.c3d", "axes_flipped_by_one_bit_67360_3.c3d"]
)
def test_one_flipped_bit_does_not_turn_the_axes_of_a_recording(shared_data, name):
    """Both were copies of a file whose axes are known, with a bit of one marker flipped."""
    damaged = read_recording(shared_data / "broken" / name)
    sound = read_recording(shared_data / "c3d_samples" / "sgi_real.c3d")
    assert damaged.notes[0].values["axes"] == sound.notes[0].values["axes"]
    same = np.isclose(damaged.markers.position, sound.markers.position, equal_nan=True)
    assert np.count_nonzero(~same.all(axis=-1)) == 1


def test_what_was_found_on_reading_is_printed_with_a_later_error():
    plate = Fact("left_out", "plate 2", "FORCE_PLATFORM:TYPE does not name its type")
    (gaps,) = impossible_samples(["LASIS", "RASIS"], [2, 0])
    axes = Note.of("axes", axes=("forward", "left", "up"), evidence="as given")
    with (
        pytest.raises(ValueError, match="mass missing") as error,
        saying([plate, plate, gaps, axes]),
    ):
        raise ValueError("mass missing")
    assert error.value.__notes__ == [f"on reading, {plate}", f"on reading, {gaps}"]
    fault, file = pytest.raises(ValueError, match=r"walk\.c3d: axes"), Path("walk.c3d")
    with fault as error, naming(file), saying([plate]):
        raise ValueError("axes unknown")
    assert describe_error(error.value).startswith("walk.c3d: axes unknown; ")
    assert describe_error(error.value).endswith(f", {plate}")
