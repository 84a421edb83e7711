"""A plate on a platform that bends: its wrench from accelerations before and after, too."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.fit import (
    BLOCKS,
    MIN_SAMPLES_PER_GAIN,
    fit_trials,
)
from compensation.inertia.model import InertiaModel, Setup
from compensation.inertia.residual import (
    HELD_OUT_PARTS,
    correlation_of,
    model_error_of,
    recording_weights,
    slow_part,
    zero_of_trials,
)
from compensation.inputs import read_rate, read_table, refuse_unequal
from hbm.spatial import Array

LAGS_S: Final = (0.01, 0.02, 0.04)
"""Of the second differences: short against the periods that pass 20 Hz, up to a tenth of a second
of motion in all. Longer ones hardly leave less in the virtual laboratory, and one accelerometer
then takes slow pitch for fast."""
DIFFERENCE_SD_MPS2: Final = (0.03, 0.03, 0.1)
"""By which a difference must vary before its gain follows the recording, with one accelerometer,
two, and three or more: a tenth and less of what a calibration signal excites. Three that are not in
line show the platform's motion by themselves, and the differences have to account for bending
alone; with fewer they also stand in for rotation that is not shown, but comes with vibration.
Directions that the calibration hardly excites keep the gains of the static model. Judged in
docs/inertia_models.md."""
RCOND: Final = 1e-12
"""Variance of a combination of channels, by that of the largest, below which it is constant: two
sensors on a rigid platform sway alike."""
Trial = tuple[ArrayLike, ArrayLike]


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
        difference = np.zeros_like(a)  # in memory as the readings are
        if 2 * step < len(a):
            within = a[2 * step :] - 2 * a[step:-step] + a[: -2 * step]
            difference[step:-step] = np.nan_to_num(within, posinf=np.nan, neginf=np.nan)
        difference[np.isnan(a)] = np.nan
        channels.append(difference)
    return np.hstack(channels)


def fit_dynamic(
    trials: Sequence[Trial],
    setup: Setup,
    lags_s: Sequence[float] = LAGS_S,
    zero_sd: ArrayLike | None = None,
) -> InertiaModel:
    """Fit the wrench of a moving, empty plate to accelerations at, before and after each instant.

    Parameters
    ----------
    trials
        Of each recording the readings and differences, as `dynamic_channels` gives them,
        (N, k (1 + lags)) [m/s²], and the wrench (N, 6) [N, N·m] as for `fit_trials`.
    setup
        How all were recorded.
    lags_s
        Lags of the differences [s].
    zero_sd
        As for `fit_trials`.

    Returns
    -------
    InertiaModel
        With `lags_s`; all else as `fit_trials` gives it.

    Raises
    ------
    ValueError
        As `fit_trials`; also where the signals pass a real-time filter, in which nothing is known
        of the instants to come.

    Notes
    -----
    Between accelerometers and load cells the structure bends: a mode of natural frequency ``ω₀``
    that the accelerometers do not follow turns the acceleration ``a`` at the frequency ``ω`` into
    ``a / (1 − ω²/ω₀²)``, a series in even derivatives of ``a``. Second differences over some lags
    stand for these derivatives. Least squares with a penalty on the gains of the differences
    (ridge regression, Hoerl and Kennard 1970), none on those of the readings and the offset.
    All recordings weigh alike, sample by sample.

    It is symmetric in time and shifts nothing: what the accelerometers are late is estimated
    beforehand (`find_sensors`).

    Examples
    --------
    A belt assembly of 150 kg on load cells, whose resonance at 40 Hz the accelerometer does not
    show:

    >>> import numpy as np
    >>> time = np.arange(0, 20, 0.01)
    >>> sway = np.sin(2 * np.pi * (2 + time / 4) * time)
    >>> felt = np.column_stack([0.1 * sway**2, sway, 9.81 + 0.1 * sway**3])
    >>> cells = felt - np.gradient(np.gradient(felt, time, axis=0), time, axis=0) / (80 * np.pi)**2
    >>> wrench = cells @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> setup = Setup(("rear",), rate_hz=100.0, cutoff_hz=20.0)
    >>> dynamic = fit_dynamic([(dynamic_channels(felt, 100.0), wrench)], setup)
    >>> static = fit_trials([(felt, wrench)], setup)
    >>> bool(dynamic.sigma[1] < 0.2 * static.sigma[1])
    True
    """
    read, k = _read(trials), 3 * len(setup.sensors)
    static = fit_trials([(x[:, :k], w) for x, w in read], setup, zero_sd=zero_sd)
    return extend(static, read, lags_s, zero_sd)


def extend(
    static: InertiaModel,
    trials: Sequence[Trial],
    lags_s: Sequence[float] = LAGS_S,
    zero_sd: ArrayLike | None = None,
    beside_weight: float = 1.0,
) -> InertiaModel:
    """Make the dynamic model, as `fit_dynamic`, of recordings with a static one, with a setup."""
    setup = static.setup
    if setup is None:
        raise ValueError("the model does not state how it was recorded; fit it with a setup")
    refuse_real_time(setup)
    k = 3 * len(setup.sensors)
    read = _read(trials)
    count, n = read[0][0].shape[1], sum(len(x) for x, _ in read)
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
    felt_mean, wrench_mean = (np.array([t[side].mean(axis=0) for t in read]) for side in (0, 1))
    design = np.vstack([x - m for (x, _), m in zip(read, felt_mean, strict=True)])
    about = np.vstack([w - m for (_, w), m in zip(read, wrench_mean, strict=True)])
    counts = np.array([len(x) for x, _ in read])
    weight = np.repeat(recording_weights(counts, beside_weight), counts)[:, None]
    inverse = _inverse(design.T @ (weight * design), n, k)
    slopes = inverse @ (design.T @ (weight * about))
    residual, zeros = about - design @ slopes, wrench_mean - felt_mean @ slopes

    one_of_each = np.repeat(n / (len(read) * counts), counts)
    blocks = pairwise(np.linspace(0, n, min(BLOCKS, n) + 1).astype(int))
    with_offset = np.column_stack([weight * design, one_of_each])
    scores = np.stack([with_offset[i:j].T @ residual[i:j] for i, j in blocks])
    scores -= scores.mean(axis=0)
    meat = np.einsum("brc,bsc->crs", scores, scores) * len(scores) / (len(scores) - 1)
    bread = np.zeros((count + 1, count + 1))
    bread[:-1, :-1], bread[-1, -1] = inverse, 1 / n
    bread[-1, :-1] = -felt_mean.mean(axis=0) @ inverse

    ends = np.cumsum(counts)[:-1]
    slow = [part for x in np.split(residual, ends) if (part := slow_part(x, setup)) is not None]
    all_slow = np.vstack(slow) if len(slow) == len(read) else residual
    unseen = left_of_held_out(read, k, beside_weight)
    return InertiaModel(
        gain=np.vstack([slopes, zeros.mean(axis=0)]),
        covariance=bread @ meat @ bread.T,
        sigma=np.sqrt(np.sum(residual**2, axis=0) / (n - count - len(read))),
        rank=static.rank,
        condition=static.condition,
        r_squared=1 - np.sum(residual**2, axis=0) / np.sum(about**2, axis=0),
        rms_measured=static.rms_measured,
        rms_compensated=np.sqrt(np.mean(residual**2, axis=0)),
        acceleration_mean=static.acceleration_mean,
        acceleration_covariance=static.acceleration_covariance,
        acceleration_low=static.acceleration_low,
        acceleration_high=static.acceleration_high,
        sensor_noise=np.zeros(k),
        samples=n,
        setup=setup,
        correlation=correlation_of(all_slow),
        rms_slow=np.sqrt(np.mean(all_slow**2, axis=0)),
        model_error=model_error_of(
            [x[:, :k] for x, _ in read],
            unseen,
            setup,
            zero_of_trials(zeros, zero_sd),
            () if static.model_error is None else static.model_error.belts_mps,
        ),
        lags_s=tuple(lags_s),
    )


def left_of_held_out(
    trials: Sequence[Trial], readings: int, beside_weight: float = 1.0
) -> list[Array]:
    """Give what models leave of parts of recordings to which they were not fitted.

    Parameters
    ----------
    trials
        Of each recording the channels (N, K) [m/s²], readings first, then differences if any, and
        the wrench (N, 6) [N, N·m].
    readings
        How many of the channels are readings, whose gains have no penalty.
    beside_weight
        As for `fit_trials`.

    Returns
    -------
    list of Array
        Of each recording, about its own zero, (N, 6) [N, N·m]. Each is cut into ten parts, and each
        part is compensated by a model fitted to all others.

    Raises
    ------
    ValueError
        Wrong shapes, no samples, or gaps.

    Examples
    --------
    >>> felt = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = felt @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> bool(np.abs(left_of_held_out([(felt, wrench)], 3)).max() < 1e-6)
    True
    """
    read = _read(trials)
    about = [(x - x.mean(axis=0), w - w.mean(axis=0)) for x, w in read]
    counts = [len(x) for x, _ in about]
    weights, count = recording_weights(counts, beside_weight), sum(counts)
    gram = np.sum([q * x.T @ x for q, (x, _) in zip(weights, about, strict=True)], axis=0)
    cross = np.sum([q * x.T @ w for q, (x, w) in zip(weights, about, strict=True)], axis=0)
    found = []
    for q, (x, w) in zip(weights, about, strict=True):
        left = []
        for a, b in zip(*(np.array_split(side, HELD_OUT_PARTS) for side in (x, w)), strict=True):
            inverse = _inverse(gram - q * a.T @ a, count - q * len(a), readings)
            slopes = inverse @ (cross - q * a.T @ b)
            left.append(b - (slopes.T @ a.T).T)
        found.append(np.concatenate(left))
    return found


def refuse_real_time(setup: Setup) -> None:
    """Raise a ValueError where signals are filtered in real time: differences look ahead."""
    if setup.cutoff_hz is not None and setup.filter_method == "realtime":
        raise ValueError(
            f"a dynamic model needs the accelerations of the next {max(LAGS_S):g} s, which a "
            "real-time filter does not know; use the static model, or filter with zero_phase"
        )


def _read(trials: Sequence[Trial]) -> list[tuple[Array, Array]]:
    if not trials:
        raise ValueError("a fit needs at least one recording")
    read = [(read_table(x, "channels"), read_table(w, "wrench", 6)) for x, w in trials]
    if len({x.shape[1] for x, _ in read}) > 1:
        raise ValueError(f"recordings differ in channels: {[x.shape[1] for x, _ in read]}")
    for x, w in read:
        refuse_unequal(channels=x, wrench=w)
    return read


def _inverse(gram: Array, samples: float, readings: int) -> Array:
    """Invert the normal equations of readings and differences about their means, (K, K)."""
    sensors = min(readings // 3, len(DIFFERENCE_SD_MPS2))
    penalty = np.zeros(len(gram))
    penalty[readings:] = samples * DIFFERENCE_SD_MPS2[sensors - 1] ** 2
    return np.asarray(np.linalg.pinv(gram + np.diag(penalty), RCOND, hermitian=True))
