"""What a compensation leaves besides noise, as the accelerometers of a trial let expect it.

A linear model of a few accelerometers does not know how a platform bends, rolls on its base or is
shaken by people. What it leaves grows with the motion, differently in every direction and band of
frequencies, and with the speed of the belts, whose rollers shake their plate more than the
platform: the calibration's recordings, each part predicted by the others, show how.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from compensation.inputs import refuse_gaps
from hbm.numbers import read_numbers
from hbm.signals.filtering import low_pass
from hbm.spatial import Array, read_only

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "model_error")

SLOW_HZ: Final = 6.0
"""Cut-off of the Human Body Model, through which residuals pass."""
ZERO_SD: Final = np.repeat([0.5, 0.25], 3)
"""Standard deviation of a plate's zero from recording to recording [N, N·m], as far as recordings
do not show it; assumed, of a plate that is zeroed on the same day."""
SMOOTHING_S: Final = 1.0
"""Over which energies are averaged: a few periods of what shakes a platform."""
ITERATIONS: Final = 7
"""Of the weights of the fit; recordings gain weight in the second half."""
RUNNING_MPS: Final = 0.05
"""Speed above which belts run: the noise of a speed channel is less."""


@dataclass(frozen=True, slots=True)
class ModelError:
    """Variance of what a model leaves of an empty plate, by how the platform moves.

    Attributes
    ----------
    center
        Mean readings of the calibration, (k,) [m/s²].
    directions
        Orthonormal directions of the readings in every band, (B, k, k), one per column; B is 0
        where the calibration's rate is unknown, and 6 else.
    per_energy
        Variance per energy in each direction of each band [N² or (N·m)² per (m/s²)²], of what
        passed the calibration's low-pass and of its part below 6 Hz, (2, B k, 6).
    floor
        Variance at rest, of the same two, (2, 6) [N², (N·m)²].
    zero
        Standard deviation of a trial's zero about the calibration's, (6,) [N, N·m].
    per_belts
        Of the same two, variance where belts run, and variance per fourth power of their speed,
        (2, 2, 6) [N², (N·m)²; per (m/s)⁴]; by default none.
    belts_mps
        Speed of the belts in every recording of the calibration, without a sign, (M,) [m/s]; empty
        where it is unknown.

    Examples
    --------
    >>> bands, zero = np.zeros((0, 3, 3)), np.zeros(6)
    >>> quiet = ModelError(np.zeros(3), bands, np.zeros((2, 0, 6)), np.ones((2, 6)), zero)
    >>> quiet.variance(np.zeros((2, 3)), 100.0)[0]
    array([1., 1., 1., 1., 1., 1.])
    """

    center: Array
    directions: Array
    per_energy: Array
    floor: Array
    zero: Array
    per_belts: Array = field(default_factory=lambda: np.zeros((2, 2, 6)))
    belts_mps: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        k = np.size(self.center)
        bands = len(self.directions)
        shapes = {
            "center": (k,),
            "directions": (bands, k, k),
            "per_energy": (2, bands * k, 6),
            "floor": (2, 6),
            "zero": (6,),
            "per_belts": (2, 2, 6),
            "belts_mps": (np.size(self.belts_mps),),
        }
        for name, shape in shapes.items():
            value = read_only(np.reshape(getattr(self, name), shape))
            if value.size:
                refuse_gaps(value, f"model error: {name}")
            object.__setattr__(self, name, value)
        object.__setattr__(self, "belts_mps", read_only(np.abs(self.belts_mps)))

    @property
    def fastest_mps(self) -> float | None:
        """The largest belt speed of its recordings [m/s]; None where they are unknown."""
        return float(self.belts_mps.max()) if self.belts_mps.size else None

    def variance(
        self,
        accelerations: ArrayLike,
        rate_hz: float,
        slow: bool = False,
        belts_mps: ArrayLike | None = None,
    ) -> Array:
        """Give the variance to expect of what the model leaves, but for the zero.

        Parameters
        ----------
        accelerations
            Readings of a trial, low-passed as those of the calibration, (N, k) [m/s²]; NaN where
            unknown.
        rate_hz
            Their rate [Hz].
        slow
            Whether 6 Hz is passed afterwards.
        belts_mps
            Speed of the belts, (N,) or one number [m/s]; None or NaN where unknown: then that of
            the calibration's fastest recording.

        Returns
        -------
        Array
            (N, 6) [N², (N·m)²]; NaN where the readings are unknown.
        """
        a = np.asarray(accelerations, float)
        fastest = self.fastest_mps or 0.0
        # where the belts' speed is unknown, that of the calibration's fastest recording
        speed = np.asarray(fastest if belts_mps is None else belts_mps, float)
        terms = _belt_terms(np.where(np.isnan(speed), fastest, speed))
        floor = self.floor[int(slow)] + terms @ self.per_belts[int(slow)]
        finite = np.isfinite(a).all(axis=1)
        if not len(self.directions):
            return np.where(finite[:, None], floor, np.nan)
        # variance in proportion to the energy of motion in each direction and band
        energy = _smooth(self.motion(a, rate_hz) ** 2, rate_hz)
        return np.asarray(energy @ self.per_energy[int(slow)] + floor)

    def motion(self, accelerations: ArrayLike, rate_hz: float) -> Array:
        """Give the motion of a trial by direction and band, of whose energies the error is made.

        Arguments are those of `variance`; about the calibration's mean, in the order of
        `per_energy`, (N, B k) [m/s²]; NaN where the readings are unknown.
        """
        a = np.asarray(accelerations, float)
        if not len(self.directions):
            return np.empty((len(a), 0))
        finite = np.isfinite(a).all(axis=1, keepdims=True)
        bands = _bands(np.where(finite, a, np.nan) - self.center, rate_hz)
        return _turned(bands, self.directions)


def fit_model_error(
    accelerations: Sequence[Array],
    unseen: Sequence[Array],
    rate_hz: float | None,
    cutoff_hz: float | None,
    zero: ArrayLike,
    belts_mps: ArrayLike = (),
) -> ModelError:
    """Fit how the squares of what a model leaves grow with the motion of the platform.

    Parameters
    ----------
    accelerations
        Readings of every recording of the calibration, (N, k) [m/s²].
    unseen
        What is left of each part of each recording by a model fitted to the others, about the zero
        of the recording, (N, 6) [N, N·m].
    rate_hz, cutoff_hz
        Of all of them; a rate of None where it is unknown: then, and where a recording is too
        short, the error is the same in every motion.
    zero
        Standard deviation of a trial's zero about the calibration's, (6,) [N, N·m].
    belts_mps
        Speed of the belts in every recording, (M,) [m/s]; empty where it is unknown.

    Notes
    -----
    The readings are split into bands; the directions of a band are the principal ones of the
    recordings, each of which counts alike, so that neither the axes of the sensors nor the longest
    recording decide. Squared errors, averaged over a second, are then a sum of a constant and of
    the energies in all directions of all bands, with factors that are not negative; weighted least
    squares by their expectation, as squares of normal errors scatter in proportion to it. An
    energy that hardly changes is left to the constant: its factor would be chance, and a trial in
    which somebody shakes the platform in that direction would be expected to leave anything.

    Belts add a constant where they run, of friction and drives, and a part that grows with the
    fourth power of their speed, as the square of the force of unbalanced rollers does. Either is
    told from the rest only where recordings differ in it: by one with belts at rest, and by two
    speeds of running belts. Else it is in the constant. Of the rollers' angles few recordings show
    little: their part is widened as an interval of Student's t is.
    """
    speeds = np.abs(np.array(belts_mps, float))
    center = np.mean([a.mean(axis=0) for a in accelerations], axis=0)
    k, slow = len(center), [slow_part(part, rate_hz) for part in unseen]
    left_slow = [part for part in slow if part is not None]
    if rate_hz is None or len(left_slow) < len(slow):
        floor = np.tile(np.mean(np.vstack(unseen) ** 2, axis=0), (2, 1))
        none = np.zeros((0, k, k)), np.zeros((2, 0, 6))
        return ModelError(center, *none, floor, np.array(zero), belts_mps=speeds)
    # fewer samples hold as much of a low-passed signal
    step = thinning_step(rate_hz, cutoff_hz)
    rate_hz /= step
    accelerations, unseen, left_slow = (
        [part[::step] for part in parts] for parts in (accelerations, unseen, left_slow)
    )
    center = np.mean([a.mean(axis=0) for a in accelerations], axis=0)
    bands = [_bands(a - center, rate_hz) for a in accelerations]
    directions = np.array([_directions(of_band) for of_band in zip(*bands, strict=True)])
    window = max(round(SMOOTHING_S * rate_hz), 1)

    def averaged(values: Array) -> Array:
        """Average squares over time, one row for every `SMOOTHING_S`."""
        return _smooth(values**2, rate_hz)[window // 2 :: window]

    energies = [averaged(_turned(band, directions)) for band in bands]
    # terms of belts only where recordings tell them apart
    running = speeds[speeds > RUNNING_MPS]
    several = running.max(initial=0.0) > LIMITS.faster * running.min(initial=np.inf)
    shown = [len(running) < len(speeds), bool(several)]  # whether recordings tell each term apart
    of_belts = _belt_terms(speeds) * shown if len(speeds) else np.zeros((len(energies), 2))
    designs = [
        np.column_stack([energy, np.tile([*terms, 1.0], (len(energy), 1))])
        for energy, terms in zip(energies, of_belts, strict=True)
    ]
    # an energy that hardly varies cannot be told from the constant
    together = np.vstack(designs)
    changing = together.std(axis=0) > LIMITS.least_variation * together.mean(axis=0)
    changing[-3:] = True  # belts and constant
    designs = [design * changing for design in designs]
    factors = np.array(
        [_not_negative(designs, [averaged(part) for part in side]) for side in (unseen, left_slow)]
    )
    if speeds.any():  # the factor of the variance that grows with speed: few recordings show it
        # effective number of recordings with unbalanced rollers, as of weights
        recordings = np.sum(speeds**4) ** 2 / np.sum(speeds**8)
        factors[:, -2 if several else -3] *= widening(LIMITS.belt_degrees * recordings) ** 2
    energies_and_belts = factors[:, :-3], factors[:, -1], np.array(zero), factors[:, -3:-1]
    return ModelError(center, directions, *energies_and_belts, speeds)


def thinning_step(rate_hz: float, cutoff_hz: float | None) -> int:
    """Give how many samples apart those are that hold all of a low-passed signal; 1 of any other.

    Five samples per period of the cut-off keep what passed a second-order low-pass.
    """
    return 1 if cutoff_hz is None else max(int(rate_hz / (5.0 * cutoff_hz)), 1)


def widening(degrees: float) -> float:
    """Give the factor of a standard deviation of few degrees of freedom, ± 1.96 of which hold 95 %.

    Examples
    --------
    >>> f"{widening(6):.2f}, {widening(1000):.2f}"
    '1.25, 1.00'
    """
    return float(scipy.stats.t.ppf(0.975, degrees) / scipy.stats.norm.ppf(0.975))


def zero_of_trials(zeros: ArrayLike, given_sd: ArrayLike | None = None) -> Array:
    """Give the standard deviation of a trial's zero about that of a calibration.

    Parameters
    ----------
    zeros
        Zero of the plate in every recording of the calibration, (M, 6) [N, N·m]; the calibration's
        is their mean.
    given_sd
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
    # a trial's zero differs by its own scatter, and by the error of the calibration's mean
    both = np.sqrt(1 + 1 / len(zeros))
    if len(zeros) == 1 or given_sd is not None:
        sd = np.broadcast_to(np.asarray(ZERO_SD if given_sd is None else given_sd, float), (6,))
        if not np.all(np.isfinite(sd) & (sd >= 0)):
            raise ValueError(f"zero_sd must be 0 or positive, got {sd}")
        return np.asarray(both * sd)
    # variances shrink to the mean of three forces or moments, and that to the assumed one
    squares = np.sum((zeros - zeros.mean(axis=0)) ** 2, axis=0)
    alike = np.repeat(squares.reshape(2, 3).sum(axis=1), 3)
    degrees = LIMITS.zero_degrees + 3 * (len(zeros) - 1)
    pooled = (alike + LIMITS.zero_degrees * ZERO_SD**2) / degrees
    variance = (squares + LIMITS.zero_degrees * pooled) / (len(zeros) - 1 + LIMITS.zero_degrees)
    return np.asarray(both * np.sqrt(variance) * widening(degrees))


