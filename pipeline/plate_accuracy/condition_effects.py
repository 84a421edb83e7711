"""How the errors of plates depend on speed, weight, place and the other conditions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import pandas as pd
from scipy import stats

from pipeline.io.write import markdown
from pipeline.statistics.factorial import anova, compare_levels, residuals

FACTORS: Final = ("belt", "profile", "speed_mps", "position_m", "mass_kg")
MIN_TRIALS_PER_COEFFICIENT: Final = 3
"""Of an analysis of variance."""
MIN_BLOCKS: Final = 5
"""Recordings in which thirds of the belt can be compared."""
MAX_EXPONENT: Final = 2.0
"""Of a Box-Cox transform, either way: squares and their inverses are the strongest transforms in
use. Beyond, single values far from the others determine the exponent."""
ALPHA: Final = 0.05
LAB_NOTE: Final = "Lab axes: x forward, y left, z up."
TEST_COLUMNS: Final = (
    *("quantity", "exponent", "shapiro_w", "shapiro_p", "effect", "df", "df_error", "f", "p"),
    "partial_eta_squared",
)
PAIR_COLUMNS: Final = ("quantity", "factor", "first", "second", "p_bonferroni")


@dataclass(frozen=True, slots=True)
class ConditionEffects:
    """Analyses of variance of the orthogonal errors.

    Attributes
    ----------
    tests
        One row per quantity and effect: quantity, exponent (Box–Cox λ), shapiro_w and shapiro_p
        (Shapiro–Wilk test of the model's residuals), effect, df, df_error, f, p,
        partial_eta_squared. The effect "zone" is the third of the belt, antero-posterior.
    pairs
        Pairs of levels, Bonferroni-corrected: quantity, factor, first, second, p_bonferroni.
    remarks
        Where the assumptions do not hold, and what was not tested.
    """

    tests: pd.DataFrame
    pairs: pd.DataFrame
    remarks: tuple[str, ...] = ()


NO_EFFECTS: Final = ConditionEffects(
    pd.DataFrame(columns=TEST_COLUMNS), pd.DataFrame(columns=PAIR_COLUMNS)
)


@dataclass(frozen=True, slots=True)
class _Analysis:
    """Data of one quantity, the factors of its model, and those of them that are of interest."""

    quantity: str
    data: pd.DataFrame
    factors: Sequence[str]
    tested: Sequence[str]


def reported_errors(errors: pd.DataFrame) -> pd.DataFrame:
    """Give the errors of the recordings with supports, or of all where none has supports."""
    return errors[errors["supports"] == errors["supports"].any()]


def condition_effects(errors: pd.DataFrame) -> ConditionEffects:
    """Test what the orthogonal errors depend on, in the recordings with supports if there are any.

    Parameters
    ----------
    errors
        As in `pipeline.plate_accuracy.accuracy.PlateAccuracy`.

    Returns
    -------
    ConditionEffects
        Empty, with a remark, where there are too few recordings.

    Notes
    -----
    Per quantity two analyses of variance of type III, main effects, after a Box–Cox transform. Of
    whole recordings: belt, profile, speed, position and weight, as far as they vary. Of the thirds
    of the belt within recordings: the third, with the recording as a block, since thirds of one
    recording share its weight, speed and noise.

    Deviations from the original: van de Loosdrecht (2018, II.A.4) tests with three factors, which
    leaves belt and profile in the error, and does not state whether the transformed data were
    normal.
    """
    supported = reported_errors(errors)
    tests, pairs, remarks = [], [], []
    for label, analyses in (
        ("whole recordings", list(_of_recordings(supported))),
        ("thirds of the belt", list(_of_thirds(supported))),
    ):
        done = []
        for one in analyses:
            try:
                table, compared = _analyse(one)
            except ValueError as error:
                remarks.append(f"{one.quantity}, {label}: not tested: {error}")
                continue
            done.append(table)
            pairs.append(compared)
        if not analyses:
            remarks.append(f"{label}: not tested, too few recordings, or nothing varies")
        if done:
            remarks += _assumptions(label, pd.concat(done))
        tests += done
    if not tests:
        return ConditionEffects(NO_EFFECTS.tests, NO_EFFECTS.pairs, tuple(remarks))
    return ConditionEffects(
        pd.concat(tests, ignore_index=True)[list(TEST_COLUMNS)],
        pd.concat(pairs, ignore_index=True)[list(PAIR_COLUMNS)],
        tuple(remarks),
    )


def _of_recordings(errors: pd.DataFrame) -> Iterator[_Analysis]:
    whole = errors[errors["zone"] == "all"]
    used = [factor for factor in FACTORS if whole[factor].nunique() > 1]
    for quantity, part in whole.groupby("quantity", sort=False):
        coefficients = 1 + sum(part[factor].nunique() - 1 for factor in used)
        if used and len(part) >= MIN_TRIALS_PER_COEFFICIENT * coefficients:
            yield _Analysis(str(quantity), part, used, used)


def _of_thirds(errors: pd.DataFrame) -> Iterator[_Analysis]:
    thirds = errors[errors["zone"] != "all"]
    for quantity, part in thirds.groupby("quantity", sort=False):
        several = part[part.groupby("file")["zone"].transform("nunique") > 1]
        if several["file"].nunique() >= MIN_BLOCKS:
            yield _Analysis(str(quantity), several, ("file", "zone"), ("zone",))


def _analyse(one: _Analysis) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Give tests and pairs of one quantity."""
    sizes = one.data["orthogonal"].to_numpy()
    if not (sizes > 0).all():
        raise ValueError("a Box–Cox transform needs positive values, none missing")
    transformed, exponent = stats.boxcox(sizes / stats.gmean(sizes))  # λ is the same in any unit
    data = one.data.assign(y=transformed)
    table = anova(data, "y", one.factors)
    normal = stats.shapiro(residuals(data, "y", one.factors))
    tests = table[table["effect"].isin(one.tested)].assign(
        quantity=one.quantity,
        exponent=exponent,
        shapiro_w=normal.statistic,
        shapiro_p=normal.pvalue,
        df_error=table["df"].iloc[-1],
    )
    pairs = [
        compare_levels(data, "y", one.factors, factor).assign(quantity=one.quantity, factor=factor)
        for factor in one.tested
    ]
    return tests, pd.concat(pairs)


def _assumptions(label: str, tests: pd.DataFrame) -> list[str]:
    """Say of which quantities the exponent or the residuals are out of the ordinary."""
    each = tests.drop_duplicates("quantity")
    odd = each[each["exponent"].abs() > MAX_EXPONENT]
    skew = each[each["shapiro_p"] < ALPHA]
    remarks = []
    if len(odd):
        named = ", ".join(
            f"{q} (λ = {x:.1f})" for q, x in zip(odd["quantity"], odd["exponent"], strict=True)
        )
        remarks.append(
            f"{label}: Box–Cox exponent beyond ±{MAX_EXPONENT:g} of {named}: these errors "
            "hardly vary, or single recordings stand out; look at errors.csv before their p"
        )
    if len(skew):
        named = ", ".join(
            f"{q} (W = {w:.3f}, {'p < 0.001' if p < 0.001 else f'p = {p:.3f}'})"
            for q, w, p in skew[["quantity", "shapiro_w", "shapiro_p"]].itertuples(index=False)
        )
        remarks.append(
            f"{label}: residuals differ from a normal distribution (Shapiro–Wilk): {named}; their "
            "p are approximate"
        )
    return remarks


def effects_section(effects: ConditionEffects) -> list[str]:
    """Give the paragraphs of the page on the effects of the conditions."""
    lines = ["## Effects of the conditions"]
    if len(effects.tests):
        lines += [
            f"{LAB_NOTE} Orthogonal errors after a Box–Cox transform (exponent), analysis of "
            "variance of type III, main effects. The thirds of the belt (zone: antero-posterior "
            "position) are compared within recordings; all others between recordings. shapiro_p "
            "is the Shapiro–Wilk test of the residuals. Pairs of levels, Bonferroni-corrected, are "
            "in pairs.csv.",
            markdown(effects.tests, 3),
        ]
    remarks = "\n".join(f"- {remark}" for remark in effects.remarks)
    return [*lines, remarks] if remarks else lines
