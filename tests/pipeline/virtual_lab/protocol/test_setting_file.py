"""Everything of a virtual laboratory can be stated in TOML, and has an effect."""

import pickle

import numpy as np
import pytest

from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.walking_protocol import (
    Protocol,
    Setting,
    read_setting,
    setting_toml,
)
from pipeline.virtual_lab.protocol.walking_trial import record, run_walk, study_subject
from tests.pipeline.virtual_lab.conftest import SHORT

FAULTS = [
    (table, name, value)
    for table, own in Faults().model_dump().items()
    for name, value in own.items()
]
WITH = {f"belts.{name}": {"drive": "motor"} for name in ("roughness", "unbalance_kg_per_m")}
"""What has to be there for a fault to have an effect; of bodies, that it is not the same."""
OTHER_BODY = {"same_body": False}
ELSEWHERE = {"platform.pivot_error_m", "machine.sway_hz"}
"""Faults of the study file and of the motion itself."""
SIZE = {
    "sensors": 4,
    "sway_hz": 5.0,
    "clocks.scale": 100.0,
    "gaps_per_minute": 60.0,
    "platform.delay_s": 0.03,
    "pivot_error_m": 0.05,
    "right_later_s": 0.01,
    "placement_deg": 1.0,
    "placement_forward_m": 0.01,
    "placement_left_m": 0.01,
    "replay_frames": 5,
}


def test_a_setting_is_the_same_after_being_written_and_read():
    for setting in (Setting(), Setting(seed=7, faults=Faults.none(), protocol=SHORT)):
        assert read_setting(setting_toml(setting)) == setting


def test_the_motion_of_a_platform_without_a_pose_counts_nowhere():
    level = Protocol(pose="none", conditions=("baseline", "pitch"))
    assert read_setting(setting_toml(Setting(protocol=level))).protocol == level
    with pytest.raises(ValueError, match=r'pose = "none" .*unknown'):
        Protocol(pose="none")
    assert Protocol(pose="none", sway_window="cycle").sway_window == "cycle"


@pytest.mark.parametrize(("table", "name", "value"), FAULTS)
def test_every_fault_has_an_effect(short_recording, table, name, value):
    """One fault in a perfect laboratory changes the recording or, in a body, the body itself."""
    key = f"{table}.{name}"
    of_body = {} if name == "same_body" else OTHER_BODY
    needed = of_body if table == "body" else WITH.get(key, {})
    other = getattr(Faults.none(), table).model_copy(update=needed)
    without = Faults.none().model_copy(update={table: other})
    changed = other.model_copy(update={name: SIZE.get(key, SIZE.get(name, value))})
    stated = Setting(faults=without.model_copy(update={table: changed}))
    faults = read_setting(setting_toml(stated)).faults
    assert faults != without
    if table == "body":
        bodies = [pickle.dumps(study_subject(Setting(faults=f), 0)) for f in (faults, without)]
        same = bodies[0] == bodies[1]
    else:
        same = short_recording(faults) == short_recording(without)
    assert same is (key in ELSEWHERE)


@pytest.fixture(scope="module")
def short_recording():
    """Give a function of faults: everything that is recorded in a few seconds, as bytes."""
    protocol = Protocol(pitch_s=3.0, standing_s=1.5, starting_s=1.5)
    setting = Setting(protocol=protocol, faults=Faults.none())
    treadmill = make_treadmill(setting.faults, setting.seed)
    walk, motion = run_walk(setting, treadmill.machine, study_subject(setting, 0), 0, "pitch")

    def recorded(faults):
        drawn, rng = make_treadmill(faults, 1), np.random.default_rng(2)
        recording = record(drawn, motion, walk, "x.c3d", rng)
        parts = [recording.markers.position, recording.analog.values]
        parts += [plate.wrench_in_plate for plate in recording.plates]
        return tuple(part.tobytes() for part in parts)

    return recorded


def test_a_fault_that_does_not_exist_is_refused_by_name():
    with pytest.raises(ValueError, match=r"faults\.plates\.cross_talks"):
        read_setting("[faults.plates]\ncross_talks = 1.0")
    with pytest.raises(ValueError, match="not valid TOML"):
        read_setting("[faults.plates\n")
