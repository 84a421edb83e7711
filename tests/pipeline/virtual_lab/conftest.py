"""Walks that several tests look at."""

from functools import cache

import pytest

from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.machine import Machine
from pipeline.virtual_lab.protocol.bench import make_bench
from pipeline.virtual_lab.protocol.experiment import run_trial, run_walk, walker_of
from pipeline.virtual_lab.protocol.protocol import Protocol, Setting

SHORT = Protocol(
    baseline_s=20.0, pitch_s=24.0, waits_s=(12.0, 12.0), calibration="square_sway_60s_3mps"
)


@cache
def _walk(subject, condition, usual_body):
    faults = Faults() if usual_body else Faults.none()
    waits = (12.0,) * (2 if subject == 0 else 1)
    setting = Setting(protocol=SHORT.model_copy(update={"waits_s": waits}), faults=faults)
    return run_walk(setting, Machine(), walker_of(setting, subject), subject, condition)


@pytest.fixture(scope="session")
def walked():
    """Give a function of subject and condition: what the person and the treadmill did."""
    return lambda subject, condition="baseline", usual_body=True: _walk(
        subject, condition, usual_body
    )


@cache
def _perfect(condition):
    setting = Setting(protocol=SHORT, faults=Faults.none())
    bench = make_bench(setting.faults, setting.seed)
    return run_trial(setting, bench, walker_of(setting, 2), 2, condition), bench


@pytest.fixture(scope="session")
def perfect():
    """Give a function of the condition: a trial in a perfect laboratory, and its bench."""
    return _perfect
