"""The Methods section of a study, by ``methods.txt``, and the works that it cites."""

import platform
import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from typing import Any, Final

import pandas as pd

from pipeline.config.study import Study
from pipeline.figures.residuals import mean_part
from pipeline.report.blocks import TEMPLATES
from pipeline.report.tables import described
from pipeline.run.load import Results
from pipeline.run.provenance import engines_of
from pipeline.statistics.comparison import MIXED_ANOVA, RM_ANOVA
from pipeline.statistics.design import Design, design_of
from pipeline.statistics.verdict import join_names, judged_conditions, level_name
from pipeline.trial.gait.cycles import MIN_PLATFORM_SPEED_MPS
from pipeline.trial.quality import settling_s
from pipeline.trial.result import TrialResult

SEXES: Final = {"male": "male", "female": "female", "unspecified": "of unspecified sex"}
CITED_ELSEWHERE: Final = ("hbm_residuals", "vandeloosdrecht2018", "hicks2015")
"""Works that the report rests on, or names outside the Methods."""


def methods(
    results: Results, statistics: pd.DataFrame, design: Design, study: Study | None = None
) -> list[str]:
    """Write the Methods section.

    Parameters
    ----------
    results
        The trials; the settings are theirs.
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned for their residuals;
        only tests that were computed are described.
    design
        The design that it was computed for.
    study
        The study, if its folder is available; without it, platform, accelerometers and the
        selection of gait cycles are not described.

    Returns
    -------
    list of str
        Paragraphs, to be copied and shortened.
    """
    trials = list(results.trials.values())
    text = TEMPLATES.get_template("methods.txt").render(
        trials=trials,
        design=design,
        **_of_subjects(results, trials, design),
        **_of_kinematics(trials),
        **_of_forces(trials, study),
        **_of_cycles(trials, study, design),
        **_of_statistics(statistics, design),
        **_of_software(trials, statistics),
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
    text = "".join(paragraphs).replace(" ", "").lower()
    cited = [
        key
        for key in references()
        if key in CITED_ELSEWHERE or re.search(re.sub(r"(\d+)$", r"\\D{0,30}\1", key), text)
    ]
    entries = "\n\n".join(references()[key] for key in cited) + "\n"
    return entries.replace("{VERSION}", f"{{{software_version}}}")


def _noted(trials: Sequence[TrialResult], code: str) -> list[Mapping[str, Any]]:
    """Give the values of all notes of a code."""
    return [note.values for trial in trials for note in trial.notes if note.code == code]


def _of_subjects(
    results: Results, trials: Sequence[TrialResult], design: Design
) -> dict[str, object]:
    """Describe the subjects."""
    people = results.subjects
    sexes = people["sex"].value_counts()
    measures = [
        f"{name} {_mean_sd(people[column], form)} {unit}"
        for name, column, form, unit in (
            ("age", "age_years", ".0f", "years"),
            ("stature", "height_m", ".2f", "m"),
            ("body mass", "mass_kg", ".1f", "kg"),
        )
        if people[column].notna().all()
    ]
    counts = [f"{sexes[sex]} {words}" for sex, words in SEXES.items() if sex in sexes]
    stated = [trial.subject.height_m is not None for trial in trials]
    return {
        "people": len(people),
        "people_in_words": [", ".join(counts), *measures],
        "conditions": design.in_order(trial.condition for trial in trials),
        "all_statures_stated": all(stated),
        "some_statures_stated": any(stated),
    }


def _of_kinematics(trials: Sequence[TrialResult]) -> dict[str, object]:
    """Describe body, inverse kinematics, filters and the equations of motion."""
    settings = [trial.settings for trial in trials]
    own = {t.subject.id: t.overridden_segments for t in trials if t.overridden_segments}
    return {
        "settings": settings,
        "offsets_mm": [f"{1000 * each.marker_offset_m:g}" for each in settings],
        "filters": sorted({(each.filter, f"{each.cutoff_hz:g}") for each in settings}),
        "sexes": sorted({trial.subject.sex for trial in trials}),
        "overridden": sorted(f"{name}: {join_names(parts)}" for name, parts in own.items()),
        "landmark_rules": [
            rule for values in _noted(trials, "landmarks_substituted") for rule in values["rules"]
        ],
        "held": sorted(
            {
                name
                for values in _noted(trials, "coordinates_held")
                for name in values["coordinates"]
            }
        ),
        "engines": engines_of([trial.engine for trial in trials]),
    }


def _of_forces(trials: Sequence[TrialResult], study: Study | None) -> dict[str, object]:
    """Describe the plates, their way into the lab, and the compensation."""
    corrected = [
        *_noted(trials, "plates_corrected"),
        *_noted(trials, "plate_delays_calibrated"),
    ]
    dynamic = [values["lags_ms"] for values in _noted(trials, "compensated_dynamically")]
    treadmill = study.file.treadmill if study else None
    return {
        "treadmill": treadmill,
        "plate_files": [values["calibration"] for values in corrected],
        "plate_delays": [
            f"{1000 * delay_s:.1f} ms (plate {plate})"
            for values in corrected
            if isinstance(by_plate := values.get("delays_s"), Mapping)
            for plate, delay_s in by_plate.items()
        ],
        "delays_ms": sorted({f"{1000 * (t.settings.plate_delay_s or 0.0):g}" for t in trials}),
        "thresholds_n": [f"{trial.settings.contact_threshold_n:g}" for trial in trials],
        "compensated": any("compensated" in trial.variants for trial in trials),
        "lags_ms": next((lags for lags in dynamic if isinstance(lags, tuple)), ()),
        "doubts": dict.fromkeys(note.text for trial in trials for note in trial.of_calibration),
    }


def _of_cycles(
    trials: Sequence[TrialResult], study: Study | None, design: Design
) -> dict[str, object]:
    """Describe gait events, the cycles that count, and spans in place of them."""
    walking = [trial for trial in trials if trial.span is None]
    rules = study.file.conditions if study else {}
    counts: dict[str, list[float]] = {}
    spans_s: dict[str, list[float]] = {}
    for trial in trials:
        if trial.span is None:
            number = sum(len(spans) for spans in trial.cycles.values())
            counts.setdefault(trial.condition, []).append(number)
        else:
            spans_s.setdefault(trial.condition, []).append(trial.span[1] - trial.span[0])
    settling = {settling_s([(t.settings.filter, t.settings.cutoff_hz)]) for t in trials}
    return {
        "codes": {note.code for trial in trials for note in trial.notes},
        "rules": [(name, rule) for name, rule in rules.items() if name in counts],
        "parts": _parts(walking),
        "cycle_counts": [f"{_range(counts[c], '.0f')} ({c})" for c in design.in_order(counts)],
        "spans": [f"{_range(spans_s[c], '.1f')} s ({c})" for c in design.in_order(spans_s)],
        "settling": sorted((f"{after:.2f}", f"{before:.2f}") for after, before in settling),
        "shares": [f"{100 * trial.settings.min_valid_share:g} %" for trial in trials],
    }


def _parts(trials: Sequence[TrialResult]) -> list[tuple[str, str, str]]:
    """Give each condition of which a part of the cycles counts, the part, and where it is [%]."""
    found = []
    for condition, name in {t.condition: t.part.name for t in trials if t.part}.items():
        part = described(name)
        if name == "motion":
            part += f" (above {MIN_PLATFORM_SPEED_MPS:g} m/s, by its pose; not its slow return)"
        mean = mean_part(t for t in trials if t.condition == condition)
        found.append((condition, part, f"{mean[0]:.0f} to {mean[1]:.0f}" if mean else ""))
    return found


def _of_statistics(statistics: pd.DataFrame, design: Design) -> dict[str, object]:
    """Describe how residuals were compared."""
    tested = sorted(set(statistics.loc[statistics["p_corrected"].notna(), "test"]))
    joint = [test.partition(" with ") for test in tested if " with " in test]
    usual = design_of(design.conditions, compensated=design.compensated, reference=design.reference)
    pairs = [f"{first} against {second}" for first, second in design.pairs]
    if design.pairs == usual.pairs:
        pairs = ["IC against no IC in each condition"] * design.compensated
        if design.others:
            others = join_names([design.judged(condition) for condition in design.others])
            pairs.append(f"{others} against {design.reference_cell}")
    return {
        "tested": tested,
        "pairs": pairs,
        "judged": judged_conditions(design),
        "level": level_name(design),
        "joint": [
            names.split(" and ") for anova, _, names in joint if anova in (RM_ANOVA, MIXED_ANOVA)
        ],
    }


def _of_software(trials: Sequence[TrialResult], statistics: pd.DataFrame) -> dict[str, object]:
    """Name the software with its versions."""
    versions = trials[0].versions
    packages = [f"{name} {versions[name.lower()]}" for name in ("CasADi", "NumPy", "SciPy")]
    if statistics["p_corrected"].notna().any():
        packages.append(f"pingouin {version('pingouin')}")
    own = [trial.versions["hbm-residuals"] for trial in trials]
    return {"own_versions": own, "python": platform.python_version(), "packages": packages}


def _mean_sd(values: pd.Series, form: str) -> str:
    """Write mean and SD of values."""
    spread = f" ± {values.std():{form}}" if len(values) > 1 else ""
    return f"{values.mean():{form}}{spread}"


def _range(values: Sequence[float], form: str) -> str:
    """Write the smallest and the largest of values."""
    low, high = (f"{value:{form}}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
