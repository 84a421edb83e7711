"""Statistics of a study: one tidy table of tests from the long table of residuals.

Each question has one test and its robust partner: a repeated-measures analysis of variance and
Friedman's test over the cells, paired t and Wilcoxon tests of the planned pairs.
"""

from collections.abc import Iterator
from math import isnan, nan
from typing import Any, Final

import numpy as np
import pandas as pd

from hbm.numbers import read_numbers
from hbm.spatial import Array
from pipeline.statistics.design import ALPHA, COMPENSATION, EXPERIMENT_3, MIN_SUBJECTS, Design
from pipeline.statistics.mixed import (
    effects_of_factors,
    is_incomplete_or_repeated,
    judging_comparison,
    recording_values,
)
from pipeline.statistics.paired import IntervalEstimate, compare_paired
from pipeline.statistics.rm_glm import (
    GlmTerm,
    observed_power,
    partial_eta_squared_interval,
    repeated_measures_glm,
)

RM_ANOVA: Final = "RM-ANOVA"
MIXED_ANOVA: Final = "mixed ANOVA"
MIXED_MODEL: Final = "mixed model"
"""Names of the tests without and with a between-subject group."""
LIMITS: Final = read_numbers("pipeline.statistics", "thresholds.toml", "friedman")
ALL_CELLS: Final = "all cells"
Row = dict[str, Any]
EMPTY: Final[Row] = {
    **{"test": "", "effect": "", "statistic_name": "", "statistic": nan, "df1": nan, "df2": nan},
    **{"p_uncorrected": nan, "p_corrected": nan, "correction": "", "epsilon": nan},
    **{"effect_size_name": "", "effect_size": nan, "ci_low": nan, "ci_high": nan, "power": nan},
    **{"n": 0, "note": ""},
}
"""Columns of the table of tests, as `statistics` describes them, of a row that has none."""