def slow_part(residual: Array, rate_hz: float | None) -> Array | None:
    """Give what passes the filter of trials, (N, C); None without a second of known rate.

    The calibration's own filter passes vibration of the platform's base, which is not in residuals.
    """
    if rate_hz is None or len(residual) < rate_hz or rate_hz < 4 * SLOW_HZ:
        return None
    return low_pass(residual, rate_hz, SLOW_HZ, "zero_phase")


def residual_correlation(residual: Array, rate_hz: float | None = None) -> Array:
    """Give the correlations of what calibrations leave, of several plates side by side, (C, C).

    Of samples at common instants, (N, C); below 6 Hz where a second of known rate is given; 0 with
    a channel of which nothing is left. Plates are compensated by the same accelerometers, whose
    noise is in all of them.
    """
    slow = slow_part(residual, rate_hz)
    return correlation_of(residual if slow is None else slow)


def correlation_of(residual: Array) -> Array:
    """Give the correlations between channels, (C, C); 0 with one that leaves nothing."""
    size = np.sqrt(np.mean(residual**2, axis=0))
    scaled = residual / np.where(size > 0, size, 1.0)
    correlation = scaled.T @ scaled / len(scaled)
    np.fill_diagonal(correlation, 1.0)
    return correlation


def _belt_terms(speed: Array) -> Array:
    """Give whether belts run, and the fourth power of their speed, (..., 2)."""
    return np.stack([np.abs(speed) > RUNNING_MPS, speed**4], axis=-1)


