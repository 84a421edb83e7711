"""A person on the platform beside the empty plate, whom it carries: walking, running, stepping.

Simple load patterns, without a body: the thesis' validation trials of the calibration ranking.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.signal import butter, sosfiltfilt

from hbm.spatial import GRAVITY_MPS2, Array

LoadPattern = Callable[[Array, np.random.Generator], Array]
"""Gives the load of a person at times (N,) [s], (N, 6) [N, N·m]."""
MASS_KG: Final = 75.0
"""Of the person; the mean of the thesis' subjects, rounded."""
RIGHT_BELT_M: Final = -0.25
"""Middle of the right belt, sideways."""
BOARDS_M: Final = 0.6
"""How far the boards beside the belts are from the middle; assumed."""

WALKING_STEPS_PER_S: Final = 1.85
WALKING_CONTACT_STEPS: Final = 1.25
RUNNING_STEPS_PER_S: Final = 2.7
RUNNING_CONTACT_STEPS: Final = 0.75
"""Cadence, and contact time per step time, of walking at 1.3 m/s and running at 2.5 m/s: with
double support and with flight; typical values."""
STEP_TIME_SD_S: Final = 0.01
PEAK_SD: Final = 0.05
"""Standard deviations of the start of a step and, as a share, of its force; assumed."""
BRAKING_SHARE: Final = 0.18
LATERAL_SHARE: Final = 0.05
"""Largest fore-aft force by the vertical force's amplitude, and lateral by vertical force;
typical of walking."""
FOOTHOLD_AHEAD_M: Final = 0.3
STANCE_TRAVEL_M: Final = 0.6
STEP_WIDTH_M: Final = 0.16
"""Where the centre of pressure starts ahead of the middle of the plate, how far it travels back
during a contact, and how far left and right feet are apart; assumed."""
MARGIN_S: Final = 1.0
"""There are no steps in the first and the last second of a recording."""

BOARD_BAND_HZ: Final = (0.3, 6.0)
"""Band of the forces of a person who moves about; assumed."""
BOARD_FORCE_SHARE: Final = (0.1, 0.1, 0.3)
"""Standard deviation of the forces (forward, left, up) by body weight; assumed."""
BOARD_CHANGE_S: Final = 15.0
"""Period of walking from one side's board to the other's and back; assumed."""
BOARD_REACH_M: Final = 0.5
BOARD_ASIDE_SD_M: Final = 0.02
"""How far along a board the person goes from its middle (three standard deviations), and standard
deviation of the place across it; assumed."""


def walking(time: Array, rng: np.random.Generator) -> Array:
    """Give the load of a person who walks on the right belt, (N, 6) [N, N·m].

    Action on the platform in neutral, about the lab origin.
    """
    return _steps(time, rng, WALKING_STEPS_PER_S, WALKING_CONTACT_STEPS)


def running(time: Array, rng: np.random.Generator) -> Array:
    """Give the load of a person who runs on the right belt, as `walking`."""
    return _steps(time, rng, RUNNING_STEPS_PER_S, RUNNING_CONTACT_STEPS)


def stepping_on_boards(time: Array, rng: np.random.Generator) -> Array:
    """Give the load of a person who moves about on the boards beside the belts, as `walking`."""
    rate_hz = 1 / (time[1] - time[0])
    band = butter(2, BOARD_BAND_HZ, "band", fs=rate_hz, output="sos")
    drawn = sosfiltfilt(band, rng.normal(size=(len(time), 5)), axis=0)
    drawn /= drawn.std(axis=0)
    weight = MASS_KG * GRAVITY_MPS2
    force = drawn[:, :3] * weight * BOARD_FORCE_SHARE - [0, 0, weight]
    side = BOARDS_M * np.tanh(3 * np.sin(2 * np.pi * time / BOARD_CHANGE_S))
    along, aside = BOARD_REACH_M * drawn[:, 3] / 3, BOARD_ASIDE_SD_M * drawn[:, 4]
    point = np.column_stack([along, side + aside, 0 * time])
    return np.hstack([force, np.cross(point, force)])


def _steps(
    time: Array, rng: np.random.Generator, steps_per_s: float, contact_steps: float
) -> Array:
    """Give half sines of vertical force that carry the weight on average, (N, 6).

    ``contact_steps`` is contact time by step time.
    """
    weight = MASS_KG * GRAVITY_MPS2
    wrench = np.zeros((len(time), 6))
    starts = np.arange(MARGIN_S, time[-1] - MARGIN_S, 1 / steps_per_s)
    for n, start in enumerate(starts + rng.normal(0, STEP_TIME_SD_S, len(starts))):
        contact_s, side = contact_steps / steps_per_s, (-1) ** n
        rows = slice(*np.searchsorted(time, [start, start + contact_s]))
        phase = (time[rows] - start) / contact_s
        amplitude = weight * np.pi / 2 / contact_steps * (1 + PEAK_SD * rng.normal())
        vertical = amplitude * np.sin(np.pi * phase)
        forward = -BRAKING_SHARE * vertical * np.cos(np.pi * phase)
        lateral = LATERAL_SHARE * side * vertical
        force = -np.column_stack([forward, lateral, vertical])
        place = [
            FOOTHOLD_AHEAD_M - STANCE_TRAVEL_M * phase,
            RIGHT_BELT_M + STEP_WIDTH_M / 2 * side + 0 * phase,
            0 * phase,
        ]
        point = np.column_stack(place)
        wrench[rows] += np.hstack([force, np.cross(point, force)])
    return wrench
