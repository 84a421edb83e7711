import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from pipeline.io.opensim import read_mot, read_sto

"""What stands in the names of the columns of a force."""

IK = """Coordinates
version=1
nRows=2
nColumns=4
inDegrees=yes

Angles are in degrees.

endheader
time\tpelvis_tilt\tpelvis_tx\tknee_angle_r
0.0\t90\t0.5\t-180
0.1\tnan\t0.6\t-90
"""


@pytest.fixture
def table_file(tmp_path):
    def write(text):
        path = tmp_path / "table.mot"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_columns_are_as_in_the_file(table_file):
    table = read_mot(table_file(IK))
    np.testing.assert_array_equal(table.time, [0, 0.1])
    assert table.names == ("pelvis_tilt", "pelvis_tx", "knee_angle_r")
    assert table.in_degrees
    np.testing.assert_array_equal(table.column("knee_angle_r"), [-180, -90])
    np.testing.assert_array_equal(table.column("pelvis_tx"), [0.5, 0.6])
    assert np.isnan(table.column("pelvis_tilt")[1])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("endheader", "", "no line 'endheader'"),
        ("time", "Frame", "first column is .*expected 'time'"),
        ("nRows=2", "nRows=3", "says nrows=3 but it holds 2"),
        ("nColumns=4", "nColumns=5", "says ncolumns=5 but it holds 4"),
        ("\tknee_angle_r", "", "line 11 holds 4 fields for 3 columns"),
        ("0.6", "0,6", "line 12, column 'pelvis_tx': '0,6' has a decimal comma"),
        ("0.6", "abc", "line 12, column 'pelvis_tx': 'abc' is no number"),
        ("\t-90\n", "\n", "line 12 holds 3 fields for 4 columns"),
    ],
)
def test_a_damaged_table_is_refused_in_one_line(table_file, old, new, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_mot(table_file(IK.replace(old, new)))
    assert str(caught.value).startswith("table.mot: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "in_degrees", "shape"),
    [
        ("opensim_subject01/subject01_walk1_ik.mot", True, (73, 23)),
        ("opensim_subject01/inverse_dynamics.sto", False, (73, 23)),
        ("truth_walk/coordinates.sto", False, (223, 33)),
    ],
)
def test_real_tables_of_every_version(shared_data, name, in_degrees, shape):
    table = read_sto(shared_data / name)
    assert table.in_degrees is in_degrees
    assert table.values.shape == shape


def test_both_real_walks_have_hips_that_swing_like_walking(shared_data):
    for name in ("opensim_subject01/subject01_walk1_ik.mot", "truth_walk/coordinates.sto"):
        table = read_sto(shared_data / name)
        hip = (
            np.radians(table.column("hip_flexion_r"))
            if table.in_degrees
            else table.column("hip_flexion_r")
        )
        assert np.deg2rad(30) < np.ptp(hip) < np.deg2rad(70)


@pytest.mark.opensim
@pytest.mark.skipif(find_spec("opensim") is None, reason="the OpenSim wheel is not installed")
def test_opensim_itself_reads_the_same_table(shared_data, tmp_path):
    """In a separate process, for OpenSim comes with another casadi."""
    path = shared_data / "truth_walk" / "coordinates.sto"
    code = """if True:
        import sys, numpy, opensim
        table = opensim.TimeSeriesTable(sys.argv[1])
        labels = list(table.getColumnLabels())
        numpy.savez(sys.argv[2], labels=labels, values=table.getMatrix().to_numpy())
    """
    command = [sys.executable, "-c", code, str(path), str(tmp_path / "theirs.npz")]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=120)
    theirs, ours = np.load(tmp_path / "theirs.npz"), read_sto(path)
    assert tuple(theirs["labels"]) == ours.names
    np.testing.assert_allclose(theirs["values"], ours.values)
