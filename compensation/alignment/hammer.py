"""The delay of a plate behind the cameras, from impacts of a hammer that carries a marker."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.alignment.delay import Delay
from compensation.inputs import read_signal, refuse_constant, refuse_unequal
from hbm.spatial import Array

ONSET_SD: Final = 5.0
"""Standard deviations from the baseline at which the force begins (van de Loosdrecht 2018)."""
SD_PER_MAD: Final = 1.4826
"""Standard deviation of normal noise per median absolute deviation, which impacts do not move."""
MIN_IMPACTS: Final = 3
"""For a standard error from their scatter."""
SAMPLES_OF_A_LINE: Final = 3
"""Marker samples on either side of the lowest: 30 ms at 100 Hz, in which speed hardly changes."""


def hammer_delay(
    marker_time: ArrayLike,
    marker_height: ArrayLike,
    force_time: ArrayLike,
    force: ArrayLike,
    window_s: float = 0.1,
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
    window_s
        The marker's reversal is sought this long before and after the force begins [s].

    Returns
    -------
    Delay
        Mean over impacts, positive where the plate is later; its standard error from their
        scatter.

    Raises
    ------
    ValueError
        Wrong shapes, no samples, gaps, times that do not increase, fewer than 3 impacts.

    Notes
    -----
    The force begins where it first leaves the baseline by five standard deviations (van de
    Loosdrecht 2018, II.A.3): halfway between the last sample within and the first beyond, since
    the force of an impact rises within less than a sample. Baseline and deviation are the median
    and 1.4826 times the median absolute deviation, which impacts do not move. The marker reverses
    where the lines through three samples on its way down and three on its way up meet.

    Deviations from the original: both instants to a fraction of a sample; the original takes the
    lowest and the first sample.

    Examples
    --------
    Three impacts at 1, 2 and 3 s; the plate is 4 ms late:

    >>> import numpy as np
    >>> marker_time, force_time = np.arange(0, 4, 0.01), np.arange(0, 4, 0.001)
    >>> height = np.min([np.abs(marker_time - t) for t in (1, 2, 3)], axis=0)
    >>> force = np.random.default_rng(0).normal(size=len(force_time))
    >>> for t in (1, 2, 3):
    ...     force[1000 * t + 4 : 1000 * t + 9] += 800.0
    >>> f"{hammer_delay(marker_time, height, force_time, force).seconds:.4f}"
    '0.0035'
    """
    t_m, height = _read_timed(marker_time, marker_height, "marker")
    t_f, load = _read_timed(force_time, force, "force")
    found = [
        onset - reversal
        for onset in _onsets(t_f, load, 2 * window_s)
        if (reversal := _reversal(t_m, height, onset, window_s)) is not None
    ]
    if len(found) < MIN_IMPACTS:
        raise ValueError(
            f"{len(found)} impacts found in both marker and force, expected at least "
            f"{MIN_IMPACTS}; is the force unfiltered and are both on one clock?"
        )
    error = float(np.std(found, ddof=1) / np.sqrt(len(found)))
    return Delay(float(np.mean(found)), error, differences=tuple(found))


def _read_timed(time: ArrayLike, values: ArrayLike, name: str) -> tuple[Array, Array]:
    t, x = read_signal(time, f"{name} times"), read_signal(values, name)
    refuse_unequal(**{f"{name}_times": t, name: x})
    if not np.all(np.diff(t) > 0):
        raise ValueError(f"{name} times must increase")
    refuse_constant(x[:, None], name, ("its only channel",))
    return t, x


def _onsets(time: Array, force: Array, quiet_s: float) -> list[float]:
    """Instants at which the force leaves its baseline after it was quiet for a while."""
    baseline = float(np.median(force))
    spread = SD_PER_MAD * float(np.median(np.abs(force - baseline)))
    out = np.flatnonzero(np.abs(force - baseline) > ONSET_SD * spread)
    first = out[np.diff(time[out], prepend=-np.inf) > quiet_s]
    return [float(time[k - 1] + time[k]) / 2 for k in first if k > 0]


def _reversal(time: Array, height: Array, around: float, window_s: float) -> float | None:
    """Instant at which the marker's fall turns into a rise, None where it does not."""
    near = np.flatnonzero(np.abs(time - around) <= window_s)
    if len(near) == 0:
        return None
    lowest, n = int(near[np.argmin(height[near])]), SAMPLES_OF_A_LINE
    if lowest < n + 1 or lowest > len(time) - n - 2:
        return None
    # the lowest sample may lie on either side of the reversal: it belongs to neither line
    down, up = slice(lowest - n, lowest), slice(lowest + 1, lowest + n + 1)
    fall, rise = (
        np.polynomial.Polynomial.fit(time[part] - around, height[part], 1).convert().coef
        for part in (down, up)
    )
    if not fall[1] < 0 <= rise[1]:
        return None
    return around + float((fall[0] - rise[0]) / (rise[1] - fall[1]))
