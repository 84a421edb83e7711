"""Belt compensation in a study: belt pulses under a walking subject, up to the residuals."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import belt_signals, resample_signal, validation_signals
from pipeline.config.study import read_study
from pipeline.io.recording import Analog
from pipeline.trial.ground.belts import belt_axes
from pipeline.trial.process import process_trial
from pipeline.virtual_lab.machine.belts import belt_moment
from pipeline.virtual_lab.machine.platform import Machine
from tests.pipeline import lab

STUDY = """
[settings]
marker_set = "hbm2"

[treadmill.platform]
markers = ["PF1", "PF2", "PF3", "PF4"]
{belt}
[conditions.even]
[conditions.pulses]
"""
BELT = """
[treadmill.belt]
calibration = "belts.c3d"
speed_channels = ["Belt"]
"""
SUBJECT = """
id = "sub01"
mass_kg = 75.0

[trials.even]
file = "even.c3d"

[trials.pulses]
file = "pulses.c3d"
"""


def with_belts(recording, speed):
    """Accelerate both belts, with or without a subject."""
    time = recording.analog.time
    speed = np.resize(speed, len(time))
    moment = belt_moment(Machine(), np.gradient(speed, 1e-3), 1000.0)
    plates = tuple(
        replace(
            plate,
            wrench_in_plate=plate.wrench_in_plate
            + np.hstack([np.zeros((len(time), 3)), moment[:, None] * belt_axes(plate)[:, 1]]),
        )
        for plate in recording.plates
    )
    channels = recording.analog
    noisy = speed + np.random.default_rng(1).normal(0, 0.005, len(speed))
    analog = Analog(
        time,
        (*channels.names, "Belt"),
        (*channels.units, "m/s"),
        np.column_stack([channels.values, noisy]),
    )
    return replace(recording, plates=plates, analog=analog)


@pytest.fixture(scope="module")
def folder(walker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("belts")
    random, pulses = (
        resample_signal(signal, 1000.0).belt_speed
        for signal in (belt_signals(1, 1.0)[0], validation_signals()[5])
    )
    empty = lab.on_platform(lab.without_people(60.0), lab.still(60.0))
    walking = lab.on_platform(walker, lab.still(12.0), seed=1)
    lab.save(with_belts(empty, random), folder / "belts.c3d")
    lab.save(with_belts(walking, np.full(len(pulses), 1.3)), folder / "even.c3d")
    lab.save(with_belts(walking, pulses), folder / "pulses.c3d")
    (folder / "sub01.toml").write_text(SUBJECT, encoding="utf-8")
    return folder


def residual_my(folder, condition, belt):
    """RMS of My as measured and, where the study states it, compensated [N·m]."""
    (folder / "study.toml").write_text(STUDY.format(belt=belt), encoding="utf-8")
    result = process_trial(read_study(folder), "sub01", condition)
    found = [d for d in (result.measured, result.compensated) if d is not None]
    return [float(np.sqrt(np.mean(d.residual[300:-100, 4] ** 2))) for d in found]


def test_compensation_leaves_a_tenth_of_the_pitch_moment_of_both_belts(folder):
    even, even_compensated = residual_my(folder, "even", BELT)
    pulses, compensated = residual_my(folder, "pulses", BELT)
    assert pulses > 10 * even
    assert compensated**2 - even**2 < (0.1 * pulses) ** 2
    assert even_compensated == pytest.approx(even, rel=0.05)
