"""A live view draws what its recording, read back, holds."""

from dataclasses import replace

import numpy as np
import pytest
import rerun.blueprint as rrb

from pipeline.trial.residuals import AXES, reported
from pipeline.viewer.file import recording_file
from pipeline.viewer.live import LiveScene
from pipeline.viewer.live_drawing import LiveDrawing
from pipeline.viewer.trial import write_recording
from tests.pipeline.stored_recording import Stored
from tests.pipeline.viewer_frames import shown_frames
from tests.pipeline.viewer_trial import viewer_trial

FRAMES = 60
VARIANTS = ("measured", "compensated")
LOST = slice(20, 30)


@pytest.fixture(scope="module")
def trial():
    return viewer_trial(FRAMES, lost=LOST)


def scene_of(trial):
    return LiveScene(trial.body, trial.plates, trial.markers.names, VARIANTS, "none", 30.0)


def draw(scene, path, batches):
    """Draw batches of numbered frames into a file."""
    with recording_file(path, "live", "live", rrb.Blueprint(auto_views=False)) as stream:
        drawing = LiveDrawing(stream, scene)
        for batch in batches:
            drawing.show((batch, None))
    return Stored(path)


def cut(frames, sizes):
    numbered, start = list(enumerate(frames)), 0
    for size in sizes:
        yield numbered[start : start + size]
        start += size
    yield numbered[start:]


@pytest.fixture(scope="module")
def frame_by_frame(trial, tmp_path_factory):
    folder = tmp_path_factory.mktemp("live")
    frames = shown_frames(trial)
    return draw(scene_of(trial), folder / "live.rrd", cut(frames, [1] * (FRAMES - 1)))


@pytest.fixture(scope="module")
def recorded(trial, tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "trial.rrd"
    write_recording(trial, path, view_hz=100)
    return Stored(path)


def test_live_view_draws_the_same_scene_as_the_recording_of_the_trial(frame_by_frame, recorded):
    moving = [e for e, timeline in recorded.tables if e.startswith("/lab/") and timeline == "time"]
    assert len(moving) > 20
    for entity in moving:
        for column in recorded.tables[entity, "time"][0].schema.names:
            if ":" not in column:
                continue
            name = column.rpartition(":")[2]
            ours, theirs = (each.rows(entity[1:], name) for each in (frame_by_frame, recorded))
            assert len(ours) == len(theirs) == FRAMES
            for a, b in zip(ours, theirs, strict=True):
                np.testing.assert_allclose(a, b, atol=1e-6, err_msg=f"{entity} {name}")


def test_live_traces_are_the_residuals_of_every_frame_that_counts(frame_by_frame, trial):
    for k, axis in enumerate(AXES):
        drawn = np.array(frame_by_frame.rows(f"residual/{axis}", "scalars"))
        for variant, dynamics in zip(VARIANTS, (trial.measured, trial.compensated), strict=True):
            counts = trial.counts[:, None]
            expected = np.where(counts, reported(dynamics.residual), np.nan)[:, k]
            np.testing.assert_array_equal(drawn[:, VARIANTS.index(variant)], expected)
    assert not trial.counts[LOST].any()


def test_traces_are_broken_where_frames_were_left_out(trial, tmp_path):
    numbered = list(enumerate(shown_frames(trial)))
    batches = [numbered[:5] + numbered[8:10], numbered[15:20]]
    stored = draw(scene_of(trial), tmp_path / "live.rrd", batches)
    fx = np.array(stored.rows("residual/Fx", "scalars"))[:, 0]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(fx)), [5, 8])
    assert np.all(np.diff(stored.times("residual/Fx")) > 0)


def test_a_batch_after_a_pause_is_drawn_at_50_hz_with_its_last_frame(trial, tmp_path):
    stored = draw(scene_of(trial), tmp_path / "live.rrd", cut(shown_frames(trial), []))
    times = stored.times("lab/markers/measured")
    np.testing.assert_allclose(times, trial.motion.time[1::2], atol=1e-9)
    assert len(stored.rows("residual/Fx", "scalars")) == FRAMES


def test_frames_whose_time_does_not_increase_are_not_drawn(trial, tmp_path):
    unknown, *frames = shown_frames(trial)[:7]
    unknown = replace(unknown, time=np.nan)
    frames[3] = replace(frames[3], time=frames[2].time)
    frames[4] = replace(frames[4], time=frames[1].time)
    batches = cut([unknown, unknown, *frames], [1])
    stored = draw(scene_of(trial), tmp_path / "live.rrd", batches)
    expected = [frames[k].time - frames[0].time for k in (0, 1, 2, 5)]
    times = stored.times("residual/Fx")
    breaks = [expected[0], expected[-1]]  # where frames are missing
    np.testing.assert_allclose(times, np.sort([*expected, *breaks]), atol=2e-6)


def test_time_is_shown_since_the_first_frame(trial, tmp_path):
    frames = [replace(frame, time=1e6 + frame.time) for frame in shown_frames(trial)[:4]]
    stored = draw(scene_of(trial), tmp_path / "live.rrd", cut(frames, [1, 1, 1]))
    np.testing.assert_allclose(stored.times("residual/Fx"), [0, 0.01, 0.02, 0.03], atol=1e-8)


def test_a_platform_of_unknown_pose_and_a_frame_that_does_not_count_are_gaps(trial, tmp_path):
    first, second = shown_frames(trial)[:2]
    unknown = replace(first, platform=(np.eye(3), np.full(3, np.nan)), counts=False)
    stored = draw(scene_of(trial), tmp_path / "live.rrd", [[(0, unknown)], [(1, second)]])
    places = np.array(stored.rows("lab/platform", "translation"))[:, 0]
    np.testing.assert_array_equal(np.isnan(places).all(axis=1), [True, False])
    fx = np.array(stored.rows("residual/Fx", "scalars"))[:, 0]
    np.testing.assert_array_equal(np.isnan(fx), [True, False])
