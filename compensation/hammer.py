"""The delay of a plate behind the cameras, from impacts of a hammer that carries a marker."""

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from compensation.delay import Delay
from compensation.inputs import read_signal, refuse_constant, refuse_unequal
from hbm.numbers import read_numbers
from hbm.spatial import Array

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "hammer")

MARGIN_S: Final = 0.001
"""Between a contact and the marker samples beside it, for the error of the delay so far."""


def hammer_delay(
    marker_time: ArrayLike, marker_height: ArrayLike, force_time: ArrayLike, force: ArrayLike
) -> Delay:
    """Estimate by how much a plate lags the cameras from impacts of a hammer with a marker.

    Parameters
    ----------
    marker_time
        Instants of the marker's samples, (N,) [s].
    marker_height
        Height of the marker on the hammer, (N,) [m].
    force_time
        Instants of the plate's samples, (P,) [s], on the same nominal clock.
    force
        Vertical force of the plate, unfiltered, (P,) [N].

    Returns
    -------
    Delay
        Mean over impacts, positive where the plate is later; its standard error from their
        scatter, and from what is unknown of the hand's push within a contact.

    Raises
    ------
    ValueError
        Wrong shapes, no samples, gaps, times that do not increase, a force at less than 500 Hz,
        fewer than 3 impacts.

    Notes
    -----
    In a contact, the hammer's momentum changes by the impulse of the force. The paths of the marker
    before and after it, extended into it, therefore meet at the centroid in time of that force,
    t* = ∫ t F dt / ∫ F dt, whatever the shape and duration of the contact and however much the
    hammer bounces. The delay is the difference of the two instants. The paths are parabolas through
    60 ms on either side, without samples within a contact; hand and gravity accelerate the hammer
    evenly. When within a contact their acceleration changes from the one to the other is unknown;
    the standard error holds for any instant.

    The force of an impact is summed from where it first leaves the baseline by five standard
    deviations (van de Loosdrecht 2018, II.A.3) until it is quiet for 10 ms. Baseline and deviation
    are the median and 1.4826 times the median absolute deviation. Impacts whose marker shows no
    reversal, or fewer than four samples on a side, and contacts longer than 50 ms do not count.

    Deviations from the original: it takes the marker's lowest sample and the first sample of the
    force. The marker is lowest in the middle of a contact or later, so that a delay by them is too
    small by half of the contact and more.

    Examples
    --------
    Three impacts of 5 ms at 1, 2 and 3 s; the plate is 2 ms late:

    >>> import numpy as np
    >>> marker_time, force_time = np.arange(0, 4, 0.01), np.arange(0, 4, 0.001)
    >>> height = np.min([np.abs(marker_time - t - 0.002) for t in (1, 2, 3)], axis=0)
    >>> force = np.random.default_rng(0).normal(size=len(force_time))
    >>> for t in (1, 2, 3):
    ...     force[1000 * t + 2 : 1000 * t + 7] += 800.0
    >>> f"{hammer_delay(marker_time, height, force_time, force).seconds:.4f}"
    '0.0020'
    """
    t_m, height = _read_timed(marker_time, marker_height, "marker")
    t_f, load = _read_timed(force_time, force, "force")
    if (rate_hz := 1 / float(np.median(np.diff(t_f)))) < LIMITS.least_rate:
        raise ValueError(
            f"a force at {rate_hz:.0f} Hz misses impacts between its samples, expected "
            f"{LIMITS.least_rate:.0f} Hz at least; leave the impacts out, weights that a belt "
            "carries back and forth show the delay too"
        )
    contacts = _contacts(t_f, load)
    turns = [(contact, _sharpest_turn(t_m, height, contact)) for contact in contacts]
    delays = _enough([contact.centroid - turn for contact, turn in turns if turn is not None])
    gaps_s: list[float] = []
    # each time with the delay of the time before, to tell which samples are in contact
    for _ in range(4):
        delay = float(np.median(delays))
        impacts = (_impact(t_m, height, contact, delay) for contact in contacts)
        estimates = [impact for impact in impacts if impact is not None]
        delays, gaps_s = _enough([x for x, _ in estimates]), [x for _, x in estimates]
    scatter = np.std(delays, ddof=1) / np.sqrt(len(delays))
    error, freedom = float(np.hypot(scatter, np.mean(gaps_s))), len(delays) - 1
    return Delay(float(np.mean(delays)), error, degrees_of_freedom=freedom)


def _enough(delays: list[float]) -> list[float]:
    if len(delays) < LIMITS.least_impacts:
        raise ValueError(
            f"{len(delays)} impacts in both marker and force, expected at least "
            f"{LIMITS.least_impacts}; is the force unfiltered and are both on one clock?"
        )
    return delays


def _read_timed(time: ArrayLike, values: ArrayLike, name: str) -> tuple[Array, Array]:
    t, x = read_signal(time, f"{name} times"), read_signal(values, name)
    refuse_unequal(**{f"{name}_times": t, name: x})
    if not np.all(np.diff(t) > 0):
        raise ValueError(f"{name} times must increase")
    refuse_constant(x[:, None], name, ("its only channel",))
    return t, x


