"""Omnibus tests of compensation, condition, group and their interactions."""

from collections.abc import Iterator
from math import isnan
from typing import Final

import pandas as pd

from pipeline.statistics.design import MIN_SUBJECTS, Design
from pipeline.statistics.f_test import partial_eta_squared_interval
from pipeline.statistics.nonparametric import aligned_ranks, sign_flip
from pipeline.statistics.rm_glm import GlmTerm, repeated_measures_glm
from pipeline.statistics.row import (
    Row,
    complete_subjects,
    join_notes,
    not_computed,
    smallest_p_note,
)

RM_ANOVA: Final = "RM-ANOVA"
MIXED_ANOVA: Final = "mixed ANOVA"
"""Names of the tests without and with a between-subject group."""


def factorial_rows(cells: pd.DataFrame, design: Design, alpha: float) -> Iterator[Row]:
    """Test the within factors and their interaction: ANOVA, sign-flip permutations, aligned ranks.

    Parameters
    ----------
    cells
        One row per subject, one column per cell in the order of the design's; NaN is missing.
    design
        The factors.
    alpha
        Level of significance for Mauchly's test and the observed power.

    Yields
    ------
    Row
        Mauchly's test, F, sign-flip permutation test and aligned-rank F of each effect.
    """
    complete, missing = complete_subjects(cells)
    n, factors = len(complete), design.factors
    if n < MIN_SUBJECTS:
        yield not_computed(RM_ANOVA, "", n, MIN_SUBJECTS, missing)
        return
    values = complete.to_numpy().reshape(n, *design.levels)
    for term in repeated_measures_glm(values, factors, alpha=alpha):
        effect = ":".join(term.within)
        tested = [factor in term.within for factor in factors]
        yield from _mauchly(RM_ANOVA, effect, term, n, missing)
        yield _f_test(RM_ANOVA, effect, term, n, missing, alpha)

        flips = sign_flip(values, tested)
        patterns = f"{'all' if flips.exact else 'random'} {flips.patterns} sign patterns"
        yield Row(
            *("sign-flip permutation", effect, "F", term.f, term.df1, term.df2),
            p_uncorrected=flips.p,
            p_corrected=flips.p,
            correction="none",
            n=n,
            note=join_notes(patterns, smallest_p_note(n, 1, alpha), missing),
        )

        ranked = repeated_measures_glm(aligned_ranks(values, tested), factors, alpha=alpha)
        own = next(other for other in ranked if other.within == term.within)
        yield _f_test("aligned-rank RM-ANOVA", effect, own, n, missing, alpha)


def between_rows(
    cells: pd.DataFrame, between: pd.DataFrame, design: Design, *, centre: bool, alpha: float
) -> Iterator[Row]:
    """Test the within factors and their interactions with groups and covariates.

    Parameters
    ----------
    cells, design
        As in `factorial_rows`.
    between
        One row per subject, indexed as `cells`; columns of text are groups, of numbers slopes.
        The column that the design names as its group makes the test a mixed ANOVA.
    centre, alpha
        As in `repeated_measures_glm`.

    Yields
    ------
    Row
        Mauchly's test and F of each effect.
    """
    complete, missing = complete_subjects(cells.join(between))
    n = len(complete)
    names = [str(name) for name in between]
    varying = [name for name in names if complete[name].nunique() > 1]
    same = [f"{name} left out: the same for all subjects" for name in names if name not in varying]
    covariates = [name for name in varying or names if name != design.group]
    anova = MIXED_ANOVA if design.group in names else RM_ANOVA
    test = f"{anova} with {' and '.join(covariates)}" if covariates else anova
    if n < MIN_SUBJECTS:
        yield not_computed(test, "", n, MIN_SUBJECTS, missing)
        return
    notes = (*same, "" if centre or not covariates else "covariates not centred", missing)
    if not varying or (design.group in names and design.group not in varying):
        yield Row(test, "", n=n, note=join_notes("not computed", *notes))
        return
    try:
        terms = repeated_measures_glm(
            complete[list(design.cells)].to_numpy().reshape(n, *design.levels),
            design.factors,
            {name: complete[name].to_numpy() for name in varying},
            centre=centre,
            alpha=alpha,
        )
    except ValueError as error:
        yield Row(test, "", n=n, note=join_notes(f"not computed: {error}", *notes))
        return
    for term in terms:
        effect = ":".join(filter(None, (*term.within, term.between)))
        yield from _mauchly(test, effect, term, n, join_notes(*notes))
        yield _f_test(test, effect, term, n, join_notes(*notes), alpha)


def _f_test(test: str, effect: str, term: GlmTerm, n: int, note: str, alpha: float) -> Row:
    if isnan(term.f):
        reason = "not computed: no error term, the effect does not vary between subjects"
        return Row(test, effect, n=n, note=join_notes(reason, note))
    several = term.contrasts > 1
    spherical = not several or term.mauchly_p >= alpha
    sphericity = ""
    if several:
        if isnan(term.mauchly_p):
            sphericity = "sphericity cannot be tested with so few subjects"
        elif spherical:
            sphericity = f"sphericity not rejected; Greenhouse-Geisser p = {term.p_gg:.3g}"
        else:
            sphericity = f"sphericity rejected, Mauchly p = {term.mauchly_p:.3g}"
    share = 1.0 if spherical else term.epsilon
    low, high = partial_eta_squared_interval(term.f, share * term.df1, share * term.df2)
    return Row(
        *(test, effect, "F", term.f, term.df1, term.df2),
        p_uncorrected=term.p,
        p_corrected=term.p if spherical else term.p_gg,
        correction="none" if spherical else "Greenhouse-Geisser",
        epsilon=term.epsilon,
        epsilon_hf=term.epsilon_hf,
        effect_size_name="partial eta squared",
        effect_size=term.partial_eta_squared,
        ci_low=low,
        ci_high=high,
        power=term.power if spherical else term.power_gg,
        n=n,
        note=join_notes(sphericity, note),
    )


def _mauchly(test: str, effect: str, term: GlmTerm, n: int, note: str) -> Iterator[Row]:
    """Give Mauchly's test of a within effect that has more than one contrast."""
    if not term.between and not isnan(term.mauchly_p):
        yield Row(
            *(f"Mauchly, {test}", effect, "W", term.mauchly_w),
            p_uncorrected=term.mauchly_p,
            p_corrected=term.mauchly_p,
            correction="none",
            n=n,
            note=note,
        )
