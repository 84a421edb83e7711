"""The Methods section of a study, by ``methods.txt``, and the works that it cites."""

import platform
import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from importlib.resources import files

import pandas as pd

from compensation.inertia.fit import LAGS_S
from hbm.body import FEET
from hbm.spelling import mean_sd
from pipeline.config.study import Study
from pipeline.figures.residuals import mean_part
from pipeline.report.blocks import templates
from pipeline.report.tables import described
from pipeline.run.load import Results
from pipeline.statistics.comparison import MIXED_MODEL
from pipeline.statistics.design import Design
from pipeline.statistics.verdict import judged_conditions, within_margin
from pipeline.trial.gait.cycles import LIMITS as CYCLES
from pipeline.trial.quality import settling_s
from pipeline.trial.result import TrialResult


def methods(
    results: Results,
    statistics: pd.DataFrame,
    design: Design,
    study: Study | None = None,
    *,
    curves: bool = False,
) -> list[str]:
    """Write the Methods section.

    Parameters
    ----------
    results
        The trials that are described.
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned for their residuals;
        only tests that were computed are described.
    design
        The design that it was computed for.
    study
        The study, if its folder is available; without it, platform, accelerometers and the
        selection of gait cycles are not described.
    curves
        Whether any curves were compared.

    Returns
    -------
    list of str
        Paragraphs, to be copied and shortened.
    """
    trials = list(results.trials.values())
    computed = statistics[statistics["p_corrected"].notna()]

    def pairs_by(test: str) -> list[tuple[str, str]]:
        """Give the planned pairs for which a test was computed."""
        effects = set(computed.loc[computed["test"] == test, "effect"])
        return [pair for pair in design.pairs if " - ".join(pair) in effects]

    by_t, by_model = pairs_by("paired t"), pairs_by(MIXED_MODEL)
    template = templates().get_template("methods.txt")
    text = template.render(
        trials=trials,
        design=design,
        procedures=[trial.procedure for trial in trials],
        without_shoes=all(map(_without_shoes, trials)),
        settings=[trial.settings for trial in trials],
        sexes=sorted({trial.subject.sex for trial in trials}),
        people=len(results.subjects),
        people_in_words=_people(results.subjects),
        conditions=design.in_order(trial.condition for trial in trials),
        filters=sorted({(t.settings.filter, f"{t.settings.cutoff_hz:g}") for t in trials}),
        engines=sorted({trial.engine for trial in trials}),
        treadmill=study.file.treadmill if study else None,
        compensated=any("compensated" in trial.variants for trial in trials),
        lags_s=LAGS_S,
        doubts=dict.fromkeys(note.text for trial in trials for note in trial.of_calibration),
        tested=list(computed["test"].unique()),
        by_t=by_t,
        by_model=by_model,
        factors_by_model=set(computed.loc[computed["test"] == MIXED_MODEL, "effect"])
        - {" - ".join(pair) for pair in by_model},
        judged={(design.judged(c), design.reference_cell) for c in judged_conditions(design)}
        & {*by_t, *by_model},
        within_margin=within_margin(design),
        versions=trials[0].versions,
        python=platform.python_version(),
        pingouin=version("pingouin"),
        curves_tested=curves,
        **_cycles(trials, study, design),
    )
    paragraphs = (" ".join(paragraph.split()) for paragraph in re.split(r"\n\s*\n", text))
    return list(filter(None, paragraphs))


@cache
def references() -> Mapping[str, str]:
    """Give the BibTeX entries of ``references.bib`` by their keys."""
    text = files("pipeline.report").joinpath("references.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{(\w+),$", text, re.MULTILINE)
    return dict(zip(keys, text.strip().split("\n\n"), strict=True))


def bibtex(paragraphs: Sequence[str], software_version: str) -> str:
    """Give the BibTeX entries of what the Methods cite, of the thesis and of this software.

    A work is cited where its first author's name is followed by its year.
    """
    # works that the report rests on, or names outside the Methods
    always = ("hbm_residuals", "vandeloosdrecht2018", "hicks2015")
    text = "".join(paragraphs).replace(" ", "").lower()
    cited = [
        key
        for key in references()
        if key in always or re.search(re.sub(r"(\d+)$", r"\\D{0,30}\1", key), text)
    ]
    entries = "\n\n".join(references()[key] for key in cited) + "\n"
    return entries.replace("{VERSION}", f"{{{software_version}}}")


def _without_shoes(trial: TrialResult) -> bool:
    """Whether nothing is known of shoes in a trial's body."""
    return trial.subject.shoe_mass_kg is None and {*FEET}.isdisjoint(trial.overridden_segments)


def _people(people: pd.DataFrame) -> list[str]:
    """Describe the subjects: how many of each sex, age, stature and mass."""
    sexes = people["sex"].value_counts()
    named = {"male": "male", "female": "female", "unspecified": "of unspecified sex"}
    counts = [f"{sexes[sex]} {words}" for sex, words in named.items() if sex in sexes]
    measures = [
        f"{name} {mean_sd(people[column].mean(), people[column].std(), form)} {unit}"
        for name, column, form, unit in (
            ("age", "age_years", ".0f", "years"),
            ("stature", "height_m", ".2f", "m"),
            ("body mass", "mass_kg", ".1f", "kg"),
        )
        if people[column].notna().all()
    ]
    return [", ".join(counts), *measures]


def _cycles(
    trials: Sequence[TrialResult], study: Study | None, design: Design
) -> dict[str, object]:
    """Describe the cycles that count, the parts of them, and spans in place of them."""
    rules = study.file.conditions if study else {}
    counts: dict[str, list[float]] = {}
    spans_s: dict[str, list[float]] = {}
    for trial in trials:
        if trial.span is None:
            number = sum(len(spans) for spans in trial.cycles.values())
            counts.setdefault(trial.condition, []).append(number)
        else:
            spans_s.setdefault(trial.condition, []).append(trial.span[1] - trial.span[0])
    times_s = {settling_s([(t.settings.filter, t.settings.cutoff_hz)]) for t in trials}
    return {
        "rules": [(name, rule) for name, rule in rules.items() if name in counts],
        "parts": _parts([trial for trial in trials if trial.span is None]),
        "cycle_counts": [f"{_range(counts[c], '.0f')} ({c})" for c in design.in_order(counts)],
        "spans": [f"{_range(spans_s[c], '.1f')} s ({c})" for c in design.in_order(spans_s)],
        "settling": sorted({(f"{after:.2f}", f"{before:.2f}") for after, before in times_s}),
    }


def _parts(trials: Sequence[TrialResult]) -> list[tuple[str, str, str]]:
    """Give each condition of which a part of the cycles counts, the part, and where it is [%]."""
    rows = []
    for condition, name in {t.condition: t.part.name for t in trials if t.part}.items():
        part = described(name)
        if name == "motion":
            part += f" (above {CYCLES.platform_speed:g} m/s, by its pose; not its slow return)"
        mean = mean_part(t for t in trials if t.condition == condition)
        rows.append((condition, part, f"{mean[0]:.0f} to {mean[1]:.0f}" if mean else ""))
    return rows


def _range(values: Sequence[float], form: str) -> str:
    """Write the smallest and the largest of values."""
    low, high = (f"{value:{form}}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
