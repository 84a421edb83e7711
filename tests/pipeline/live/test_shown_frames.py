"""A live view is shown of a frame what it is shown of the same trial from a file."""

from collections import deque
from types import SimpleNamespace

import numpy as np

from pipeline.cli.live_session import take_new
from pipeline.config.schema import Settings, Subject
from pipeline.live.monitor import Monitor
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality
from pipeline.trial.study_files import read_study_file
from tests.pipeline import lab
from tests.pipeline.live.playing import arrivals, chain_of, play
from tests.pipeline.viewer_frames import shown_frames

REALTIME = Settings(filter="realtime")


class View:
    """Keeps what it is shown."""

    def __init__(self):
        self.frames = []
        self.show = self.frames.append


def test_a_view_is_shown_of_live_frames_what_it_is_shown_of_the_trial(study, laboratory):
    walk = lab.cropped(read_study_file(study, "sub01_pitch.c3d"), 0, 800)
    whole = process_recording(walk, Subject(sex="male"), REALTIME, laboratory=laboratory)
    chain = chain_of(whole.body, laboratory, REALTIME, walk)
    frames, view = play(chain, arrivals(walk)), View()
    session = SimpleNamespace(samples=deque(), frames=deque((frame, 1e-3) for frame in frames))
    take_new(session, Monitor(chain, walk.plates), view)
    assert len(view.frames) == len(frames)
    compared = 0
    for live, of_trial, frame in zip(view.frames, shown_frames(whole), frames, strict=True):
        np.testing.assert_array_equal(live.markers, of_trial.markers)
        if frame.quality & (Quality.LATE | Quality.PLATFORM_UNKNOWN):
            continue
        compared += 1
        np.testing.assert_allclose(live.q, of_trial.q, atol=1e-9)
        for ours, theirs in zip(live.platform, of_trial.platform, strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-9)
        for name, residual in live.residual.items():
            np.testing.assert_allclose(residual, of_trial.residual[name], atol=1e-4)
            np.testing.assert_allclose(live.ground[name], of_trial.ground[name], atol=1e-4)
    assert compared > 0.8 * len(frames)
