"""The delay of force plates behind markers, from the motion of the subject's own body."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.delay import Delay
from hbm.numbers import read_numbers
from hbm.signals.filtering import oscillation
from hbm.signals.resampling import Signal, interpolant
from hbm.signals.samples import median_of
from hbm.spatial import Array, Mask

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "force_delay")

USUAL: Final = np.array([1.0, LIMITS.tissue_deviation, LIMITS.gain_deviation])
"""One standard deviation before the forces are looked at: of the delay [s], so large that they
alone determine it, of soft tissue and of the ratio."""


def marker_plate_delay(plate_force: ArrayLike, motion_force: ArrayLike, time: ArrayLike) -> Delay:
    """Estimate by how much the plates lag the markers, from Newton's second law.

    Parameters
    ----------
    plate_force
        Sum of all external forces on the subject in lab axes, brought to the markers' times,
        (T, 3) [N].
    motion_force
        The same force from the markers: m(a − g) of the whole body's centre of mass, through the
        same filter, (T, 3) [N]. Frames with a gap (NaN) in either are left out.
    time
        Sample times of both, in equal steps, (T,) [s].

    Returns
    -------
    Delay
        Positive where the plates are later than the markers: the force from the markers at ``t``
        agrees best with the plates at ``t + seconds``.

    Raises
    ------
    ValueError
        If the arrays do not fit, if there are too few frames, if the best agreement is not within
        ± 150 ms, or if the 95 % interval is wider than ± 10 ms, or ± 15 ms where the motion
        explains most of the force: too little motion, or axes that disagree.

    Notes
    -----
    Least squares over a shift of the plates' cubic spline, a constant offset of each axis, the
    ratio of both forces and the force of soft tissue. Soft tissue follows the bones late, which
    plates measure and markers do not show; left out, it would make plates 2 to 3 ms later than they
    are. It is one oscillator that the force from the markers drives, of a usual mass whose
    deviation is part of the standard error, and so is that of the ratio.

    Each axis is weighted by the variance of what is left in it, and frames as by the soft-L1 loss,
    so that a stumble or a marker that jumps has little weight. The standard error takes what is
    left as an error of the body model that repeats in every stride, so that more strides do not
    make the delay surer. It is larger where the axes show delays that differ by more than it says
    (Birge 1932, Phys Rev 40:207).

    Unlike `estimate_delay`, whose channels may be combined in any way, both signals are one force
    in newtons and the same axes.

    The real-time filter's acceleration is half a time step older than its value, so forces filtered
    with it show half a step less delay than there is (5 ms at 100 Hz); zero phase shows it all.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(0, 10, 0.01)
    >>> def force(at):
    ...     return 60 * np.column_stack([np.sin(6 * at), np.sin(3 * at), np.cos(6 * at)])
    >>> motion = force(time)
    >>> plates = force(time - 0.013) + soft_tissue(motion, time)
    >>> f"{marker_plate_delay(plates, motion, time).seconds:.3f}"
    '0.013'
    """
    plate, motion = np.asarray(plate_force, float), np.asarray(motion_force, float)
    time = np.asarray(time, float)
    if not plate.shape == motion.shape == (len(time), 3) or len(time) < 2:
        raise ValueError(
            f"both forces must have shape (T, 3) with T > 1, here T = {len(time)} times, "
            f"got {plate.shape} and {motion.shape}"
        )
    step_s = float(np.median(np.diff(time)))
    _independent(np.isfinite(plate + motion).all(axis=1), step_s)
    # the plates carry soft tissue too, which moves against the bones
    tissue = soft_tissue(motion, time)
    expected = motion + tissue
    # whole frames first, then fractions by Gauss–Newton
    delay_s = step_s * _nearest_lag(plate, expected, int(LIMITS.longest // step_s))
    scale, spline = np.full(3, np.inf), interpolant(time, plate)
    expected, tissue, seen_at = (
        x[np.isfinite(expected).all(axis=1)] for x in (expected, tissue, time)
    )

    def plate_at(later_s: Array) -> Array:
        return spline(seen_at[:, None] + later_s)

    for _ in range(50):
        step, error_s, scale = _step(plate_at, expected, tissue, step_s, delay_s, scale)
        # no farther than a frame at a time, where the slope of the force holds
        delay_s += float(np.clip(step, -step_s, step_s))
        if abs(step) < 1e-6 * step_s or abs(delay_s) > LIMITS.longest - step_s:
            break
    delay = Delay(delay_s, error_s)
    if abs(delay_s) > LIMITS.longest - step_s:
        raise ValueError(
            f"plates and markers agree nowhere within ±{1000 * LIMITS.longest:.0f} ms; "
            "are they of the same trial, in the same axes?"
        )
    # a force that the motion explains well shows a delay through little change, too
    of_motion = np.sum(scale**2) < (1 - LIMITS.least_explained) * np.sum(np.nanvar(plate, axis=0))
    most_s = LIMITS.largest_uncertainty_of_motion if of_motion else LIMITS.largest_uncertainty
    if not delay.uncertainty <= most_s:
        raise ValueError(
            f"its 95 % interval would be ± {1000 * delay.uncertainty:.1f} ms, more than "
            f"{1000 * most_s:.0f} ms: the force changes too little, or its axes disagree"
        )
    return delay


def soft_tissue(motion_force: Array, time: Array) -> Array:
    """Give the force that soft tissue of usual mass adds to that of a rigid body, (T, 3) [N]."""
    frames = np.isfinite(motion_force).all(axis=1)
    # seen from the body, the tissue is driven by minus the body's acceleration
    axes = motion_force[frames].T
    drive = np.column_stack([-np.interp(time, time[frames], axis) for axis in axes])
    _, added = oscillation(drive - drive[0], time, LIMITS.tissue_frequency, LIMITS.tissue_damping)
    return np.asarray(LIMITS.tissue_mass * added)


def _independent(used: Mask, step_s: float) -> float:
    """Give how many independent errors the frames that are used have, (T,); refuse too few."""
    duration_s = np.count_nonzero(used) * step_s
    if duration_s * LIMITS.independent_rate <= LIMITS.least_independent:
        raise ValueError(
            f"more than {LIMITS.least_independent / LIMITS.independent_rate:.2g} s of frames "
            f"without gaps are needed, got {duration_s:.2g} s"
        )
    # errors of a body model repeat with the stride: a longer recording has no more of them
    return float(LIMITS.independent_rate * min(duration_s, LIMITS.stride))


def _nearest_lag(plate: Array, expected: Array, reach: int) -> int:
    """Give the lag of the plates, in frames, at which forces (T, 3) agree best but for offsets."""
    spreads, frames = {}, np.count_nonzero(np.isfinite(plate + expected).all(axis=1))
    for lag in sorted(range(-reach, reach + 1), key=abs):  # of those that agree alike, the shortest
        late = plate[max(lag, 0) : len(plate) + min(lag, 0)]
        difference = late - expected[max(-lag, 0) : len(expected) - max(lag, 0)]
        difference = difference[np.isfinite(difference).all(axis=1)]
        if 2 * len(difference) > frames:
            spreads[lag] = float(np.abs(difference - [*map(median_of, difference.T)]).mean())
    return min(spreads, key=spreads.__getitem__)


def _step(
    plate_at: Signal, expected: Array, tissue: Array, step_s: float, delay_s: float, scale: Array
) -> tuple[float, float, Array]:
    """Give how much later the plates are than `delay_s` says [s].

    With its standard error [s], and the size of what is left in each axis, (3,) [N], which the next
    step is given; infinite in the first.
    """
    # the plates' force at the delay, and a hundredth of a frame to either side
    around = delay_s + 0.01 * step_s * np.array([-1.0, 0.0, 1.0])
    before, late, after = np.moveaxis(plate_at(around), 1, 0)
    used = np.isfinite(before + late + after + expected).all(axis=1)
    independent = _independent(used, step_s)
    errors = (expected - late)[used]
    # derivatives of the difference by delay, amount of soft tissue and ratio of the forces
    columns = np.stack([(after - before)[used] / np.ptp(around), -tissue[used], -expected[used]])
    errors = errors - [*map(median_of, errors.T)]
    # large errors count less (pseudo-Huber): heel strikes, other contacts
    weight = 1 / np.sqrt(1 + (errors / scale) ** 2)
    # without the weighted mean over frames
    total = weight.sum(axis=0)
    errors, columns = (x - (weight * x).sum(-2, keepdims=True) / total for x in (errors, columns))
    scale = _size(errors) if np.isinf(scale).all() else scale
    per_frame = weight * independent / len(errors) / np.maximum(scale, LIMITS.noise_floor) ** 2
    flat, weighted = (x.reshape(len(columns), -1) for x in (columns, columns * per_frame))
    # ridge: what is usual of tissue and ratio is known beforehand
    covariance = np.linalg.inv(weighted @ flat.T + np.diag(USUAL**-2.0))
    size = covariance @ (weighted @ errors.ravel())
    rest = errors - (size @ flat).reshape(errors.shape)
    # what shows the delay alone, beside tissue and ratio
    alone = (covariance[0] / covariance[0, 0] @ flat).reshape(errors.shape)
    of_axis = (alone**2 * per_frame).sum(axis=0)
    from_axis = (alone * rest * per_frame).sum(axis=0)
    # axes that want different delays widen the interval: χ² of the axes, by two degrees
    disagreement = float(np.sum(from_axis**2 / np.maximum(of_axis, np.finfo(float).tiny))) / 2
    # few independent errors: the variance of Student's t
    variance = covariance[0, 0] * independent / (independent - 2) * max(disagreement, 1.0)
    return float(size[0]), float(np.sqrt(variance)), _size(rest)


def _size(error: Array) -> Array:
    """Give the standard deviation of errors (T, 3), few of which may be large, (3,).

    Halfway to that of all axes: one stride shows little of each axis by itself.
    """
    # robust: median absolute deviation, between that of each axis and of all
    variance = np.square([1.4826 * median_of(sizes) for sizes in np.abs(error).T])
    return np.asarray(np.sqrt((variance + variance.mean()) / 2))
