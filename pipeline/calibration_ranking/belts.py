"""Experiment 2, belts: the trial with the best model, and vibration of the accelerometers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd

from compensation import BeltModel, InertiaModel, fit_belt
from hbm.spatial import Array
from pipeline.calibration_ranking.ranking import RESAMPLES, Ranking, blocks, ranked
from pipeline.calibration_ranking.trials import RATE_HZ, BeltTrial

LAGS: Final = range(-10, 11, 2)
"""Samples by which accelerometers may follow or precede the belt, 0.1 s either way."""
RANDOM_SHIFTS: Final = 199
"""Of the readings in time; the smallest p is 1 in 200."""
MIN_SHIFT_S: Final = 1.0
"""Of these shifts, beyond the lags and the ringing."""
ACCELERATING_SHARE: Final = 0.5
"""Of the largest acceleration, above which a belt counts as accelerating."""
RINGING_S: Final = 0.5
"""For which the frame vibrates after that."""


def rank_belts(
    calibration: Sequence[BeltTrial], validation: Sequence[BeltTrial], *, seed: int = 0
) -> Ranking[BeltModel]:
    """Fit a belt model to every calibration trial, score it on the validation trials, and rank.

    Parameters
    ----------
    calibration, validation
        The trials, equally filtered.
    seed
        Of the bootstrap.

    Returns
    -------
    Ranking
        Columns are the validation trials; the component is My. The bootstrap draws blocks of 5 s
        of the validation trials and leaves the models as fitted.

    Raises
    ------
    ValueError
        If a trial cannot be fitted, or there are fewer than two.
    """
    if len(calibration) < 2:
        raise ValueError(f"a ranking needs at least 2 belt trials, got {len(calibration)}")
    models = {}
    for trial in calibration:
        try:
            models[trial.name] = fit_belt(trial.acceleration, _about_mean(trial.moment))
        except ValueError as error:
            raise ValueError(f"{trial.name}: {error}") from error
    rng = np.random.default_rng(seed)
    rows, columns = [], []
    for trial in validation:
        measured = _about_mean(trial.moment)
        errors = [_about_mean(measured - m.predict(trial.acceleration)) for m in models.values()]
        raw = float(np.sqrt(np.mean(measured**2)))
        rows += [
            (name, trial.name, "My", raw, float(np.sqrt(np.mean(error**2))))
            for name, error in zip(models, errors, strict=True)
        ]
        cut = blocks(len(measured))
        drawn = rng.multinomial(len(cut), np.full(len(cut), 1 / len(cut)), RESAMPLES).astype(float)
        left = drawn @ np.array([[np.sum(e[b] ** 2) for e in errors] for b in cut])
        total = drawn @ np.array([np.sum(measured[b] ** 2) for b in cut])
        columns.append(np.sqrt(left / total[:, None]))
    scores = pd.DataFrame(
        rows, columns=["trial", "validation", "component", "rms_raw", "rms_after"]
    )
    return ranked(scores, np.stack(columns, axis=2), models)


def taken_away(
    model: BeltModel, empty: Sequence[BeltTrial], person: Sequence[BeltTrial]
) -> pd.DataFrame:
    """Give what a belt model takes away of the pitch moment, with nobody and with a person.

    Parameters
    ----------
    model
        The model.
    empty, person
        Trials with nobody on the belts, and with a person on the other belt.

    Returns
    -------
    pandas.DataFrame
        One row per trial: validation, person (yes or no), rms_raw and rms_after about their means
        [N·m], reduction [%].
    """
    rows = []
    for answer, trials in (("no", empty), ("yes", person)):
        for trial in trials:
            raw = float(np.std(trial.moment))
            after = float(np.std(trial.moment - model.predict(trial.acceleration)))
            rows.append((trial.name, answer, raw, after, 100 * (1 - after / raw)))
    return pd.DataFrame(rows, columns=["validation", "person", "rms_raw", "rms_after", "reduction"])


@dataclass(frozen=True, slots=True)
class Interaction:
    """Response of the accelerometers to an accelerating belt.

    Attributes
    ----------
    table
        One row per channel: channel, rms [m/s²] about its mean, rms_of_belt [m/s²] of the part
        that follows the belt's acceleration, its share of the variance [1], p; rms_ratio, the RMS
        while the belt accelerates and half a second after, by that of the rest [1], and
        p_rms_ratio.
    artefact
        RMS of the wrench that a pitch and sway model wrongly predicts from that part, (6,)
        [N, N·m]; NaN without a model.
    """

    table: pd.DataFrame
    artefact: Array


def belt_interaction(
    trial: BeltTrial, model: InertiaModel | None = None, *, seed: int = 0
) -> Interaction:
    """Find the belt's acceleration in the accelerometers (van de Loosdrecht 2018, D.3.2).

    Parameters
    ----------
    trial
        A belt trial with the platform at rest.
    model
        A pitch and sway model, to give the effect on a compensated plate.
    seed
        Of the random shifts.

    Returns
    -------
    Interaction
        Each channel regressed on the belt's acceleration at lags of up to 0.1 s, and the ratio of
        its RMS, which does not depend on the phase: a roller vibrates at its own angle. The
        p-values are the shares of random circular shifts in time that give as much.
    """
    lagged = np.column_stack([np.roll(trial.acceleration, lag) for lag in LAGS])
    basis = np.linalg.qr(lagged - lagged.mean(axis=0))[0]
    readings = trial.readings - trial.readings.mean(axis=0)
    explained = basis @ (basis.T @ readings)
    share, rms_ratio = _share(basis, readings), _rms_ratio(trial.acceleration, readings)
    least = round(MIN_SHIFT_S * RATE_HZ)
    shifts = np.random.default_rng(seed).integers(least, len(readings) - least, RANDOM_SHIFTS)
    shifted = [np.roll(readings, by, axis=0) for by in shifts]
    random_share = np.array([_share(basis, r) for r in shifted])
    random_ratio = np.array([_rms_ratio(trial.acceleration, r) for r in shifted])
    table = pd.DataFrame(
        {
            "channel": list(trial.channels),
            "rms": readings.std(axis=0),
            "rms_of_belt": np.sqrt(np.mean(explained**2, axis=0)),
            "share": share,
            "p": _p_value(share, random_share),
            "rms_ratio": rms_ratio,
            "p_rms_ratio": _p_value(rms_ratio, random_ratio),
        }
    )
    artefact = np.full(6, np.nan)
    if model is not None:
        artefact = np.sqrt(np.mean((explained @ model.gain[:-1]) ** 2, axis=0))
    return Interaction(table, artefact)


def _share(basis: Array, readings: Array) -> Array:
    """Give the share of the readings' variance that lies in the span of a basis, (k,)."""
    inside = np.sum((basis.T @ readings) ** 2, axis=0)
    return _ratio(inside, np.sum(readings**2, axis=0))


