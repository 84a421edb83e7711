"""Repeatability of values that were recorded several times, in one session or in several."""

from collections.abc import Sequence
from math import nan, sqrt
from typing import Final

import numpy as np
import pandas as pd
import scipy

from hbm.numbers import read_numbers
from hbm.spatial import Array
from pipeline.statistics.design import MIN_SUBJECTS, TAIL

LIMITS: Final = read_numbers("pipeline.statistics", "thresholds.toml", "reliability")
KEYS: Final = ["condition", "compensated", "name", "unit"]


def reliability(values: pd.DataFrame) -> pd.DataFrame:
    """Summarise how well values repeat.

    Parameters
    ----------
    values
        A row per recording: subject, session (empty where there is one), recording, condition,
        compensated, name, unit, value.

    Returns
    -------
    pandas.DataFrame
        A row per condition, compensation and name that is repeated in two subjects or more.

        repeated, n_subjects, n_repeats
            What is repeated, "session" (the mean of its recordings) or "recording"; subjects with
            two repeats or more, and the repeats that all of these have.
        mean, sd_within
            Mean, and within-subject standard deviation: the root mean square over subjects.
        icc, icc_low, icc_high
            Intraclass correlation of single repeats, absolute agreement, with 95 % interval
            between 0 and 1; a negative estimate means that no variance between subjects is seen.
        sem, smallest_detectable_change
            Standard error of measurement, and the change that exceeds it in one person (95 %).

    Notes
    -----
    ICC(A,1) of McGraw and Wong 1996 (Psychol Methods 1:30); the standard error of measurement is
    the total standard deviation times √(1 − ICC), the smallest detectable change 1.96 √2 of it
    (Weir 2005, J Strength Cond Res 19:231).

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> names = {"session": "", "condition": "walk", "compensated": False, "name": "Fx"}
    >>> table = [
    ...     {**names, "unit": "N", "subject": s, "recording": r, "value": s + 0.1 * rng.normal()}
    ...     for s in range(9) for r in ("01", "02")
    ... ]
    >>> row = reliability(pd.DataFrame(table)).iloc[0]
    >>> (row["repeated"], int(row["n_subjects"]), bool(row["icc"] > 0.99))
    ('recording', 9, True)
    """
    rows, is_repeated = [], values.duplicated([*KEYS, "subject"], keep=False)
    for key, repeated in values[is_repeated].groupby(KEYS, sort=False):
        # sessions where two subjects have several, since those include what changes between days
        sessions = repeated.groupby("subject")["session"].nunique()
        of_sessions = bool((sessions > 1).sum() >= MIN_SUBJECTS)
        unit = "session" if of_sessions else "recording"
        means = repeated.groupby(["subject", unit], sort=True)["value"].mean()
        of_subjects = [value for _, value in means.groupby("subject") if len(value) > 1]
        if len(of_subjects) >= MIN_SUBJECTS:
            repeats = [value.to_numpy(float) for value in of_subjects]
            count = min(map(len, repeats))
            rows.append((*key, unit, len(repeats), count, *_of_repeats(repeats, count)))
    columns = (
        *KEYS,
        *("repeated", "n_subjects", "n_repeats", "mean", "sd_within", "icc", "icc_low", "icc_high"),
        *("sem", "smallest_detectable_change"),
    )
    return pd.DataFrame(rows, columns=columns)


def _of_repeats(repeats: Sequence[Array], count: int) -> tuple[float, ...]:
    """Give the numbers of one value, from the mean on, of the repeats of each subject."""
    # variances of subjects are pooled by their degrees of freedom
    freedoms = [len(values) - 1 for values in repeats]
    within = sqrt(np.average([values.var(ddof=1) for values in repeats], weights=freedoms))
    mean = float(np.mean([values.mean() for values in repeats]))
    # the correlation takes as many repeats of each subject: the first ones
    table = np.array([values[:count] for values in repeats])
    icc, low, high = _agreement(table)
    sem = float(table.std(ddof=1)) * sqrt(max(1 - icc, 0.0))
    return mean, within, icc, low, high, sem, 1.96 * sqrt(2) * sem


def _agreement(table: Array) -> tuple[float, float, float]:
    """Give the intraclass correlation of single repeats, (subjects, repeats), with its interval.

    NaN without variance, and of two repeats of two subjects.
    """
    n, k = table.shape
    if table.size < LIMITS.fewest_values or not table.std() > 0:
        return nan, nan, nan
    # mean squares of subjects, of repeats and of the error
    subjects, repeats = table.mean(axis=1, keepdims=True), table.mean(axis=0, keepdims=True)
    error = np.sum((table - subjects - repeats + table.mean()) ** 2) / ((n - 1) * (k - 1))
    of_subjects, of_repeats = k * subjects.var(ddof=1), n * repeats.var(ddof=1)
    # absolute agreement: a difference between the repeats of all subjects counts as disagreement
    total = of_subjects + (k - 1) * error + k * (of_repeats - error) / n
    icc = (of_subjects - error) / total
    if not icc < 1:  # all repeats of a subject are equal
        return 1.0, 1.0, 1.0
    # degrees of freedom of the error of a repeat, by Satterthwaite (McGraw and Wong, table 7)
    a, b = k * icc / (n * (1 - icc)), 1 + k * icc * (n - 1) / (n * (1 - icc))
    parts = np.array([a * of_repeats, b * error])
    df = parts.sum() ** 2 / (parts**2 / [k - 1, (n - 1) * (k - 1)]).sum()
    # the bounds put F of the subjects at either tail
    rest = k * of_repeats + (k * n - k - n) * error
    high_f, low_f = scipy.stats.f.isf(TAIL, n - 1, df), scipy.stats.f.isf(TAIL, df, n - 1)
    low = n * (of_subjects - high_f * error) / (high_f * rest + n * of_subjects)
    high = n * (low_f * of_subjects - error) / (rest + n * low_f * of_subjects)
    low, high = np.clip([low, high], 0.0, 1.0)
    return float(icc), float(low), float(high)
