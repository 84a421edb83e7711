"""Fit what a moving, empty plate measures to the accelerations of its platform."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.model import InertiaModel, Setup, sensor_names
from compensation.inertia.model_error import (
    correlation_of,
    fit_model_error,
    slow_part,
    zero_of_trials,
)
from compensation.inputs import (
    read_table,
    refuse_constant,
    refuse_other_units,
    refuse_other_wrench_units,
    refuse_still_platform,
    refuse_unequal,
)
from hbm.numbers import read_numbers
from hbm.spatial import WRENCH_COMPONENTS, Array, Indices

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "fit")

Trial = tuple[ArrayLike, ArrayLike]
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
tests/validation/inertia_models.md."""


def fit_inertia(
    accelerations: ArrayLike,
    wrench: ArrayLike,
    setup: Setup | None = None,
    sensor_noise: ArrayLike = 0.0,
    zero_sd: ArrayLike | None = None,
) -> InertiaModel:
    """Fit the wrench of a moving, empty plate to the accelerations of the platform.

    Parameters
    ----------
    accelerations
        Readings of the accelerometers on the platform, (N, k) [m/s²], three columns per sensor.
        They must contain gravity: neither tared nor high-passed.
    wrench
        Wrench measured by the empty plate at the same instants, equally filtered, in the moving
        plate frame about its origin, (N, 6) [N, N·m].
    setup
        How both were recorded; needed to save the model.
    sensor_noise
        Standard deviation of the accelerometers' noise after the filter, one for all or (k,)
        [m/s²]; `sensor_noise_of` estimates it. 0 is the published method, ordinary least squares.
    zero_sd
        Standard deviation by which the plate's zero changes from recording to recording, one for
        all or (6,) [N, N·m]; None for the assumed one (`zero_of_trials`), 0 where it stays.

    Returns
    -------
    InertiaModel
        Gains, their uncertainty, and how well they explain the recording.

    Raises
    ------
    ValueError
        Wrong shapes, no or too few samples, gaps, different numbers of samples, constant
        channels, implausible units (g, mm/s², kN, N·mm), a platform that did not move, or a
        noise that is negative or too large.

    Notes
    -----
    A point ``r`` of a rigid platform has the specific force ``f(r) = f₀ + W r`` in platform axes,
    with ``W = [α]× + [ω]×[ω]×``: affine in ``r``. The cells carry ``F = Σ mᵢ f(rᵢ)`` and
    ``M = Σ mᵢ rᵢ × f(rᵢ)``, both linear in ``(f₀, W)`` whatever the mass distribution. Cells
    and sensors with fixed gain, axes and offset keep it so; the offset takes the offsets and the
    tare. The fit is exact, apart from noise, where the channels determine ``(f₀, W)``:

    - Sway and pitch about a fixed axis have 3 + 2 unknowns (``f₀``, the angular acceleration and
      the angular velocity squared). Two sensors whose baseline is not parallel to the pitch axis
      determine them: exact. One sensor, or a baseline parallel to the axis, has three channels
      for five unknowns: an approximation, good where rotation is slow or of one frequency.
    - Any motion in space has 12 unknowns: exact with four sensors that are not in one plane.
      With fewer, or four in one plane, the centripetal products ``ωᵢωⱼ`` are approximated.

    Not linear, hence not removed: saturation, bending of the platform, unequal filters or delays,
    drift, and moving parts (for belt acceleration see `fit_belt`).

    Noise in the accelerometers biases ordinary least squares towards zero where the calibration
    moves little, and pitch of ± 10° changes the vertical specific force by 0.15 m/s² only: the
    vertical force is then compensated too little in trials that tilt slowly. With `sensor_noise`
    the noise's share is subtracted from the normal equations, in every principal direction whose
    motion exceeds its noise (Fuller 1987, 1.2).

    The covariance of the gains is the sandwich estimate over 60 blocks of the trial, which allows
    for residuals that are correlated in time, as filtered signals are (Liang and Zeger 1986).

    Source: Hnat et al. (2018); van de Loosdrecht (2018), eq. 2.

    Deviations from the original: the minimum-norm solution where the design is rank-deficient;
    uncertainty, checks and the allowance for noise are added.

    Examples
    --------
    A belt assembly of 150 kg that only sways, under one accelerometer:

    >>> import numpy as np
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> model = fit_inertia(accelerations, wrench)
    >>> model.gain[:3, :3].round() + 0.0
    array([[-150.,    0.,    0.],
           [   0., -150.,    0.],
           [   0.,    0., -150.]])
    """
    return fit_trials([(accelerations, wrench)], setup, sensor_noise, zero_sd)


