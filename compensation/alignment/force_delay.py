"""The delay of force plates behind markers, from the motion of the subject's own body."""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from compensation.alignment.delay import Delay, clustered_standard_error
from hbm.signals.resampling import interpolate
from hbm.spatial import Array, Mask

MAX_DELAY_S: Final = 0.15
"""Delays are sought up to this, either way; walking repeats itself every half second."""
BLOCK_S: Final = 0.5
"""About one step: errors within it are alike and count as one."""
MIN_BLOCKS: Final = 4
"""Two strides; fewer have no scatter between them to judge the uncertainty by."""
NOISE_FLOOR_N: Final = 1.0
"""Disagreement below this is never an outlier, and a force that changes by less shows no delay."""
SLOPE_STEP: Final = 0.01
"""Of a sample, either way, over which the slope of the plates' force is taken."""


def marker_plate_delay(plate_force: ArrayLike, motion_force: ArrayLike, time: ArrayLike) -> Delay:
    """Estimate by how much the plates lag the markers, from Newton's second law.

    Parameters
    ----------
    plate_force
        Sum of all external forces on the subject in lab axes, brought to the markers' times,
        (T, 3) [N].
    motion_force
        The same force from the markers: m(a − g) of the whole body's centre of mass, through the
        same filter, (T, 3) [N]. Frames with a gap (NaN) in either do not count.
    time
        Sample times of both, (T,) [s].

    Returns
    -------
    Delay
        Positive where the plates are later than the markers: the force from the markers at ``t``
        agrees best with the plates at ``t + seconds``. The standard error comes from the scatter
        between blocks of ``BLOCK_S`` and between the three axes: an error of the body model
        repeats in every step, but shifts each axis differently.

    Raises
    ------
    ValueError
        If the arrays do not fit, if there are too few frames or the force changes too little, or
        if the best agreement is not within ``MAX_DELAY_S``.

    Notes
    -----
    Least squares over a shift of the plates' cubic spline and a constant offset per axis (a wrong
    mass or zero is no delay), with the soft-L1 loss, so that a stumble or a marker that jumps has
    little weight. The standard error is `clustered_standard_error` by blocks and by axes.

    Unlike `estimate_delay`, whose channels may be combined in any way, both signals are one force
    in newtons and the same axes: nothing but offset and shift is free.

    The real-time filter's acceleration is half a time step older than its value, so forces filtered
    with it show half a step less delay than there is (5 ms at 100 Hz); zero phase shows it all.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(0, 10, 0.01)
    >>> def force(at):
    ...     return 60 * np.column_stack([np.sin(6 * at), np.sin(3 * at), np.cos(6 * at)])
    >>> f"{marker_plate_delay(force(time - 0.013), force(time), time).seconds:.4f}"
    '0.0130'
    """
    plate, motion = np.asarray(plate_force, float), np.asarray(motion_force, float)
    time = np.asarray(time, float)
    if not plate.shape == motion.shape == (len(time), 3) or len(time) < 2:
        raise ValueError(
            f"both forces must have shape (T, 3) with T > 1, here T = {len(time)} times, "
            f"got {plate.shape} and {motion.shape}"
        )
    step = np.median(np.diff(time))
    reach = int(MAX_DELAY_S // step)
    lags = sorted(range(-reach, reach + 1), key=abs)  # of those that agree alike, the shortest
    known = interpolate(time, plate, time)  # short stretches between gaps have no spline
    searched = slice(reach, max(len(time) - reach, reach))
    at, wanted = time[searched], motion[searched]
    together: Mask = np.asarray(np.isfinite(known).all(axis=1))
    usable: Mask = np.asarray(np.isfinite(wanted).all(axis=1))
    for lag in lags:
        usable &= together[reach + lag : reach + lag + len(at)]
    block = np.unique(at[usable] // BLOCK_S, return_inverse=True)[1]
    if len(set(block)) < MIN_BLOCKS:
        raise ValueError(
            f"the delay between plates and markers needs {MIN_BLOCKS * BLOCK_S:g} s of frames "
            f"without gaps, got {usable.sum()} such frames"
        )
    at, wanted = at[usable], wanted.T.compress(usable, axis=1).T
    frames = reach + np.flatnonzero(usable)
    offsets, spreads = np.empty((len(lags), 3)), np.empty(len(lags))
    for k, lag in enumerate(lags):
        disagreement = known.T.take(frames + lag, axis=1) - wanted.T
        offsets[k] = np.median(disagreement, axis=1)
        spreads[k] = np.mean(np.abs(disagreement - offsets[k][:, None]))
    best = int(np.argmin(spreads))
    scale = max(NOISE_FLOOR_N, spreads[best])

    @lru_cache(maxsize=2)  # slopes by the offsets need the same shift again
    def shifted(delay_s: float) -> Array:
        return interpolate(time, plate, at + delay_s)

    def residual(parameters: Array) -> Array:
        return np.ravel((shifted(parameters[0]) - wanted - parameters[1:]).T)

    free = np.full(3, np.inf)
    fit = least_squares(
        residual,
        x0=[step * lags[best], *offsets[best]],
        bounds=([-step * reach, *-free], [step * reach, *free]),
        x_scale=[step, *np.full(3, scale)],
        loss="soft_l1",
        f_scale=scale,
    )
    delay_s, error = float(fit.x[0]), fit.fun.reshape(3, -1).T
    if step * reach - abs(delay_s) < step:
        raise ValueError(
            f"plates and markers agree nowhere within ±{1000 * MAX_DELAY_S:.0f} ms; "
            "are they of the same trial, in the same axes?"
        )
    either_way = step * np.array([-SLOPE_STEP, SLOPE_STEP])
    near = interpolate(time, plate, at[:, None] + delay_s + either_way)
    slope = np.diff(near, axis=1)[:, 0] / (2 * SLOPE_STEP * step)
    uncertainty_s = _standard_error(error / scale, slope / scale, block)
    noticeable = np.sqrt(np.mean(slope**2)) * MAX_DELAY_S > NOISE_FLOOR_N
    if not noticeable or uncertainty_s > MAX_DELAY_S / 3:
        raise ValueError("the force changes too little to estimate the delay of plates and markers")
    return Delay(delay_s, uncertainty_s)


def _standard_error(error: Array, slope: Array, block: NDArray[np.intp]) -> float:
    """Give the standard error of a shift under soft-L1 loss; see `clustered_standard_error`.

    Errors and their slopes (T, 3) are in units of the loss's scale; errors are taken as correlated
    within a block and within an axis.
    """
    growth = 1 + error**2
    scores = np.zeros((block.max() + 1, 3))
    np.add.at(scores, block, slope * error / np.sqrt(growth))
    information = float(np.sum(slope**2 / growth**1.5))
    return clustered_standard_error([scores.sum(axis=0), scores.sum(axis=1)], information)
