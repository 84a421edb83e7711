"""Learn what a moving, empty plate measures from the accelerations of its platform."""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.model import InertiaModel, Setup, sensor_names
from compensation.inertia.plausibility import (
    refuse_other_units,
    refuse_other_wrench_units,
    refuse_still_platform,
)
from compensation.inputs import COMPONENTS, read_table, refuse_constant, refuse_unequal
from hbm.spatial import Array

_SAMPLES_PER_UNKNOWN = 10
_BLOCKS = 60
_LEAST_SIGNAL = 1.0  # variance of motion by that of noise above which noise is allowed for
_DIRECTIONS = 5  # of the specific force in sway and pitch


def fit_inertia(
    accelerations: ArrayLike,
    wrench: ArrayLike,
    setup: Setup | None = None,
    sensor_noise: ArrayLike = 0.0,
) -> InertiaModel:
    """Fit the wrench of a moving, empty plate to the accelerations of the platform.

    Parameters
    ----------
    accelerations
        What the accelerometers on the platform read, (N, k) [m/s²], three columns per sensor.
        Gravity must be in it: neither tared nor high-passed.
    wrench
        What the empty plate measured at the same instants, equally filtered, in the moving plate
        frame about its origin, (N, 6) [N, N·m].
    setup
        How both were recorded; needed to save the model.
    sensor_noise
        Standard deviation of the accelerometers' noise after the filter, one for all or (k,)
        [m/s²]; `sensor_noise_of` finds it. 0 is the published method, ordinary least squares.

    Returns
    -------
    InertiaModel
        Gains and an account of how well they are known.

    Raises
    ------
    ValueError
        Wrong shapes, no or too few samples, gaps, different numbers of samples, constant
        channels, units that cannot be (g, mm/s², kN, N·mm), a platform that did not move, or a
        noise that is no size.

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
    drift, and moving parts (belt acceleration: see `compensation.belt.model`).

    Noise in the accelerometers biases ordinary least squares towards zero where the calibration
    moves little, and pitch of ± 10° changes the vertical specific force by 0.15 m/s² only: the
    vertical force is then compensated too little in trials that tilt slowly. With `sensor_noise`
    the noise's share is taken out of the normal equations, in every principal direction that
    moves more than it is noisy (Fuller 1987, 1.2).

    The covariance is the sandwich estimate over 60 blocks of the trial, which allows for
    residuals that are correlated in time, as filtered signals are (Liang and Zeger 1986).

    Source: Hnat et al. (2018); van de Loosdrecht (2018), eq. 2.

    Deviations from the original: the minimum-norm solution where the rank is short; uncertainty,
    checks and the allowance for noise are added.
    """
    a, w = read_table(accelerations, "accelerations"), read_table(wrench, "wrench", 6)
    n, k = a.shape
    sensors = sensor_names(setup, k)
    refuse_unequal(accelerations=a, wrench=w)
    if n < _SAMPLES_PER_UNKNOWN * (k + 1):
        raise ValueError(
            f"{n} samples are too few to fit {k + 1} gains per component; "
            f"give at least {_SAMPLES_PER_UNKNOWN * (k + 1)}, better a minute of motion"
        )
    channels = tuple(f"sensor {sensor} {axis}" for sensor in sensors for axis in "xyz")
    refuse_constant(a, "accelerations", channels)
    refuse_constant(w, "wrench", COMPONENTS)
    refuse_other_units(a, sensors)
    refuse_still_platform(a)
    refuse_other_wrench_units(a, w)
    noise = _read_noise(sensor_noise, k)

    mean = a.mean(axis=0)
    scale = (noise if noise.any() else np.std(a, axis=0)) * np.sqrt(n)
    u, s, vt = np.linalg.svd((a - mean) / scale, full_matrices=False)
    rank = int(np.sum(s > s[0] * n * np.finfo(float).eps))
    u, s, directions = u[:, :rank], s[:rank], vt[:rank].T / scale[:, None]
    noisy = np.where(noise.any() & (s**2 > 1 + _LEAST_SIGNAL), 1.0, 0.0)  # of each direction
    slopes = (s / (s**2 - noisy))[:, None] * (u.T @ w)
    to_gain = np.block([[directions, np.zeros((k, 1))], [-mean @ directions, np.ones(1)]])
    gain = to_gain @ np.vstack([slopes, w.mean(axis=0)])
    residual = w - a @ gain[:-1] - gain[-1]

    design = np.column_stack([u * s, np.ones(n)])
    share = np.vstack([noisy[:, None] * slopes, np.zeros(6)]) / n
    blocks = pairwise(np.linspace(0, n, min(_BLOCKS, n) + 1).astype(int))
    scores = np.stack([design[i:j].T @ residual[i:j] + (j - i) * share for i, j in blocks])
    meat = np.einsum("brc,bsc->crs", scores, scores) * len(scores) / (len(scores) - 1)
    bread = to_gain / np.append(s**2 - noisy, n)

    sigma = np.sqrt(np.sum(residual**2, axis=0) / (n - rank - 1))
    return InertiaModel(
        gain=gain,
        covariance=bread @ meat @ bread.T,
        sigma=sigma,
        rank=rank + 1,
        condition=float(s[0] / s[-1]),
        r_squared=1 - np.var(residual, axis=0) / np.var(w, axis=0),
        rms_measured=np.sqrt(np.mean(w**2, axis=0)),
        rms_compensated=np.sqrt(np.mean(residual**2, axis=0)),
        acceleration_mean=mean,
        acceleration_covariance=np.cov(a, rowvar=False),
        acceleration_low=a.min(axis=0),
        acceleration_high=a.max(axis=0),
        sensor_noise=noise,
        samples=n,
        setup=setup,
    )


def sensor_noise_of(accelerations: ArrayLike) -> float:
    """Find the accelerometers' noise in a calibration trial of sway and pitch.

    Parameters
    ----------
    accelerations
        What two or more accelerometers read, (N, k) [m/s²], filtered as for the fit.

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
    Rigid sway and pitch move the ``k`` channels along five directions only; what the other
    ``k - 5`` principal directions hold is noise, supposed equal in all channels. A platform that
    also rolls, yaws or bends makes the noise look larger than it is.
    """
    a = read_table(accelerations, "accelerations")
    if a.shape[1] <= _DIRECTIONS or a.shape[1] % 3 or len(a) < 2:
        raise ValueError(
            f"accelerations of shape {a.shape} do not tell noise from motion; "
            "give two sensors or more, 3 channels each"
        )
    variance = np.linalg.eigvalsh(np.cov(a, rowvar=False))
    return float(np.sqrt(max(variance[:-_DIRECTIONS].mean(), 0.0)))


def _read_noise(sensor_noise: ArrayLike, channels: int) -> Array:
    noise = np.asarray(sensor_noise, float)
    if noise.shape not in ((), (channels,)):
        raise ValueError(f"sensor_noise must be one number or ({channels},), got {noise.shape}")
    if not (np.all(noise > 0) or np.all(noise == 0)) or np.any(noise > 1):
        raise ValueError(
            f"sensor_noise must be positive and below 1 m/s² in every channel, or 0, got {noise}"
        )
    return np.broadcast_to(noise, (channels,))
