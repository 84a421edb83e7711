"""Fit what a moving, empty plate measures to the accelerations of its platform."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.model import InertiaModel, Setup, sensor_names
from compensation.inertia.plausibility import (
    refuse_other_units,
    refuse_other_wrench_units,
    refuse_still_platform,
)
from compensation.inertia.residual import (
    correlation_of,
    held_out,
    model_error_of,
    recording_weights,
    slow_part,
    zero_of_trials,
)
from compensation.inputs import read_table, refuse_constant, refuse_unequal
from hbm.spatial import WRENCH_COMPONENTS, Array, Indices

MIN_SAMPLES_PER_GAIN: Final = 10
"""Fewer fit the noise; a minute at 100 Hz has hundreds."""
BLOCKS: Final = 60
"""Blocks of a trial whose errors are taken as independent: a second each in a minute of motion."""
MIN_SIGNAL_TO_NOISE: Final = 1.0
"""Variance of motion per variance of noise, in a principal direction, above which the noise's share
is taken out; below it the direction is noise, and taking its share out would change the sign."""
RIGID_DIRECTIONS: Final = 5
"""Of sway and pitch: ``f₀``, the angular acceleration and the angular velocity squared."""
MAX_SENSOR_NOISE_MPS2: Final = 1.0
"""A tenth of gravity: no accelerometer on a platform is noisier after the filter."""


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
    trials: Sequence[tuple[ArrayLike, ArrayLike]],
    setup: Setup | None = None,
    sensor_noise: ArrayLike = 0.0,
    zero_sd: ArrayLike | None = None,
    belts_mps: ArrayLike = (),
    beside_weight: float = 1.0,
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

    Returns
    -------
    InertiaModel
        Its offset is the mean of those of the recordings.

    Raises
    ------
    ValueError
        No recordings; else as `fit_inertia`, for all recordings together.

    Notes
    -----
    A platform that people shake moves in ways in which no signal moves it. Two accelerometers do
    not show all of them; what they show of those that occur together is learned from recordings in
    which they occur. What they do not show at all spoils the gains for commanded motion, unless
    these recordings weigh little. However little, they count in full in what the model is expected
    to leave.

    Examples
    --------
    >>> rng, gain = np.random.default_rng(0), np.hstack([-150 * np.eye(3), np.ones((3, 3))])
    >>> felt = [rng.normal([0, 0, 9.81], 1.0, (600, 3)) for _ in range(2)]
    >>> model = fit_trials([(felt[0], felt[0] @ gain), (felt[1], felt[1] @ gain + 4.0)])
    >>> model.gain[-1].round(6)
    array([2., 2., 2., 2., 2., 2.])
    """
    if not trials:
        raise ValueError("a fit needs at least one recording")
    read = [(read_table(a, "accelerations"), read_table(w, "wrench", 6)) for a, w in trials]
    if len({a.shape[1] for a, _ in read}) > 1:
        raise ValueError(f"recordings differ in channels: {[a.shape[1] for a, _ in read]}")
    for one, other in read:
        refuse_unequal(accelerations=one, wrench=other)
    a, w = (np.vstack(both) for both in zip(*read, strict=True))
    n, k = a.shape
    sensors = sensor_names(setup, k)
    if n < MIN_SAMPLES_PER_GAIN * (k + 1):
        raise ValueError(
            f"{n} samples are too few to fit {k + 1} gains per component; "
            f"give at least {MIN_SAMPLES_PER_GAIN * (k + 1)}, better a minute of motion"
        )
    channels = tuple(f"sensor {sensor} {axis}" for sensor in sensors for axis in "xyz")
    refuse_constant(a, "accelerations", channels)
    refuse_constant(w, "wrench", WRENCH_COMPONENTS)
    refuse_other_units(a, sensors)
    refuse_still_platform(a)
    refuse_other_wrench_units(a, w)
    noise = _read_noise(sensor_noise, k)

    counts = np.array([len(one) for one, _ in read])
    ends = np.cumsum(counts)[:-1]
    felt_mean = np.array([one.mean(axis=0) for one, _ in read])
    wrench_mean = np.array([other.mean(axis=0) for _, other in read])
    mean = felt_mean.mean(axis=0)
    weight = np.repeat(recording_weights(counts, beside_weight), counts)
    root = np.sqrt(weight)[:, None]
    scale = (noise if noise.any() else np.std(a, axis=0)) * np.sqrt(n)
    centred = (a - _repeated(felt_mean, counts)) / scale
    u, s, vt = np.linalg.svd(root * centred, full_matrices=False)
    rank = int(np.sum(s > s[0] * n * np.finfo(float).eps))
    u, s, directions = u[:, :rank], s[:rank], vt[:rank].T / scale[:, None]
    noisy = np.where(noise.any() & (s**2 > 1 + MIN_SIGNAL_TO_NOISE), 1.0, 0.0)  # of each direction
    slopes = (s / (s**2 - noisy))[:, None] * (u.T @ (root * w))
    to_gain = np.block([[directions, np.zeros((k, 1))], [-mean @ directions, np.ones(1)]])
    gain = to_gain @ np.vstack([slopes, wrench_mean.mean(axis=0)])
    zeros = wrench_mean - felt_mean @ gain[:-1]
    residual = w - (gain[:-1].T @ a.T).T - _repeated(zeros, counts)

    one_of_each = np.repeat(n / (len(read) * counts), counts)
    design = np.column_stack([root * u * s, one_of_each])
    share = np.vstack([noisy[:, None] * slopes, np.zeros(6)]) / n
    blocks = pairwise(np.linspace(0, n, min(BLOCKS, n) + 1).astype(int))
    scores = np.stack(
        [design[i:j].T @ residual[i:j] + weight[i:j].sum() * share for i, j in blocks]
    )
    meat = np.einsum("brc,bsc->crs", scores, scores) * len(scores) / (len(scores) - 1)
    bread = to_gain / np.append(s**2 - noisy, n)

    left = np.split(residual, ends)
    slow = [part for part in (slow_part(one, setup) for one in left) if part is not None]
    all_slow = np.vstack(slow) if len(slow) == len(read) else None
    zero = zero_of_trials(zeros, zero_sd)
    about = w - _repeated(wrench_mean, counts)
    unseen = np.vstack(held_out(np.split(u, ends), np.split(root * about, ends), noisy / s**2))
    return InertiaModel(
        gain=gain,
        covariance=bread @ meat @ bread.T,
        sigma=np.sqrt(np.sum(residual**2, axis=0) / (n - rank - len(read))),
        rank=rank + 1,
        condition=float(s[0] / s[-1]),
        r_squared=1 - np.sum(residual**2, axis=0) / np.sum(about**2, axis=0),
        rms_measured=np.sqrt(np.mean(w**2, axis=0)),
        rms_compensated=np.sqrt(np.mean(residual**2, axis=0)),
        acceleration_mean=mean,
        acceleration_covariance=np.cov(a, rowvar=False),
        acceleration_low=a.min(axis=0),
        acceleration_high=a.max(axis=0),
        sensor_noise=noise,
        samples=n,
        setup=setup,
        correlation=correlation_of(residual if all_slow is None else all_slow),
        rms_slow=None if all_slow is None else np.sqrt(np.mean(all_slow**2, axis=0)),
        model_error=model_error_of(
            [one for one, _ in read], np.split(unseen / root, ends), setup, zero, belts_mps
        ),
    )


