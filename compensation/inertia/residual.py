"""What fits of recordings leave: its part below 6 Hz, of parts not seen by the fit, of zeros."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.model import SLOW_HZ, Setup
from compensation.inertia.model_error import ModelError, fit_model_error, thinned, widening
from compensation.inputs import read_table
from hbm.signals.filtering import low_pass
from hbm.spatial import Array

HELD_OUT_PARTS: Final = 10
"""Of a recording, each predicted by the rest: 6 s of a minute."""
MIN_LEFT_SHARE: Final = 1e-3
"""Of a direction's energy that must be in the rest for its gain to be found without a part."""
ZERO_SD: Final = np.repeat([0.5, 0.25], 3)
"""Standard deviation of a plate's zero from recording to recording [N, N·m], as far as recordings
do not show it; assumed, of a plate that is zeroed on the same day."""
ZERO_DEGREES: Final = 3
"""Degrees of freedom that the assumed value is worth beside those that recordings show of three
forces or moments, three per recording after the first; and what is pooled over them beside those of
one component, one per recording after the first."""


def recording_weights(counts: ArrayLike, beside_weight: float) -> Array:
    """Give the weight of a sample of each recording, (M,), with which all weigh as many as N.

    Those after the first, of people beside, weigh `beside_weight` of those of the first.
    """
    counts = np.asarray(counts)
    if not 0 < beside_weight <= 1:
        raise ValueError(f"beside_weight must be above 0 and at most 1, got {beside_weight}")
    weights = np.where(np.arange(len(counts)) == 0, 1.0, beside_weight)
    return np.asarray(weights * counts.sum() / (weights @ counts))


def held_out(orthonormal: Sequence[Array], wrench: Sequence[Array], noise: Array) -> list[Array]:
    """Give what a fit leaves of each part of its recordings if that part is not fitted.

    Parameters
    ----------
    orthonormal
        Left singular vectors of the channels about each recording's mean, (N, r) per recording.
    wrench
        About each recording's mean, (N, 6) [N, N·m] per recording, weighted alike.
    noise
        Share of each direction's energy that is noise and subtracted, (r,).

    Returns
    -------
    list of Array
        About the zero of each recording, which remains that of all its samples, (N, 6) [N, N·m].
    """
    right = np.sum([u.T @ w for u, w in zip(orthonormal, wrench, strict=True)], axis=0)
    count = sum(map(len, wrench))
    found = []
    for u, w in zip(orthonormal, wrench, strict=True):
        left = np.empty_like(w)
        for i, j in pairwise(np.linspace(0, len(w), HELD_OUT_PARTS + 1).astype(int)):
            rest = np.diag(1 - noise * (count - (j - i)) / count) - u[i:j].T @ u[i:j]
            slopes = np.linalg.pinv(rest, MIN_LEFT_SHARE, hermitian=True)
            left[i:j] = w[i:j] - u[i:j] @ (slopes @ (right - u[i:j].T @ w[i:j]))
        found.append(left)
    return found


def zero_of_trials(zeros: ArrayLike, stated: ArrayLike | None = None) -> Array:
    """Give the standard deviation of a trial's zero about that of a calibration.

    Parameters
    ----------
    zeros
        Zero of the plate in every recording of the calibration, (M, 6) [N, N·m]; the calibration's
        is their mean.
    stated
        Standard deviation of the zero of one recording, where it is known, one for all or (6,).

    Returns
    -------
    Array
        (6,) [N, N·m]: of one recording that of the difference of two zeros, as stated or of
        `ZERO_SD`. Of several, where none is stated, their scatter counts, of each component
        beside that of all forces or all moments, which counts beside the assumed one; widened as
        an interval of Student's t is.

    Examples
    --------
    >>> zero_of_trials(np.zeros((1, 6))).round(2)
    array([0.71, 0.71, 0.71, 0.35, 0.35, 0.35])
    """
    zeros = np.asarray(zeros, float)
    both = np.sqrt(1 + 1 / len(zeros))
    if len(zeros) == 1 or stated is not None:
        sd = np.broadcast_to(np.asarray(ZERO_SD if stated is None else stated, float), (6,))
        if not np.all(np.isfinite(sd) & (sd >= 0)):
            raise ValueError(f"zero_sd must be 0 or positive, got {sd}")
        return np.asarray(both * sd)
    squares = np.sum((zeros - zeros.mean(axis=0)) ** 2, axis=0)
    alike = np.repeat(squares.reshape(2, 3).sum(axis=1), 3)
    degrees = ZERO_DEGREES + 3 * (len(zeros) - 1)
    pooled = (alike + ZERO_DEGREES * ZERO_SD**2) / degrees
    variance = (squares + ZERO_DEGREES * pooled) / (len(zeros) - 1 + ZERO_DEGREES)
    return np.asarray(both * np.sqrt(variance) * widening(degrees))


