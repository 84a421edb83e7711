"""Statistics of a study: one tidy table from the long table of residuals."""

from collections.abc import Iterator
from dataclasses import asdict, fields, replace
from math import isnan

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.statistics.design import EXPERIMENT_3, MIN_SUBJECTS, Design
from pipeline.statistics.omnibus import between_rows, factorial_rows
from pipeline.statistics.paired import IntervalEstimate, PairedComparison, compare_paired
from pipeline.statistics.row import (
    Row,
    complete_subjects,
    join_notes,
    not_computed,
    smallest_p_note,
)

MIN_SUBJECTS_FRIEDMAN = 3
"""Below, the chi-square approximation does not hold."""
MIN_CELLS_FRIEDMAN = 3
"""Two cells are a pair."""
ALL_CELLS = "all cells"
MIN_DIFFERENCES_SHAPIRO = 4
"""pingouin requires at least four values."""


def statistics(
    residuals: pd.DataFrame,
    subjects: pd.DataFrame | None = None,
    design: Design = EXPERIMENT_3,
    *,
    centre: bool = True,
    alpha: float = 0.05,
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
    The planned pairs are corrected for within a residual, as in the thesis, not over all six
    residuals; they are over the subjects of all groups.
    """
    _check(residuals)
    if subjects is not None:
        _check_subjects(subjects, design)
    elif design.group is not None:
        raise ValueError(f"groups by {design.group} need a table of subjects")
    data = residuals[residuals["compensated"].isin(design.variants)]
    names = [design.cell(*key) for key in zip(data["condition"], data["compensated"], strict=True)]
    data = data.assign(cell=names)
    listed = [] if subjects is None else list(subjects["subject"])
    everyone = list(dict.fromkeys([*listed, *residuals["subject"]]))
    rows = []
    for (axis, unit), group in data.groupby(["axis", "unit"], sort=False):
        cells = group.pivot(index="subject", columns="cell", values="rms")
        cells = cells.reindex(index=everyone, columns=list(design.cells))
        tests = _tests(cells, subjects, design, centre=centre, alpha=alpha)
        rows += [{"axis": axis, "unit": unit, **asdict(test)} for test in tests]
    others = sorted(set(residuals["condition"]) - set(design.conditions))
    if others:
        note = f"conditions outside the design were not tested: {', '.join(others)}"
        rows.append({"axis": "", "unit": "", **asdict(Row("none", "", note=note))})
    return pd.DataFrame(rows, columns=["axis", "unit", *(field.name for field in fields(Row))])


def _tests(
    cells: pd.DataFrame,
    subjects: pd.DataFrame | None,
    design: Design,
    *,
    centre: bool,
    alpha: float,
) -> list[Row]:
    """Run every test of one residual."""
    measured = int(cells.notna().any(axis=1).sum())
    if not design.factors:
        note = "not computed: one condition without compensation, nothing to compare"
        return [Row("all", "", n=measured, note=note)]
    if measured < MIN_SUBJECTS:
        return [not_computed("all", "", measured, MIN_SUBJECTS, complete_subjects(cells)[1])]
    group = () if design.group is None else (design.group,)
    people = None if subjects is None else subjects.set_index("subject")
    if people is not None and "sex" in people:  # what is not stated is no third sex
        people = people.assign(sex=people["sex"].replace("unspecified", None))
    tests: list[Row] = []
    if people is None or not group:
        tests += factorial_rows(cells, design, alpha)
    else:
        tests += between_rows(cells, people[[*group]], design, centre=centre, alpha=alpha)
    tests += [*_friedman(cells, design), *_pairs(cells, design, alpha)]
    if people is not None and design.covariates:
        own = people[[*group, *design.covariates]]
        tests += between_rows(cells, own, design, centre=centre, alpha=alpha)
    return tests


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


def _check_subjects(subjects: pd.DataFrame, design: Design) -> None:
    needed = ("subject", *design.covariates, *(() if design.group is None else (design.group,)))
    absent = [name for name in needed if name not in subjects]
    if absent:
        raise ValueError(f"subjects: no column {', '.join(absent)}; there are {[*subjects]}")
    twice = subjects["subject"][subjects["subject"].duplicated()]
    if len(twice):
        raise ValueError(f"subjects: given more than once: {', '.join(map(str, twice))}")


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
        if len(columns) < MIN_CELLS_FRIEDMAN:
            continue
        note = limitation if effect == ALL_CELLS else ""
        complete, missing = complete_subjects(cells[columns])
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


def _pairs(cells: pd.DataFrame, design: Design, alpha: float) -> Iterator[Row]:
    """Compare the planned pairs: normality, tests with both corrections, estimates."""
    if not design.pairs:
        return
    found: dict[str, PairedComparison] = {}
    missing: dict[str, str] = {}
    for first, second in design.pairs:
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
        for correction, corrected in _corrected(p, len(design.pairs)).items():
            for effect, p_corrected in zip(found, corrected, strict=True):
                limit = smallest_p_note(found[effect].n, len(design.pairs), alpha)
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


def _corrected(p: Array, planned: int) -> dict[str, Array]:
    """Correct for all planned pairs, also where one of them could not be tested."""
    import pingouin

    every = np.ones(planned)
    every[: len(p)] = np.nan_to_num(p, nan=1.0)
    return {
        f"{name} x{planned}": np.where(
            np.isnan(p), np.nan, pingouin.multicomp(every, method=method)[1][: len(p)]
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