def fit_trials(
    trials: Sequence[Trial],
    setup: Setup | None = None,
    sensor_noise: ArrayLike = 0.0,
    zero_sd: ArrayLike | None = None,
    belts_mps: ArrayLike = (),
    beside_weight: float = 1.0,
    lags_s: Sequence[float] = (),
) -> InertiaModel:
    """Fit one model to several recordings of an empty plate, each with a zero of its own.

    Parameters
    ----------
    trials
        Accelerations (N, k) [m/s²] and wrench (N, 6) [N, N·m] of each recording, as for
        `fit_inertia`: the platform following a signal, somebody walking beside the empty plate.
    setup, sensor_noise
        As for `fit_inertia`.
    zero_sd
        Standard deviation of the plate's zero from recording to recording, one for all or (6,)
        [N, N·m]; None to estimate it from the recordings (`zero_of_trials`), 0 where it is known.
    belts_mps
        Speed of the belts in every recording, (M,) [m/s]; empty where it is unknown. What the model
        leaves then depends on it.
    beside_weight
        Weight of a sample of the recordings after the first, of people beside, by that of the
        first, of commanded motion; above 0, at most 1. `weigh_beside` finds it.
    lags_s
        Of a dynamic model: the accelerations are followed by their differences over these lags, as
        `dynamic_channels` gives them, (N, k (1 + lags)) [s]. Empty for a static one.

    Returns
    -------
    InertiaModel
        Its offset is the mean of those of the recordings.

    Raises
    ------
    ValueError
        No recordings; a dynamic model of signals that passed a real-time filter, in which nothing
        is known of the instants to come; else as `fit_inertia`, for all recordings together.

    Notes
    -----
    A platform that people shake moves in ways in which no signal moves it. Two accelerometers do
    not show all of them; what they show of those that occur together is learned from recordings in
    which they occur. What they do not show at all spoils the gains for commanded motion, unless
    these recordings weigh little. However little, they count in full in what the model is expected
    to leave.

    Between accelerometers and load cells the structure bends: a mode of natural frequency ``ω₀``
    that the accelerometers do not follow turns the acceleration ``a`` at the frequency ``ω`` into
    ``a / (1 − ω²/ω₀²)``, a series in even derivatives of ``a``. Second differences over some lags
    stand for these derivatives. Their gains have a penalty (ridge regression, Hoerl and Kennard
    1970), those of the readings and the offset none.

    Examples
    --------
    >>> rng, gain = np.random.default_rng(0), np.hstack([-150 * np.eye(3), np.ones((3, 3))])
    >>> a, b = (rng.normal([0, 0, 9.81], 1.0, (600, 3)) for _ in range(2))
    >>> model = fit_trials([(a, a @ gain), (b, b @ gain + 4.0)])
    >>> model.gain[-1].round(6)
    array([2., 2., 2., 2., 2., 2.])
    """
    if not trials:
        raise ValueError("a fit needs at least one recording")
    read = [(read_table(a, "accelerations"), read_table(w, "wrench", 6)) for a, w in trials]
    for one, other in read:
        refuse_unequal(accelerations=one, wrench=other)
    accelerations, w = (np.vstack(both) for both in zip(*read, strict=True))
    n, channels = accelerations.shape
    # readings first, then their differences lag by lag
    k = channels // (1 + len(lags_s))
    a, sensors = accelerations[:, :k], sensor_names(setup, k)
    if k * (1 + len(lags_s)) != channels:
        raise ValueError(
            f"channels: {channels}, expected the readings of all accelerometers and as many "
            f"differences for each of {len(lags_s)} lags"
        )
    if lags_s and setup is not None and setup.cutoff_hz and setup.filter_method == "realtime":
        raise ValueError(
            f"a dynamic model needs the accelerations of the next {max(LAGS_S):g} s, which a "
            "real-time filter does not know; use the static model, or filter with zero_phase"
        )
    if is_short(accelerations):
        raise ValueError(
            f"{n} samples are too few to fit {channels + 1} gains per component; "
            f"give at least {LIMITS.least_samples * (channels + 1)}, better a minute of motion"
        )
    names = tuple(f"sensor {sensor} {axis}" for sensor in sensors for axis in "xyz")
    refuse_constant(a, "accelerations", names)
    refuse_constant(w, "wrench", WRENCH_COMPONENTS)
    refuse_other_units(a, sensors)
    refuse_still_platform(a)
    refuse_other_wrench_units(a, w)
    noise = np.broadcast_to(np.asarray(0.0 if lags_s else sensor_noise, float), (k,))
    if (noise.any() and not (noise > 0).all()) or (noise > LIMITS.largest_noise).any():
        raise ValueError(
            f"sensor_noise must be positive and below {LIMITS.largest_noise:g} m/s² in every "
            f"channel, or 0, got {noise}"
        )

    # each recording has a zero of its own: about its means, gains do not see it
    counts = np.array([len(one) for one, _ in read])
    ends = np.cumsum(counts)[:-1]
    mean_accelerations = np.array([one.mean(axis=0) for one, _ in read])
    wrench_mean = np.array([other.mean(axis=0) for _, other in read])
    mean = mean_accelerations.mean(axis=0)
    weight, u, s, directions = _decomposed([x for x, _ in read], len(lags_s), beside_weight, noise)
    root = np.sqrt(weight)[:, None]
    # errors in variables: noise adds 1 to the square of each scaled singular value
    noisy = np.where(noise.any() & (s**2 > 1 + LIMITS.least_signal), 1.0, 0.0)  # of each direction
    # least squares by a singular value decomposition: normal equations square the condition
    slopes = (s / (s**2 - noisy))[:, None] * (u.T @ (root * w))
    # from directions back to channels, with the constant at zero acceleration
    to_gain = np.block([[directions, np.zeros((channels, 1))], [-mean @ directions, np.ones(1)]])
    gain = to_gain @ np.vstack([slopes, wrench_mean.mean(axis=0)])
    zeros = wrench_mean - mean_accelerations @ gain[:-1]
    residual = w - (gain[:-1].T @ accelerations.T).T - _repeated(zeros, counts)

    # recordings weigh alike in the constant
    one_of_each = np.repeat(n / (len(read) * counts), counts)
    design = np.column_stack([root * u * s, one_of_each])
    noise_part = np.vstack([noisy[:, None] * slopes, np.zeros(6)]) / n
    # a second each in a minute of motion
    blocks = pairwise(np.linspace(0, n, min(60, n) + 1).astype(int))
    # covariance of the gains by the sandwich, from sums over blocks: errors in time are correlated
    scores = np.stack(
        [design[i:j].T @ residual[i:j] + weight[i:j].sum() * noise_part for i, j in blocks]
    )
    if lags_s:
        scores -= scores.mean(axis=0)  # with a penalty they do not add up to 0
    meat = np.einsum("brc,bsc->crs", scores, scores) * len(scores) / (len(scores) - 1)
    bread = to_gain / np.append(s**2 - noisy, n)

    rate_hz, cutoff_hz = (None, None) if setup is None else (setup.rate_hz, setup.cutoff_hz)
    slow = [slow_part(part, rate_hz) for part in np.split(residual, ends)]
    long_enough = [part for part in slow if part is not None]
    all_slow = np.vstack(long_enough) if len(long_enough) == len(read) else residual
    about = w - _repeated(wrench_mean, counts)
    # errors of parts that were not fitted are those of trials; of fitted ones they are too small
    unseen = _held_out(np.split(u, ends), np.split(root * about, ends), noisy / s**2)
    return InertiaModel(
        gain=gain,
        covariance=bread @ meat @ bread.T,
        sigma=np.sqrt(np.sum(residual**2, axis=0) / (n - len(s) - len(read))),
        rank=len(s) + 1,
        condition=float(s[0] / s[-1]),
        r_squared=1 - np.sum(residual**2, axis=0) / np.sum(about**2, axis=0),
        rms_measured=np.sqrt(np.mean(w**2, axis=0)),
        rms_compensated=np.sqrt(np.mean(residual**2, axis=0)),
        acceleration_mean=mean[:k],
        acceleration_covariance=np.cov(a, rowvar=False),
        acceleration_low=a.min(axis=0),
        acceleration_high=a.max(axis=0),
        sensor_noise=noise,
        samples=n,
        setup=setup,
        correlation=correlation_of(all_slow),
        rms_slow=np.sqrt(np.mean(all_slow**2, axis=0)),
        model_error=fit_model_error(
            [one[:, :k] for one, _ in read],
            np.split(np.vstack(unseen) / root, ends),
            rate_hz,
            cutoff_hz,
            zero_of_trials(zeros, zero_sd),
            belts_mps,
        ),
        lags_s=tuple(lags_s),
    )


