"""Statistics of experiment 3: one tidy table from the long table of residuals."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, fields, replace
from math import isnan

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.statistics.design import (
    CELLS,
    CONDITIONS,
    MIN_SUBJECTS,
    PLANNED_PAIRS,
    Row,
    complete_subjects,
    join_notes,
    not_computed,
    smallest_p_note,
)
from pipeline.statistics.omnibus import covariate_rows, factorial_rows
from pipeline.statistics.paired import IntervalEstimate, PairedComparison, compare_paired

MIN_SUBJECTS_FRIEDMAN = 3
"""Below, the chi-square approximation does not hold."""
MIN_DIFFERENCES_SHAPIRO = 4
"""pingouin requires at least four values."""


def statistics(
    residuals: pd.DataFrame,
    subjects: pd.DataFrame | None = None,
    *,
    covariates: Sequence[str] = ("sex", "height_m"),
    centre: bool = True,
    alpha: float = 0.05,
) -> pd.DataFrame:
    """Run every test of experiment 3 on every residual.

    Parameters
    ----------
    residuals
        Long table: subject, condition (baseline, sway, pitch), compensated (bool), axis, unit,
        rms. A missing row or NaN is a missing cell.
    subjects
        One row per subject of the study: subject and the covariates. Subjects without residuals
        are reported. None leaves the covariates out.
    covariates
        Columns of `subjects` that enter one model together: text as groups, numbers as slopes.
    centre
        Centre the covariates (see `repeated_measures_glm`); False as in SPSS.
    alpha
        Level of significance for Mauchly's test and the observed power.

    Returns
    -------
    pandas.DataFrame
        Columns axis, unit, and those of `Row`.

    Raises
    ------
    ValueError
        If a column is missing, a cell or a subject is given twice, an axis has two units, an RMS
        is negative or infinite, or `compensated` is not boolean.

    Notes
    -----
    Each test takes all subjects who have the cells it needs; the others are named in its note.
    The five planned pairs are corrected for within a residual, as in the thesis, not over all six
    residuals.
    """
    _check(residuals)
    if subjects is not None:
        _check_subjects(subjects, covariates)
    compensation = np.where(residuals["compensated"], " IC", " no IC")
    data = residuals.assign(cell=residuals["condition"] + compensation)
    listed = [] if subjects is None else list(subjects["subject"])
    everyone = list(dict.fromkeys([*listed, *data["subject"]]))
    rows = []
    for (axis, unit), group in data.groupby(["axis", "unit"], sort=False):
        cells = group.pivot(index="subject", columns="cell", values="rms")
        cells = cells.reindex(index=everyone, columns=list(CELLS))
        measured = int(cells.notna().any(axis=1).sum())
        if measured < MIN_SUBJECTS:
            missing = complete_subjects(cells)[1]
            tests = [not_computed("all", "", measured, MIN_SUBJECTS, missing)]
        else:
            tests = [*factorial_rows(cells, alpha), *_friedman(cells), *_pairs(cells, alpha)]
            if subjects is not None:
                table = subjects.set_index("subject")[list(covariates)]
                tests += covariate_rows(cells, table, centre=centre, alpha=alpha)
        rows += [{"axis": axis, "unit": unit, **asdict(test)} for test in tests]
    others = sorted(set(data["condition"]) - set(CONDITIONS))
    if others:
        note = f"conditions outside the 2 x 3 design were not tested: {', '.join(others)}"
        rows.append({"axis": "", "unit": "", **asdict(Row("none", "", note=note))})
    return pd.DataFrame(rows, columns=["axis", "unit", *(field.name for field in fields(Row))])


def _check(residuals: pd.DataFrame) -> None:
    needed = ["subject", "condition", "compensated", "axis", "unit", "rms"]
    absent = [name for name in needed if name not in residuals]
    if absent:
        raise ValueError(f"residuals: no column {', '.join(absent)}; expected {', '.join(needed)}")
    if not residuals["compensated"].isin([True, False]).all():
        raise ValueError("residuals: column compensated must hold True or False only")
    if (residuals["rms"] < 0).any() or np.isinf(residuals["rms"]).any():
        raise ValueError("residuals: an RMS is negative or infinite")
    cell = ["subject", "condition", "compensated", "axis"]
    twice = residuals.loc[residuals.duplicated(cell), cell]
    if len(twice):
        raise ValueError(f"residuals: given more than once: {', '.join(map(str, twice.iloc[0]))}")
    units = residuals.groupby("axis")["unit"].nunique()
    if (units > 1).any():
        raise ValueError(f"residuals: more than one unit for {', '.join(units.index[units > 1])}")


def _check_subjects(subjects: pd.DataFrame, covariates: Sequence[str]) -> None:
    absent = [name for name in ("subject", *covariates) if name not in subjects]
    if absent:
        raise ValueError(f"subjects: no column {', '.join(absent)}; there are {[*subjects]}")
    twice = subjects["subject"][subjects["subject"].duplicated()]
    if len(twice):
        raise ValueError(f"subjects: given more than once: {', '.join(map(str, twice))}")


def _friedman(cells: pd.DataFrame) -> Iterator[Row]:
    """Friedman's one-way test over all cells, and over the conditions without and with IC."""
    import pingouin

    limitation = "one-way over six cells: does not separate IC, condition and their interaction"
    for effect, columns, note in (
        ("six cells", CELLS, limitation),
        ("condition, no IC", CELLS[:3], ""),
        ("condition, IC", CELLS[3:], ""),
    ):
        complete, missing = complete_subjects(cells[list(columns)])
        if len(complete) < MIN_SUBJECTS_FRIEDMAN:
            yield not_computed("Friedman", effect, len(complete), MIN_SUBJECTS_FRIEDMAN, missing)
            continue
        if (complete.nunique(axis=1) == 1).all():
            reason = "not computed: every subject has the same value in all cells"
            yield Row("Friedman", effect, n=len(complete), note=join_notes(reason, missing))
            continue
        found = pingouin.friedman(complete).iloc[0]
        yield Row(
            *("Friedman", effect, "chi2", float(found["Q"]), float(found["ddof1"])),
            p_uncorrected=float(found["p_unc"]),
            p_corrected=float(found["p_unc"]),
            correction="none",
            effect_size_name="Kendall's W",
            effect_size=float(found["W"]),
            n=len(complete),
            note=join_notes(note, missing),
        )