class _Contact(NamedTuple):
    """A contact in the force's time: begin, end, centroid, and when the next contact begins [s]."""

    begin: float
    end: float
    centroid: float
    next: float


def _contacts(time: Array, force: Array) -> list[_Contact]:
    """Find contacts that follow no other one closely."""
    # the hammer is off the plate most of the time: the median is the zero
    load = force - float(np.median(force))
    # SD of normal noise by its median absolute deviation, which impacts do not move
    spread = 1.4826 * float(np.median(np.abs(load)))
    # contacts, apart by silence
    out = np.flatnonzero(np.abs(load) > LIMITS.onset * spread)
    parts = np.split(out, np.flatnonzero(np.diff(time[out], prepend=-np.inf) > LIMITS.quiet))[1:]
    begins = [-np.inf, *(float(time[part[0]]) for part in parts), np.inf]
    contacts = []
    for part, before, begin, after in zip(parts, begins, begins[1:], begins[2:], strict=False):
        # the first sample below the onset on either side belongs to the contact
        rows = slice(max(part[0] - 1, 0), part[-1] + 2)
        end, impulse = float(time[part[-1]]), float(load[rows].sum())
        if begin - before > LIMITS.apart and end - begin < LIMITS.longest and impulse > 0:
            # centre of the impulse: what the marker's velocity changes by, as one instant
            centroid = float(np.sum(time[rows] * load[rows])) / impulse
            contacts.append(_Contact(begin, end, centroid, after))
    return contacts


def _sharpest_turn(time: Array, height: Array, contact: _Contact) -> float | None:
    """Give when the marker turns most sharply upwards near an impact, None where it does not."""
    turn = np.zeros(len(time))
    # second difference over two samples: largest where the marker turns upwards
    turn[2:-2] = height[4:] - 2 * height[2:-2] + height[:-4]
    near = np.flatnonzero(np.abs(time - contact.centroid) <= LIMITS.window)
    if not len(near):
        return None
    sharpest = int(near[np.argmax(turn[near])])
    # a minimum of the height, no mere bend of the path
    around = height[sharpest - 2 : sharpest + 3]
    if len(around) < 5 or not around[0] > around[2] <= around[4]:
        return None
    return float(time[sharpest])


def _impact(
    time: Array, height: Array, contact: _Contact, delay_s: float
) -> tuple[float, float] | None:
    """Give the delay by where the paths before and after a contact meet, and what is unknown of it.

    The latter is the standard error for what is unknown of the hand's acceleration within the
    contact [s]. None where the paths are too short.
    """
    # the contact in the marker's time
    begin, end, middle, next_begin = (t - delay_s for t in contact)
    down = (time < begin - MARGIN_S) & (time >= begin - LIMITS.flight)
    up = (time > end + MARGIN_S) & (time <= min(end + LIMITS.flight, next_begin - MARGIN_S))
    # one sample more than a parabola has coefficients
    if min(np.count_nonzero(down), np.count_nonzero(up)) < 4:
        return None
    # free flight before and after: parabolas, continued into the contact
    fall, rise = (
        Polynomial.fit(time[part] - middle, height[part], 2).convert() for part in (down, up)
    )
    apart = rise - fall
    # velocity and acceleration that the contact changes by
    kink, bend = float(apart.deriv()(0.0)), float(apart.deriv(2)(0.0))
    if kink <= 0:
        return None
    meets = 0.0
    for _ in range(4):
        # Newton's method for where both parabolas are at the same height
        meets -= float(apart(meets) / apart.deriv()(meets))
    # error where accelerations differ: the impulse may lie anywhere in the contact (uniform)
    unknown_s = abs(bend) * (end - begin) ** 2 / 8 / kink / np.sqrt(3)
    return contact.centroid - (middle + meets), float(unknown_s)


class AgreedDelay(NamedTuple):
    """The delay to correct by, what it is from, and whether the other method contradicts it."""

    delay: Delay
    method: Literal["motion", "hammer"]
    disagree: bool = False


def agreed_delay(hammer: Delay | None, motion: Delay | None) -> AgreedDelay | None:
    """Choose between a plate's delay by a hammer and that in motion, and compare them.

    That in motion, of weights that accelerate, is taken where its 95 % interval is within ± 1 ms,
    since it is measured as the plate is used and needs no model of an impact; else the one with the
    narrower interval. They disagree where their intervals do not overlap: one of them is wrong by
    more than it states. None where neither is known.

    Examples
    --------
    >>> found = agreed_delay(hammer=Delay(0.0009, 0.0001), motion=Delay(0.0040, 0.0001))
    >>> found.method, found.disagree
    ('motion', True)
    """
    if motion is None:
        return None if hammer is None else AgreedDelay(hammer, "hammer")
    if hammer is None:
        return AgreedDelay(motion, "motion")
    # two 95 % intervals that do not meet
    apart_s = abs(hammer.seconds - motion.seconds)
    disagree = apart_s > hammer.uncertainty + motion.uncertainty
    if motion.uncertainty <= max(LIMITS.precise, hammer.uncertainty):
        return AgreedDelay(motion, "motion", disagree)
    return AgreedDelay(hammer, "hammer", disagree)
