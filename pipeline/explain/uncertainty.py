"""How sure the size of residuals is: what usual errors of a measurement change it by.

The delta method adds the effects of all causes, each about as large as usual.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from hbm.ik.tracking import solve_ik
from hbm.signals.samples import mean_rate_hz
from hbm.spatial import Array, Indices
from pipeline.explain.budget import Bands, RmsUncertainty
from pipeline.explain.cause import UNSEEN, Cause, groups, priors
from pipeline.explain.linearise import ExplainedPart
from pipeline.trial.chain import Chain
from pipeline.trial.residuals import reported
from pipeline.trial.result import TrialResult


def drawn_rms(
    residual: Array,
    usual: Array,
    noise: Array,
    samples: float,
    sizes: Array,
    hidden: Array | float = 0.0,
) -> Array:
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
        Of the causes, in usual sizes, and of the noise as a whole, drawn N times, (N, K + 1).
    hidden
        Mean square of what is in the residual and would not be with more markers, (N, 6).

    Returns
    -------
    Array
        The RMS with errors of these sizes added, (N, 6).

    Notes
    -----
    To first order in the causes, the residual is ``r + Σ sₖ eₖ``, and its mean square a quadratic
    form in the sizes s: squares of causes do not average out, so that the gradient of the RMS alone
    (JCGM 100:2008, 5.1.2) is wrong where causes do as much as the residual. Noise is a further
    cause that is independent of itself in each sample.

    Examples
    --------
    >>> residual = np.full((101, 6), 10.0)
    >>> sizes = np.random.default_rng(0).standard_normal((4000, 2))
    >>> drawn = drawn_rms(residual, np.ones((1, 101, 6)), np.zeros(6), 0.1, sizes)
    >>> drawn.std(axis=0).round(1).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    """
    frames = len(residual)
    along = np.einsum("tx,ktx->kx", residual, usual) / frames
    size, apart = sizes[:, :-1], sizes[:, -1:]
    added = _mean_square(usual, size)
    # ⟨(r + Σ s e)²⟩ = ⟨r²⟩ + 2 Σ s ⟨r e⟩ + ⟨(Σ s e)²⟩, noise being independent of both
    form = (residual**2).mean(axis=0) - hidden + 2 * size @ along + added + noise**2
    rms = np.sqrt(np.maximum(form, 0.0))
    # an RMS of n independent samples of noise is itself uncertain by one part in √n
    return np.asarray(np.maximum(rms + apart * noise / np.sqrt(samples * frames), 0.0))