def _repeated(of_each: Array, counts: Indices) -> Array:
    """Give the row of every recording, (M, C), to all of its samples, (N, C).

    Every channel is in one piece of memory, as samples are: it takes a tenth of the time to sum.
    """
    return np.repeat(of_each.T, counts, axis=1).T


def sensor_noise_of(accelerations: ArrayLike) -> float:
    """Estimate the accelerometers' noise from a calibration trial of sway and pitch.

    Parameters
    ----------
    accelerations
        Readings of two or more accelerometers, (N, k) [m/s²], filtered as for the fit.

    Returns
    -------
    float
        Standard deviation of the noise per channel [m/s²].

    Raises
    ------
    ValueError
        Fewer than two sensors, wrong shape, no samples or gaps.

    Notes
    -----
    Rigid sway and pitch move the ``k`` channels along five directions only; the variance of the
    other ``k - 5`` principal directions is noise, taken as equal in all channels. On a platform
    that also rolls, yaws or bends the estimate is too large.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> five = rng.normal(size=(5000, 5)) @ rng.normal(size=(5, 6))
    >>> round(sensor_noise_of(five + 0.02 * rng.normal(size=(5000, 6))), 3)
    0.02
    """
    a = read_table(accelerations, "accelerations")
    if a.shape[1] <= RIGID_DIRECTIONS or a.shape[1] % 3 or len(a) < 2:
        raise ValueError(
            f"accelerations of shape {a.shape} do not separate noise from motion; "
            "give two sensors or more, 3 channels each"
        )
    variance = np.linalg.eigvalsh(np.cov(a, rowvar=False))
    return float(np.sqrt(max(variance[:-RIGID_DIRECTIONS].mean(), 0.0)))


def _read_noise(sensor_noise: ArrayLike, channels: int) -> Array:
    noise = np.asarray(sensor_noise, float)
    if noise.shape not in ((), (channels,)):
        raise ValueError(f"sensor_noise must be one number or ({channels},), got {noise.shape}")
    if not (np.all(noise > 0) or np.all(noise == 0)) or np.any(noise > MAX_SENSOR_NOISE_MPS2):
        raise ValueError(
            f"sensor_noise must be positive and below {MAX_SENSOR_NOISE_MPS2:g} m/s² in every "
            f"channel, or 0, got {noise}"
        )
    return np.broadcast_to(noise, (channels,))
