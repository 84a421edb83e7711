"""A stored trial is written whole or not at all, and read back as it was."""

import errno
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hbm.coordinates import COORDINATES
from pipeline.export.tables import write_tables
from pipeline.io import write
from pipeline.io.recording import Event, Plate
from pipeline.io.write import read_parquet
from pipeline.run.store import (
    LOST,
    OF_FRAMES,
    SEAL,
    TRIAL,
    VERSION,
    read_trial,
    sealed,
    write_trial,
)
from pipeline.trial.findings.finding import Correction, Finding
from pipeline.trial.findings.raw import RawFault
from tests.pipeline.equality import assert_identical
from tests.pipeline.fake_results import fake_trial
from tests.pipeline.viewer_trial import viewer_trial


@pytest.fixture(scope="module")
def written(processed, tmp_path_factory):
    path = tmp_path_factory.mktemp("trials") / "sub01_pitch.parquet"
    write_trial(replace(processed, condition="pitch", key="a key"), path)
    return path


def test_a_file_that_expands_to_far_more_than_its_size_is_refused_before_it_is_read(
    written, tmp_path
):
    """Columns of equal values take no place in a file, whatever its pages state."""
    path, rows = tmp_path / "bomb.parquet", 50_000
    schema = pq.read_schema(written).remove_metadata()
    schema = pa.schema([*schema, *(pa.field(f"more{k}", pa.float64()) for k in range(50))])
    equal = {"string": "", "bool": False, "list<element: int64>": []}
    columns = [pa.array([equal.get(str(kind), 0)] * rows, kind) for kind in schema.types]
    with pq.ParquetWriter(path, schema, compression="zstd") as file:
        file.write_table(pa.table(columns, schema=schema))
        file.add_key_value_metadata({VERSION: b""})
    with pytest.raises(ValueError, match=r"\d+ MB, .* \d+ MB"):
        read_trial(path, frames=False)
    write.MAX_EXPANDED_BYTES, most = 10**6, write.MAX_EXPANDED_BYTES
    try:
        with pytest.raises(ValueError, match="at most 1 MB"):
            read_parquet(path)
    finally:
        write.MAX_EXPANDED_BYTES = most


def test_what_follows_from_other_columns_is_not_stored(written):
    names = pq.read_schema(written).names
    assert not [n for n in names if n.startswith(("q.", "v.", "a.", "tau.", "marker_error."))]
    assert written.stat().st_size < 1000 * pq.read_metadata(written).num_rows


def test_what_is_not_stored_is_exported_frame_by_frame(processed, written, tmp_path):
    result = read_trial(written)
    write_tables(result, tmp_path, "walk")
    frames = pd.read_parquet(tmp_path / "walk_frames.parquet")
    stored = pd.read_parquet(written)
    for name in ("time_s", "event", "quality", "residual.compensated.My"):
        assert_identical(frames[name].to_numpy(), stored[name].to_numpy())
    k = COORDINATES.index("LKneeFlexion")
    for symbol in "qva":
        found = frames[f"{symbol}.LKneeFlexion"].to_numpy()
        assert_identical(found, getattr(processed.motion, symbol)[:, k], lost=2 * LOST)
    moment = processed.measured.tau[:, k]
    assert_identical(frames["tau.measured.LKneeFlexion"].to_numpy(), moment, lost=2 * LOST)
    assert {f"marker_error.{name}" for name in processed.motion.markers} < {*frames}


def without_folder(result):
    """The result as it is stored: of the recording, the file's name alone."""
    name = Path(result.source.name)
    return replace(result, source=name, condition="pitch", key="a key")


def test_a_trial_is_read_back_whole_but_for_rounding(processed, written):
    assert processed.platform is not None
    assert processed.compensated is not None
    assert_identical(read_trial(written), without_folder(processed), lost=2 * LOST)


TRIED = Correction(("1: move x 0.04",), None, *[tuple(np.arange(6) / 7)] * 4, helps=True)
MOVED = Finding("moved", (1,), "", (0.04, 1 / 3), (0.01, 0.006), 60.0, correction=TRIED)
CLIPPED = RawFault(2, "Fz", "clipped", 800.0, 2, ((4.2, 4.201), (6.5, 6.501)))
FINDINGS = (
    Finding("clipped", (2,), channels=(CLIPPED,)),
    replace(MOVED, rivals=(Finding("gain", (1,), "Mx", (0.25,), (0.05,), 58.0),)),
)


@pytest.mark.parametrize(("compensated", "moving"), [(True, True), (False, False)])
def test_trials_with_gaps_unsolved_frames_and_onsets_are_read_back(tmp_path, compensated, moving):
    lost = slice(40, 60)
    result = viewer_trial(400, compensated=compensated, moving=moving, lost=lost)
    result = replace(
        result,
        plates=(replace(result.plates[0], corners=np.full((4, 3), np.nan)), result.plates[1]),
        delay_s=np.nan,
        delay_uncertainty_s=np.nan,
        overridden_segments=("left_foot",),
        findings=FINDINGS,
    )
    write_trial(result, tmp_path / "walk.parquet")
    assert_identical(read_trial(tmp_path / "walk.parquet"), result, lost=2 * LOST)


numbers = st.floats(allow_nan=False, allow_infinity=False)