def statistics(
    residuals: pd.DataFrame,
    subjects: pd.DataFrame | None = None,
    design: Design = EXPERIMENT_3,
    recordings: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """Run every test of a design on every residual.

    Parameters
    ----------
    residuals
        Long table: subject, condition, compensated (bool), axis, unit, rms. A missing row or NaN
        is a missing cell.
    subjects
        One row per subject of the study: subject, and the design's covariates (text as groups,
        numbers as slopes) and group. Subjects without residuals are reported. None leaves the
        covariates out.
    design
        Conditions, planned pairs, covariates; by default those of experiment 3.
    recordings
        The same long table with a row per recording: where a subject lacks a cell or has several
        recordings of one, mixed models use all of them.

    Returns
    -------
    pandas.DataFrame
        A test, or an estimate, of one effect on one residual per row:

        axis, unit
            The residual.
        test, effect
            Name of the test and its effect: factors joined by colons, pairs as "first - second".
        statistic_name, statistic, df1, df2
            The test statistic and its degrees of freedom, with sphericity assumed; by Kenward and
            Roger of mixed models.
        p_uncorrected, p_corrected, correction
            The p-value of the test alone, the one to report, and how it was corrected: "none",
            "Greenhouse-Geisser" where sphericity is rejected or cannot be tested, "Bonferroni x5"
            or "Holm x5" for five planned pairs.
        epsilon
            Greenhouse–Geisser epsilon, whether applied or not.
        effect_size_name, effect_size, ci_low, ci_high
            Effect size, and its 95 % confidence interval where it has one.
        power
            Observed power; it and the interval of an F test are corrected as `p_corrected` is.
        n
            Subjects in this test.
        note
            Subjects left out, what could not be computed, and limitations of the test.

    Raises
    ------
    ValueError
        If a cell is given twice, or subjects in groups have no table.

    Notes
    -----
    Each test takes all subjects who have the cells it needs; the others are named in its note.
    The planned pairs are corrected for within a residual, as in the thesis, not over all six
    residuals; they are over the subjects of all groups.
    """
    if subjects is None and design.group is not None:
        raise ValueError(f"groups by {design.group} need a table of subjects")
    data = residuals[residuals["compensated"].isin(design.variants)]
    data = data.assign(cell=design.cells_of(data))
    listed = [] if subjects is None else list(subjects["subject"])
    everyone = list(dict.fromkeys([*listed, *residuals["subject"]]))
    rows = []
    for (axis, unit), group in data.groupby(["axis", "unit"], sort=False):
        cells = group.pivot(index="subject", columns="cell", values="rms")
        cells = cells.reindex(index=everyone, columns=list(design.cells))
        tests = _tests(cells, subjects, design)
        if recordings is not None:
            values = recording_values(recordings, str(axis), design)
            if subjects is not None and design.group is not None:
                of_group = subjects.set_index("subject")[design.group]
                values = values.assign(group=values["subject"].map(of_group))
            tests += _mixed(values, design)
        rows += [{"axis": axis, "unit": unit, **row} for row in tests]
    others = sorted(set(residuals["condition"]) - set(design.conditions))
    if others:
        note = f"conditions outside the design were not tested: {', '.join(others)}"
        rows.append({"axis": "", "unit": "", **_row("none", "", 0, note)})
    return pd.DataFrame(rows, columns=["axis", "unit", *EMPTY])


def _tests(cells: pd.DataFrame, subjects: pd.DataFrame | None, design: Design) -> list[Row]:
    """Run every test of one residual; cells has a row per subject and a column per cell."""
    measured = int(cells.notna().any(axis=1).sum())
    if not design.factors:
        note = "not computed: one condition without compensation, nothing to compare"
        return [_row("all", "", measured, note)]
    if measured < MIN_SUBJECTS:
        return [_too_few("all", "", measured, MIN_SUBJECTS, _complete(cells)[1])]
    group = [] if subjects is None or design.group is None else [design.group]
    people = pd.DataFrame(index=cells.index) if subjects is None else subjects.set_index("subject")
    if "sex" in people:  # what is not stated is no third sex
        people = people.assign(sex=people["sex"].replace("unspecified", None))
    tests = [
        *_anova(cells, people[group], design),
        *_friedman(cells, design),
        *_pairs(cells, design),
    ]
    if subjects is not None and design.covariates:
        tests += _anova(cells, people[[*group, *design.covariates]], design)
    return tests


def _row(test: str, effect: str, n: int, *notes: str, **values: object) -> Row:
    """Give the row of a test with n subjects; notes that are empty are left out."""
    note = "; ".join(filter(None, notes))
    return EMPTY | {"test": test, "effect": effect, "n": n, "note": note} | values


def _too_few(test: str, effect: str, n: int, needed: int, missing: str) -> Row:
    """Give the row of a test that has too few complete subjects."""
    reason = f"not computed: needs at least {needed} complete subjects, got {n}"
    return _row(test, effect, n, reason, missing)


def _complete(cells: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """Give the subjects (rows) who have all cells, and a note that names the others."""
    gaps = [
        f"{subject} (no {', '.join(cells.columns[gap])})"
        for subject, gap in zip(cells.index, cells.isna().to_numpy(), strict=True)
        if gap.any()
    ]
    return cells.dropna(), f"without {', '.join(gaps)}" if gaps else ""


def _anova(cells: pd.DataFrame, between: pd.DataFrame, design: Design) -> Iterator[Row]:
    """Test the within factors, and their interactions with groups and covariates if there are any.

    Columns of text in `between` are groups, of numbers slopes; the design's group makes the test a
    mixed analysis of variance.
    """
    complete, missing = _complete(cells.join(between))
    n, names = len(complete), [str(name) for name in between]
    # what is the same for all subjects has no effect that could be estimated
    varying = [name for name in names if complete[name].nunique() > 1]
    same = [f"{name} not used: the same for all subjects" for name in names if name not in varying]
    covariates = [name for name in varying or names if name != design.group]
    test = MIXED_ANOVA if design.group in names else RM_ANOVA
    test += f" with {' and '.join(covariates)}" if covariates else ""
    if n < MIN_SUBJECTS:
        yield _too_few(test, "", n, MIN_SUBJECTS, missing)
        return
    if (names and not varying) or (design.group in names and design.group not in varying):
        yield _row(test, "", n, "not computed", *same, missing)
        return
    levels = {COMPENSATION: 2, design.factor: len(design.conditions)}
    shape = n, *(levels[factor] for factor in design.factors)
    try:
        terms = repeated_measures_glm(
            complete[list(design.cells)].to_numpy().reshape(shape),
            design.factors,
            {name: complete[name].to_numpy() for name in varying},
        )
    except ValueError as error:
        yield _row(test, "", n, f"not computed: {error}", *same, missing)
        return
    for term in terms:
        effect = ":".join(filter(None, (*term.within, term.between)))
        if not term.between and not isnan(term.mauchly_p):
            of_w = {"statistic_name": "W", "statistic": term.mauchly_w}
            p = _uncorrected(term.mauchly_p)
            yield _row(f"Mauchly, {test}", effect, n, *same, missing, **of_w, **p)
        if isnan(term.f):
            reason = "not computed: no error term, the effect does not vary between subjects"
            yield _row(test, effect, n, reason, *same, missing)
        else:
            values, sphericity = _f_test(term)
            yield _row(test, effect, n, sphericity, *same, missing, **values)


def _uncorrected(p: float) -> Row:
    """Give a p-value that needs no correction."""
    return {"p_uncorrected": p, "p_corrected": p, "correction": "none"}


def _f_test(term: GlmTerm) -> tuple[Row, str]:
    """Give an F test, corrected where sphericity is rejected or cannot be tested, and which is."""
    spherical = term.contrasts == 1 or term.mauchly_p >= ALPHA
    sphericity = ""
    if isnan(term.mauchly_p):
        sphericity = "sphericity cannot be tested with so few subjects" * (term.contrasts > 1)
    elif spherical:
        sphericity = f"sphericity not rejected; Greenhouse-Geisser p = {term.p_gg:.3g}"
    else:
        sphericity = f"sphericity rejected, Mauchly p = {term.mauchly_p:.3g}"
    # Greenhouse and Geisser: both degrees of freedom times epsilon
    factor = 1.0 if spherical else term.epsilon
    df = factor * term.df1, factor * term.df2
    low, high = partial_eta_squared_interval(term.f, *df)
    values = {
        "statistic_name": "F",
        "statistic": term.f,
        "df1": term.df1,
        "df2": term.df2,
        "p_uncorrected": term.p,
        "p_corrected": term.p if spherical else term.p_gg,
        "correction": "none" if spherical else "Greenhouse-Geisser",
        "epsilon": term.epsilon,
        "effect_size_name": "partial eta squared",
        "effect_size": term.partial_eta_squared,
        "ci_low": low,
        "ci_high": high,
        "power": observed_power(term.f, *df, ALPHA),
    }
    return values, sphericity


def _friedman(cells: pd.DataFrame, design: Design) -> Iterator[Row]:
    """Friedman's one-way test over all cells, and over the conditions without and with IC."""
    import pingouin

    limitation = "one-way over all cells: does not separate IC, condition and their interaction"
    labels = {False: ", no IC", True: ", IC"} if design.compensated else {False: ""}
    tested = {
        f"{design.factor}{label}": [design.cell(c, variant) for c in design.conditions]
        for variant, label in labels.items()
    }
    if len(design.factors) > 1:
        tested = {ALL_CELLS: list(design.cells), **tested}
    for effect, columns in tested.items():
        # two cells are a pair, which Wilcoxon's test compares
        if len(columns) < 3:
            continue
        complete, missing = _complete(cells[columns])
        n = len(complete)
        if n < LIMITS.fewest_subjects:
            yield _too_few("Friedman", effect, n, LIMITS.fewest_subjects, missing)
        elif (complete.nunique(axis=1) == 1).all():
            reason = "not computed: every subject has the same value in all cells"
            yield _row("Friedman", effect, n, reason, missing)
        else:
            test = pingouin.friedman(complete).iloc[0]
            values = {
                "statistic_name": "chi2",
                "statistic": float(test["Q"]),
                "df1": float(test["ddof1"]),
                "effect_size_name": "Kendall's W",
                "effect_size": float(test["W"]),
            }
            values |= _uncorrected(float(test["p_unc"]))
            yield _row("Friedman", effect, n, limitation * (effect == ALL_CELLS), missing, **values)


def _pairs(cells: pd.DataFrame, design: Design) -> Iterator[Row]:
    """Compare the planned pairs: tests with both corrections, estimates."""
    tests: dict[str, list[Row]] = {}
    estimates = []
    for first, second in design.pairs:
        effect = f"{first} - {second}"
        complete, missing = _complete(cells[[first, second]])
        n = len(complete)
        if n < MIN_SUBJECTS:
            yield _too_few("planned pair", effect, n, MIN_SUBJECTS, missing)
            continue
        pair = compare_paired((complete[first] - complete[second]).to_numpy())
        no_t = "not computed: all differences are equal" * isnan(pair.t)
        no_w = "not computed: all differences are zero" * isnan(pair.w)
        # all differences of one sign: 2 of 2^n sign patterns, times the pairs of Bonferroni
        smallest = min(1.0, len(design.pairs) * 2.0 ** (1 - n))
        limit = f"smallest possible p with {n} subjects: {smallest:.3g}" * (smallest > ALPHA)
        of_t = {"statistic_name": "t", "statistic": pair.t, "df1": n - 1}
        of_w = {"statistic_name": "W", "statistic": pair.w}
        g = _size("Hedges' g", pair.g)
        biserial = _size("rank-biserial", IntervalEstimate(pair.rank_biserial))
        for name, values, p, notes in (
            ("paired t", of_t | g, pair.p_t, (no_t,)),
            ("Wilcoxon exact", of_w | biserial, pair.p_exact, (no_w, limit)),
            ("Wilcoxon asymptotic", of_w | biserial, pair.p_asymptotic, (no_w,)),
        ):
            row = _row(name, effect, n, *notes, missing, p_uncorrected=p, **values)
            tests.setdefault(name, []).append(row)
        for size in (_size("mean difference", pair.mean), _size("Cohen's dz", pair.dz)):
            estimates.append(_row("estimate", effect, n, missing, **size))
    for rows in tests.values():
        yield from _with_corrections(rows, len(design.pairs))
    yield from estimates


def _mixed(values: pd.DataFrame, design: Design) -> Iterator[Row]:
    """Compare by mixed models, where these are more than the tests of complete subjects."""
    if not design.factors or not is_incomplete_or_repeated(values, design.cells):
        return
    n, recordings = values["subject"].nunique(), values[["subject", "recording"]].drop_duplicates()
    used = f"{len(recordings)} recordings of {n} subjects; one variance in all cells"
    try:
        if n <= MIN_SUBJECTS:
            raise ValueError(f"factors need more than {MIN_SUBJECTS} subjects, got {n}")
        for effect, test in effects_of_factors(values, design):
            of_test = {"statistic_name": "F", "statistic": test.f}
            of_test |= {"df1": test.df1, "df2": test.df2}
            yield _row(MIXED_MODEL, effect, n, used, **of_test, **_uncorrected(test.p))
    except ValueError as error:
        yield _row(MIXED_MODEL, "", n, f"not computed: {error}")
    rows = []
    for first, second in design.pairs:
        effect = f"{first} - {second}"
        try:
            compared = judging_comparison(values, first, second)
        except ValueError as error:
            yield _row(MIXED_MODEL, effect, n, f"not computed: {error}")
            continue
        interval = IntervalEstimate(compared.difference, *compared.interval())
        of_t = {"statistic_name": "t", "statistic": compared.t, "df1": compared.df()}
        of_t |= {"p_uncorrected": compared.p, **_size("mean difference", interval)}
        note = f"{compared.recordings} recordings"
        name = "paired t" if compared.model is None else MIXED_MODEL
        rows.append(_row(name, effect, compared.subjects, note, **of_t))
    for row in _with_corrections(rows, len(design.pairs)):  # of all pairs together
        if row["test"] == MIXED_MODEL:  # else it is in the table already
            yield row


def _with_corrections(rows: list[Row], planned: int) -> Iterator[Row]:
    """Give the rows of a test of planned pairs with each correction."""
    alone = np.array([row["p_uncorrected"] for row in rows])
    for correction, corrected in _corrected(alone, planned).items():
        for row, p in zip(rows, corrected, strict=True):
            yield row | {"correction": correction, "p_corrected": float(p)}


def _size(name: str, size: IntervalEstimate) -> Row:
    """Give an effect size with its interval."""
    interval = {"ci_low": size.low, "ci_high": size.high}
    return {"effect_size_name": name, "effect_size": size.value, **interval}


def _corrected(p: Array, planned: int) -> dict[str, Array]:
    """Correct for all planned pairs, also where one of them could not be tested."""
    import pingouin

    # a pair without a test counts as one with p = 1
    of_planned = np.ones(planned)
    of_planned[: len(p)] = np.nan_to_num(p, nan=1.0)
    return {
        f"{name} x{planned}": np.where(
            np.isnan(p), np.nan, pingouin.multicomp(of_planned, method=method)[1][: len(p)]
        )
        for name, method in (("Bonferroni", "bonf"), ("Holm", "holm"))
    }
