"""Names of people that stand in the headers of recordings appear in nothing that is written."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from rerun.chunk import RrdReader

from pipeline.cli.app import main
from pipeline.io.c3d.read import read_c3d
from pipeline.io.read_options import ReadOptions
from pipeline.virtual_lab.machine import c3d_file
from pipeline.virtual_lab.machine.c3d_file import write_c3d

NAMES = ("XANTHIPPE", "ZEBULONSKI", "QUINCYSTON", "WATSONHOLM")
"""Long enough that none occurs in a picture or in packed numbers by chance."""
SUBJECT, OTHER, OPERATOR, DOCTOR = (f"Dr. {name}" for name in NAMES)
STUDY = """
label_prefix = "1"
[conditions.walk]
[conditions.again]
"""
PERSON = """
id = "sub01"
mass_kg = 75
[trials.walk]
file = "walk.c3d"
[trials.again]
file = "again.c3d"
"""


def write_named(recording, path):
    """Write a C3D file with two subjects, whose header says who everybody is."""
    markers, moved = recording.markers, recording.markers.position[:, :5] + [0, 3.0, 0]
    names = [f"{SUBJECT}:{name}" for name in markers.names]
    names += [f"{OTHER}:{name}" for name in markers.names[:5]]
    both = replace(markers, names=tuple(names), position=np.hstack([markers.position, moved]))
    groups = {
        "EVENT": {
            "USED": np.array([2]),
            "TIMES": np.array([[0.0, 0.0], [1.0, 2.0]]),
            "LABELS": [f"Foot Strike of {SUBJECT}", "Foot Strike"],
            "CONTEXTS": [SUBJECT, OTHER],
            "SUBJECTS": [SUBJECT, OTHER],
            "DESCRIPTIONS": [f"told by {OPERATOR}"] * 2,
        },
        "SUBJECTS": {"NAMES": [SUBJECT, OTHER], "MARKER_SETS": [f"set of {OPERATOR}"]},
        "MANUFACTURER": {"COMPANY": DOCTOR, "SOFTWARE": OPERATOR},
        "OPERATOR": {"NAME": OPERATOR, "COMMENT": f"referred by {DOCTOR}"},
    }
    encode = c3d_file.parameter_section

    def section(stated, data_block):
        labels = {"DESCRIPTIONS": [f"on {SUBJECT}"] * len(names)}
        point = {"POINT": {**stated["POINT"], **labels}}
        return encode({**stated, **point, **groups}, data_block)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(c3d_file, "parameter_section", section)
        write_c3d(path, both, recording.plates)
    assert all(name.encode() in path.read_bytes() for name in NAMES)


@pytest.fixture(scope="module")
def study(walker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("named")
    again = replace(walker.markers, position=walker.markers.position + 0.001)  # no copy
    write_named(walker, folder / "walk.c3d")
    write_named(replace(walker, markers=again), folder / "again.c3d")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "sub01.toml").write_text(PERSON, encoding="utf-8")
    return folder


def texts_of(path):
    """Everything that a file holds, as text; tables and viewer files uncompressed."""
    yield path.name
    yield path.read_bytes().decode("utf-8", "replace")
    if path.suffix == ".parquet":
        yield str(pq.read_metadata(path).metadata)
        yield pq.read_table(path).to_pandas().to_csv()
    if path.suffix == ".rrd":
        for chunk in RrdReader(path).stream():
            yield chunk.entity_path
            yield str(chunk.to_record_batch().to_pydict())


def found_in(text):
    return [name for name in NAMES if name in text]


def test_of_two_subjects_one_is_read_and_nobody_is_named(study):
    recording = read_c3d(study / "walk.c3d", ReadOptions(label_prefix="1"))
    assert "LASIS" in recording.markers.names
    assert found_in(repr(recording.metadata)) == []
    assert found_in(" ".join(map(str, recording.notes))) == []


FORMATS = ("--format", "osim", "--format", "urdf", "--format", "tables")


@pytest.mark.slow
def test_no_output_of_a_study_holds_a_name_from_a_header(study, tmp_path, capfd):
    """Terminal, results, report, tables, BIDS data set and viewer files."""
    walk, out = str(study / "walk.c3d"), tmp_path / "out"
    chosen = ["--label-prefix", "1", "--mass-kg", "75"]
    commands = [
        (0, ["check", str(study)]),
        (0, ["run", str(study), "--out", str(out / "results"), "--jobs", "1"]),
        (0, ["report", str(out / "results")]),
        (0, ["view", str(out / "results"), "--save", str(out / "view.rrd")]),
        (0, ["residuals", walk, *chosen, "--out", str(out / "one")]),
        (0, ["export", walk, *chosen, "--format", "bids", "--out", str(out / "bids")]),
        (0, ["export", walk, *chosen, *FORMATS, "--out", str(out / "models")]),
        (2, ["residuals", walk, "--out", str(out / "none")]),
        (2, ["residuals", walk, "--label-prefix", "Xanthippe", "--out", str(out / "none")]),
    ]
    for code, command in commands:
        assert main(command) == code, command
    said = capfd.readouterr()
    assert found_in(said.out + said.err) == []
    files = [path for path in out.rglob("*") if path.is_file()]
    assert {".parquet", ".html", ".csv", ".json", ".tsv", ".rrd", ".trc", ".osim"} <= {
        path.suffix for path in files
    }
    assert {path.name: f for path in files for t in texts_of(path) if (f := found_in(t))} == {}


def test_reasons_of_failures_hold_no_name(study, tmp_path, capfd):
    """Without a choice of the subject every trial fails."""
    unchosen = tmp_path / "unchosen"
    unchosen.mkdir()
    for path in study.iterdir():
        (unchosen / path.name).write_bytes(path.read_bytes())
    text = STUDY.replace('label_prefix = "1"', "")
    (unchosen / "study.toml").write_text(text, encoding="utf-8")
    out = tmp_path / "results"
    assert main(["check", str(unchosen)]) == 2
    assert main(["run", str(unchosen), "--out", str(out), "--jobs", "1"]) == 1
    said = capfd.readouterr()
    assert "2 subjects" in said.out + said.err
    assert found_in(said.out + said.err) == []
    files = [path for path in out.rglob("*") if path.is_file()]
    assert {path.name: f for path in files for t in texts_of(path) if (f := found_in(t))} == {}
