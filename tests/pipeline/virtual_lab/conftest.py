"""Simulated walks that several tests use."""

from functools import cache

import pytest

from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.machine.platform import Machine
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_trial, run_walk, study_subject

SHORT = Protocol(
    baseline_s=20.0, pitch_s=24.0, waits_s=(12.0, 12.0), calibration="square_sway_60s_3mps"
)


@cache
def _walk(subject, condition, varied_body):
    faults = Faults() if varied_body else Faults.none()
    length = {} if subject == 0 else {"baseline_s": 17.0, "waits_s": (12.0,)}
    setting = Setting(protocol=SHORT.model_copy(update=length), faults=faults)
    return run_walk(setting, Machine(), study_subject(setting, subject), subject, condition)


@pytest.fixture(scope="session")
def walked():
    """Give a function of subject and condition: how the person and the treadmill moved."""
    return lambda subject, condition="baseline", varied_body=True: _walk(
        subject, condition, varied_body
    )


@cache
def _perfect(condition):
    setting = Setting(protocol=SHORT, faults=Faults.none())
    treadmill = make_treadmill(setting.faults, setting.seed)
    return run_trial(setting, treadmill, study_subject(setting, 2), 2, condition), treadmill


@pytest.fixture(scope="session")
def perfect():
    """Give a function of condition: a trial in a perfect laboratory, and its treadmill."""
    return _perfect
