"""A hammer that strikes a plate: how it falls, how long it touches, and how it comes back."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.virtual_lab.machine.instruments.sampling import ANALOG_HZ

HEAD_KG: Final = 0.5
"""Mass of the hammer's head; assumed."""
STEPS_HZ: Final = 20_000.0
"""Rate of the integration: 20 steps in the shortest contact."""
FREE_S: Final = 0.2
"""How long the head moves freely after a blow, until the hand lifts it again."""
LIFT_S: Final = 0.4
"""How long the hand lifts it; less than there is between blows."""

BLOWS: Final = 15
BLOW_INTERVAL_S: Final = 2.0
BLOW_SPREAD_S: Final = 0.3
HAMMER_S: Final = 33.0
"""Blows with the hammer on a belt (the thesis' number), mean time between them, how far the time of
a blow is from that, and duration of the recording; assumed."""


@dataclass(frozen=True, slots=True)
class Blows:
    """Blows with a hammer, each in its own time, 0 where the head first touches.

    Attributes
    ----------
    contact_s
        How long the first contact lasts, (n,) [s]; its force is nearly half a sine.
    speed_mps
        With which the head arrives, (n,) [m/s].
    restitution
        About the share of that speed with which it leaves, (n,) [1].
    swing_mps2
        Acceleration before a blow, by hand and gravity, (n,), negative: down.
    hand_mps2
        Acceleration by the hand after a blow, (n,), beside gravity's: where it presses down, the
        head bounces.
    """

    contact_s: Array
    speed_mps: Array
    restitution: Array
    swing_mps2: Array
    hand_mps2: Array

    @classmethod
    def draw(
        cls, count: int, shortest_s: float, longest_s: float, rng: np.random.Generator
    ) -> "Blows":
        """Draw blows as a person strikes them; the ranges are assumed."""
        return cls(
            rng.uniform(shortest_s, longest_s, count),
            rng.uniform(1.0, 2.5, count),
            rng.uniform(0.2, 0.7, count),
            rng.uniform(-25.0, -8.0, count),
            rng.uniform(-10.0, 15.0, count),
        )


def strike(blows: Blows) -> tuple[Array, Array, Array]:
    """Integrate the equation of motion of the head from rest in the hand to rest in the hand.

    Parameters
    ----------
    blows
        The blows.

    Returns
    -------
    time
        (S,) [s], 0 at the first contact.
    height
        Of the head above the plate, (S, n) [m].
    force
        On the plate, upwards on the head, (S, n) [N].

    Notes
    -----
    Contact after Hunt and Crossley (1975): a spring whose half period is the duration of the
    contact, with damping in proportion to its compression, so that the force begins and ends at
    zero; it never pulls. The hand holds the head, swings it down at constant acceleration, leaves
    it nearly alone for 0.2 s and lifts it.
    """
    stiffness = HEAD_KG * (np.pi / blows.contact_s) ** 2
    damping = 1.5 * (1 - blows.restitution) / blows.speed_mps * stiffness
    step, begins = 1 / STEPS_HZ, blows.speed_mps / -blows.swing_mps2
    held = blows.speed_mps * begins / 2
    time = np.arange(-np.ceil(begins.max() / step), (FREE_S + LIFT_S) / step) * step
    height, force = np.empty((2, len(time), len(held)))
    z, speed = held.copy(), np.zeros(len(held))
    for k, t in enumerate(time):
        pressed = np.minimum(z, 0.0)
        push = np.maximum(-stiffness * pressed + damping * pressed * speed, 0.0)
        free = blows.hand_mps2 - GRAVITY_MPS2 if t >= 0 else blows.swing_mps2 * (t >= -begins)
        lifted = np.clip((t - FREE_S) / LIFT_S, 0, 1)
        height[k], force[k] = z + (held - z) * lifted**2 * (3 - 2 * lifted), push
        speed += step * (free + push / HEAD_KG)
        z += step * speed
    return time, height, np.where(time[:, None] < FREE_S, force, 0.0)


def strike_belt(
    shortest_s: float, longest_s: float, delay_s: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Strike a belt fifteen times, and hold the hammer above it in between.

    Parameters
    ----------
    shortest_s, longest_s
        Of the contacts [s].
    delay_s
        By how much the plate is later than the cameras [s].
    rng
        Source of the blows and their times.

    Returns
    -------
    height
        Of the head above the plate as cameras time it, at 1000 Hz, (N,) [m].
    force
        On the plate as the plate times it, at 1000 Hz, (N,) [N].
    """
    time = np.arange(round(HAMMER_S * ANALOG_HZ)) / ANALOG_HZ
    spread = rng.uniform(-BLOW_SPREAD_S, BLOW_SPREAD_S, BLOWS)
    since, height, force = strike(Blows.draw(BLOWS, shortest_s, longest_s, rng))
    head, load = np.full(len(time), np.nan), np.zeros(len(time))
    for k, blow in enumerate(BLOW_INTERVAL_S * np.arange(1, BLOWS + 1) + spread):
        own = np.interp(time - blow, since, height[:, k], left=np.nan, right=np.nan)
        head = np.where(np.isfinite(own), own, head)
        late = time - blow - delay_s
        load += np.interp(late, since, force[:, k], left=0.0, right=0.0)
    held = np.isfinite(head)
    return np.interp(time, time[held], head[held]), load
