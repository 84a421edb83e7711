"""A treadmill whose belts yield on their load cells is calibrated and compensated dynamically.

The rigid laboratory of `tests.pipeline.lab`, whose plates see the assemblies' forces through one
undamped mode of 25 Hz. A person's forces are not on these plates, so that all of it is artefact.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from compensation import to_json
from pipeline.config.schema import Treadmill
from pipeline.trial.ground.calibrations import fit_calibration, read_calibration
from pipeline.trial.ground.laboratory import Laboratory, bind
from pipeline.trial.ground.wrenches import plate_artefacts, plate_loads
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import ground_of

MODE_HZ = 25.0
SENSORS = {"accelerometers": lab.CHANNELS, "platform": {"markers": list(lab.PLATFORM_MARKERS_M)}}
INSIDE = slice(100, -100)
LEFT_N = 0.6
"""Noise of plates and accelerometers after the filter, by which the two models may differ."""


def fast(seconds, seed):
    """Give sway and pitch that reach 8 Hz, and rest at both ends."""
    time, rng = lab.analog_clock(seconds), np.random.default_rng(seed)
    moving = lab.ramp((time - 1.5) / 2) * lab.ramp((seconds - time) / 2)
    hz = rng.uniform(0.3, 8.0, (20, 2))
    waves = np.sin(2 * np.pi * hz * time[:, None, None] + rng.uniform(0, 6, (20, 2))) / hz**1.5
    sway, pitch = (waves.sum(axis=1) * moving[:, None]).T
    return lab.PlatformMotion(time, 0.004 * sway, np.radians(0.5) * pitch)


@cache
def moving(seed, seconds=14.0):
    return lab.on_platform(lab.without_people(seconds), fast(seconds, seed), seed=seed)


def yielding(recording):
    """Let the plates see what they carry through one mode; the ends of a recording are at rest."""
    plates = []
    for plate in recording.plates:
        rest = plate.wrench_in_plate[0]
        spectrum = np.fft.rfft(plate.wrench_in_plate - rest, axis=0)
        hz = np.fft.rfftfreq(len(plate.time), plate.time[1] - plate.time[0])
        seen = np.where(hz < 15, MODE_HZ**2 / (MODE_HZ**2 - np.minimum(hz, 15.0) ** 2), 1.0)
        wrench = np.fft.irfft(spectrum * seen[:, None], len(plate.time), axis=0) + rest
        plates.append(replace(plate, wrench_in_plate=wrench))
    return replace(recording, plates=tuple(plates))


def laboratory(recording, model="auto", check=None):
    treadmill = Treadmill(**SENSORS, inertia_model=model)
    checks = [] if check is None else [check]
    return Laboratory(treadmill, fit_calibration(recording, treadmill, checks=checks))


def left(recording, lab_):
    ground = ground_of(recording, lab_, recording.markers.time, 0.0)
    return [wrench[INSIDE] for wrench in ground.variants["compensated"]]


@pytest.fixture(scope="module")
def calibrated():
    """Laboratories with the calibration of the same yielding treadmill: static and chosen."""
    recording, check = yielding(moving(1)), yielding(moving(3))
    return laboratory(recording, "static", check), laboratory(recording, check=check)


def test_the_dynamic_model_is_chosen_and_leaves_less_of_another_recording(calibrated):
    static, chosen = calibrated
    assert not static.calibration.dynamic
    assert chosen.calibration.dynamic
    other = yielding(moving(2))
    for simple, better in zip(*(left(other, one) for one in calibrated), strict=True):
        assert np.linalg.norm(better[:, :3].std(axis=0)) < 0.5 * np.linalg.norm(
            simple[:, :3].std(axis=0)
        )


def test_on_a_rigid_treadmill_both_models_compensate_alike():
    recording, other = moving(1), moving(2)
    assert not laboratory(recording, check=moving(3)).calibration.dynamic
    by_model = [left(other, laboratory(recording, model)) for model in ("static", "dynamic")]
    for simple, better in zip(*by_model, strict=True):
        assert np.abs((simple - better).std(axis=0)).max() < LEFT_N


def test_files_of_compensated_plates_hold_what_trials_are_computed_with(calibrated):
    """What is subtracted from unfiltered plates is, after the low-pass, what trials subtract."""
    _, chosen = calibrated
    other = yielding(moving(2))
    artefacts, _ = plate_artefacts(bind(other, chosen))
    setup = next(iter(chosen.calibration.plates.values())).setup
    for plate, artefact, wrench in zip(other.plates, artefacts, left(other, chosen), strict=True):
        after = setup.low_pass(plate.wrench_in_plate - artefact, plate.time)
        frames = after[:: len(plate.time) // len(other.markers.time)][INSIDE]
        in_lab = wrench @ np.eye(6)
        assert np.abs(
            np.linalg.norm(frames[:, :3], axis=1) - np.linalg.norm(in_lab[:, :3], axis=1)
        ).mean() < LEFT_N  # fmt: skip
    for load in plate_loads(bind(other, chosen)):
        assert np.abs(load.force[500:-500]).mean() < 5 * LEFT_N


def test_a_stated_model_that_is_not_the_files_is_refused(calibrated, tmp_path):
    for fitted, stated in zip(calibrated, ("dynamic", "static"), strict=True):
        path = tmp_path / f"{stated}.json"
        path.write_text(to_json(fitted.calibration), encoding="utf-8")
        treadmill = Treadmill(**SENSORS, inertia_model=stated)
        with pytest.raises(ValueError, match=f"--model {stated}"):
            read_calibration(path, treadmill)
        assert read_calibration(path, Treadmill(**SENSORS)).in_use
