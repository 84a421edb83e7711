"""The head of a file can be shown to others: what it says is there, names of people are not."""

from hypothesis import given
from hypothesis import strategies as st

from pipeline.cli.app import main
from pipeline.io.header import describe_header
from tests.pipeline.other_formats import (
    excerpt,
    write_dflow,
    write_mox,
    write_nexus,
    write_opensim,
)
from tests.pipeline.test_privacy import NAMES, write_named
from tests.pipeline.xdf_file import recorded, write_xdf


def shows(path, *texts):
    """The description of a file, which has all texts and no name."""
    described = "\n".join(describe_header(path))
    assert not [name for name in NAMES if name in described]
    assert not [text for text in texts if text not in described]
    return described


def test_a_c3d_file_shows_counts_rates_units_labels_and_plates_without_names(walker, tmp_path):
    write_named(walker, tmp_path / "walk.c3d")
    frames = len(walker.markers.time)
    shows(
        tmp_path / "walk.c3d",
        f"frames 1 to {frames}",
        "POINT:UNITS [1] m",
        "1:LASIS, 1:RASIS",
        "2:LASIS",
        "FORCE_PLATFORM:CORNERS [3×4×2]",
        "OPERATOR:NAME [1] ‹2 letters›. ‹10 letters›",
    )


def test_text_files_show_keys_units_and_labels_without_names(walker, tmp_path):
    short = excerpt(walker, 400, 420)
    write_opensim(short, tmp_path / "XANTHIPPE.trc", tmp_path / "walk.mot")
    shows(tmp_path / "XANTHIPPE.trc", "DataRate", "LASIS")
    write_dflow(short, tmp_path / "walk.txt")
    shows(tmp_path / "walk.txt", "FrameNumber", "LASIS.PosX")
    write_nexus(short, tmp_path / "nexus.csv", subject="XANTHIPPE:")
    shows(tmp_path / "nexus.csv", "Trajectories", "1:LASIS", "Fx")
    write_mox(short, tmp_path / "walk.mox")
    shows(tmp_path / "walk.mox", "MOX; ")


def test_streams_show_types_rates_and_labels(walker, tmp_path):
    write_xdf(tmp_path / "walk.xdf", recorded(walker))
    shows(tmp_path / "walk.xdf", "100 Hz", "LASIS", "channels of")


def test_a_file_that_cannot_be_read_says_why_and_shows_how_far_it_makes_sense(walker, tmp_path):
    write_named(walker, tmp_path / "walk.c3d")
    content = bytearray((tmp_path / "walk.c3d").read_bytes())
    content[523:525] = b"\xff\xff"  # from the first group to the next record
    (tmp_path / "walk.c3d").write_bytes(content)
    shows(tmp_path / "walk.c3d", "frames 1 to", "it points backwards")


@given(content=st.binary(max_size=3000), c3d=st.booleans())
def test_no_bytes_end_in_an_error(tmp_path_factory, content, c3d):
    path = tmp_path_factory.getbasetemp() / "any"
    path.write_bytes(b"\x02\x50" + content if c3d else content)
    assert describe_header(path)


def test_hbm_file_header_prints_it_for_any_file(tmp_path, capsys):
    (tmp_path / "note.txt").write_text("XANTHIPPE walks\t1.5\t1984-03-12\n", encoding="utf-8")
    assert main([str(tmp_path / "note.txt"), "--header"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "‹9 letters› ‹5 letters› | 1.5 | ‹date›"
