"""Pitch and sway: the wrench of an empty plate as a linear function of accelerometers.

The load cells of a plate carry the belt assembly above them. When the platform moves they measure
its weight and inertia too. Both are linear in what accelerometers on the platform read, so one
recording of the empty, moving treadmill is enough to identify them.
"""

from dataclasses import dataclass, field
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from compensation.inertia.model_error import ModelError
from compensation.inputs import (
    read_rate,
    read_table,
    refuse_gaps,
    refuse_other_units,
    refuse_unequal,
)
from hbm.signals.filtering import Method, low_pass
from hbm.spatial import Array, freeze_arrays


@dataclass(frozen=True, slots=True)
class Setup:
    """How the signals of a fit were recorded and filtered; a model is valid for no other.

    Attributes
    ----------
    sensors
        Accelerometer names in the order of their columns.
    rate_hz
        Sampling rate of accelerations and wrench [Hz].
    cutoff_hz
        Low-pass cut-off that was applied to both [Hz]; None where they are unfiltered.
    filter_method
        How they were low-passed, as `low_pass` names it; of no meaning where they are unfiltered.

    Examples
    --------
    >>> setup = Setup(sensors=("rear", "front"), rate_hz=1000.0, cutoff_hz=20.0)
    >>> setup.filter_method
    'zero_phase'
    """

    sensors: tuple[str, ...]
    rate_hz: float
    cutoff_hz: float | None
    filter_method: Method = "zero_phase"

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        read_rate(self.rate_hz)
        if len(set(self.sensors)) != len(self.sensors):
            raise ValueError(f"accelerometer names must be unique, got {self.sensors}")
        if self.filter_method not in get_args(Method):
            raise ValueError(
                f"filter_method must be one of {', '.join(get_args(Method))}, "
                f"got {self.filter_method!r}"
            )

    def low_pass(self, signal: ArrayLike, time: ArrayLike) -> Array:
        """Filter signals as those of the fit were.

        Parameters
        ----------
        signal
            Channels, (N, ...). Gaps (NaN) stay gaps.
        time
            Sample times, (N,) [s]; or one number, the sampling rate [Hz].

        Returns
        -------
        Array
            The same channels through the fit's low-pass, (N, ...); as they are where the fit's
            were unfiltered.

        Raises
        ------
        ValueError
            As `low_pass`.
        """
        if self.cutoff_hz is None:
            return np.array(signal, float)
        return low_pass(signal, time, self.cutoff_hz, self.filter_method)


