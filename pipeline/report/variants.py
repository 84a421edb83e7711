"""Whether a study's conclusion depends on its choices: its residuals under each variant."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from hbm.spelling import join_names
from pipeline.config.study import Study
from pipeline.report.blocks import Table
from pipeline.report.verdict import interval, label
from pipeline.run.job import trial_key
from pipeline.run.load import Results, collect, select_trials
from pipeline.run.run import variant_folder
from pipeline.statistics.design import Design
from pipeline.statistics.recordings import pool_recordings
from pipeline.statistics.table_3 import number
from pipeline.statistics.verdict import Verdict, judged_conditions, verdicts


def variant_results(folder: Path, study: Study) -> dict[str, Results]:
    """Gather the results of each variant, of trials that are as the study states them now."""
    of_variants = {}
    for variant, varied in study.variants.items():
        if not any((variant_folder(folder, variant) / "trials").glob("*.parquet")):
            continue
        results = collect(variant_folder(folder, variant))
        current = {
            name
            for name, trial in results.trials.items()
            if name in varied.trials and trial.key == trial_key(varied, name) and not trial.shortage
        }
        if current:
            of_variants[variant] = select_trials(results, current)
    return of_variants


def variant_residuals(of_variants: Mapping[str, Results], design: Design) -> pd.DataFrame:
    """Give the values of `pool_recordings` under each variant, with its name in front."""
    parts = []
    for variant, results in of_variants.items():
        values = pool_recordings(_compared(results, design), design.weigh)
        values.insert(0, "variant", variant)
        parts.append(values)
    return pd.concat(parts, ignore_index=True)


def _compared(results: Results, design: Design) -> pd.DataFrame:
    """Give the residuals that are compared, a row per recording."""
    return design.comparable(results.residuals[results.residuals["headline"].astype(bool)])


def choices(of_variants: Mapping[str, Results], design: Design) -> tuple[str, list[Table]]:
    """Say whether a conclusion depends on the variant, and show the differences under each.

    Parameters
    ----------
    of_variants
        Results of two variants or more.
    design
        What is compared.
    """
    judged = {}
    for variant, results in of_variants.items():
        recordings = _compared(results, design)
        values = pool_recordings(recordings, design.weigh)
        judged[variant] = verdicts(values, design, recordings=recordings)
    tables = [_table(judged, condition, design) for condition in judged_conditions(design)]
    answers: dict[tuple[str, str], set[str]] = {}
    for of_variant in judged.values():
        for verdict in of_variant:
            answers.setdefault((verdict.axis, verdict.condition), set()).add(verdict.answer)
    depend = [cell for cell, different in answers.items() if len(different) > 1]
    if not depend:
        what = f"all {len(answers)} comparisons" if len(answers) > 1 else "the comparison"
        return f"No: the answer of {what} is the same under all {len(judged)} variants.", tables
    named = join_names([f"{axis} {condition}" for axis, condition in depend])
    lead = f"Yes, in {len(depend)} of {len(answers)} comparisons the answer differs: {named}."
    return lead, tables


def _table(verdicts: Mapping[str, Sequence[Verdict]], condition: str, design: Design) -> Table:
    """Show the difference of each residual from its reference under each variant."""
    rows = []
    for variant, of_variant in verdicts.items():
        cells = []
        for verdict in (v for v in of_variant if v.condition == condition):
            difference = number(verdict.difference, "+z.1f")
            between = interval(verdict.low, verdict.high)
            answer = label(verdict.answer, condition, design)
            cells.append(f"{difference}\n[{between}]\n{answer}")
        rows.append((variant, *cells))
    axes = [
        f"{v.axis} ({v.unit})" for v in next(iter(verdicts.values())) if v.condition == condition
    ]
    judged, reference = design.judged(condition), design.reference_cell
    caption = f"{judged} − {reference}: mean difference [95 % CI], answer under each variant"
    return Table(caption, ("Variant", *axes), rows, "numbers")