def _rms_ratio(acceleration: Array, readings: Array) -> Array:
    """Give the RMS while a belt accelerates and the frame rings by that of the rest, (k,)."""
    accelerating = np.abs(acceleration) > ACCELERATING_SHARE * np.max(np.abs(acceleration))
    ringing = np.ones(1 + round(RINGING_S * RATE_HZ))
    shaken = np.convolve(accelerating, ringing)[: len(accelerating)] > 0
    if shaken.all():
        return np.full(readings.shape[1], np.nan)
    then, otherwise = (np.mean(readings[rows] ** 2, axis=0) for rows in (shaken, ~shaken))
    return np.sqrt(_ratio(then, otherwise))


def _ratio(part: Array, whole: Array) -> Array:
    """Divide; NaN where the divisor is 0, as of a dead channel."""
    ratio = np.full(len(whole), np.nan)
    return np.asarray(np.divide(part, whole, out=ratio, where=whole > 0))


def _p_value(found: Array, at_random: Array) -> Array:
    """Give the share of random shifts that give as much, (k,); NaN where `found` is."""
    p = (1 + np.sum(at_random >= found, axis=0)) / (1 + RANDOM_SHIFTS)
    return np.where(np.isfinite(found), p, np.nan)


def _about_mean(signal: Array) -> Array:
    return np.asarray(signal - signal.mean())
