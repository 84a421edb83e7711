"""Whether a calibration serves: by what it leaves of its recording, and of one of another day."""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compensation.delay import BLOCKS
from compensation.inertia.fit import fit_inertia
from compensation.inertia.model import InertiaModel
from compensation.inertia.model_error import SLOW_HZ
from hbm.numbers import read_numbers
from hbm.signals.filtering import low_pass
from hbm.spatial import WRENCH_COMPONENTS, Array, Mask, read_only
from hbm.spelling import written

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "quality")

MIN_LOAD_N: Final = 150.0
"""Mean force above which a zeroed plate is not empty: a fifth of a body weight."""
PERSON_RMS: Final = np.array([37.1, 30.4, 63.1, 11.4, 20.5, 4.5])
"""RMS of the pelvis residuals of nine adults, of about 75 kg, who walk on a treadmill whose
platform is at rest: forward, sideways, up [N, N·m] (van de Loosdrecht 2018, Table III, baseline
without compensation)."""
PERSON_KG: Final = 75.0
"""Their mean body mass; limits of another person change in proportion."""
UNITS: Final = ("N",) * 3 + ("N·m",) * 3
HIP_HEIGHT_M: Final = 1.0
"""Above the plates: a horizontal force on them is a moment about the hips."""


def _max_left() -> Array:
    """Derive the limits of the components of a plate, (6,) [N, N·m]: 3.8, 14.3, 3.8 and 1.0.

    What compensation leaves is independent of the person's part, so that their squares add up, and
    two plates leave it: each component may be √((1.05² − 1) / 2) = 23 % of the person's part. How
    a plate's horizontal axes lie is not known: both have the RMS of the person's two. A horizontal
    force is as large a moment about the hips, 1 m above, and is limited by that of moments.
    """
    fraction = np.sqrt(((1 + LIMITS.largest_rise) ** 2 - 1) / 2)
    _, tilt = fraction * np.sqrt(np.mean(PERSON_RMS.reshape(2, 3)[:, :2] ** 2, axis=1))
    up, turn = fraction * PERSON_RMS[[2, 5]]
    return read_only([tilt / HIP_HEIGHT_M, tilt / HIP_HEIGHT_M, up, tilt, tilt, turn])


MAX_LEFT: Final = _max_left()
"""RMS below 6 Hz that compensation may leave of each component of a plate, (6,) [N, N·m]."""


class LeftOver(NamedTuple):
    """What a calibration leaves of one component of one plate, and its limit.

    Attributes
    ----------
    component, unit
        "Fx" … "Mz" and "N" or "N·m".
    excited, after, left, limit
        Standard deviation before, RMS after, the part of it below 6 Hz, at which residuals are
        filtered, and the largest part that is allowed.
    r_squared
        Share of the variance that the accelerometers explain.
    """

    component: str
    unit: str
    excited: float
    after: float
    left: float
    limit: float
    r_squared: float

    @property
    def passed(self) -> bool:
        """Whether the component is compensated well enough, which its R² alone cannot tell."""
        return self.left <= self.limit

    @property
    def verdict(self) -> str:
        """The same in words; a component that hardly moved shows little."""
        if not self.passed:
            return "above limit"
        return "hardly moved" if self.excited < self.limit else "good"


def left_over(model: InertiaModel) -> tuple[LeftOver, ...]:
    """Give what a calibration leaves of every component of its plate.

    Examples
    --------
    >>> import compensation, numpy as np
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> left_over(compensation.fit_inertia(accelerations, wrench))[0].verdict
    'good'
    """
    rows = []
    for k, name in enumerate(WRENCH_COMPONENTS):
        after, r_squared = float(model.rms_compensated[k]), float(model.r_squared[k])
        # what the recording excited of the component, from R² = 1 − after² / excited²
        excited = after / np.sqrt(1 - r_squared) if r_squared < 1 else float(model.rms_measured[k])
        slow, limit = float(np.asarray(model.rms_slow)[k]), float(MAX_LEFT[k])
        rows.append(LeftOver(name, UNITS[k], float(excited), after, slow, limit, r_squared))
    return tuple(rows)


def lightest_kg(rows: Iterable[LeftOver]) -> float:
    """Give the smallest body mass whose residuals the compensation raises by 5 % at most [kg].

    Examples
    --------
    >>> lightest_kg([LeftOver("Fz", "N", 90.0, 8.0, 7.15, 14.3, 0.99)])
    37.5
    """
    return PERSON_KG * max(row.left / row.limit for row in rows)


