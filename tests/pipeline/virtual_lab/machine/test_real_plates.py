"""How much people shake the plates, compared with a real treadmill."""

import numpy as np

from hbm.signals.filtering import low_pass
from pipeline.io.c3d.read import read_c3d
from pipeline.virtual_lab.protocol.instrumented_treadmill import make_treadmill, record
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_walk, study_subject

CUTOFF_HZ = 10.0
LOADED_N = 60.0
MIDDLE = slice(120, 260)
SWING = 450
"""Samples after a plate is left: the middle of swing, and its whole."""


def middle_of_swing(plates):
    """SD of forward, sideways and vertical force within the middle of swing, (3,) [N]."""
    squares = []
    for plate in plates:
        force = low_pass(plate.wrench_in_plate[:, :3], 1000.0, CUTOFF_HZ, "zero_phase")
        loaded = np.abs(force[:, 2]) > LOADED_N
        for i in np.flatnonzero(loaded[:-1] & ~loaded[1:]):
            if i + SWING < len(force) and not loaded[i + 5 : i + 380].any():
                squares.append(force[i + MIDDLE.start : i + MIDDLE.stop].var(axis=0))
    assert len(squares) > 10
    return np.sqrt(np.mean(squares, axis=0))


def test_people_shake_the_empty_plate_about_as_much_as_that_of_a_real_treadmill(shared_data):
    real = read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")
    setting = Setting(protocol=Protocol(baseline_s=12.0))
    treadmill = make_treadmill(setting.faults, setting.seed)
    walk, motion = run_walk(setting, treadmill.machine, study_subject(setting, 0), 0, "baseline")
    ours = record(treadmill, motion, walk, "x.c3d", np.random.default_rng(0))
    _, sideways, vertical = middle_of_swing(ours.plates) / middle_of_swing(real.plates)
    assert 1 < sideways < 3  # a machine that moves is softer
    assert 1 / 3 < vertical < 3
