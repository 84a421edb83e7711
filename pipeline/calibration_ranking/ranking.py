"""Experiment 2: the calibration trial with the best compensation, and how certain that is."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Generic, TypeVar

import numpy as np
import pandas as pd
import scipy

from compensation import BeltModel, InertiaModel, fit_belt, fit_inertia
from hbm.numbers import read_numbers
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.calibration_ranking.trials import RATE_HZ, BeltTrial, PlatformTrial

LIMITS: Final = read_numbers("pipeline.calibration_ranking", "thresholds.toml", "choice")
RESAMPLES: Final = 1000
"""Of the bootstrap: a share of wins of 1 % is known to 0.3 %."""
Model = TypeVar("Model", InertiaModel, BeltModel)
Trial = TypeVar("Trial", PlatformTrial, BeltTrial)


@dataclass(frozen=True, slots=True)
class Ranking(Generic[Model]):
    """Calibration trials in their order, and the models fitted to them.

    Attributes
    ----------
    table
        One row per calibration trial, best first: trial, mean_rank, firsts (columns in which it is
        the best), wins (share of the resamples in which its mean rank is the lowest), rank_low and
        rank_high (95 % of its resampled mean ranks).
    scores
        One row per calibration trial, validation trial and component: rms_raw, rms_after [N, N·m],
        excess_high (upper end of the 95 % interval of what it leaves more than the winner, from
        the resamples) [N, N·m], reduction [%], rank.
    models
        Name -> fitted model.
    """

    table: pd.DataFrame
    scores: pd.DataFrame
    models: Mapping[str, Model] = field(default_factory=dict)

    @property
    def winner(self) -> str:
        """Name of the best calibration trial."""
        return str(self.table["trial"].iloc[0])

    @property
    def possibly_best(self) -> list[str]:
        """Trials that may be the best: the winner, and those that win some resamples."""
        wins = self.table["wins"] >= LIMITS.least_wins
        return list(self.table["trial"][wins | (self.table.index == 0)])


def rank_platform(
    calibration: Sequence[PlatformTrial], validation: Sequence[PlatformTrial], *, seed: int = 0
) -> Ranking[InertiaModel]:
    """Fit a model to every calibration trial, score it on every validation trial, and rank.

    Parameters
    ----------
    calibration, validation
        The trials, equally recorded and filtered.
    seed
        Of the bootstrap.

    Returns
    -------
    Ranking
        Ranks are by reduction of the RMS in every column (validation trial × component).

    Raises
    ------
    ValueError
        If a trial cannot be fitted, was recorded with other sensors, or there are fewer than two
        calibration trials.

    Notes
    -----
    Source: van de Loosdrecht (2018), II.B and D.4.

    Beyond the original: the bootstrap. Each resample draws blocks of 5 s of the validation trials
    with replacement, and for each calibration a gain from its covariance and another zero of the
    plate. The zero differs from trial to trial, as the calibrations' mean errors show, and would
    differ if the experiment were repeated; resampled blocks do not contain that.
    """
    # a model knows the directions of its own sensors only
    for trial in (*calibration, *validation):
        if trial.setup != calibration[0].setup:
            raise ValueError(
                f"{trial.name} was recorded with {', '.join(trial.setup.sensors)}, "
                f"{calibration[0].name} with {', '.join(calibration[0].setup.sensors)}"
            )
    models = _fitted(
        calibration, lambda trial: fit_inertia(trial.accelerations, trial.wrench, trial.setup)
    )
    scores = []
    for trial in validation:
        dead = [c for c, rms in zip(WRENCH_COMPONENTS, _rms(trial.wrench), strict=True) if rms == 0]
        if dead:
            raise ValueError(
                f"{trial.name}: the plate's {', '.join(dead)} is 0 throughout; is it connected?"
            )
        remains = {n: trial.wrench - m.predict(trial.accelerations) for n, m in models.items()}
        scores.append(_scores(trial.name, WRENCH_COMPONENTS, trial.wrench, remains))
    resampled = _resampled(list(models.values()), validation, np.random.default_rng(seed))
    return ranked(pd.concat(scores, ignore_index=True), resampled, models)


def _fitted(trials: Sequence[Trial], fit: Callable[[Trial], Model]) -> dict[str, Model]:
    """Fit a model to every calibration trial, by its name."""
    if len(trials) < 2:
        raise ValueError(f"a ranking needs at least 2 calibration trials, got {len(trials)}")
    models = {}
    for trial in trials:
        try:
            models[trial.name] = fit(trial)
        except ValueError as error:
            raise ValueError(f"{trial.name}: {error}") from error
    return models


def _scores(
    validation: str, components: Sequence[str], measured: Array, remains: Mapping[str, Array]
) -> pd.DataFrame:
    """Give RMS raw and after compensation of the components, (N, C), by calibration trial."""
    raw = _rms(measured)
    columns = ["trial", "validation", "component", "rms_raw", "rms_after"]
    rows = [
        (name, validation, *row)
        for name, rest in remains.items()
        for row in zip(components, raw, _rms(rest), strict=True)
    ]
    return pd.DataFrame(rows, columns=columns)


def ranked(scores: pd.DataFrame, resampled: Array, models: Mapping[str, Model]) -> Ranking[Model]:
    """Rank trials by how much they reduce the RMS in every column.

    Parameters
    ----------
    scores
        As in `Ranking`, without excess_high, reduction and rank; trials in the same order in each
        column.
    resampled
        RMS after compensation by RMS raw in every resample, (resamples, trials, columns).
    models
        Name -> fitted model.

    Returns
    -------
    Ranking
        Best trial first.
    """
    # percentages of the raw RMS, so that forces and moments count alike
    scores = scores.assign(reduction=100 * (1 - scores["rms_after"] / scores["rms_raw"]))
    columns = scores.groupby(["validation", "component"], sort=False)["reduction"]
    scores["rank"] = columns.rank(ascending=False)
    means = scores.groupby("trial", sort=False)["rank"].mean()
    best = scores["rank"] == columns.transform(lambda x: x.rank(ascending=False).min()).to_numpy()
    # the same ranking in every resample: the smallest remainder has rank 1
    again = scipy.stats.rankdata(resampled, axis=1).mean(axis=2)
    low, high = np.percentile(again, [2.5, 97.5], axis=0)
    table = pd.DataFrame(
        {
            "trial": means.index,
            "mean_rank": means.to_numpy(),
            "firsts": best.groupby(scores["trial"], sort=False).sum().to_numpy(),
            "wins": np.bincount(again.argmin(axis=1), minlength=len(means)) / len(again),
            "rank_low": low,
            "rank_high": high,
        }
    )
    table = table.sort_values(["mean_rank", "firsts"], ascending=[True, False], ignore_index=True)
    # in pairs with the winner: what both have alike in a resample does not count
    winner = list(means.index).index(table["trial"].iloc[0])
    high = np.percentile(resampled - resampled[:, winner : winner + 1], 97.5, axis=0)
    row, column = means.index.get_indexer(pd.Index(scores["trial"])), columns.ngroup().to_numpy()
    scores.insert(5, "excess_high", high[row, column] * scores["rms_raw"])
    return Ranking(table, scores, models)


def best_trials(ranking: Ranking[Model]) -> pd.DataFrame:
    """Give the best calibration trial of every column, like the thesis' Fig. F.7.

    Returns
    -------
    pandas.DataFrame
        One row per validation trial, one column per component.
    """
    columns = ranking.scores.groupby(["validation", "component"], sort=False)
    best = ranking.scores.loc[columns["rank"].idxmin()]
    wide = best.pivot(index="validation", columns="component", values="trial")
    return wide[[c for c in WRENCH_COMPONENTS if c in wide.columns]]


def _drawn_blocks(count: int, rng: np.random.Generator) -> tuple[list[slice], Array]:
    """Cut samples at 100 Hz into blocks of about 5 s, two at least, and draw among them.

    Gives the B blocks, and how often each is in every resample, (resamples, B).
    """
    # errors are correlated over less than a block, so that blocks are independent
    edges = np.linspace(0, count, max(round(count / (5.0 * RATE_HZ)), 2) + 1).astype(int)
    cut = [slice(a, b) for a, b in pairwise(edges)]
    drawn = rng.multinomial(len(cut), np.full(len(cut), 1 / len(cut)), RESAMPLES)
    return cut, drawn.astype(float)


def _resampled(
    models: list[InertiaModel], validation: Sequence[PlatformTrial], rng: np.random.Generator
) -> Array:
    """Give RMS after by RMS raw in every resample, (resamples, models, columns)."""
    errors = [[v.wrench - model.predict(v.accelerations) for model in models] for v in validation]
    # the zero of each calibration, by the mean error that it leaves beside that of all
    mean_error = np.mean([[e.mean(axis=0) for e in row] for row in errors], axis=0)
    zero = mean_error - mean_error.mean(axis=0)
    zero_sd = zero.std(axis=0, ddof=1)
    change = np.stack([_gain_errors(model, zero_sd, rng) for model in models], axis=1)
    change[:, :, -1] -= zero  # replaced by the zero drawn
    columns = []
    for trial, row in zip(validation, errors, strict=True):
        design = np.column_stack([trial.accelerations, np.ones(len(trial.wrench))])
        # sums over blocks, of which a resample takes each as often as it was drawn
        cut, drawn = _drawn_blocks(len(design), rng)
        gram = np.tensordot(drawn, [design[b].T @ design[b] for b in cut], 1)
        cross = np.tensordot(drawn, [[design[b].T @ e[b] for e in row] for b in cut], 1)
        plain = np.tensordot(drawn, [[(e[b] ** 2).sum(axis=0) for e in row] for b in cut], 1)
        raw = np.tensordot(drawn, [(trial.wrench[b] ** 2).sum(axis=0) for b in cut], 1)
        # |e - X d|² = |e|² + d' (X'X d - 2 X'e) for a change d of gain and zero
        moved = np.einsum("rij,rmjc->rmic", gram, change) - 2 * cross
        remaining = plain + np.einsum("rmic,rmic->rmc", change, moved)
        columns.append(np.sqrt(np.maximum(remaining, 0) / raw[:, None]))
    return np.concatenate(columns, axis=2)


def _gain_errors(model: InertiaModel, zero_sd: Array, rng: np.random.Generator) -> Array:
    """Draw by how much gain and zero might have differed, (resamples, k + 1, 6)."""
    draws = np.empty((RESAMPLES, *model.gain.shape))
    for c, covariance in enumerate(model.covariance):
        # normal draws times a square root of the covariance, which may be singular
        variance, directions = np.linalg.eigh(covariance)
        root = directions * np.sqrt(np.maximum(variance, 0))
        draws[..., c] = rng.normal(size=(RESAMPLES, len(variance))) @ root.T
    draws[:, -1] += rng.normal(0, zero_sd, (RESAMPLES, 6))
    return draws


def _rms(wrench: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(wrench**2, axis=0)))


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
    # the model has no zero: it is fitted to what varies
    models = _fitted(
        calibration,
        lambda trial: fit_belt(trial.acceleration, trial.moment - trial.moment.mean()),
    )
    rng = np.random.default_rng(seed)
    scores, resampled = [], []
    for trial in validation:
        # about the mean, which a zero of the plate shifts
        measured, remains = trial.moment - trial.moment.mean(), {}
        for name, model in models.items():
            rest = measured - model.predict(trial.acceleration)
            remains[name] = (rest - rest.mean())[:, None]
        scores.append(_scores(trial.name, ["My"], measured[:, None], remains))
        cut, drawn = _drawn_blocks(len(measured), rng)
        after = drawn @ np.array([[np.sum(rest[b] ** 2) for rest in remains.values()] for b in cut])
        total = drawn @ np.array([np.sum(measured[b] ** 2) for b in cut])
        resampled.append(np.sqrt(after / total[:, None]))
    return ranked(pd.concat(scores, ignore_index=True), np.stack(resampled, axis=2), models)


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
            # standard deviations, as a person adds a mean of its own
            raw = float(np.std(trial.moment))
            after = float(np.std(trial.moment - model.predict(trial.acceleration)))
            rows.append((trial.name, answer, raw, after, 100 * (1 - after / raw)))
    return pd.DataFrame(rows, columns=["validation", "person", "rms_raw", "rms_after", "reduction"])


def belt_interaction(
    trial: BeltTrial, model: InertiaModel | None = None, *, seed: int = 0
) -> tuple[pd.DataFrame, Array]:
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
    table
        Each channel regressed on the belt's acceleration at lags of up to 0.1 s: channel, rms
        [m/s²] about its mean, rms_of_belt [m/s²] of the part that follows, its share of the
        variance [1], and p, the share of random circular shifts in time that give as much; share
        and p are NaN for a dead channel.
    artefact
        RMS of the wrench that the model wrongly predicts from that part, (6,) [N, N·m]; NaN
        without a model.
    """
    # accelerometers may follow the belt or precede it by up to 0.1 s
    lagged = np.column_stack([np.roll(trial.acceleration, lag) for lag in range(-10, 11, 2)])
    # orthonormal columns: the part of readings that follows the belt is their projection
    basis = np.linalg.qr(lagged - lagged.mean(axis=0))[0]
    readings = trial.readings - trial.readings.mean(axis=0)
    explained, total = basis @ (basis.T @ readings), np.sum(readings**2, axis=0)
    size = np.sum(explained**2, axis=0)
    # shifts in time of 1 s at least, beyond lags and ringing; of 199 the smallest p is 1 in 200
    least, count = round(1.0 * RATE_HZ), 199
    shifts = np.random.default_rng(seed).integers(least, len(readings) - least, count)
    # shifted readings keep their own spectrum, but have nothing to do with the belt
    at_random = [np.sum((basis.T @ np.roll(readings, by, axis=0)) ** 2, axis=0) for by in shifts]
    as_much = np.sum(np.array(at_random) >= size, axis=0)
    alive = total > 0
    table = pd.DataFrame(
        {
            "channel": list(trial.channels),
            "rms": readings.std(axis=0),
            "rms_of_belt": np.sqrt(size / len(readings)),
            "share": np.where(alive, size / np.where(alive, total, 1.0), np.nan),
            "p": np.where(alive, (1 + as_much) / (1 + count), np.nan),
        }
    )
    if model is None:
        return table, np.full(6, np.nan)
    return table, _rms(explained @ model.gain[:-1])


