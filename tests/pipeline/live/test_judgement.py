"""What a session uses of streams with losses is what the trial of its recording uses."""

from contextlib import closing

import numpy as np
import pytest

from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.io.read import read_recording
from pipeline.live.output import STREAMS, Recorder, describe_stream
from pipeline.live.replay import RecordedSource
from pipeline.live.session import Session
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import reported
from pipeline.trial.study_files import read_study_file
from tests.pipeline import lab
from tests.pipeline.live.perturbed import Faults, PerturbedSource
from tests.pipeline.live.playing import body_of, chain_of

PERSON = Subject(sex="male", mass_kg=74.6)
REALTIME = Settings(filter="realtime")
LOST = {
    "one sample in ten": Faults(drop=0.1),
    "cameras for 30 ms": Faults(absent_s={"Markers": (4.0, 4.03)}),
    "all for 30 ms": Faults(absent_s=dict.fromkeys(("Markers", "Plates", "Analog"), (4.0, 4.03))),
    "cameras for 60 ms": Faults(absent_s={"Markers": (4.0, 4.06)}),
    "plates for 60 ms": Faults(absent_s={"Plates": (4.0, 4.06)}),
    "one sample in ten late": Faults(reorder=0.1),
    "one sample in ten twice": Faults(duplicate=0.1),
}


@pytest.fixture(scope="module")
def recorded(walker, study, laboratory):
    """Name -> a walk, its laboratory and the body."""
    moving = read_study_file(study, "sub01_pitch.c3d")
    walks = {"still": (walker, Laboratory(Treadmill())), MOVING: (moving, laboratory)}
    found = {}
    for name, (walk, where) in walks.items():
        trial = lab.cropped(walk, 0, 560)
        body = body_of(trial, PERSON, laboratory=where)
        found[name] = trial, where, body
    return found


MOVING = "pitching, compensated"
CASES = [(MOVING, lost) for lost in LOST]
CASES += [("still", lost) for lost in ("one sample in ten", "all for 30 ms")]


@pytest.mark.parametrize(("walk", "lost"), CASES)
def test_the_same_frames_with_the_same_numbers(recorded, tmp_path, walk, lost):
    trial, where, body = recorded[walk]
    source = PerturbedSource(RecordedSource(trial, chunk_s=0.1), LOST[lost])
    chain = chain_of(body, where, REALTIME, trial, wait_s=1.0)
    described = [describe_stream(each, chain.live, trial.plates) for each in source.streams]
    with closing(Recorder(tmp_path, described, ())) as recorder:
        session = Session(source, chain)
        while not source.ended:
            for samples in source.receive(0.0):
                session._take(samples, samples.time[-1])
                recorder.take(session.samples[-1])
    frames = [frame for frame, _ in session.frames if not frame.quality & Quality.LATE]
    used = {round(100 * frame.time): frame for frame in frames if frame.quality.counts}
    assert np.mean([frame.quality.counts for frame in frames if frame.time > 1.5]) > 0.9
    for method in ("realtime", "zero_phase"):
        read = read_recording(tmp_path / STREAMS)
        settings = Settings(filter=method)
        whole = process_recording(read, PERSON, settings, static=trial, laboratory=where)
        first = round(100 * (session.frames[0][0].time - read.markers.time[0]))
        last = max(used)
        counted = [k + first for k in np.flatnonzero(whole.counts) if k + first <= last]
        if method == "realtime":
            assert counted == sorted(used)
            best = whole.compensated or whole.measured
            residual = reported(best.residual)[np.array(counted) - first]
            ours = [[*used[k].residual.values()][-1] for k in counted]
            np.testing.assert_allclose(ours, residual, rtol=0, atol=1e-4)
        else:
            assert len(counted) > 0.95 * len(used)
