"""Simulated belts, processed as recordings of a real one, resemble it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from compensation.belts import BeltModel, belt_acceleration, fit_belt
from hbm.signals.filtering import low_pass
from hbm.spatial import Array
from pipeline.virtual_lab.machine.belts import RotatingLine, identified_drive
from tests.virtual_machine.belt_features import features, segments
from tests.virtual_machine.belt_recording import (
    COMMAND_SD_MPS2,
    RATE_HZ,
    BeltRecording,
    read_recording,
    simulate_recording,
)
from tests.virtual_machine.roller import Roller, fit_roller

CUTOFF_HZ = 6.0
EDGE = 200


class Processed(NamedTuple):
    """The published processing of a recording."""

    model: BeltModel
    r_squared: float
    left: float
    spectrum: Array
    roller: Roller
    left_without_roller: float


def process(recording: BeltRecording) -> Processed:
    acceleration = belt_acceleration(recording.speed, RATE_HZ, CUTOFF_HZ, "realtime")
    moment = low_pass(recording.moment, RATE_HZ, CUTOFF_HZ, "realtime")
    model = fit_belt(acceleration, moment)
    left = moment - model.predict(acceleration)
    roller = fit_roller(left, recording.speed, RATE_HZ, CUTOFF_HZ)
    without = left - roller.predict(recording.speed, RATE_HZ)
    inner = slice(EDGE, -EDGE)
    power = np.abs(np.fft.rfft(left[inner] - left[inner].mean())) ** 2
    hz = np.fft.rfftfreq(len(left[inner]), 1 / RATE_HZ)
    bands = [power[(hz >= low) & (hz < low + 1)].sum() for low in range(10)]
    return Processed(
        model,
        float(1 - np.var(left[inner]) / np.var(moment[inner])),
        float(np.std(left[inner])),
        np.sqrt(bands) / len(left[inner]),
        roller,
        float(np.std(without[inner])),
    )


@pytest.fixture(scope="module")
def recorded(shared_data):
    return [read_recording(shared_data / "belt_acceleration", number) for number in (1, 2)]


@pytest.fixture(scope="module")
def real(recorded):
    return [process(recording) for recording in recorded]


@pytest.fixture(scope="module")
def simulated():
    drive = identified_drive()
    return [process(simulate_recording(drive, COMMAND_SD_MPS2, seed)) for seed in range(11, 19)]


@pytest.fixture(scope="module")
def alike(real):
    """Simulated recordings whose rollers are as far out of balance as those of the real ones."""
    drive = replace(identified_drive(), unbalance_kg_per_m=0.0)
    return [
        process(
            simulate_recording(
                replace(
                    drive,
                    lines=(*drive.lines, RotatingLine(r.roller.turns_per_m, r.roller.amplitude)),
                ),
                COMMAND_SD_MPS2,
                seed,
            )
        )
        for seed, r in enumerate(real, start=31)
    ]


@pytest.mark.slow
def test_real_left_over_moments_and_r_squared_lie_within_those_of_simulated_belts(real, simulated):
    for name in ("r_squared", "left"):
        values = [getattr(s, name) for s in simulated]
        for r in real:
            assert min(values) < getattr(r, name) < max(values), name


@pytest.mark.slow
def test_with_equal_rollers_simulated_belts_leave_as_much_and_in_the_same_bands(real, alike):
    for r, s in zip(real, alike, strict=True):
        assert s.left == pytest.approx(r.left, rel=0.1)
        assert s.r_squared == pytest.approx(r.r_squared, abs=0.006)
        np.testing.assert_allclose(s.spectrum, r.spectrum, rtol=0.25)
        assert s.left_without_roller == pytest.approx(r.left_without_roller, rel=0.12)


@pytest.mark.slow
def test_the_same_roller_is_found_in_all(real, simulated):
    for each in (*real, *simulated):
        if each.roller.amplitude > 0.2:
            assert each.roller.turns_per_m == pytest.approx(1.5828, abs=0.003)
    assert min(s.roller.amplitude for s in simulated) < min(r.roller.amplitude for r in real)
    assert max(s.roller.amplitude for s in simulated) > max(r.roller.amplitude for r in real)


@pytest.mark.slow
def test_models_fitted_to_simulated_belts_predict_the_real_moment_as_well_as_its_own(
    recorded, real, simulated
):
    """Coefficients differ between recordings of one belt; what they predict does not."""
    recording, own = recorded[1], real[1]
    acceleration = belt_acceleration(recording.speed, RATE_HZ, CUTOFF_HZ, "realtime")
    moment = low_pass(recording.moment, RATE_HZ, CUTOFF_HZ, "realtime")
    for s in simulated:
        left = np.std((moment - s.model.predict(acceleration))[EDGE:-EDGE])
        assert left < 1.06 * own.left


@pytest.mark.slow
def test_moment_follows_acceleration_as_in_the_recording_that_was_not_fitted(recorded):
    drive = identified_drive()
    other = features(*segments(recorded[1]))
    own = features(*segments(simulate_recording(drive, COMMAND_SD_MPS2, 41)))
    below_10_hz = slice(0, 9)
    np.testing.assert_allclose(own.gain[below_10_hz], other.gain[below_10_hz], atol=0.06)
    np.testing.assert_allclose(own.phase[below_10_hz], other.phase[below_10_hz], atol=0.12)
    np.testing.assert_allclose(own.moment[below_10_hz], other.moment[below_10_hz], atol=0.3)
