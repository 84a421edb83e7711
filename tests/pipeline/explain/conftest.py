"""What tests of the causes of residuals share: a trial without faults, and one that moves."""

import numpy as np
import pytest

import pipeline
from pipeline.config.schema import Treadmill
from pipeline.explain.linearise import result_chain
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.study_files import read_study_file


@pytest.fixture(scope="session")
def walk(walker):
    """The recording of the walker and its result."""
    subject = pipeline.Subject(sex="male")
    return walker, pipeline.process_recording(walker, subject, pipeline.Settings())


@pytest.fixture(scope="session")
def chain(walk):
    recording, result = walk
    return result_chain(recording, Laboratory(Treadmill()), result).of_frames(slice(None))


@pytest.fixture(scope="session")
def moving(study, laboratory, processed):
    """Recording, laboratory and result of a trial on a platform that pitches, compensated."""
    recording = read_study_file(study, study.subject("sub01").trials["pitch"][0].file)
    return recording, laboratory, processed


@pytest.fixture
def rng():
    return np.random.default_rng(18)