def model_error_of(
    accelerations: Sequence[Array],
    unseen: Sequence[Array],
    setup: Setup | None,
    zero: Array,
    belts_mps: ArrayLike = (),
) -> ModelError:
    """Fit the model error of any model to what it leaves of parts that it was not fitted to.

    Parameters
    ----------
    accelerations
        Readings of every recording, (N, k) [m/s²], as recorded for the fit.
    unseen
        What is left of each part of each recording by a model fitted to the others, about the zero
        of the recording, (N, 6) [N, N·m]: `held_out` gives it for a linear model.
    setup
        How they were recorded; None where that is unknown.
    zero
        Standard deviation of a trial's zero about the calibration's, (6,) [N, N·m].
    belts_mps
        Speed of the belts in every recording, (M,) [m/s]; empty where it is unknown.

    Returns
    -------
    ModelError
        The same in every motion where the rate is unknown or a recording is too short.
    """
    slow = [slow_part(part, setup) for part in unseen]
    if setup is None or any(part is None for part in slow):
        return fit_model_error(accelerations, unseen, unseen, None, zero, belts_mps)
    step = thinned(setup.rate_hz, setup.cutoff_hz)
    return fit_model_error(
        [part[::step] for part in accelerations],
        [part[::step] for part in unseen],
        [part[::step] for part in slow if part is not None],
        setup.rate_hz / step,
        zero,
        belts_mps,
    )


def slow_part(residual: Array, setup: Setup | None) -> Array | None:
    """Give what passes the filter of trials, (N, C); None without a second of known rate.

    The calibration's own filter passes vibration of the platform's base, which is not in residuals.
    """
    if setup is None or len(residual) < setup.rate_hz or setup.rate_hz < 4 * SLOW_HZ:
        return None
    return low_pass(residual, setup.rate_hz, SLOW_HZ, "zero_phase")


def residual_correlation(residual: ArrayLike, setup: Setup | None = None) -> Array:
    """Give the correlations of what calibrations leave, of several plates side by side.

    Parameters
    ----------
    residual
        At common instants, (N, C) [N, N·m].
    setup
        How it was recorded; None where that is unknown.

    Returns
    -------
    Array
        (C, C), below 6 Hz where a second of known rate is given; 0 with a channel of which nothing
        is left.

    Raises
    ------
    ValueError
        Wrong shape, no samples or gaps.

    Notes
    -----
    Plates are compensated by the same accelerometers, whose noise is in all of them.

    Examples
    --------
    >>> import numpy as np
    >>> noise = np.random.default_rng(0).normal(size=1000)
    >>> residual_correlation(np.column_stack([noise, -2 * noise]))
    array([[ 1., -1.],
           [-1.,  1.]])
    """
    left = read_table(residual, "residual")
    slow = slow_part(left, setup)
    return correlation_of(left if slow is None else slow)


def correlation_of(residual: Array) -> Array:
    """Give the correlations between channels, (C, C); 0 with one that leaves nothing."""
    size = np.sqrt(np.mean(residual**2, axis=0))
    scaled = residual / np.where(size > 0, size, 1.0)
    correlation = scaled.T @ scaled / len(scaled)
    np.fill_diagonal(correlation, 1.0)
    return correlation