def _pairs(cells: pd.DataFrame, alpha: float) -> Iterator[Row]:
    """Compare the five planned pairs: normality, tests with both corrections, estimates."""
    found: dict[str, PairedComparison] = {}
    missing: dict[str, str] = {}
    for first, second in PLANNED_PAIRS:
        effect = f"{first} - {second}"
        complete, missing[effect] = complete_subjects(cells[[first, second]])
        n = len(complete)
        if n < MIN_SUBJECTS:
            yield not_computed("planned pair", effect, n, MIN_SUBJECTS, missing[effect])
            continue
        differences = (complete[first] - complete[second]).to_numpy()
        found[effect] = compare_paired(differences)
        yield _normality(effect, differences, missing[effect])

    for test, p_name in (
        ("paired t", "p_t"),
        ("Wilcoxon exact", "p_exact"),
        ("Wilcoxon asymptotic", "p_asymptotic"),
    ):
        p = np.array([getattr(compared, p_name) for compared in found.values()])
        for correction, corrected in _corrected(p).items():
            for effect, p_corrected in zip(found, corrected, strict=True):
                limit = smallest_p_note(found[effect].n, len(PLANNED_PAIRS), alpha)
                notes = (limit * (test == "Wilcoxon exact"), missing[effect])
                row = _pair_test(test, effect, found[effect], join_notes(*notes))
                yield replace(row, correction=correction, p_corrected=float(p_corrected))

    for effect, compared in found.items():
        for name, estimate in (
            ("mean difference", compared.mean),
            ("Cohen's dz", compared.dz),
            ("Hodges-Lehmann shift", compared.shift),
        ):
            row = Row("estimate", effect, n=compared.n, note=missing[effect])
            yield _with_size(row, name, estimate)


def _pair_test(test: str, effect: str, compared: PairedComparison, note: str) -> Row:
    n = compared.n
    if test == "paired t":
        note = join_notes("not computed: all differences are equal" * isnan(compared.t), note)
        row = Row(test, effect, "t", compared.t, n - 1, p_uncorrected=compared.p_t, n=n, note=note)
        return _with_size(row, "Hedges' g", compared.g)
    note = join_notes("not computed: all differences are zero" * isnan(compared.w), note)
    p = compared.p_exact if test == "Wilcoxon exact" else compared.p_asymptotic
    row = Row(test, effect, "W", compared.w, p_uncorrected=p, n=n, note=note)
    return _with_size(row, "rank-biserial", IntervalEstimate(compared.rank_biserial))


def _with_size(row: Row, name: str, size: IntervalEstimate) -> Row:
    return replace(
        row, effect_size_name=name, effect_size=size.value, ci_low=size.low, ci_high=size.high
    )


def _corrected(p: Array) -> dict[str, Array]:
    """Correct for all planned pairs, also where one of them could not be tested."""
    import pingouin

    planned = np.ones(len(PLANNED_PAIRS))
    planned[: len(p)] = np.nan_to_num(p, nan=1.0)
    return {
        f"{name} x{len(PLANNED_PAIRS)}": np.where(
            np.isnan(p), np.nan, pingouin.multicomp(planned, method=method)[1][: len(p)]
        )
        for name, method in (("Bonferroni", "bonf"), ("Holm", "holm"))
    }


def _normality(effect: str, differences: Array, missing: str) -> Row:
    """Test the differences, whose normality the paired t-test assumes, not the cells."""
    import pingouin

    test, n = "Shapiro-Wilk of the differences", len(differences)
    if n < MIN_DIFFERENCES_SHAPIRO:
        return not_computed(test, effect, n, MIN_DIFFERENCES_SHAPIRO, missing)
    if np.ptp(differences) == 0:
        reason = "not computed: all differences are equal"
        return Row(test, effect, n=n, note=join_notes(reason, missing))
    found = pingouin.normality(differences).iloc[0]
    p = float(found["pval"])
    return Row(
        *(test, effect, "W", float(found["W"])),
        p_uncorrected=p,
        p_corrected=p,
        correction="none",
        n=n,
        note=missing,
    )
