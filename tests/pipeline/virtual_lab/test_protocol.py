"""The thesis' experiment: who does what and when, and a laboratory that is set in TOML."""

from pathlib import Path

import numpy as np
import pytest

from hbm.coordinates import INDEX
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.person.steps import Habits, schedule
from pipeline.virtual_lab.protocol.instrumented_treadmill import (
    PULSE_CHANNEL,
    SENSORS,
    make_treadmill,
    record,
)
from pipeline.virtual_lab.protocol.setting_file import read_setting, setting_toml
from pipeline.virtual_lab.protocol.walking_protocol import (
    ONSET,
    PITCH_PERIOD_S,
    SWAY_M,
    Protocol,
    Setting,
    perturbations,
    sway_command,
)
from pipeline.virtual_lab.protocol.walking_trial import run_walk, study_subject
from tests.pipeline.virtual_lab.conftest import SHORT

THESIS_WAITS_S = (
    *(17, 58, 37, 17, 23, 52, 22, 51, 22, 57),
    *(27, 20, 22, 41, 34, 27, 52, 39, 38, 56),
)
FAULTS = [
    (table, name, value)
    for table, own in Faults().model_dump().items()
    for name, value in own.items()
]
NEEDS = {"gap_s": {"gaps_per_minute": 60.0}, "range_g": {"range_g": 0.5}, "sensors": {"sensors": 4}}
SIZE = {
    "swaps_per_minute": 60.0,
    "gaps_per_minute": 60.0,
    "platform.delay_s": 0.03,
    "pivot_error_m": 0.05,
}


@pytest.fixture(scope="module")
def twenty():
    """Steps of the whole sway trial, and its perturbations."""
    protocol = Protocol()
    steps = schedule(
        Habits(), protocol.speed_mps, 4.0, protocol.duration("sway"), np.random.default_rng(3)
    )
    return steps, *perturbations(protocol, steps, seed=1)


def test_the_twenty_waits_are_those_of_the_thesis(twenty):
    _, onsets, _ = twenty
    assert Protocol().waits_s == THESIS_WAITS_S
    waits = np.diff(onsets, prepend=Protocol().steady_s)
    np.testing.assert_allclose(waits, THESIS_WAITS_S, atol=2.5)
    assert Protocol().duration("sway") == pytest.approx(12 * 60, rel=0.05)
    assert Protocol().duration("sway") * 100 > 65_535


def test_conditions_last_as_long_as_in_the_thesis():
    protocol = Protocol()
    walking = {
        name: protocol.duration(name) - protocol.steady_s
        for name in ("familiarisation", "baseline", "sway", "pitch")
    }
    assert walking == {"familiarisation": 360, "baseline": 120, "sway": 724, "pitch": 120}
    assert protocol.speed_mps == 1.3
    assert protocol.conditions == ("baseline", "sway", "pitch")


def test_half_of_the_perturbations_go_to_either_side(twenty):
    _, _, sides = twenty
    assert sorted(sides) == [-1.0] * 10 + [1.0] * 10


def test_the_platform_leaves_towards_the_other_foot_at_a_tenth_of_the_gait_cycle(twenty):
    steps, onsets, sides = twenty
    for onset, side in zip(onsets, sides, strict=True):
        last = int(np.searchsorted(steps.contact, onset)) - 1
        assert steps.side(last) == ("right" if side > 0 else "left")
        stride = steps.contact[last + 2] - steps.contact[last]
        assert (onset - steps.contact[last]) / stride == pytest.approx(ONSET, abs=0.001)


def test_a_sway_goes_out_fast_and_returns_slowly_before_the_next(twenty):
    _, onsets, sides = twenty
    time = np.arange(0, onsets[-1] + 15, 0.01)
    sway = sway_command(onsets, sides, time)
    speed = np.gradient(sway, time)
    assert np.abs(sway).max() == pytest.approx(SWAY_M)
    assert np.abs(speed).max() == pytest.approx(0.30, rel=0.02)
    since = time[:, None] - onsets
    back = ((since > 1) & (since < 7)).any(axis=1)
    assert np.abs(np.abs(sway[back]) - SWAY_M).max() < 1e-9
    slow = ((since > 7) & (since < 10.5)).any(axis=1)
    assert 0 < np.abs(speed[slow]).max() < 0.04
    assert np.abs(sway_command(onsets, sides, onsets)).max() < 1e-9


