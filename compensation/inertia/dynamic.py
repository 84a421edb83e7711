"""A plate on a platform that bends: its wrench from accelerations before and after, too."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.fit import BLOCKS, MIN_SAMPLES_PER_GAIN, fit_inertia, residual_correlation
from compensation.inertia.model import SLOW_HZ, InertiaModel, Setup
from compensation.inputs import read_rate, read_table, refuse_unequal
from hbm.signals.filtering import low_pass
from hbm.spatial import Array

LAGS_S: Final = (0.01, 0.02, 0.04)
"""Of the second differences: short against the periods that pass 20 Hz, up to a tenth of a second
of motion in all. Longer ones hardly leave less in the virtual laboratory, and one accelerometer
then takes slow pitch for fast."""
DIFFERENCE_SD_MPS2: Final = 0.1
"""By which a difference must vary before its gain follows the recording: a tenth of what a
calibration signal excites, ten times the noise of an accelerometer after the filter. Directions
that the calibration hardly excites keep the gains of the static model."""

PARTS: Final = 6
"""Of a calibration recording, each judged by a fit to the others: ten seconds in a minute."""
RCOND: Final = 1e-12
"""Variance of a combination of channels, by that of the largest, below which it is constant: two
sensors on a rigid platform sway alike."""


def dynamic_channels(
    accelerations: ArrayLike, rate_hz: float, lags_s: Sequence[float] = LAGS_S
) -> Array:
    """Give the readings and their second differences, of which a dynamic model is a function.

    Parameters
    ----------
    accelerations
        Readings of the accelerometers, (N, k) [m/s²], equal steps. Gaps (NaN) stay gaps.
    rate_hz
        Their sampling rate [Hz].
    lags_s
        Lags of the differences; whole samples are taken, at least one [s].

    Returns
    -------
    Array
        The readings ``a(t)``, then for every lag ``l`` the difference
        ``a(t + l) − 2 a(t) + a(t − l)``, (N, k (1 + lags)) [m/s²]; 0 where a gap or the end of the
        recording is nearer than the lag.

    Raises
    ------
    ValueError
        Wrong shape, or a rate that is not positive.

    Notes
    -----
    The differences vanish for whatever is constant or changes evenly, as gravity under slow tilt:
    that is left to the gains of the readings.

    Examples
    --------
    >>> dynamic_channels([[0.0], [1.0], [4.0], [9.0]], 100.0, [0.01]).T
    array([[0., 1., 4., 9.],
           [0., 2., 2., 0.]])
    """
    a, rate = np.asarray(accelerations, float), read_rate(rate_hz)
    if a.ndim != 2:
        raise ValueError(f"accelerations must have shape (samples, channels), got {a.shape}")
    channels = [a]
    for lag_s in lags_s:
        step = max(round(lag_s * rate), 1)
        difference = np.zeros(a.shape)
        if 2 * step < len(a):
            within = a[2 * step :] - 2 * a[step:-step] + a[: -2 * step]
            difference[step:-step] = np.nan_to_num(within, posinf=np.nan, neginf=np.nan)
        difference[np.isnan(a)] = np.nan
        channels.append(difference)
    return np.hstack(channels)


def fit_dynamic(
    channels: ArrayLike, wrench: ArrayLike, setup: Setup, lags_s: Sequence[float] = LAGS_S
) -> InertiaModel:
    """Fit the wrench of a moving, empty plate to accelerations at, before and after each instant.

    Parameters
    ----------
    channels
        Readings and differences, as `dynamic_channels` gives them, (N, k (1 + lags)) [m/s²].
    wrench
        Wrench measured by the empty plate at the same instants, equally filtered, in the moving
        plate frame about its origin, (N, 6) [N, N·m].
    setup
        How both were recorded.
    lags_s
        Lags of the differences [s].

    Returns
    -------
    InertiaModel
        With `lags_s`; all else as `fit_inertia` gives it.

    Raises
    ------
    ValueError
        As `fit_inertia`; also where the signals pass a real-time filter, in which nothing is known
        of the instants to come.

    Notes
    -----
    Between accelerometers and load cells the structure bends: a mode of natural frequency ``ω₀``
    that the accelerometers do not follow turns the acceleration ``a`` at the frequency ``ω`` into
    ``a / (1 − ω²/ω₀²)``, a series in even derivatives of ``a``. Second differences over some lags
    stand for these derivatives. Least squares with a penalty on the gains of the differences
    (ridge regression, Hoerl and Kennard 1970), none on those of the readings and the offset.

    It is symmetric in time and shifts nothing: what the accelerometers are late is estimated
    beforehand (`find_sensors`).

    Examples
    --------
    A belt assembly of 150 kg on load cells, whose resonance at 40 Hz the accelerometer does not
    show, in motion of 8 Hz:

    >>> import numpy as np
    >>> time = np.arange(0, 20, 0.01)
    >>> sway = np.sin(2 * np.pi * (2 + time / 4) * time)
    >>> felt = np.column_stack([0.1 * sway**2, sway, 9.81 + 0.1 * sway**3])
    >>> cells = felt - np.gradient(np.gradient(felt, time, axis=0), time, axis=0) / (80 * np.pi)**2
    >>> wrench = cells @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> setup = Setup(("rear",), rate_hz=100.0, cutoff_hz=20.0)
    >>> channels = dynamic_channels(felt, 100.0)
    >>> dynamic, static = fit_dynamic(channels, wrench, setup), fit_inertia(felt, wrench, setup)
    >>> bool(dynamic.sigma[1] < 0.2 * static.sigma[1])
    True
    """
    x, w = read_table(channels, "channels"), read_table(wrench, "wrench", 6)
    refuse_unequal(channels=x, wrench=w)
    refuse_real_time(setup)
    (n, count), k = x.shape, 3 * len(setup.sensors)
    if count != k * (1 + len(lags_s)):
        raise ValueError(
            f"channels: {count}, expected {k * (1 + len(lags_s))}: the readings of "
            f"{len(setup.sensors)} accelerometers and their differences over {len(lags_s)} lags"
        )
    if n < MIN_SAMPLES_PER_GAIN * (count + 1):
        raise ValueError(
            f"{n} samples are too few to fit {count + 1} gains per component; "
            f"give at least {MIN_SAMPLES_PER_GAIN * (count + 1)}, better a minute of motion"
        )
    static = fit_inertia(x[:, :k], w, setup)
    mean = x.mean(axis=0)
    design = np.column_stack([x - mean, np.ones(n)])
    inverse = _inverse(design.T @ design, n, k)
    slopes = inverse @ (design.T @ w)
    residual = w - design @ slopes
    about_zero = np.eye(count + 1)
    about_zero[-1, :-1] = -mean
    gain, bread = about_zero @ slopes, about_zero @ inverse

    blocks = pairwise(np.linspace(0, n, min(BLOCKS, n) + 1).astype(int))
    scores = np.stack([design[i:j].T @ residual[i:j] for i, j in blocks])
    scores -= scores.mean(axis=0)
    meat = np.einsum("brc,bsc->crs", scores, scores) * len(scores) / (len(scores) - 1)
    known_rate = n >= setup.rate_hz >= 4 * SLOW_HZ
    slow = low_pass(residual, setup.rate_hz, SLOW_HZ, "zero_phase") if known_rate else residual
    return InertiaModel(
        gain=gain,
        covariance=bread @ meat @ bread.T,
        sigma=np.sqrt(np.sum(residual**2, axis=0) / (n - count - 1)),
        rank=static.rank,
        condition=static.condition,
        r_squared=1 - np.var(residual, axis=0) / np.var(w, axis=0),
        rms_measured=static.rms_measured,
        rms_compensated=np.sqrt(np.mean(residual**2, axis=0)),
        acceleration_mean=static.acceleration_mean,
        acceleration_covariance=static.acceleration_covariance,
        acceleration_low=static.acceleration_low,
        acceleration_high=static.acceleration_high,
        sensor_noise=static.sensor_noise,
        samples=n,
        setup=setup,
        correlation=residual_correlation(residual, setup),
        rms_slow=np.sqrt(np.mean(slow**2, axis=0)),
        lags_s=tuple(lags_s),
    )


def left_of_held_out(channels: ArrayLike, wrench: ArrayLike, readings: int) -> Array:
    """Give what models leave of parts of a recording to which they were not fitted.

    Parameters
    ----------
    channels
        Readings first, then differences if any, (N, K) [m/s²].
    wrench
        Wrench of the empty plate at the same instants, (N, 6) [N, N·m].
    readings
        How many of the channels are readings, whose gains have no penalty.

    Returns
    -------
    Array
        The recording is cut into six parts, and each is compensated by a model fitted to the other
        five, (N, 6) [N, N·m].

    Raises
    ------
    ValueError
        Wrong shapes, no samples, or gaps.

    Examples
    --------
    >>> felt = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = felt @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> bool(np.abs(left_of_held_out(felt, wrench, 3)).max() < 1e-6)
    True
    """
    x, w = read_table(channels, "channels"), read_table(wrench, "wrench", 6)
    refuse_unequal(channels=x, wrench=w)
    design = np.column_stack([x - x.mean(axis=0), np.ones(len(x))])
    parts = np.array_split(design, PARTS), np.array_split(w, PARTS)
    grams = np.stack([a.T @ a for a in parts[0]])
    crosses = np.stack([a.T @ b for a, b in zip(*parts, strict=True)])
    left = []
    for a, b, gram, cross in zip(*parts, grams, crosses, strict=True):
        inverse = _inverse(grams.sum(axis=0) - gram, len(x) - len(a), readings)
        left.append(b - a @ (inverse @ (crosses.sum(axis=0) - cross)))
    return np.concatenate(left)


def refuse_real_time(setup: Setup) -> None:
    """Raise a ValueError where signals are filtered in real time: differences look ahead."""
    if setup.cutoff_hz is not None and setup.filter_method == "realtime":
        raise ValueError(
            "a dynamic model needs the accelerations of the next 0.04 s, which a real-time filter "
            "does not know; use the static model, or filter with zero_phase"
        )


def _inverse(gram: Array, samples: int, readings: int) -> Array:
    """Invert the normal equations of readings, differences and a constant, the last, (K + 1)²."""
    penalty = np.zeros(len(gram))
    penalty[readings:-1] = samples * DIFFERENCE_SD_MPS2**2
    return np.asarray(np.linalg.pinv(gram + np.diag(penalty), RCOND, hermitian=True))