def refuse_unusable(plates: Mapping[str, InertiaModel]) -> None:
    """Refuse a recording that is no calibration: nothing was commanded, or somebody was on it.

    From plate -> the model fitted to it. A ValueError where the platform moved too little, or the
    accelerometers leave more force unexplained than an empty plate has.

    Examples
    --------
    >>> import compensation, numpy as np
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 0.1, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> refuse_unusable({"plate 1": compensation.fit_inertia(accelerations, wrench)})
    Traceback (most recent call last):
        ...
    ValueError: no calibration: the platform moved too little (accelerations vary by 0.10 m/s², \
expected 0.2 or more); record the empty treadmill while it follows a calibration signal
    """
    faults = []
    moved = max(float(np.sqrt(np.diag(m.acceleration_covariance).max())) for m in plates.values())
    if moved < LIMITS.least_commanded:
        faults.append(
            f"the platform moved too little (accelerations vary by {moved:.2f} m/s², expected "
            f"{LIMITS.least_commanded:g} or more)"
        )
    for name, model in plates.items():
        unexplained = float(np.linalg.norm(model.sigma[:3]))
        if unexplained > LIMITS.largest_unexplained:
            mean = np.append(model.acceleration_mean, 1.0) @ model.gain[:, 2]
            faults.append(
                f"{name} was loaded or not in time with the accelerometers (they leave "
                f"{unexplained:.0f} N unexplained, expected a few; mean vertical force "
                f"{mean:.0f} N): was somebody on the boards?"
            )
    if faults:
        raise ValueError(
            f"no calibration: {'; '.join(faults)}; record the empty treadmill while it follows a "
            "calibration signal"
        )


MAX_GAIN: Final = 0.5
"""By how much more of the limits than a new fit a calibration may leave on another day."""
MAX_ZERO_CHANGE: Final = np.repeat([3.0, 0.6], 3)
"""By which the zero of a plate may have changed [N, N·m]; in children, errors of 3 N do not change
joint moments beyond their spread (doi 10.1016/j.jbiomech.2024.112351). 0.6 N·m, a millimetre under
75 kg, are our choice."""


class DayCheck(NamedTuple):
    """What an empty recording of another day says about the calibration of one plate.

    Attributes
    ----------
    left, left_by_new_fit
        RMS about the mean below 6 Hz that the calibration, and a fit to the recording itself,
        leave, (6,) [N, N·m].
    zero_change
        Of the plate, (6,) [N, N·m].
    leaves_much, moved
        Which components are beyond their limits: of what is left, and of the zero, (6,).
    """

    left: Array
    left_by_new_fit: Array
    zero_change: Array
    leaves_much: Mask
    moved: Mask

    @property
    def faults(self) -> tuple[str, ...]:
        """What is beyond its limit, in words; empty where the calibration is still valid."""
        faults = []
        for k, (name, unit) in enumerate(zip(WRENCH_COMPONENTS, UNITS, strict=True)):
            if self.leaves_much[k]:
                remaining, by_new = self.left[k], self.left_by_new_fit[k]
                faults.append(f"{name} left {remaining:.1f} {unit}, by a new fit {by_new:.1f}")
            if self.moved[k]:
                faults.append(f"zero of {name} {written(self.zero_change[k], '+.1f')} {unit}")
        return tuple(faults)


def check_another_day(
    model: InertiaModel,
    accelerations: ArrayLike,
    wrench: ArrayLike,
    belts_mps: ArrayLike | None = None,
) -> DayCheck:
    """Compare the calibration of a plate with an empty recording of another day.

    From the static model of the plate, accelerations (N, k) [m/s²] with the calibration's delays
    undone, wrench (N, 6) [N, N·m], both low-passed as its setup says, and the speed of the belts,
    (N,) or one number [m/s], or None where it is unknown. A ValueError where the recording shows
    nothing: a platform that hardly moves, somebody on the boards.

    The calibration is valid where a new fit would take away no more than half of what may be left,
    leaves no more itself than rollers out of balance do, and the zero has changed by no more than
    zeros do.
    """
    a, w = np.asarray(accelerations, float), np.asarray(wrench, float)
    new, setup = fit_inertia(a, w, model.setup), model.setup
    assert setup is not None  # that of a calibration states it
    refuse_unusable({"the plate": new})
    # only what passes the filter of trials
    error, newly = (
        low_pass(one.compensate(a, w), setup.rate_hz, SLOW_HZ, "zero_phase") for one in (model, new)
    )
    remaining, by_new, zero = error.std(axis=0), newly.std(axis=0), error.mean(axis=0)
    expected = model.uncertainty(a, slow=True, zero=False, belts_mps=belts_mps)
    rollers = LIMITS.rollers * np.sqrt(np.mean(expected**2, axis=0))
    # squares, since independent errors add so
    beyond = remaining**2 - by_new**2 > (MAX_GAIN * MAX_LEFT) ** 2
    beyond |= by_new > np.maximum(MAX_LEFT, rollers)
    # standard error of the mean from means of blocks: errors in time are correlated
    means = [block.mean(axis=0) for block in np.array_split(error, BLOCKS)]
    usual = np.std(means, axis=0, ddof=1) / np.sqrt(BLOCKS)
    if model.model_error is not None:
        usual = np.hypot(usual, model.model_error.zero)
    moved = np.abs(zero) > np.maximum(MAX_ZERO_CHANGE, LIMITS.control_limit * usual)
    return DayCheck(remaining, by_new, zero, beyond, moved)
