"""Experiment 2, belts: the trial that makes the best model, and whether belts shake the sensors."""

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
SHIFTS: Final = 199
HARD: Final = 0.5
"""Share of the largest acceleration from which on a belt is taken to accelerate."""
RINGING_S: Final = 0.5
"""How long a shaken frame goes on."""


def rank_belts(
    calibration: Sequence[BeltTrial], validation: Sequence[BeltTrial], *, seed: int = 0
) -> tuple[Ranking, dict[str, BeltModel]]:
    """Fit a belt model to every calibration trial, score it on the validation trials, and rank.

    Parameters
    ----------
    calibration, validation
        The trials, equally filtered.
    seed
        Of the bootstrap.

    Returns
    -------
    ranking
        Columns are the validation trials; the component is My. The bootstrap draws blocks of 5 s
        of the validation trials; the models stay as fitted.
    models
        Name -> fitted model.

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
    return ranked(scores, np.stack(columns, axis=2)), models


@dataclass(frozen=True, slots=True)
class Interaction:
    """What the accelerometers notice of an accelerating belt.

    Attributes
    ----------
    table
        One row per channel: sensor channel, rms [m/s²] of its changes, rms_of_belt [m/s²] that
        follows the belt's acceleration, share of the variance [1], p; louder, the RMS while the
        belt accelerates and half a second after, by that of the rest [1], and p_louder.
    artefact
        RMS of the wrench that a pitch and sway model would wrongly predict from it, (6,)
        [N, N·m]; NaN without a model.
    """

    table: pd.DataFrame
    artefact: Array


def interaction(
    trial: BeltTrial, names: Sequence[str], model: InertiaModel | None = None, *, seed: int = 0
) -> Interaction:
    """Look for the belt's acceleration in the accelerometers (van de Loosdrecht 2018, D.3.2).

    Parameters
    ----------
    trial
        A belt trial with the platform at rest.
    names
        Of the accelerometers' channels.
    model
        A pitch and sway model, to say what the interaction does to a compensated plate.
    seed
        Of the random shifts.

    Returns
    -------
    Interaction
        Each channel regressed on the belt's acceleration at lags of up to 0.1 s, and its loudness
        whatever the phase: a roller shakes the frame at its own angle. The p-values are the shares
        of random shifts in time (round the end) that give as much.
    """
    lagged = np.column_stack([np.roll(trial.acceleration, lag) for lag in LAGS])
    basis = np.linalg.qr(lagged - lagged.mean(axis=0))[0]
    readings = trial.readings - trial.readings.mean(axis=0)
    explained = basis @ (basis.T @ readings)
    share, louder = _share(basis, readings), _louder(trial.acceleration, readings)
    later = np.random.default_rng(seed).integers(
        round(RATE_HZ), len(readings) - round(RATE_HZ), SHIFTS
    )
    shifted = [np.roll(readings, by, axis=0) for by in later]
    by_chance = np.array([_share(basis, r) for r in shifted])
    loud_by_chance = np.array([_louder(trial.acceleration, r) for r in shifted])
    table = pd.DataFrame(
        {
            "channel": list(names),
            "rms": readings.std(axis=0),
            "rms_of_belt": np.sqrt(np.mean(explained**2, axis=0)),
            "share": share,
            "p": _chance(share, by_chance),
            "louder": louder,
            "p_louder": _chance(louder, loud_by_chance),
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


def _louder(acceleration: Array, readings: Array) -> Array:
    """Give the RMS while a belt accelerates and rings by that of the rest, (k,)."""
    hard = np.abs(acceleration) > HARD * np.max(np.abs(acceleration))
    ringing = np.ones(1 + round(RINGING_S * RATE_HZ))
    while_it_does = np.convolve(hard, ringing)[: len(hard)] > 0
    if while_it_does.all():
        return np.full(readings.shape[1], np.nan)
    mean_squares = [
        np.mean(readings[rows] ** 2, axis=0) for rows in (while_it_does, ~while_it_does)
    ]
    return np.sqrt(_ratio(mean_squares[0], mean_squares[1]))


def _ratio(part: Array, whole: Array) -> Array:
    """Divide; NaN where there is nothing to divide by, as of a dead channel."""
    ratio = np.full(len(whole), np.nan)
    return np.asarray(np.divide(part, whole, out=ratio, where=whole > 0))


def _chance(found: Array, by_chance: Array) -> Array:
    """Give the share of random shifts that give as much, (k,); NaN where nothing was found."""
    p = (1 + np.sum(by_chance >= found, axis=0)) / (1 + SHIFTS)
    return np.where(np.isfinite(found), p, np.nan)


def _about_mean(signal: Array) -> Array:
    return np.asarray(signal - signal.mean())
