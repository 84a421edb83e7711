"""A platform in motion."""

import numpy as np
import pytest

from pipeline.virtual_lab.machine.platform import Machine, move_platform, smooth_step

RATE_HZ = 1000.0


@pytest.fixture
def moving():
    """Give a platform that sways and pitches at different frequencies, and its sampling rate."""
    time = np.arange(8000) / RATE_HZ
    growing = smooth_step(time / 2)
    sway = 0.03 * np.sin(2 * np.pi * 0.7 * time) * growing
    pitch = 0.12 * np.sin(2 * np.pi * 0.4 * time) * growing
    return move_platform(Machine(), sway, pitch, RATE_HZ), RATE_HZ