@dataclass(frozen=True, slots=True)
class InertiaModel:
    """The wrench that a plate measures because its own belt assembly is moved and tilted.

    Accelerations are specific force (acceleration minus gravity, which an accelerometer measures)
    in m/s², three columns per sensor, each sensor in its own fixed axes. Wrenches are in the moving
    plate's frame, about its origin, before any rotation.

    Attributes
    ----------
    gain
        (K + 1, 6) [N or N·m per m/s²]; the last row is the offset [N, N·m]. K = k (1 + lags) and
        k = 3 × sensors: a dynamic model has gains of differences too, as `lags_s` says.
    covariance
        Covariance of the gain's columns, (6, K + 1, K + 1).
    sigma
        Standard deviation of the calibration's residual, (6,) [N, N·m].
    rank, condition
        Rank of the design matrix with its offset, at most K + 1; condition number of its centred
        channels in units of their standard deviation, or of their noise where that was given.
    r_squared, rms_measured, rms_compensated
        Of the calibration, per component, (6,).
    acceleration_mean, acceleration_covariance
        Of the calibration, (k,) [m/s²] and (k, k) [m²/s⁴].
    acceleration_low, acceleration_high
        Range of the calibration, (k,) [m/s²].
    sensor_noise
        Noise of the accelerometers that the fit allowed for, (k,) [m/s²]; 0 for none.
    samples
        Number of samples fitted.
    setup
        How the signals were recorded; None where it was not stated.
    correlation
        Of the calibration's residual between components, (6, 6), below `SLOW_HZ` where its rate is
        known; by default none.
    rms_slow
        As `rms_compensated`, of what passes a low-pass of `SLOW_HZ` as residuals do; by default,
        where the rate is unknown, `rms_compensated`.
    model_error
        What the model leaves besides noise, and the plate's zero; None of files of version 2.
    lags_s
        Of a dynamic model: its accelerations are those of `dynamic_channels` for these lags, the
        readings first, (N, K). Empty for a static one, of which K = k [s].

    Examples
    --------
    >>> import compensation, numpy as np
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> model = compensation.fit_inertia(accelerations, wrench)
    >>> left = model.compensate(accelerations, wrench)
    >>> bool(np.abs(left).max() < 1e-9)
    True
    """

    gain: Array
    covariance: Array
    sigma: Array
    rank: int
    condition: float
    r_squared: Array
    rms_measured: Array
    rms_compensated: Array
    acceleration_mean: Array
    acceleration_covariance: Array
    acceleration_low: Array
    acceleration_high: Array
    sensor_noise: Array
    samples: int
    setup: Setup | None = None
    correlation: Array = field(default_factory=lambda: np.eye(6))
    rms_slow: Array | None = None
    model_error: ModelError | None = None
    lags_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.rms_slow is None:
            object.__setattr__(self, "rms_slow", self.rms_compensated)
        object.__setattr__(self, "lags_s", tuple(self.lags_s))
        channels = len(np.atleast_1d(self.gain)) - 1
        k = channels // (1 + len(self.lags_s))
        rows = k * (1 + len(self.lags_s)) + 1
        shapes = {
            "gain": (rows, 6),
            "covariance": (6, rows, rows),
            **dict.fromkeys(("sigma", "r_squared", "rms_measured"), (6,)),
            **dict.fromkeys(("rms_compensated", "rms_slow"), (6,)),
            **dict.fromkeys(("acceleration_mean", "acceleration_low", "acceleration_high"), (k,)),
            "sensor_noise": (k,),
            "acceleration_covariance": (k, k),
            "correlation": (6, 6),
        }
        freeze_arrays(self, "inertia model", **shapes)
        for name in shapes:
            refuse_gaps(np.atleast_1d(getattr(self, name)), f"inertia model: {name}")
        sensor_names(self.setup, k)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the accelerometers: the setup's, or numbers from 1."""
        return sensor_names(self.setup, len(self.acceleration_mean))

    def predict(self, accelerations: ArrayLike) -> Array:
        """Predict the wrench of the empty plate.

        Parameters
        ----------
        accelerations
            Readings of the accelerometers, low-passed as those of the fit, (N, K) [m/s²].

        Returns
        -------
        Array
            Wrenches in the moving plate frame about its origin, (N, 6) [N, N·m].

        Raises
        ------
        ValueError
            Wrong shape, no samples, gaps, or accelerations in another unit.
        """
        return np.asarray(self._design(accelerations) @ self.gain)

    def compensate(self, accelerations: ArrayLike, wrench: ArrayLike) -> Array:
        """Subtract the predicted wrench from a measured one at the same instants.

        Both are as for `predict`, and so are the errors; the remainder is the action on the subject
        and noise, (N, 6) [N, N·m].
        """
        predicted, wrench = self.predict(accelerations), read_table(wrench, "wrench", 6)
        refuse_unequal(accelerations=predicted, wrench=wrench)
        return wrench - predicted

    def uncertainty(
        self,
        accelerations: ArrayLike,
        slow: bool = False,
        rate_hz: float | None = None,
        zero: bool = True,
        belts_mps: ArrayLike | None = None,
    ) -> Array:
        """Give the standard deviation of a compensated wrench, sample by sample.

        Parameters
        ----------
        accelerations
            Readings of the accelerometers over a trial, low-passed as those of the fit, (N, K)
            [m/s²]; NaN where unknown.
        slow
            Whether the wrench passes `SLOW_HZ` afterwards, which leaves less of the noise.
        rate_hz
            Of the readings [Hz]; None for the setup's.
        zero
            Whether the plate's zero counts, which is the same in all samples of a trial.
        belts_mps
            Speed of the belts, (N,) or one number [m/s]; None where unknown, as of
            `ModelError.variance`.

        Returns
        -------
        Array
            One standard deviation, (N, 6) [N, N·m]; a 95 % interval is ± 1.96 of it. It holds the
            noise of plate and accelerometers, what the model does not explain of a motion like
            this (`ModelError`), the uncertainty of the gains at these readings, and the plate's
            zero. Without `model_error` it is noise and gains alone. NaN where the readings are.
        """
        a = np.asarray(accelerations, float)
        finite = np.isfinite(a).all(axis=1)
        variance = np.full((len(a), 6), np.nan)
        if finite.any():
            x = self._design(a[finite])
            # xᵀ C x of each component: uncertainty of the gains
            variance[finite] = np.stack([np.sum((x @ c) * x, axis=1) for c in self.covariance], 1)
        error = self.model_error
        if error is None:
            noise = np.asarray(self.rms_slow if slow else self.sigma)
            return np.asarray(np.sqrt(variance + noise**2))
        rate = rate_hz or (self.setup.rate_hz if self.setup is not None else 1.0)
        # and what no gain explains, by how the platform moves
        variance += error.variance(a[:, : len(self.sensor_noise)], rate, slow, belts_mps)
        return np.asarray(np.sqrt(variance + (error.zero**2 if zero else 0.0)))

    def require(self, setup: Setup) -> None:
        """Refuse signals of other sensors, rate or filter than those of the fit: a ValueError."""
        if self.setup is None:
            raise ValueError("the model has no set-up of its recording; fit it with one")
        fields = ["sensors", "rate_hz", "cutoff_hz"]
        if setup.cutoff_hz is not None:
            fields.append("filter_method")
        differ = [
            f"{name} {getattr(self.setup, name)!r}, but the recording has {getattr(setup, name)!r}"
            for name in fields
            if getattr(self.setup, name) != getattr(setup, name)
        ]
        if differ:
            raise ValueError(f"calibration does not match: it has {'; '.join(differ)}")

    def _design(self, accelerations: ArrayLike) -> Array:
        a = read_table(accelerations, "accelerations", len(self.gain) - 1)
        refuse_other_units(a[:, : len(self.acceleration_mean)], self.sensors)
        return np.column_stack([a, np.ones(len(a))])


def sensor_names(setup: Setup | None, channels: int) -> tuple[str, ...]:
    """Give the setup's sensor names, or numbers from 1; a ValueError where they do not fit."""
    if channels == 0 or channels % 3:
        raise ValueError(
            f"accelerations have {channels} channels, expected 3 for every accelerometer"
        )
    if setup is None:
        return tuple(str(n + 1) for n in range(channels // 3))
    if len(setup.sensors) != channels // 3:
        raise ValueError(
            f"{len(setup.sensors)} accelerometer names {setup.sensors} for {channels} channels, "
            "expected 3 channels for each"
        )
    return setup.sensors
