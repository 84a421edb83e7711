"""The campaign of signals counts rightly."""

import numpy as np
import pandas as pd
import pytest

from pipeline.calibration_ranking.ranking import Ranking
from tests.campaign.calibration_signals import (
    logarithms,
    orders_found_again,
    ratios,
    winners_found_again,
)

NAMES = ("random_60s_0mps", "all_60s_0mps", "random_60s_3mps", "all_60s_3mps")


def ranking(order, *, all_by_random=1.0, rank_width=0.5, wins=(1.0, 0.0, 0.0, 0.0)):
    """One laboratory: its signals from best to worst, and what each leaves in two cells."""
    names = [NAMES[k] for k in order]
    place = np.arange(1.0, 5.0)
    table = pd.DataFrame(
        {
            "trial": names,
            "mean_rank": place,
            "wins": wins,
            "rank_low": place - rank_width,
            "rank_high": place + rank_width,
        }
    )
    scores = pd.DataFrame(
        [
            (name, "sway", component, all_by_random if name.startswith("all") else 1.0)
            for name in names
            for component in ("Fx", "Fy")
        ],
        columns=["trial", "validation", "component", "rms_after"],
    )
    return Ranking(table, scores)


def test_a_kind_that_leaves_a_tenth_more_everywhere_has_the_ratio_1_1():
    rankings = [ranking((0, 1, 2, 3), all_by_random=1.1 * f) for f in (0.99, 1 / 0.99)]
    found = ratios(logarithms(rankings), "kind").loc["all"]
    assert found["ratio"] == pytest.approx(1.1)
    assert found["low"] < 1.1 < found["high"]
    assert ratios(logarithms(rankings), "speed_mps").loc[3.0, "ratio"] == pytest.approx(1)


def test_equal_orders_are_found_again_and_opposite_ones_are_not():
    assert orders_found_again([ranking((0, 1, 2, 3), rank_width=0.4)] * 2) == 1
    opposite = [ranking((0, 1, 2, 3), rank_width=0.4), ranking((3, 2, 1, 0), rank_width=0.4)]
    assert orders_found_again(opposite) == 0
    assert np.isnan(orders_found_again([ranking((0, 1, 2, 3), rank_width=4.0)] * 2))


def test_winners_are_found_again_where_they_win_some_resamples():
    both = [
        ranking((0, 1, 2, 3), wins=(0.9, 0.1, 0.0, 0.0)),
        ranking((1, 0, 2, 3), wins=(1.0, 0.0, 0.0, 0.0)),
    ]
    assert winners_found_again(both) == 0.5  # the first allows the other's winner, not vice versa