def left_of_held_out(
    trials: Sequence[tuple[Array, Array]], lags: int = 0, beside_weight: float = 1.0
) -> list[Array]:
    """Give what models leave of parts of recordings to which they were not fitted, (N, 6) each.

    Trials, number of lags and weight are those of `fit_trials`. Each recording is cut into ten
    parts, and each part is compensated by a model fitted to all others, about its recording's zero.

    Examples
    --------
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> bool(np.abs(left_of_held_out([(accelerations, wrench)])).max() < 1e-6)
    True
    """
    channels, wrenches = zip(*trials, strict=True)
    weight, u, s, _ = _decomposed(channels, lags, beside_weight, np.zeros(1))
    root, ends = np.sqrt(weight)[:, None], np.cumsum([len(x) for x in channels])[:-1]
    about = np.vstack([w - w.mean(axis=0) for w in wrenches])
    unseen = _held_out(np.split(u, ends), np.split(root * about, ends), np.zeros(len(s)))
    return np.split(np.vstack(unseen) / root, ends)


def is_short(accelerations: Array) -> bool:
    """Whether channels (N, K) are too few samples to fit their gains."""
    return bool(len(accelerations) < LIMITS.least_samples * (accelerations.shape[1] + 1))


def _decomposed(
    accelerations: Sequence[Array], lags: int, beside_weight: float, noise: Array
) -> tuple[Array, Array, Array, Array]:
    """Decompose weighted channels of recordings about their means, and the penalty, by a SVD.

    Gives the weight of every sample (N,), left vectors (N, r), singular values (r,), of channels in
    units of their noise or standard deviation, and directions (K, r) by which gains follow.
    """
    counts = np.array([len(x) for x in accelerations])
    # the first recording is commanded motion; weights sum to the number of samples
    of_each = np.where(np.arange(len(accelerations)) == 0, 1.0, beside_weight)
    n, weight = counts.sum(), np.repeat(of_each * counts.sum() / (of_each @ counts), counts)
    a = np.vstack(accelerations)
    centred = a - _repeated(np.array([x.mean(axis=0) for x in accelerations]), counts)
    size = noise if noise.any() else np.std(a, axis=0)
    penalty, k = np.zeros(a.shape[1]), a.shape[1] // (1 + lags)
    # ridge on the gains of differences: they follow only motion that differs by more
    penalty[k:] = DIFFERENCE_SD_MPS2[min(k // 3, len(DIFFERENCE_SD_MPS2)) - 1]
    scale = np.hypot(size, penalty) * np.sqrt(n)
    rows = np.sqrt(weight)[:, None] * (centred / scale)
    # a penalty is one more row of the design for each channel
    rows = np.vstack([rows, np.diag(penalty * np.sqrt(n) / scale)[k:]])
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    rank = int(np.sum(s > s[0] * n * np.finfo(float).eps))
    return weight, u[:n, :rank], s[:rank], vt[:rank].T / scale[:, None]


def _held_out(orthonormal: Sequence[Array], wrench: Sequence[Array], noise: Array) -> list[Array]:
    """Give what a fit leaves of each part of its recordings if that part is not fitted.

    Of left vectors (N, r) and wrench (N, 6) of each recording, weighted alike, and the share of
    each direction's energy that is noise, (r,). The zero of a recording remains that of all of it.
    """
    right = np.sum([u.T @ w for u, w in zip(orthonormal, wrench, strict=True)], axis=0)
    count = sum(map(len, wrench))
    errors = []
    for u, w in zip(orthonormal, wrench, strict=True):
        error = np.empty_like(w)
        # ten parts, each predicted by the rest: 6 s of a minute
        for i, j in pairwise(np.linspace(0, len(w), 10 + 1).astype(int)):
            # normal matrix without the part: 1 − Uᵀ U of orthonormal columns; no new decomposition
            rest = np.diag(1 - noise * (count - (j - i)) / count) - u[i:j].T @ u[i:j]
            # a direction of which the rest holds less than a thousandth has no gain
            slopes = np.linalg.pinv(rest, 1e-3, hermitian=True)
            error[i:j] = w[i:j] - u[i:j] @ (slopes @ (right - u[i:j].T @ w[i:j]))
        errors.append(error)
    return errors


def dynamic_channels(
    accelerations: ArrayLike, rate_hz: float, lags_s: Sequence[float] = LAGS_S
) -> Array:
    """Give the readings and their second differences, of which a dynamic model is a function.

    From readings (N, k) [m/s²], gaps NaN: the readings ``a(t)``, then for every lag ``l`` the
    difference ``a(t + l) − 2 a(t) + a(t − l)``, (N, k (1 + lags)) [m/s²]; 0 where a gap or the end
    of the recording is nearer than the lag. The differences vanish for whatever is constant or
    changes evenly, as gravity under slow tilt: that is left to the gains of the readings.

    Examples
    --------
    >>> dynamic_channels([[0.0], [1.0], [4.0], [9.0]], 100.0, [0.01]).T
    array([[0., 1., 4., 9.],
           [0., 2., 2., 0.]])
    """
    a = np.asarray(accelerations, float)
    channels = [a]
    for lag_s in lags_s:
        # second difference over a lag: what a platform that bends adds to its rigid motion
        step = max(round(lag_s * rate_hz), 1)
        difference = np.zeros_like(a)  # in memory as the readings are
        if 2 * step < len(a):
            within = a[2 * step :] - 2 * a[step:-step] + a[: -2 * step]
            difference[step:-step] = np.nan_to_num(within, posinf=np.nan, neginf=np.nan)
        difference[np.isnan(a)] = np.nan
        channels.append(difference)
    return np.hstack(channels)


def _repeated(of_each: Array, counts: Indices) -> Array:
    """Give the row of every recording, (M, C), to all of its samples, (N, C).

    Every channel is in one piece of memory, as samples are: it takes a tenth of the time to sum.
    """
    return np.repeat(of_each.T, counts, axis=1).T