@given(
    mass=numbers,
    center=arrays(float, 3, elements=numbers),
    onsets=arrays(float, st.integers(0, 4), elements=numbers),
    corners=arrays(float, (4, 3), elements=st.floats(allow_infinity=False)),
    event_s=numbers,
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=8)
def test_numbers_other_than_the_frames_are_read_back_exactly(
    processed, tmp_path_factory, mass, center, onsets, corners, event_s
):
    foot = replace(processed.body.segments["left_foot"], mass=abs(mass), center=center)
    body = replace(processed.body, segments={**processed.body.segments, "left_foot": foot})
    result = replace(
        processed,
        body=body,
        onsets=onsets,
        plates=(Plate(1, np.empty(0), np.empty((0, 6)), np.eye(3), center, corners),),
        uncertainty=None,
        events=(Event(event_s, "foot_strike", "left"),),
    )
    path = tmp_path_factory.getbasetemp() / "numbers.parquet"
    write_trial(result, path)
    back = read_trial(path, frames=False)
    for name in ("body", "onsets", "plates", "events"):
        assert_identical(getattr(back, name), getattr(result, name))


def test_events_are_on_the_frame_nearest_to_them(processed, written):
    frames = pd.read_parquet(written, columns=["time_s", "event"])
    labelled = frames[frames["event"] != ""]
    assert len(labelled) > 8
    for event in processed.events:
        row = frames.iloc[(frames["time_s"] - event.time).abs().argmin()]
        assert f"{event.side} {event.label}" in row["event"]


def test_a_trial_is_read_without_its_frames(written):
    stored = read_trial(written, frames=False)
    assert stored.motion.q.shape == (0, 46)
    whole = read_trial(written)
    for name in {field.name for field in fields(whole)} - OF_FRAMES:
        assert_identical(getattr(stored, name), getattr(whole, name))


def rewrite(source, target, change=lambda text: text, frames=None, version=None):
    """Copy a stored trial with another JSON or version, or fewer frames."""
    table = pq.read_table(source)[:frames]
    texts = [change(table[TRIAL][0].as_py()), *[None] * (len(table) - 1)]
    table = table.set_column(table.column_names.index(TRIAL), TRIAL, [texts])
    known = pq.read_metadata(source).metadata[VERSION]
    target.write_bytes(sealed(table, version or known))


@pytest.mark.parametrize(
    ("before", "after", "version", "reason"),
    [
        ("", "", b'{"version":13}', "written by another version"),
        ('"center":', '"centre":', None, "is damaged: .* validation error"),
    ],
)
def test_a_summary_of_another_format_gives_one_line(
    written, tmp_path, before, after, version, reason
):
    path = tmp_path / "other.parquet"
    rewrite(written, path, lambda text: text.replace(before, after, 1), version=version)
    with pytest.raises(ValueError, match=rf"^other\.parquet:? {reason}.*'hbm run'"):
        read_trial(path, frames=False)


def test_a_recording_is_not_called_a_damaged_result_that_may_be_deleted(moving_study):
    with pytest.raises(ValueError, match=r"sub01_sway\.c3d .*recording.*hr\.read$"):
        read_trial(moving_study / "sub01_sway.c3d")


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_truncated_file_is_not_a_result(written, tmp_path, share):
    whole = written.read_bytes()
    broken = tmp_path / "broken.parquet"
    broken.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match=r"broken\.parquet is damaged: .*'hbm run'"):
        read_trial(broken)


def test_every_flipped_bit_is_found(tmp_path):
    path, broken = tmp_path / "small.parquet", tmp_path / "broken.parquet"
    write_trial(replace(fake_trial(1, "sway", cycles=2), condition="sway", key="a key"), path)
    whole = path.read_bytes()
    seal = whole.rindex(SEAL)
    behind = seal + len(SEAL)
    for place in (*range(0, seal, seal // 60), *range(behind, len(whole), 23)):
        content = bytearray(whole)
        content[place] ^= 1 << place % 8
        broken.write_bytes(content)
        with pytest.raises(ValueError, match=r"^broken\.parquet is damaged: .*'hbm run'"):
            read_trial(broken, frames=False)


@pytest.mark.parametrize("place", range(len(SEAL)))
def test_a_checksum_that_cannot_be_told_is_missed(written, tmp_path, place):
    content, broken = bytearray(written.read_bytes()), tmp_path / "broken.parquet"
    content[content.rindex(SEAL) + place] ^= 1
    broken.write_bytes(content)
    with pytest.raises(ValueError, match=r"^broken\.parquet .*no checksum"):
        read_trial(broken, frames=False)


def test_a_trial_that_lacks_frames_is_damaged(written, tmp_path):
    rewrite(written, tmp_path / "less.parquet", frames=1100)
    with pytest.raises(ValueError, match=r"damaged: .*1100 frames.* 1200"):
        read_trial(tmp_path / "less.parquet", frames=False)


def test_a_write_that_fails_leaves_what_was_there(processed, written, tmp_path, monkeypatch):
    path = tmp_path / "trial.parquet"
    path.write_bytes(written.read_bytes())

    write_table = pq.ParquetWriter.write_table

    def full(file, table):
        write_table(file, table[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pq.ParquetWriter, "write_table", full)
    with pytest.raises(OSError, match="No space left"):
        write_trial(replace(processed, condition="pitch", key="another key"), path)
    assert read_trial(path, frames=False).key == "a key"
    assert [p.name for p in tmp_path.iterdir()] == ["trial.parquet"]
