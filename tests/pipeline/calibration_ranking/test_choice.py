"""The calibration trial that is advised is best by both rules, not by thousandths of a newton."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensation import fit_belt
from pipeline.calibration_ranking.ranking import (
    LIMITS,
    as_good,
    ranked,
    taken_away,
    thesis_choice,
)
from pipeline.calibration_ranking.trials import BeltTrial
from pipeline.calibration_ranking.verdict import (
    best_levels,
    calibration_effects,
)

COLUMNS = [(v, c) for v in ("boarding", "pitch", "running", "sway") for c in ("Fx", "My")]


def ranking_of(left):
    """Rank trials by what they leave of 100 N in each of some columns: name -> what is left."""
    rows = [
        (name, *COLUMNS[k], 100.0, value)
        for name, values in left.items()
        for k, value in enumerate(values)
    ]
    names = ["trial", "validation", "component", "rms_raw", "rms_after"]
    resampled = np.array(list(left.values()))[None] / 100
    return ranked(pd.DataFrame(rows, columns=names), resampled, {})


def places(mean_ranks, firsts):
    names = [f"trial {k}" for k in range(len(mean_ranks))]
    return pd.DataFrame({"trial": names, "mean_rank": mean_ranks, "firsts": firsts})


def test_the_thesis_takes_the_trial_that_is_foremost_in_both_tables():
    """First in the ranking and best in most columns; else second place and most columns."""
    assert thesis_choice(places([4.5, 5.0, 9.0], [5, 2, 1])) == "trial 0"
    assert thesis_choice(places([4.5, 4.6, 5.5, 9.0], [0, 5, 2, 1])) == "trial 1"


@given(st.lists(st.tuples(st.integers(1, 28), st.integers(0, 24)), min_size=1, max_size=28))
def test_no_trial_is_ahead_of_the_thesis_choice_in_both_tables(rows):
    table = places(*(np.array(column, dtype=float) for column in zip(*rows, strict=True)))
    chosen = table.set_index("trial").loc[thesis_choice(table)]
    ahead = (table["mean_rank"] < chosen["mean_rank"]) & (table["firsts"] > chosen["firsts"])
    assert not ahead.any()


def test_thousandths_of_a_newton_make_no_difference_whatever_their_p():
    """Every trial differs from every other in each of the columns, by thousandths."""
    left = {f"trial {k}": [1 + 0.001 * k] * 8 for k in range(4)}
    ranking = ranking_of(left)
    assert ranking.table["wins"].iloc[0] == 1
    assert as_good(ranking) == [f"trial {k}" for k in range(4)]


def test_what_leaves_a_tenth_of_a_newton_more_anywhere_is_not_as_good():
    left = {"a": [1.0] * 8, "b": [1.05] * 8, "c": [1.0] * 7 + [1 + 1.01 * LIMITS.least_difference]}
    assert as_good(ranking_of(left)) == ["a", "b"]


def effects_of(left, noise=0.001, seed=0):
    """Test effects where a trial leaves what a function of component, speed, duration gives."""
    rng = np.random.default_rng(seed)
    rows = [
        (f"{kind}_{s}s_{v}mps", validation, c, 100.0, left(c, v, s) * rng.lognormal(0, noise))
        for kind, s, v, validation, c in product(
            ("random", "square_sway", "gaps"), (60, 300), (0, 3), ("sway", "pitch"), ("Fx", "My")
        )
    ]
    names = ["trial", "validation", "component", "rms_raw", "rms_after"]
    return calibration_effects(pd.DataFrame(rows, columns=names))[1]


def test_table_f1_states_the_better_level_and_any_where_it_does_not_matter():
    """3 m/s leaves half in Fx; 60 s leaves 3 N·m less in My; all else differs by chance."""
    table = best_levels(
        effects_of(lambda c, v, s: (4 if v else 8) if c == "Fx" else (5 if s == 60 else 8))
    ).set_index("factor")
    assert table.loc["speed_mps"].to_dict() == {"Fx": "3", "My": "any"}
    assert table.loc["duration_s"].to_dict() == {"Fx": "any", "My": "60"}


def test_a_significant_difference_of_hundredths_is_no_difference():
    pairs = effects_of(lambda _, v, s: 1.0 if v else 1.02)
    speeds = pairs[pairs["factor"] == "speed_mps"]
    assert (speeds["p_bonferroni"] < 1e-9).all()
    assert (speeds["verdict"] == "no difference").all()


def test_a_large_difference_without_significance_is_undecided():
    rng = np.random.default_rng(1)
    pairs = effects_of(lambda *_: 50 * rng.lognormal(0, 0.5))
    two = pairs[pairs["factor"] != "kind"]
    assert (two["difference"].abs() > LIMITS.least_difference).all()
    assert set(two["verdict"]) == {"undecided"}
    assert (best_levels(pairs)[["Fx", "My"]] == "undecided").all(axis=None)


def test_a_small_difference_with_a_wide_interval_is_undecided():
    """Scores of 5 N that scatter by half of it show nothing to 0.1 N, however small the mean."""
    pairs = pd.concat([effects_of(lambda *_: 5.0, noise=0.5, seed=seed) for seed in range(10)])
    small = pairs[pairs["difference"].abs() < LIMITS.least_difference]
    assert len(small) > 2
    assert set(small["verdict"]) == {"undecided"}


def test_the_interval_of_a_difference_contains_it_and_agrees_with_the_ratio():
    pairs = effects_of(lambda _, v, s: 4.0 if v else 6.0, noise=0.1)
    np.testing.assert_allclose(pairs["difference"], pairs["rms_first"] - pairs["rms_second"])
    assert (pairs["difference_low"] < pairs["difference"]).all()
    assert (pairs["difference"] < pairs["difference_high"]).all()
    for end in ("low", "high"):
        np.testing.assert_array_equal(pairs[f"difference_{end}"] > 0, pairs[f"ratio_{end}"] > 1)


def test_a_trial_is_as_good_only_where_the_resamples_agree():
    """Two trials of 1 N each, of which one is between 0.5 N better and 0.5 N worse."""
    scores = pd.DataFrame(
        [(name, "sway", "Fx", 100.0, 1.0) for name in ("a", "b", "c")],
        columns=["trial", "validation", "component", "rms_raw", "rms_after"],
    )
    scatter = np.linspace(-0.005, 0.005, 1001)
    resampled = 0.01 + np.column_stack([0 * scatter, scatter, 0.01 * scatter])[..., None]
    ranking = ranked(scores, resampled, {})
    assert ranking.scores["excess_high"].tolist() == pytest.approx([0, 0.475, 0.00475])
    assert as_good(ranking) == ["a", "c"]


def belt_trial(seed, name, person):
    """A moment of 4 N·m per m/s² of the belt, and that of a person, who knows nothing of it."""
    rng = np.random.default_rng(seed)
    acceleration, moment = rng.normal(size=6000), rng.normal(size=6000)
    nothing = np.empty((6000, 0))
    return BeltTrial(name, acceleration, 4 * acceleration + person * moment, nothing, ())


def test_a_person_leaves_as_much_of_the_moment_as_pythagoras_says():
    """A person's 3 N·m beside the belt's 4 make 5 N·m, of which 3 remain: 40 % is taken away."""
    calibration = belt_trial(1, "calibration", person=0)
    model = fit_belt(calibration.acceleration, calibration.moment)
    table = taken_away(model, [belt_trial(2, "belt", 0)], [belt_trial(3, "walk", 3)])
    nobody, person = (table.set_index("person").loc[answer] for answer in ("no", "yes"))
    assert nobody["reduction"] == pytest.approx(100, abs=0.1)
    assert person["rms_raw"] == pytest.approx(5, rel=0.03)
    assert person["rms_after"] == pytest.approx(3, rel=0.03)
    assert person["reduction"] == pytest.approx(40, abs=1.5)
