"""How sure the size of residuals is: what usual errors of a measurement change it by.

The delta method adds the effects of all causes, each about as large as usual.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.dynamics import Dynamics
from hbm.kinematics import solve_ik
from hbm.markers import Markers
from hbm.signals.samples import mean_rate_hz
from hbm.spatial import Array, Indices
from pipeline.explain.budget import Bands, CauseUncertainty, CycleRms, RmsUncertainty
from pipeline.explain.cause import SHARED_WITHIN, Cause, priors
from pipeline.explain.processing_chain import ProcessingChain
from pipeline.explain.shares import NORMAL_95
from pipeline.trial.residuals import counted, reported
from pipeline.trial.result import TrialResult

REST_HZ: Final = 6.0
"""Cut-off at which the noise of plates is stated."""
ROUNDING: Final = 1e-13
"""Of the largest eigenvalue, below which others are none."""
TINY: Final = 1e-30
"""Of a variance, so that nothing is divided by zero."""
LOGARITHMS: Final = np.arange(-64.0, 64.0, 0.25)
"""Of the variable of integration, in which the integrand falls by e^-32 towards either end."""
DRAWS: Final = 1000
"""Of what trials share: a standard deviation is then sure to 2 %."""
DECIMALS: Final = 3
"""Of draws of an RMS [N, N·m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty:
    """How sure the RMS of residuals is over some frames, by the delta method.

    Attributes
    ----------
    rms
        As measured, (6,) [N, N·m].
    mean, deviation
        Mean and standard deviation that the RMS has if errors of usual size are added, (6,).
    changes
        What one usual size of each cause changes the RMS by, (K, 6); the sign tells which way.
    squares
        One standard deviation of what the square of each cause changes it by, (K, 6).
    of_noise
        One standard deviation of the RMS due to the noise of samples, (6,).
    draws
        The RMS with causes of drawn sizes, (N, 6).
    """

    rms: Array
    mean: Array
    deviation: Array
    changes: Array
    squares: Array
    of_noise: Array
    draws: Array


def rms_uncertainty(
    residual: Array, usual: Array, noise: Array, samples: float, sizes: Array | None = None
) -> Uncertainty:
    """Propagate usual sizes of causes to the RMS of a residual.

    Parameters
    ----------
    residual
        At the frames that count, (T, 6) [N, N·m].
    usual
        What one usual size of each cause adds, (K, T, 6).
    noise
        One standard deviation of the noise of samples, (6,).
    samples
        Independent samples of it in a frame.
    sizes
        Of the causes, in usual sizes, and of the noise as a whole, drawn N times, (N, K + 1); by
        default none.

    Returns
    -------
    Uncertainty
        The causes are independent of each other and normally distributed.

    Notes
    -----
    To first order in the causes, the residual is ``r + Σ sₖ eₖ`` with standard normal sizes s. Its
    mean square, a quadratic form in them, has the mean ``⟨r, r⟩ + Σ ⟨eₖ, eₖ⟩`` and the variance
    ``4 Σ ⟨r, eₖ⟩² + 2 ΣΣ ⟨eₖ, eₗ⟩²``, each ``⟨,⟩`` over T (Mathai and Provost 1992, Quadratic forms
    in random variables, 3.2b), which says how much of it is due to each cause. The mean of its root
    follows from its moment-generating function, and with it the deviation: squares of causes do not
    average out, and the gradient of the RMS alone (JCGM 100:2008, 5.1.2) is wrong where causes do
    as much as the residual. Noise is a further cause that is independent of itself in each sample.

    Examples
    --------
    >>> time = np.linspace(0, 1, 101)[:, None]
    >>> residual = np.full((101, 6), 10.0)
    >>> usual = np.ones((1, 101, 6))
    >>> found = rms_uncertainty(residual, usual, np.zeros(6), samples=0.1)
    >>> found.deviation.round(1).tolist(), found.changes[0].round(1).tolist()
    ([1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    """
    frames = len(residual)
    square = (residual**2).mean(axis=0)
    columns = np.moveaxis(usual, 2, 0)
    products = columns @ columns.transpose(0, 2, 1) / frames
    along = np.einsum("tx,ktx->xk", residual, usual) / frames
    of_noise = 2 * np.sqrt(square / (samples * frames)) * noise
    linear, squares = 2 * along.T, np.sqrt(2 * (products**2).sum(axis=2).T)
    expected = square + np.einsum("xkk->x", products) + noise**2
    mean = np.array(
        [
            mean_root(own + apart**2, gram, towards)
            for own, apart, gram, towards in zip(square, noise, products, along, strict=True)
        ]
    )
    found = np.maximum(expected - mean**2, 0.0) + of_noise**2 / (4 * expected + TINY)
    deviation = np.sqrt(found)
    variance = (linear**2 + squares**2).sum(axis=0) + of_noise**2
    scale = deviation / np.sqrt(variance + TINY)
    of_noise = scale * of_noise
    drawn = np.zeros((0, len(usual) + 1)) if sizes is None else sizes
    size, apart = drawn[:, :-1], drawn[:, -1:]
    added = [(size @ gram * size).sum(axis=1) for gram in products]
    form = square + 2 * size @ along.T + np.transpose(added)
    draws = np.maximum(np.sqrt(np.maximum(form, 0.0)) + apart * of_noise, 0.0)
    return Uncertainty(
        np.sqrt(square), mean, deviation, scale * linear, scale * squares, of_noise, draws
    )


def shared_sizes(causes: Sequence[Cause], subject: str, trial: str, draws: int) -> Array:
    """Draw sizes of causes: in all trials that share a cause, the same.

    Parameters
    ----------
    causes
        Of a trial.
    subject, trial
        Names of them.
    draws
        How many.

    Returns
    -------
    Array
        In usual sizes, and in the last column of the noise of the trial, (draws, K + 1): standard
        normal numbers that depend on the cause's name and on the laboratory, subject or trial
        (`pipeline.explain.cause.SHARED_WITHIN`) alone.

    Examples
    --------
    >>> shared_sizes([], "sub01", "walk.c3d", draws=2).shape
    (2, 1)
    """
    within = {"laboratory": "", "subject": subject, "trial": f"{subject}/{trial}"}
    columns = []
    for cause in causes:
        if cause.along is None:
            columns.append(_normal(draws, within[SHARED_WITHIN[cause.group]], cause.name))
        else:
            errors = _normal((draws, len(cause.along)), cause.group, str(len(cause.along)))
            columns.append(errors @ cause.along)
    return np.column_stack([*columns, _normal(draws, within["trial"], "noise")])


def _normal(shape: int | tuple[int, int], *names: str) -> Array:
    """Draw standard normal numbers that depend on names alone."""
    seed = hashlib.sha256("\n".join(names).encode()).digest()
    return np.random.default_rng(int.from_bytes(seed)).standard_normal(shape)


def mean_root(square: float, products: Array, along: Array) -> float:
    """Give the mean of the root of a quadratic form in standard normal variables.

    Parameters
    ----------
    square, along, products
        Of the form ``square + 2 along · s + s · products s``, which is nowhere negative: a number,
        (K,) and (K, K).

    Returns
    -------
    float
        ``E √Q = ∫ t^(-3/2) (1 − E exp(−t Q)) dt / (2 √π)`` over t from 0 to infinity, by the
        trapezoidal rule over the logarithm of t, where it converges exponentially.

    Examples
    --------
    >>> print(f"{mean_root(0.0, np.eye(1), np.zeros(1)):.6f}")  # √(2/π), of a half-normal variable
    0.797885
    """
    eigenvalue, axes = np.linalg.eigh(products)
    expected = square + np.trace(products)
    if not expected > 0:
        return 0.0
    some = eigenvalue > ROUNDING * eigenvalue[-1]
    eigenvalue, towards = eigenvalue[some], axes.T[some] @ along
    inside = towards**2 / eigenvalue
    t = np.exp(LOGARITHMS)[:, None] / expected
    widened = 1 + 2 * t * eigenvalue
    exponent = -(t * inside / widened + np.log(widened) / 2).sum(axis=1)
    t = t[:, 0]
    exponent -= t * max(square - inside.sum(), 0.0)
    integrand = -np.expm1(exponent) / np.sqrt(t)
    return float(integrand.sum() * (LOGARITHMS[1] - LOGARITHMS[0]) / (2 * np.sqrt(np.pi)))


def samples_in_a_frame(chain: ProcessingChain) -> float:
    """Give how many independent samples of filtered noise a frame is: at 6 Hz of 100 Hz, 0.12."""
    return 2 * chain.settings.cutoff_hz / mean_rate_hz(chain.time)


def noise_of_samples(chain: ProcessingChain, seed: int = 0) -> Array:
    """Draw once what noise of markers and plates changes the residual by: its RMS, (6,)."""
    rng = np.random.default_rng(seed)
    noisy = with_noise(chain, chain.markers.position, np.zeros_like(chain.q), rng)
    return np.asarray(np.sqrt(np.nanmean((noisy.residual - chain.residual) ** 2, axis=0)))


def with_noise(
    chain: ProcessingChain, position: Array, unseen: Array, rng: np.random.Generator
) -> ProcessingChain:
    """Measure a chain again: markers somewhere, with other noise of markers and plates.

    Parameters
    ----------
    chain
        The trial, with the body that the inverse kinematics is to fit.
    position
        Of the markers, (T, K, 3) [m].
    unseen
        Change of coordinates that no marker shows, (T, 46).
    rng
        Noise is drawn from it.

    Returns
    -------
    ProcessingChain
        With the coordinates that the inverse kinematics finds.
    """
    known = priors()
    noise = known["marker_noise"].size * rng.standard_normal(position.shape)
    markers = Markers(chain.time, chain.markers.names, position + noise)
    at_rest = np.repeat([known["plate_noise_force"].size, known["plate_noise_moment"].size], 3)
    white = at_rest * np.sqrt(mean_rate_hz(chain.time) / (2 * REST_HZ))
    wrenches = [each + white * rng.standard_normal(each.shape) for each in chain.wrenches]
    q = solve_ik(chain.body, markers).q + unseen
    return chain.with_wrenches(wrenches).with_coordinates(q)


class Intervals:
    """How sure the residuals of a trial are, from the effects of causes of usual size.

    Parameters
    ----------
    chain
        The trial.
    causes
        What may be wrong with it.
    effects
        What each adds to the residual as it was measured, per unit, (K, T, 6).
    cycles
        Frames of each gait cycle that are explained.
    subject, trial
        Names of them: what trials share is drawn alike in all of them.
    """

    def __init__(
        self,
        chain: ProcessingChain,
        causes: Sequence[Cause],
        effects: Array,
        cycles: Sequence[Indices],
        subject: str = "",
        trial: str = "",
    ) -> None:
        self._chain, self._causes, self._cycles = chain, causes, cycles
        self._usual = np.array([cause.prior.size for cause in causes])[:, None, None] * effects
        self._noise = noise_of_samples(chain)
        self._frames = np.concatenate(cycles)
        self._samples = samples_in_a_frame(chain)
        self._sizes = shared_sizes(causes, subject, trial, DRAWS)

    def bands(self) -> Bands:
        """Give the residuals over time."""
        number = np.repeat(np.arange(len(self._cycles)), [len(own) for own in self._cycles])
        usual = self._usual[:, self._frames]
        return Bands(
            time=self._chain.time[self._frames],
            cycle=number,
            residual=reported(self._chain.residual[self._frames]),
            deviation=np.sqrt((usual**2).sum(axis=0) + self._noise**2),
        )

    def of_trial(self, result: TrialResult) -> tuple[RmsUncertainty, ...]:
        """Give how sure the RMS over all cycles is: as measured, and compensated where it is."""
        return self._over(self._frames, result)

    def of_window(self, result: TrialResult) -> tuple[RmsUncertainty, ...]:
        """Give the same over the part of the cycles that the condition asks for, if it does."""
        if result.part is None:
            return ()
        first = _first(result.motion.time, self._chain.time)
        wanted = self._frames[counted(result)[first + self._frames]]
        return self._over(wanted, result) if len(wanted) else ()

    def _over(self, frames: Indices, result: TrialResult) -> tuple[RmsUncertainty, ...]:
        """Give how sure the RMS over some frames is: as measured, and compensated where it is."""
        if result.compensated is None:
            return (self._of(frames, self._chain.residual, compensated=False),)
        measured = self._of(frames, _at(self._chain.time, result.measured), compensated=False)
        return measured, self._of(frames, self._chain.residual, compensated=True)

    def _of(self, frames: Indices, residual: Array, *, compensated: bool) -> RmsUncertainty:
        """Give how sure an RMS is; without compensation, it adds nothing."""
        own = [k for k, c in enumerate(self._causes) if compensated or c.group != "compensation"]
        sizes = self._sizes[:, [*own, -1]]
        found = rms_uncertainty(
            residual[frames], self._usual[own][:, frames], self._noise, self._samples, sizes
        )
        causes = tuple(
            CauseUncertainty(self._causes[k].name, self._causes[k].group, change, square)
            for k, change, square in zip(own, found.changes, found.squares, strict=True)
        )
        return RmsUncertainty(
            compensated=compensated,
            rms=found.rms,
            mean=found.mean,
            deviation=found.deviation,
            of_noise=found.of_noise,
            causes=causes,
            draws=found.draws.round(DECIMALS),
        )

    def of_cycles(self) -> tuple[CycleRms, ...]:
        """Give the RMS over each cycle."""
        time, residual = self._chain.time, self._chain.residual
        result = []
        for own in self._cycles:
            found = rms_uncertainty(residual[own], self._usual[:, own], self._noise, self._samples)
            low, high = interval(found.rms, found.deviation)
            start, stop = float(time[own[0]]), float(time[own[-1]])
            result.append(CycleRms(start, stop, found.rms, low, high))
        return tuple(result)


def interval(rms: Array, deviation: Array) -> tuple[Array, Array]:
    """Give the ends of a 95 % interval of an RMS, which is not negative."""
    return np.maximum(rms - NORMAL_95 * deviation, 0.0), rms + NORMAL_95 * deviation


def _at(time: Array, dynamics: Dynamics) -> Array:
    """Give the residual at some frames of a trial, (T, 6)."""
    first = _first(dynamics.time, time)
    return dynamics.residual[first : first + len(time)]


def _first(whole: Array, part: Array) -> int:
    """Give the frame of a trial at which a part of it begins."""
    return int(np.searchsorted(whole, part[0]))
