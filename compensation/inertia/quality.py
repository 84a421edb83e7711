"""Whether a calibration recording serves: did the platform move, was it empty, what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation.inertia.checks import MAX_UNEXPLAINED_N
from compensation.inertia.model import InertiaModel
from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array, read_only

MIN_COMMANDED_MPS2: Final = 0.2
"""Largest standard deviation of a channel of a platform that follows commands. Trials have 1 m/s²
and more (pitch of ± 10°, sway of 5 cm in 0.3 s); people on the boards shake a platform by less than
0.1 m/s²."""
PERSON_RMS: Final = np.array([37.1, 30.4, 63.1, 11.4, 20.5, 4.5])
"""RMS of the pelvis residuals of nine adults, of about 75 kg, who walk on a treadmill whose
platform is at rest: forward, sideways, up [N, N·m] (van de Loosdrecht 2018, Table III, baseline
without compensation)."""
MAX_RISE: Final = 0.05
"""By which what compensation leaves may raise these residuals; our choice."""
HIP_HEIGHT_M: Final = 1.0
"""Above the plates: a horizontal force on them is a moment about the hips."""


def _max_left() -> Array:
    """Derive the limits of the components of a plate, (6,) [N, N·m]: 3.8, 14.3, 3.8 and 1.0.

    What compensation leaves is independent of the person's part, so that their squares add up, and
    two plates leave it: each component may be √((1.05² − 1) / 2) = 23 % of the person's part. How
    a plate's horizontal axes lie is not known: both have the RMS of the person's two. A horizontal
    force is as large a moment about the hips, 1 m above, and is limited by that of moments.
    """
    share = np.sqrt(((1 + MAX_RISE) ** 2 - 1) / 2)
    _, tilt = share * np.sqrt(np.mean(PERSON_RMS.reshape(2, 3)[:, :2] ** 2, axis=1))
    up, turn = share * PERSON_RMS[[2, 5]]
    return read_only([tilt / HIP_HEIGHT_M, tilt / HIP_HEIGHT_M, up, tilt, tilt, turn])


MAX_LEFT: Final = _max_left()
"""RMS below 6 Hz that compensation may leave of each component of a plate, (6,) [N, N·m]."""


@dataclass(frozen=True, slots=True)
class LeftOver:
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
    rows = []
    for k, name in enumerate(WRENCH_COMPONENTS):
        after, r_squared = float(model.rms_compensated[k]), float(model.r_squared[k])
        excited = after / np.sqrt(1 - r_squared) if r_squared < 1 else float(model.rms_measured[k])
        slow, limit = float(np.asarray(model.rms_slow)[k]), float(MAX_LEFT[k])
        unit = "N" if k < 3 else "N·m"
        rows.append(LeftOver(name, unit, float(excited), after, slow, limit, r_squared))
    return tuple(rows)


OF_CALIBRATION: Final = (
    "calibration_loaded",
    "calibration_unexplained",
    "calibration_leaves_much",
    "calibration_not_judged",
)
"""Codes of notes on a calibration that hold for everything that uses it."""


def verdict_notes(verdict: Mapping[str, Sequence[LeftOver]]) -> tuple[Note, ...]:
    """Put the verdict on a calibration, plate -> components, into one note; none where it passes.

    Without any plate, as of files of earlier versions, the calibration was not judged.
    """
    if not verdict:
        return (Note.of("calibration_not_judged"),)
    beyond = [
        f"{plate} {row.component} {row.left:.1f} {row.unit} (limit {row.limit:.1f})"
        for plate, rows in verdict.items()
        for row in rows
        if not row.passed
    ]
    return (Note.of("calibration_leaves_much", left=beyond),) if beyond else ()


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