def _bands(moved: Array, rate_hz: float) -> list[Array]:
    """Split readings (N, k) into bands of frequencies; short parts between gaps count as slow."""
    # commanded motion and steps, their harmonics, modes of a platform's base, and the rest
    below = [_below(moved, rate_hz, edge) for edge in (2.0, 4.0, 6.0, 9.0, 12.0)]
    edges = [np.zeros_like(moved), *below, moved]
    return [high - low for low, high in pairwise(edges)]


def _below(moved: Array, rate_hz: float, edge_hz: float) -> Array:
    if edge_hz >= rate_hz / 2 or len(moved) * edge_hz < rate_hz or len(moved) < 2:
        return moved
    # gaps and short parts have no slow part: they stay whole in one band
    slow = low_pass(moved, rate_hz, edge_hz, "zero_phase")
    return np.where(np.isnan(slow), moved, slow)


def _directions(recordings: Sequence[Array]) -> Array:
    """Give the principal directions of a band, (k, k), all recordings counting alike."""
    squares = [part.T @ part for part in recordings]
    traces = [max(float(np.trace(square)), np.finfo(float).tiny) for square in squares]
    # each recording by its own energy, so that long or strong ones do not decide
    alike = np.sum([s / trace for s, trace in zip(squares, traces, strict=True)], axis=0)
    return np.asarray(np.linalg.eigh(alike)[1])


