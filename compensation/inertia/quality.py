"""Whether a calibration recording serves: did the platform move, was it empty, what is left."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation.inertia.checks import MAX_UNEXPLAINED_N
from compensation.inertia.model import InertiaModel
from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS

MIN_COMMANDED_MPS2: Final = 0.2
"""Largest standard deviation of a channel of a platform that follows commands. Trials have 1 m/s²
and more (pitch of ± 10°, sway of 5 cm in 0.3 s); people on the boards shake a platform by less than
0.1 m/s²."""
MAX_LEFT_N: Final = 9.0
MAX_LEFT_NM: Final = 1.8
"""RMS below 6 Hz that compensation may leave. Peaks, three times the RMS, then stay below what
Hicks et al. (2015) allow the residuals of an adult of 50 kg: 5 % of a peak force of 1.1 body
weights, and 1 % of it times a height of the centre of mass of 1 m."""


@dataclass(frozen=True, slots=True)
class LeftOver:
    """What a calibration leaves of one component of one plate, beside what residuals allow.

    Attributes
    ----------
    component, unit
        "fx" … "mz" and "N" or "N·m".
    excited, after, left, limit
        Standard deviation before, RMS after, the part of it below 6 Hz, at which residuals are
        filtered, and the largest part that they allow.
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
    def verdict(self) -> str:
        """Whether the component is compensated well enough, which its R² alone cannot tell."""
        if self.left > self.limit:
            return "too much left"
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
    limits = [(MAX_LEFT_N, "N")] * 3 + [(MAX_LEFT_NM, "N·m")] * 3
    rows = []
    for k, (limit, unit) in enumerate(limits):
        after, r_squared = float(model.rms_compensated[k]), float(model.r_squared[k])
        excited = after / np.sqrt(1 - r_squared) if r_squared < 1 else float(model.rms_measured[k])
        name = WRENCH_COMPONENTS[k]
        slow = float(np.asarray(model.rms_slow)[k])
        rows.append(LeftOver(name, unit, float(excited), after, slow, limit, r_squared))
    return tuple(rows)


def check_left_over(model: InertiaModel, plate: str) -> tuple[Note, ...]:
    """Warn of every component of which a calibration leaves more than residuals allow."""
    return tuple(
        Note.of(
            "calibration_leaves_much",
            plate=plate,
            component=row.component,
            left=f"{row.left:.1f} {row.unit}",
            limit=f"{row.limit:g} {row.unit}",
            r_squared=row.r_squared,
        )
        for row in left_over(model)
        if row.left > row.limit
    )


def refuse_unusable(plates: Mapping[str, InertiaModel]) -> None:
    """Refuse a recording that is no calibration: nothing was commanded, or somebody was on it.

    Parameters
    ----------
    plates
        Plate -> the model fitted to the recording.

    Raises
    ------
    ValueError
        The platform moved too little, or the accelerometers leave more force unexplained than an
        empty plate has; the message says what was seen and what to do.

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
    seen = []
    moved = max(float(np.sqrt(np.diag(m.acceleration_covariance).max())) for m in plates.values())
    if moved < MIN_COMMANDED_MPS2:
        seen.append(
            f"the platform moved too little (accelerations vary by {moved:.2f} m/s², expected "
            f"{MIN_COMMANDED_MPS2:g} or more)"
        )
    for name, model in plates.items():
        unexplained = float(np.linalg.norm(model.sigma[:3]))
        if unexplained > MAX_UNEXPLAINED_N:
            mean = np.append(model.acceleration_mean, 1.0) @ model.gain[:, 2]
            seen.append(
                f"{name} was loaded or not in time with the accelerometers (they leave "
                f"{unexplained:.0f} N unexplained, expected a few; mean vertical force "
                f"{mean:.0f} N): was somebody on the boards?"
            )
    if seen:
        raise ValueError(
            f"no calibration: {'; '.join(seen)}; record the empty treadmill while it follows a "
            "calibration signal"
        )
