"""What has changed since a calibration: one accelerometer, or the gain of a plate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from compensation.alignment.delay import BLOCKS
from hbm.notes import Note, NoteValue
from hbm.spatial import WRENCH_COMPONENTS, Array, fit_rotation

QUANTILE_95: Final = 1.96
MIN_GAIN_CHANGE: Final = 0.005
MIN_TURN_DEG: Final = 0.5
MIN_DIFFERENCE: Final = 0.03
"""Changes that matter: a reading wrong by 0.5 % of sway or by 0.5° leaves a newton. The last one is
of a reading as a whole, of which vibration of the base explains up to 2 %."""
MIN_EXPLAINED: Final = 0.9
"""Share of what a sensor's free transformation explains that a gain or a turn alone must reach."""
GAIN_ERROR: Final = 0.0006
TURN_ERROR_DEG: Final = 0.08
DIFFERENCE_ERROR: Final = 0.005
"""Standard errors besides the noise's: vibration on an elastic base differs from signal to signal
(virtual laboratory)."""
Change = Literal["gain", "turned", "moved"]
CODES: Final[dict[Change, str]] = {
    "gain": "calibration_sensor_gain",
    "turned": "calibration_sensor_turned",
    "moved": "calibration_sensor_moved",
}
"""Of the notes that say so."""


@dataclass(frozen=True, slots=True)
class SensorChange:
    """The transformation of one sensor's readings that explains most of a calibration's error.

    Attributes
    ----------
    sensor
        Its name.
    explained, by_gain, by_turn
        By how much the transformation reduces the weighted squares, and how much of that its gain
        or its rotation alone does.
    gain, gain_error
        Today's gain by that of the calibration, and its standard error.
    turn_deg, turn_error_deg
        Angle of the rotation [deg].
    difference, difference_error
        Largest share by which a reading differs from that of the calibration.
    """

    sensor: str
    explained: float
    by_gain: float
    by_turn: float
    gain: float
    gain_error: float
    turn_deg: float
    turn_error_deg: float
    difference: float
    difference_error: float

    @property
    def kind(self) -> Change | None:
        """What has changed; None where nothing has that matters and exceeds its interval."""
        if self.by_gain >= MIN_EXPLAINED * self.explained:
            beyond = abs(self.gain - 1) - QUANTILE_95 * self.gain_error
            return "gain" if beyond > MIN_GAIN_CHANGE else None
        if self.by_turn >= MIN_EXPLAINED * self.explained:
            beyond = self.turn_deg - QUANTILE_95 * self.turn_error_deg
            return "turned" if beyond > MIN_TURN_DEG else None
        beyond = self.difference - QUANTILE_95 * self.difference_error
        return "moved" if beyond > MIN_DIFFERENCE else None

    def note(self, kind: Change, recording: str) -> Note:
        """Say what has changed, by a recording."""
        values: dict[str, NoteValue] = {"sensor": self.sensor, "recording": recording}
        if kind == "gain":
            values |= {"change": self.gain - 1, "interval": QUANTILE_95 * self.gain_error}
        elif kind == "turned":
            values |= {"angle_deg": self.turn_deg, "interval": QUANTILE_95 * self.turn_error_deg}
        else:
            interval = QUANTILE_95 * self.difference_error
            values |= {"change": self.difference, "interval": interval}
        return Note(CODES[kind], values)


def likeliest(changes: Sequence[SensorChange]) -> tuple[Change, SensorChange] | None:
    """Give what has changed in one of several sensors, and of which; None where nothing has.

    Of those that explain nearly as much as the best, the simplest change counts. Two sensors of
    which one was moved may explain the plates alike: then both are named.
    """
    best = max(change.explained for change in changes)
    near = [(c.kind, c) for c in changes if c.explained >= MIN_EXPLAINED * best]
    for kind in CODES:
        alike = sorted((c for k, c in near if k == kind), key=lambda c: -c.explained)
        if alike:
            names = " or ".join(c.sensor for c in alike) if kind == "moved" else alike[0].sensor
            return kind, replace(alike[0], sensor=names)
    return None


def sensor_change(sensor: str, readings: Array, gain: Array, error: Array) -> SensorChange:
    """Find the linear transformation of a sensor's readings that explains a prediction's error.

    Parameters
    ----------
    sensor
        Its name.
    readings
        (N, 3) [m/s²].
    gain
        The calibration's for it, each component in units of its noise, (3, C).
    error
        Measured minus predicted wrench, in the same units, (N, C).

    Returns
    -------
    SensorChange
        With errors of a jackknife over blocks. About the means: neither offset nor zero counts.
    """
    a, e = readings - readings.mean(axis=0), error - error.mean(axis=0)
    parts = zip(np.array_split(a, BLOCKS), np.array_split(e, BLOCKS), strict=True)
    weight = gain @ gain.T
    of_block = [(np.kron(x.T @ x, weight), (x.T @ y @ gain.T).ravel()) for x, y in parts]
    normal = np.sum([n for n, _ in of_block], axis=0)
    right = np.sum([r for _, r in of_block], axis=0)
    found, free = _transformation(normal, right)
    drawn = np.array([_transformation(normal - n, right - r)[0] for n, r in of_block])
    noise = np.sqrt(np.var(drawn, axis=0) * (len(drawn) - 1))
    errors = np.hypot(noise, [GAIN_ERROR, TURN_ERROR_DEG, DIFFERENCE_ERROR])

    def explained(change: Array) -> float:
        return float(2 * right @ change.ravel() - change.ravel() @ normal @ change.ravel())

    return SensorChange(
        sensor,
        explained(free),
        explained((1 / found[0] - 1) * np.eye(3)),
        explained(fit_rotation(np.eye(3) + free) - np.eye(3)),
        *(float(x) for pair in zip(found, errors, strict=True) for x in pair),
    )


