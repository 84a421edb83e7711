"""Repeatability is that of a published example, and unknown where values are too few."""

import numpy as np
import pandas as pd
import pytest

from pipeline.statistics.reliability import reliability

RATINGS = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]]
"""Of six people by four judges: Shrout and Fleiss 1979, Psychol Bull 86:420, table 2."""


def table(ratings, unit="recording"):
    rows = [
        {"subject": f"s{k}", "session": "", "recording": "", "value": float(value)} | {unit: f"{j}"}
        for k, own in enumerate(ratings)
        for j, value in enumerate(own)
    ]
    return pd.DataFrame(rows).assign(condition="walk", compensated=False, name="Fx", unit="N")


def test_the_example_of_shrout_and_fleiss_is_reproduced():
    """ICC(2,1) = 0.29, with an interval of 0.02 to 0.76 (McGraw and Wong 1996, table 7)."""
    (row,) = reliability(table(RATINGS)).itertuples()
    assert row.icc == pytest.approx(0.29, abs=0.005)
    assert (row.icc_low, row.icc_high) == pytest.approx((0.0188, 0.7611), abs=5e-5)
    assert row.sd_within == pytest.approx(np.sqrt(np.var(RATINGS, axis=1, ddof=1).mean()))
    assert row.sem == pytest.approx(np.std(RATINGS, ddof=1) * np.sqrt(1 - row.icc))
    assert row.smallest_detectable_change == pytest.approx(1.96 * np.sqrt(2) * row.sem)


def test_intervals_of_an_intraclass_correlation_are_between_0_and_1():
    """The interval of these would reach to -1.4, which no share of a variance can be."""
    (row,) = reliability(table([[1.0, 2.0], [2.0, 1.1], [1.4, 1.6]])).itertuples()
    assert row.icc < 0 == row.icc_low <= row.icc_high <= 1
    (row,) = reliability(table([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])).itertuples()
    assert (row.icc, row.icc_low, row.icc_high) == (1, 1, 1)


def test_sessions_are_what_is_repeated_where_subjects_came_more_than_once():
    (row,) = reliability(table(RATINGS, "session")).itertuples()
    assert (row.repeated, row.n_subjects, row.n_repeats) == ("session", 6, 4)


def test_two_repeats_of_two_subjects_have_no_intraclass_correlation():
    (row,) = reliability(table([[1.0, 1.2], [2.0, 2.3]])).itertuples()
    assert np.isnan(row.icc)
    assert row.sd_within == pytest.approx(np.sqrt((0.2**2 + 0.3**2) / 4))


def test_subjects_without_repeats_and_single_subjects_have_no_row():
    assert reliability(table([[1.0], [2.0], [3.0]])).empty
    assert reliability(table([[1.0, 1.1, 1.2]])).empty
