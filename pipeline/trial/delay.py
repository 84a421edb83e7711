"""How much later force plates are stamped than markers, judged by the body's own motion."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from hbm.signals.resampling import interpolate
from hbm.spatial import Array

LONGEST_DELAY_S = 0.15
"""Delays are sought up to this, either way; walking repeats itself every half second."""
BLOCK_S = 0.5
"""About one step: errors within it are alike and count as one."""
FEWEST_BLOCKS = 4
NOISE_FLOOR_N = 1.0
"""Disagreement below this is never an outlier."""


def marker_plate_delay(
    plate_force: ArrayLike, motion_force: ArrayLike, time: ArrayLike
) -> tuple[float, float]:
    """Estimate by how much the plates lag the markers, from Newton's second law.

    Parameters
    ----------
    plate_force
        Sum of all external forces on the subject in lab axes, brought to the markers' times,
        (T, 3) [N].
    motion_force
        The same force as the markers tell it: m(a − g) of the whole body's centre of mass, through
        the same filter, (T, 3) [N]. Frames with a gap (NaN) in either do not count.
    time
        Sample times of both, (T,) [s].

    Returns
    -------
    delay_s
        Positive where the plates are later than the markers: what the markers tell at ``t``
        agrees best with the plates at ``t + delay_s``.
    uncertainty_s
        Standard error, from the scatter between blocks of ``BLOCK_S`` and between the three axes:
        a fault of the body model repeats in every step, but pulls each axis its own way.

    Raises
    ------
    ValueError
        If the arrays do not fit, if there are too few frames or no change of force to tell by, or
        if the best agreement is not within ``LONGEST_DELAY_S``.

    Notes
    -----
    Least squares over a shift of the plates' cubic spline and a constant offset per axis (a wrong
    mass or zero is no delay), with the soft-L1 loss, so that a stumble or a marker that jumps has
    little say. The variance is the sandwich estimate with scores summed over blocks, plus the one
    with scores summed over axes (Cameron, Gelbach and Miller 2011, J Bus Econ Stat 29:238, without
    their correction for what both count, hence rather too large than too small).

    The real-time filter's acceleration is half a time step older than its value, so forces filtered
    with it show half a step less delay than there is (5 ms at 100 Hz); zero phase shows it all.
    """
    plate, motion = np.asarray(plate_force, float), np.asarray(motion_force, float)
    time = np.asarray(time, float)
    if not plate.shape == motion.shape == (len(time), 3) or len(time) < 2:
        raise ValueError(
            f"both forces must have shape (T, 3) with T > 1, here T = {len(time)} times, "
            f"got {plate.shape} and {motion.shape}"
        )
    step = np.median(np.diff(time))
    shifts = step * np.arange(-(LONGEST_DELAY_S // step), LONGEST_DELAY_S // step + 1)
    disagreement = interpolate(time, plate, time[:, None] + shifts) - motion[:, None]
    usable = np.isfinite(disagreement).all(axis=(1, 2))
    block = np.unique(time[usable] // BLOCK_S, return_inverse=True)[1]
    if len(set(block)) < FEWEST_BLOCKS:
        raise ValueError(
            f"the delay between plates and markers needs {FEWEST_BLOCKS * BLOCK_S:g} s of frames "
            f"without gaps, got {usable.sum()} such frames"
        )
    at, told = time[usable], motion[usable]
    disagreement = disagreement[usable]
    offset = np.median(disagreement, axis=0)
    spread = np.mean(abs(disagreement - offset), axis=(0, 2))
    best = int(np.argmin(spread))
    scale = max(NOISE_FLOOR_N, spread[best])

    def residual(parameters: Array) -> Array:
        error = interpolate(time, plate, at + parameters[0]) - told - parameters[1:]
        return np.ravel(error)

    free = np.full(3, np.inf)
    fit = least_squares(
        residual,
        x0=[shifts[best], *offset[best]],
        bounds=([shifts[0], *-free], [shifts[-1], *free]),
        x_scale=[step, *np.full(3, scale)],
        loss="soft_l1",
        f_scale=scale,
    )
    delay_s, error = float(fit.x[0]), fit.fun.reshape(-1, 3)
    if min(delay_s - shifts[0], shifts[-1] - delay_s) < step:
        raise ValueError(
            f"plates and markers agree nowhere within ±{1000 * LONGEST_DELAY_S:.0f} ms; "
            "are they of the same trial, in the same axes?"
        )
    near = interpolate(time, plate, at[:, None] + delay_s + step * np.array([-0.01, 0.01]))
    slope = np.diff(near, axis=1)[:, 0] / (0.02 * step)
    uncertainty_s = _standard_error(error / scale, slope / scale, block)
    noticeable = np.sqrt(np.mean(slope**2)) * LONGEST_DELAY_S > NOISE_FLOOR_N
    if not noticeable or uncertainty_s > LONGEST_DELAY_S / 3:
        raise ValueError("the force changes too little to tell the delay of plates and markers")
    return delay_s, uncertainty_s


def _standard_error(error: Array, slope: Array, block: NDArray[np.intp]) -> float:
    """Give the sandwich standard error of a shift under soft-L1 loss.

    Errors and their slopes (T, 3) come in units of the loss's scale; errors are taken as alike
    within a block and within an axis.
    """
    growth = 1 + error**2
    scores = np.zeros((block.max() + 1, 3))
    np.add.at(scores, block, slope * error / np.sqrt(growth))
    by_axis, by_block = scores.sum(axis=0), scores.sum(axis=1)
    variance = sum(np.sum(x**2) * len(x) / (len(x) - 1) for x in (by_axis, by_block))
    information = np.sum(slope**2 / growth**1.5)
    return float(np.sqrt(variance) / information) if information > 0 else np.inf
