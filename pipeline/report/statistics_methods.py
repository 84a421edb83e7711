"""The paragraph of the Methods on statistics, from the design and the tests that were computed."""

from typing import Final

import pandas as pd

from pipeline.statistics.comparison import MIXED_ANOVA, RM_ANOVA
from pipeline.statistics.design import Design, design_of
from pipeline.statistics.verdict import join_names, judged_conditions, level_name

COVARIATES: Final = {"height_m": "stature", "mass_kg": "body mass", "age_years": "age"}
"""Key -> words; the other keys are words."""


def statistics_methods(statistics: pd.DataFrame, design: Design) -> list[str]:
    """Describe how residuals were compared.

    Parameters
    ----------
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned; only tests that were
        computed are described.
    design
        The design that it was computed for.

    Returns
    -------
    list of str
        One paragraph, or none.
    """
    computed = set(statistics.loc[statistics["p_corrected"].notna(), "test"])
    parts = []
    if computed & {RM_ANOVA, MIXED_ANOVA}:
        parts.append(_anova(design))
    if "paired t" in computed:
        parts.append(_planned_pairs(design))
    if "Friedman" in computed:
        parts.append("As a check, the cells were also compared by Friedman's test.")
    for test in sorted(computed):
        anova, joint, names = test.partition(" with ")
        if joint and anova in (RM_ANOVA, MIXED_ANOVA):
            covariates = [COVARIATES.get(name, name) for name in names.split(" and ")]
            kind = "covariates" if len(covariates) > 1 else "a covariate"
            added = f"{join_names(covariates)} as {kind}"
            parts.append(f"A further analysis of variance included {added}.")
    return [" ".join([*parts, "The level of significance was 0.05."])] if parts else []


def _anova(design: Design) -> str:
    """Describe the analysis of variance."""
    factors = ["compensation (no IC, IC)"] * design.compensated
    if len(design.conditions) > 1:
        factors.append(f"{design.factor} ({', '.join(design.conditions)})")
    ways, plural = ("two-way", "s") if len(factors) > 1 else ("one-way", "")
    how = f"a {ways} repeated-measures analysis of variance with the factor{plural}"
    within = join_names(factors)
    if design.group is not None:
        how = f"a mixed analysis of variance with {design.group} between subjects and"
        within += " within subjects"
    text = f"RMS residuals were compared by {how} {within}."
    if len(design.conditions) < 3:
        return text
    return (
        f"{text} The Greenhouse–Geisser correction was applied where Mauchly's test rejected "
        "sphericity or could not be computed."
    )


def _planned_pairs(design: Design) -> str:
    """Describe the planned comparisons and the verdict."""
    usual = design_of(design.conditions, compensated=design.compensated, reference=design.reference)
    reference, pairs = design.reference_cell, len(design.pairs)
    which = "; ".join(f"{first} against {second}" for first, second in design.pairs)
    if design.pairs == usual.pairs:
        parts = ["IC against no IC in each condition"] * design.compensated
        if design.others:
            others = join_names([design.judged(condition) for condition in design.others])
            parts.append(f"{others} against {reference}")
        which = "; ".join(parts)
    corrected = f" with {design.correction.capitalize()} correction" * (pairs > 1)
    planned = f"The {pairs} planned pairs were" if pairs > 1 else "The planned pair was"
    text = (
        f"{planned} compared ({which}) by paired t-tests and exact Wilcoxon "
        f"signed-rank tests{corrected}."
    )
    if not judged_conditions(design):
        return text
    return (
        f"{text} A residual was considered to be at {level_name(design)} "
        "if the upper bound of the simultaneous 95 % confidence interval of its ratio to "
        f"{reference} (Fieller 1954) was at most {1 + design.margin:g} (non-inferiority; "
        "Schuirmann 1987)."
    )