def _transformation(normal: Array, right: Array) -> tuple[Array, Array]:
    """Give gain, turn [deg] and difference of a sensor, (3,), and the best ``E``, (3, 3).

    The calibration's readings are today's ``a (1 + E)``, with ``normal vec(E) = right``, so that
    today's gain is the inverse.
    """
    best = np.linalg.lstsq(normal, right)[0].reshape(3, 3)
    one = np.eye(3).ravel()
    scale = float(right @ one / (one @ normal @ one))
    back = np.eye(3) + best
    cosine = np.clip((np.trace(fit_rotation(back)) - 1) / 2, -1, 1)
    difference = float(np.linalg.norm(np.linalg.pinv(back) - np.eye(3), 2))
    return np.array([1 / (1 + scale), np.degrees(np.arccos(cosine)), difference]), np.asarray(
        best, float
    )


@dataclass(frozen=True, slots=True)
class PlateGain:
    """Change of the gain of one plate since a calibration, and of each of its components.

    Attributes
    ----------
    plate
        Its name.
    change, error
        One change for all components, and its standard error.
    changes, errors
        One for each component, (6,). What hardly moved has a large error.
    """

    plate: str
    change: float
    error: float
    changes: Array
    errors: Array

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Which components changed more than a calibration tolerates, beyond the interval, (6,)."""
        beyond = np.abs(self.changes) - QUANTILE_95 * self.errors
        return np.asarray(beyond > MIN_GAIN_CHANGE)

    @property
    def alike(self) -> bool:
        """Whether all components have changed alike."""
        spread = np.abs(self.changes - self.change) - QUANTILE_95 * self.errors
        return bool(abs(self.change) > MIN_GAIN_CHANGE and np.all(spread < MIN_GAIN_CHANGE / 2))

    def note(self, recording: str) -> Note:
        """Say by how much the gain has changed, of all components or of some, by a recording."""
        if self.alike:
            return Note.of(
                "calibration_plate_gain",
                plate=self.plate,
                change=self.change,
                interval=QUANTILE_95 * self.error,
                recording=recording,
            )
        found = [k for k in range(6) if self.significant[k]]
        return Note.of(
            "calibration_plate_component_gain",
            plate=self.plate,
            change={WRENCH_COMPONENTS[k]: self.changes[k] for k in found},
            interval={WRENCH_COMPONENTS[k]: QUANTILE_95 * self.errors[k] for k in found},
            recording=recording,
        )


def plate_gains(
    plates: Sequence[str], predicted: Array, error: Array
) -> tuple[tuple[PlateGain, ...], float]:
    """Find the change of every component's gain that explains most of a prediction's error.

    Parameters
    ----------
    plates
        Their names.
    predicted, error
        Predicted wrench, and measured minus predicted, six components per plate in units of their
        noise, (N, 6 P).

    Returns
    -------
    gains
        One per plate, of those of which any component has changed significantly.
    explained
        By how much the significant ones together reduce the weighted squares.
    """
    p, e = (x - x.mean(axis=0) for x in (predicted, error))
    cross, square = (
        np.array([block.sum(axis=0) for block in np.array_split(product, BLOCKS)])
        for product in (p * e, p**2)
    )
    found, explained = [], 0.0
    for k, plate in enumerate(plates):
        own = slice(6 * k, 6 * k + 6)
        right, normal = cross[:, own], square[:, own]
        changes, errors = _factor(right, normal)
        change, of_all = _factor(right.sum(axis=1), normal.sum(axis=1))
        gain = PlateGain(plate, float(change), float(of_all), changes, errors)
        if gain.significant.any():
            found.append(gain)
            explained += float((changes * right.sum(axis=0))[gain.significant].sum())
    return tuple(found), explained


def _factor(right: Array, normal: Array) -> tuple[Array, Array]:
    """Give ``Σ right / Σ normal`` over blocks, and its standard error by a jackknife over them."""
    least = np.finfo(float).tiny
    drawn = (right.sum(axis=0) - right) / np.maximum(normal.sum(axis=0) - normal, least)
    noise = np.sqrt(np.var(drawn, axis=0) * (len(right) - 1))
    change: Array = right.sum(axis=0) / np.maximum(normal.sum(axis=0), least)
    return change, np.hypot(noise, GAIN_ERROR)


def sensor_offset(
    readings: Array, gains: Sequence[Array], zeros: Array
) -> tuple[int, Array] | None:
    """Find the sensor whose offset, not the plates' zero, has changed.

    Parameters
    ----------
    readings
        Change of the sensors' mean readings since the calibration, (3 S,) [m/s²].
    gains
        The calibration's for each sensor, (3, C).
    zeros
        Change of the plates' zeros in the same units, (C,).

    Returns
    -------
    sensor, offset
        Its number, and its offset's change (3,) [m/s²]; None where no sensor's offset explains the
        zeros, or its mean reading has not changed by about as much.
    """
    for k, gain in enumerate(gains):
        offset = -np.linalg.lstsq(gain.T, zeros)[0]
        left = np.sum((zeros + offset @ gain) ** 2)
        unlike = np.linalg.norm(readings[3 * k : 3 * k + 3] - offset)
        if left < (1 - MIN_EXPLAINED) * np.sum(zeros**2) and unlike < np.linalg.norm(offset) / 2:
            return k, np.asarray(offset)
    return None