def _mean_square(usual: Array, size: Array) -> Array:
    """Give the mean square of what causes add, (K, T, 6), with drawn sizes, (N, K): (N, 6)."""
    # Gram matrix of the causes in each axis: frames are summed once, not once for each draw
    columns = np.moveaxis(usual, 2, 0)
    products = columns @ columns.transpose(0, 2, 1) / usual.shape[1]
    return np.transpose([(size @ gram * size).sum(axis=1) for gram in products])


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
        (`pipeline.explain.cause.groups`) alone.

    Examples
    --------
    >>> shared_sizes([], "sub01", "walk.c3d", draws=2).shape
    (2, 1)
    """
    within = {"laboratory": "", "subject": subject, "trial": f"{subject}/{trial}"}
    columns = []
    for cause in causes:
        if cause.along is None:
            columns.append(_normal(draws, within[groups()[cause.group]["within"]], cause.name))
        else:
            # combinations of the same errors of a calibration are correlated between trials
            errors = _normal((draws, len(cause.along)), cause.group, str(len(cause.along)))
            columns.append(errors @ cause.along)
    return np.column_stack([*columns, _normal(draws, within["trial"], "noise")])


def _normal(shape: int | tuple[int, int], *names: str) -> Array:
    """Draw standard normal numbers that depend on names alone."""
    seed = hashlib.sha256("\n".join(names).encode()).digest()
    return np.random.default_rng(int.from_bytes(seed)).standard_normal(shape)


def noise_of_samples(chain: Chain, seed: int = 0) -> Array:
    """Draw once what noise of markers and plates changes the residual by: its RMS, (6,)."""
    rng = np.random.default_rng(seed)
    noisy = with_noise(chain, np.zeros_like(chain.q), rng)
    return np.asarray(np.sqrt(np.nanmean((noisy.residual - chain.residual) ** 2, axis=0)))


def with_noise(chain: Chain, unseen: Array, rng: np.random.Generator) -> Chain:
    """Measure a chain again: with other noise of markers and plates.

    Parameters
    ----------
    chain
        The trial, with the body that the inverse kinematics is to fit.
    unseen
        Change of coordinates that no marker shows, (T, 46).
    rng
        Noise is drawn from it.

    Returns
    -------
    Chain
        With the coordinates that the inverse kinematics finds.
    """
    usual = priors()
    noise = usual["marker_noise"].size * rng.standard_normal(chain.markers.position.shape)
    markers = replace(chain.markers, position=chain.markers.position + noise)
    at_rest = np.repeat([usual["plate_noise_force"].size, usual["plate_noise_moment"].size], 3)
    # white noise up to half the frame rate, of which a filter of 6 Hz leaves the stated one
    white = at_rest * np.sqrt(mean_rate_hz(chain.time) / (2 * 6.0))
    wrenches = [w + white * rng.standard_normal(w.shape) for w in chain.wrenches]
    q = solve_ik(chain.body, markers).q + unseen
    return chain.changed(wrenches=tuple(wrenches), q=q)


def measured_uncertainty(
    part: ExplainedPart, effects: Array, noise: Array, result: TrialResult
) -> tuple[tuple[RmsUncertainty, ...], tuple[RmsUncertainty, ...], Bands]:
    """Say how sure the residuals of a trial are, from the effects of causes of usual size.

    Parameters
    ----------
    part
        The part of the trial that is explained.
    effects
        What each cause adds to the residual as it was measured, per unit, (K, T, 6).
    noise
        Of samples, in each axis, (6,) (`noise_of_samples`).
    result
        The processed trial. What trials share is drawn alike in all of the same subject, or of the
        laboratory.

    Returns
    -------
    of_cycles, of_window
        How sure the RMS over all cycles is, and that over the part of the cycles that the condition
        asks for, if it does: as measured, and compensated where it is.
    bands
        The residuals over time.

    Notes
    -----
    What segments without markers add is in the residual already. Its mean square, drawn, is
    subtracted: so the interval is of the residual that markers on all segments would show.
    """
    chain, causes, cycles = part.chain, part.causes, part.series.frames
    usual = np.array([cause.prior.size for cause in causes])[:, None, None] * effects
    # a low-pass at f leaves 2 f independent samples a second
    samples = 2 * chain.settings.cutoff_hz / mean_rate_hz(chain.time)
    # of 1,000 draws a standard deviation is sure to 2 %
    sizes = shared_sizes(causes, result.subject.id, result.source.name, 1000)
    unseen = [k for k, cause in enumerate(causes) if cause.group in UNSEEN]
    first = int(np.searchsorted(result.motion.time, chain.time[0]))
    trial = slice(first, first + len(chain.time))
    variants = {False: chain.residual}
    if result.compensated is not None:
        variants = {False: result.measured.residual[trial], True: chain.residual}

    def over(frames: Indices) -> Iterator[RmsUncertainty]:
        hidden = _mean_square(usual[unseen][:, frames], sizes[:, unseen])
        # without compensation nothing of it can be wrong
        for compensated, residual in variants.items():
            absent = UNSEEN if compensated else UNSEEN | {"compensation"}
            added = [k for k, cause in enumerate(causes) if cause.group not in absent]
            parts = residual[frames], usual[added][:, frames]
            draws = drawn_rms(*parts, noise, samples, sizes[:, [*added, -1]], hidden)
            shown = np.mean(residual[frames] ** 2, axis=0) - hidden
            whole = np.sqrt(np.maximum(shown, 0.0)).mean(axis=0)
            yield RmsUncertainty(compensated, whole, draws.round(3))

    frames = np.concatenate(cycles)
    in_window = frames[result.counted[trial][frames] & (result.part is not None)]
    bands = Bands(
        time=chain.time[frames],
        cycle=np.repeat(np.arange(len(cycles)), [len(cycle) for cycle in cycles]),
        residual=reported(chain.residual[frames]),
        deviation=np.sqrt((usual[:, frames] ** 2).sum(axis=0) + noise**2),
    )
    return tuple(over(frames)), tuple(over(in_window)) if len(in_window) else (), bands