def _turned(bands: Sequence[Array], directions: Array) -> Array:
    """Give readings in every direction of every band, (N, B k)."""
    channels = [turned.T @ band.T for band, turned in zip(bands, directions, strict=True)]
    return np.concatenate(channels).T


def _smooth(squares: Array, rate_hz: float) -> Array:
    """Average (N, C) over `SMOOTHING_S`, over what is known of it; gaps stay gaps."""
    count = max(round(SMOOTHING_S * rate_hz), 1)
    finite = np.isfinite(squares).all(axis=1, keepdims=True)
    filled = np.where(finite, squares, 0.0)
    # mean over the known samples of the window: sum by the part that is known
    total, fraction = (
        scipy.ndimage.uniform_filter1d(x.T, count, mode="constant").T
        for x in (filled, finite.astype(float))
    )
    return np.asarray(np.where(finite, total / np.maximum(fraction, 0.5 / count), np.nan))


def _not_negative(designs: Sequence[Array], squares: Sequence[Array]) -> Array:
    """Give factors ≥ 0 of the designs' columns, (F, 6), that explain squares of each recording."""
    counts = [len(part) for part in squares]
    recording = np.repeat(np.arange(len(counts)), counts)
    design, stacked = np.vstack(designs), np.vstack(squares)
    size = np.maximum(design.max(axis=0), np.finfo(float).tiny)
    scaled = design / size
    factors = np.zeros((design.shape[1], stacked.shape[1]))
    for k, square in enumerate(stacked.T):
        if not square.any():
            continue
        expected, of_recording = np.full(len(square), square.mean()), 1 / np.array(counts)
        total = np.bincount(recording, square)
        for iteration in range(ITERATIONS):
            if iteration > ITERATIONS // 2:
                # recordings whose squares are found too small gain weight
                underrated = total / np.maximum(np.bincount(recording, expected), 1e-9 * total)
                of_recording = of_recording * np.clip(underrated, 1, 10.0) ** 2
            # weights by the expectation: squares scatter in proportion to it
            least = np.maximum(0.05 * square, 0.001 * square.mean())
            weight = np.sqrt(of_recording)[recording] / np.maximum(expected, least)
            # variances add and cannot be negative
            solved, _ = scipy.optimize.nnls(scaled * weight[:, None], square * weight)
            expected = scaled @ solved
        factors[:, k] = solved / size
    return factors