def thesis_choice(table: pd.DataFrame) -> str:
    """Choose a calibration trial by the thesis' rule.

    Parameters
    ----------
    table
        trial, mean_rank and firsts, as in `pipeline.calibration_ranking.ranking.Ranking`.

    Returns
    -------
    str
        The trial that is foremost in both of the thesis' tables: the ranking, and the best trials
        of the columns (van de Loosdrecht 2018, D.4). Where they disagree, the one with the smallest
        sum of its two places, then with the lower mean rank; the thesis does not state how it
        weighs them.

    Examples
    --------
    >>> table = pd.DataFrame(
    ...     {"trial": ["a", "b", "c"], "mean_rank": [1.5, 1.7, 2.8], "firsts": [2, 4, 0]}
    ... )
    >>> thesis_choice(table)
    'a'
    """
    # the sum of both places; of ties the lower mean rank
    places = table["mean_rank"].rank(method="min")
    places += table["firsts"].rank(method="min", ascending=False)
    foremost = table[places == places.min()].sort_values("mean_rank")
    return str(foremost["trial"].iloc[0])


def excess(ranking: Ranking[Model], name: str) -> pd.Series:
    """Give how much more a trial leaves than the winner in each column [N, N·m]."""
    columns = ["validation", "component"]
    after = ranking.scores.pivot(index=columns, columns="trial", values="rms_after")
    return after[name] - after[ranking.winner]


def as_good(ranking: Ranking[Model]) -> list[str]:
    """Name the trials that leave as much as the winner in every column, the winner first.

    They leave less than the least difference that matters more than it, or less than it, and so do
    the upper ends of the 95 % intervals of that.
    """
    most = ranking.scores.groupby("trial")["excess_high"].max()
    return [
        name
        for name in ranking.table["trial"]
        if max(excess(ranking, name).max(), most[name]) < LIMITS.least_difference
    ]
