"""What the accelerometers felt at the plates' samples."""

import numpy as np

from pipeline.config.schema import Treadmill
from pipeline.trial.ground.accelerometers import at_plate_times, at_times_of_plates

CLOCK = np.arange(400) / 1000
READINGS = np.random.default_rng(0).normal(size=(400, 3))
TREADMILL = Treadmill(accelerometers={"rear": ("x", "y", "z")})


def test_plates_sampled_at_the_same_times_share_what_was_felt():
    times = [CLOCK + 0.002, CLOCK + 0.0053, CLOCK + 0.002]
    felt = at_times_of_plates(CLOCK, READINGS, times, TREADMILL)
    assert felt[2] is felt[0]
    for one, time in zip(felt, times, strict=True):
        np.testing.assert_array_equal(one, at_plate_times(CLOCK, READINGS, time, TREADMILL))
