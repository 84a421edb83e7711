"""The setting of a virtual laboratory in TOML: everything can be stated, and has an effect."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.machine.platform import move_platform
from pipeline.virtual_lab.protocol.walking_protocol import (
    Protocol,
    Setting,
    find_setting,
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
WITH = {"belts.roughness": {"drive": "motor"}}
"""What has to be there for a fault to have an effect; of bodies, that it is not the same."""
OTHER_BODY = {"same_body": False}
ELSEWHERE = {"platform.pivot_error_m", "machine.sway_hz"}
"""Faults of the study file and of the motion itself."""
SIZE = {
    "sensors": 4,
    "assembly_kg": 100.0,
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


def test_the_example_of_the_documentation_is_a_setting():
    page = Path(__file__).resolve().parents[4] / "docs" / "ablation.md"
    example = page.read_text(encoding="utf-8").split("```toml\n")[1].split("```")[0]
    setting = read_setting(example)
    assert (setting.seed, setting.protocol.subjects, setting.protocol.pose) == (7, 3, "channels")
    assert setting.faults.accelerometers.sensors == 4
    assert setting.faults.platform.delay_s == 0.03


def test_the_shipped_setting_has_the_faults_that_the_thesis_states_and_no_other():
    found, default = find_setting(Path("thesis")), Setting()
    plates, platform = found.faults.plates, found.faults.platform
    assert plates.delays_s == (0.004, 0.002)
    assert plates.placement_deg == 0.19
    assert sorted(map(abs, (plates.placement_forward_m, plates.placement_left_m))) == [
        0.0015,
        0.0018,
    ]
    assert (platform.delay_s, platform.replay_frames) == (0.03, 2)
    assert (found.protocol.filter, found.protocol.pose) == ("realtime", "channels")
    stated = {"filter", "pose", "delay_s", "right_later_s", "replay_frames"}
    stated |= {"beside_s", "placement_deg", "placement_forward_m", "placement_left_m"}
    lines = [setting_toml(setting).splitlines() for setting in (found, default)]
    changed = {new.split(" = ")[0] for new, old in zip(*lines, strict=True) if new != old}
    assert changed == stated


def test_the_motion_of_a_platform_without_a_pose_counts_nowhere():
    level = Protocol(pose="none", conditions=("baseline", "pitch"))
    assert read_setting(setting_toml(Setting(protocol=level))).protocol == level
    with pytest.raises(ValueError, match=r'pose = "none" leaves the motion .* unknown'):
        Protocol(pose="none")
    assert Protocol(pose="none", sway_window="cycle").sway_window == "cycle"


def test_a_file_is_read_even_where_a_shipped_setting_has_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("thesis").write_text("seed = 5")
    assert find_setting(Path("thesis")) == Setting(seed=5)
    with pytest.raises(FileNotFoundError):
        find_setting(Path("dissertation"))


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


def test_a_slower_actuator_moves_the_platform_later():
    mechanics = Faults.none().machine.model_copy(update={"sway_hz": 3.0})
    slow, fast = (
        make_treadmill(Faults.none().model_copy(update={"machine": m}), 1).machine
        for m in (mechanics, Faults.none().machine)
    )
    command = np.linspace(0, 0.02, 1000)
    moved = [move_platform(m, command, command, 1000.0).sway[0, -1] for m in (slow, fast)]
    assert moved[0] < moved[1]


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
    with pytest.raises(ValueError, match="calibration"):
        read_setting('[protocol]\ncalibration = "random_30s_3mps"')
    with pytest.raises(ValueError, match="not valid TOML: it is nested too deeply"):
        read_setting(f"a = {'[' * 5000}")
