"""One delay of a plate from two methods: a hammer's impacts, and weights that the belt carries."""

from dataclasses import dataclass
from typing import Final, Literal

from compensation.alignment.delay import Delay

PRECISE_S: Final = 0.001
"""Half of the 95 % interval up to which the delay in motion is taken, however precise the hammer's:
a fifth of what the thesis' plates are late by, and of the default limit of a delay."""


@dataclass(frozen=True, slots=True)
class AgreedDelay:
    """The delay to correct by, the method it is from, and whether another method contradicts it.

    Attributes
    ----------
    delay
        The delay that is used.
    method
        What it is from: "motion" of weights on the belt, or "hammer".
    difference_s
        The hammer's delay less that in motion [s]; NaN where only one is known.
    disagree
        True where the 95 % intervals of both do not overlap: one of them is wrong by more than it
        states.

    Examples
    --------
    >>> found = agreed_delay(hammer=Delay(0.0009, 0.0001), motion=Delay(0.0040, 0.0001))
    >>> found.method, found.disagree, f"{1000 * found.difference_s:.1f} ms"
    ('motion', True, '-3.1 ms')
    """

    delay: Delay
    method: Literal["motion", "hammer"]
    difference_s: float = float("nan")
    disagree: bool = False


def agreed_delay(hammer: Delay | None, motion: Delay | None) -> AgreedDelay | None:
    """Choose between a plate's delay by a hammer and that in motion, and compare them.

    Parameters
    ----------
    hammer
        As `hammer_delay` gives it; None without impacts.
    motion
        From the same plate's wrench under weights that accelerate; None where it is unknown.

    Returns
    -------
    AgreedDelay or None
        That in motion where its 95 % interval is within ± 1 ms, since it is measured as the plate
        is used and needs no model of an impact; else the one with the narrower interval. None
        where neither is known.

    Examples
    --------
    >>> agreed_delay(Delay(0.0041, 0.0001), Delay(0.0050, 0.003)).method
    'hammer'
    """
    if hammer is None or motion is None:
        if motion is not None:
            return AgreedDelay(motion, "motion")
        return AgreedDelay(hammer, "hammer") if hammer is not None else None
    difference = hammer.seconds - motion.seconds
    disagree = abs(difference) > hammer.uncertainty + motion.uncertainty
    if motion.uncertainty <= max(PRECISE_S, hammer.uncertainty):
        return AgreedDelay(motion, "motion", difference, disagree)
    return AgreedDelay(hammer, "hammer", difference, disagree)