def test_pitch_is_a_sine_of_ten_degrees_and_thirty_seconds(walked):
    _, motion = walked(0, "pitch")
    since = motion.time - SHORT.steady_s
    pitch = np.degrees(motion.platform.pitch[0])
    late = since > 3
    lag = 2 / (2 * np.pi * 3.0)
    expected = -10 * np.sin(2 * np.pi * (since[late] - lag) / PITCH_PERIOD_S)
    np.testing.assert_allclose(pitch[late], expected, atol=0.02)


@pytest.mark.parametrize("condition", ["baseline", "sway", "pitch"])
def test_every_trial_starts_in_a_t_pose_on_a_treadmill_at_rest(walked, condition):
    walk, motion = walked(0, condition)
    still = motion.time < 1.0
    q = walk.motion.at(motion.time[still][::10])
    assert np.ptp(q, axis=0).max() < 1e-3
    for side in "RL":
        assert np.degrees(q[:, INDEX[f"{side}ShoulderAbduction"]]).min() > 80
    assert np.abs(motion.belt[still]).max() == 0
    assert np.abs(motion.platform.sway[0][still]).max() == 0
    assert np.abs(motion.platform.pitch[0][still]).max() == 0


def test_a_pulse_marks_the_onset_of_every_perturbation(walked):
    walk, motion = walked(0, "sway")
    recording = record(make_treadmill(Faults(), 1), motion, walk, "x.c3d", np.random.default_rng(0))
    pulse = recording.analog.channel(PULSE_CHANNEL)
    rises = motion.time[1:][(pulse[1:] > 2.5) & (pulse[:-1] < 2.5)]
    np.testing.assert_allclose(rises, motion.onsets, atol=0.001)
    moved = np.abs(motion.platform.sway[0]) > 1e-5
    starts = motion.time[1:][moved[1:] & ~moved[:-1]]
    assert 0 < np.min(starts[:1] - rises[:1]) < 0.02


def test_a_setting_is_the_same_after_being_written_and_read():
    for setting in (Setting(), Setting(seed=7, faults=Faults.none(), protocol=SHORT)):
        assert read_setting(setting_toml(setting)) == setting


def test_the_example_of_the_documentation_is_a_setting():
    page = Path(__file__).resolve().parents[3] / "docs" / "ablation.md"
    example = page.read_text(encoding="utf-8").split("```toml\n")[1].split("```")[0]
    setting = read_setting(example)
    assert (setting.seed, setting.protocol.subjects, setting.protocol.pose) == (7, 3, "channels")
    assert setting.faults.accelerometers.sensors == 4
    assert setting.faults.platform.delay_s == 0.03


def test_all_faults_can_be_switched_off_in_toml():
    off = "\n".join(
        f"[faults.{table}]\n" + "\n".join(f"{k} = {v}" for k, v in own.items())
        for table, own in Faults.none().model_dump().items()
    )
    assert read_setting(off).faults == Faults.none()


@pytest.mark.parametrize(("table", "name", "value"), FAULTS)
def test_every_fault_that_is_set_shows(brief, table, name, value):
    """One fault in a perfect laboratory changes what is recorded; for bodies, who walks."""
    sizes = NEEDS.get(name, {name: SIZE.get(f"{table}.{name}", SIZE.get(name, value))})
    perfect, changed = Faults.none(), dict(getattr(Faults.none(), table)) | sizes
    text = f"[faults.{table}]\n" + "\n".join(f"{k} = {v}" for k, v in changed.items())
    faults = perfect.model_copy(update={table: getattr(read_setting(text).faults, table)})
    assert faults != perfect
    if table == "body":
        with_it, without = (study_subject(Setting(faults=f), 0).body for f in (faults, perfect))
        same = np.array_equal(with_it.geometry, without.geometry) and np.array_equal(
            with_it.inertia_vector, without.inertia_vector
        )
    else:
        same = brief(faults) == brief(perfect)
    assert same is (name == "pivot_error_m")  # that one is in what the laboratory believes


@pytest.fixture(scope="module")
def brief():
    """Give a function of faults: everything that is recorded of a few seconds, as bytes."""
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


def test_accelerometers_are_as_many_as_stated():
    for count in (1, 2, 3, 4):
        accelerometers = Faults().accelerometers.model_copy(update={"sensors": count})
        treadmill = make_treadmill(
            Faults().model_copy(update={"accelerometers": accelerometers}), 1
        )
        assert [sensor.name for sensor in treadmill.sensors] == list(SENSORS[:count])
