"""The Methods of a study in words, true for its settings, with the works they cite."""

import platform
from collections.abc import Sequence
from importlib.metadata import version
from typing import Final

import pandas as pd

from pipeline.config.schema import Condition, Treadmill
from pipeline.config.study import Study
from pipeline.report.references import references
from pipeline.run.load import Results
from pipeline.statistics.design import PLANNED_PAIRS, in_order
from pipeline.statistics.verdict import MARGIN, join_names
from pipeline.trial.summary import TrialSummary

HIP: Final = {
    "harrington": ("the regression of Harrington et al. 2007", "harrington2007"),
    "bell": ("the regression of Bell et al. 1990", "bell1990"),
    "functional": ("symmetrical centre of rotation estimation (Ehrig et al. 2006)", "ehrig2006"),
}
FILTERS: Final = {
    "zero_phase": "a second-order Butterworth filter run forward and backward (−3 dB at "
    "{cutoff_hz:g} Hz after both passes)",
    "realtime": "a causal second-order Butterworth filter (cut-off {cutoff_hz:g} Hz, as in the "
    "Human Body Model's real-time filter)",
}


def methods(results: Results, statistics: pd.DataFrame, study: Study | None = None) -> list[str]:
    """Write the Methods.

    Parameters
    ----------
    results
        What `hbm run` left; the settings are those of its trials.
    statistics
        What `pipeline.statistics.comparison.statistics` made of it; only tests that could be done
        are told.
    study
        The study, if it is at hand: without it, nothing is said of platform and sensors.

    Returns
    -------
    list of str
        Paragraphs, for a person to paste and shorten.
    """
    trials = list(results.summaries.values())
    return [
        _subjects(results),
        _body(trials),
        _forces(trials, study),
        _cycles(trials, study),
        *_tests(statistics),
        _software(trials, statistics),
    ]


def cited(results: Results) -> list[str]:
    """Give the keys of the works that the Methods cite, and of the thesis, in order."""
    hips = {HIP[trial.settings.hip][1] for trial in results.summaries.values()}
    unused = {key for _, key in HIP.values()} - hips
    return [key for key in references() if key not in unused]


def _subjects(results: Results) -> str:
    people = results.subjects
    sexes = people["sex"].value_counts()
    said = {"male": "male", "female": "female", "unspecified": "of unspecified sex"}
    counts = [f"{sexes[sex]} {words}" for sex, words in said.items() if sex in sexes]
    measures = [
        f"{name} {_mean_sd(people[column], form)} {unit}"
        for name, column, form, unit in (
            ("age", "age_years", ".0f", "years"),
            ("stature", "height_m", ".2f", "m"),
            ("body mass", "mass_kg", ".1f", "kg"),
        )
        if people[column].notna().all()
    ]
    conditions = in_order(condition for _, condition in results.summaries)
    stated = [trial.subject for trial in results.summaries.values()]
    mass = _origin(
        "Body mass",
        [person.mass_kg is not None for person in stated],
        "weighed by the plates over the first 100 frames of the calibration pose",
    )
    height = _origin(
        "stature",
        [person.height_m is not None for person in stated],
        "estimated from the length of the legs",
    )
    return (
        f"The analysis covers {len(people)} subject{'s' * (len(people) > 1)} "
        f"({'; '.join([*counts, *measures])}) in the condition{'s' * (len(conditions) > 1)} "
        f"{join_names(conditions)}. {mass}; {height}."
    )


def _body(trials: Sequence[TrialSummary]) -> str:
    sets = join_names(sorted({trial.marker_set for trial in trials}))
    hips = join_names(sorted({HIP[trial.settings.hip][0] for trial in trials}))
    offsets = join_names(sorted({f"{trial.settings.marker_offset_m * 1000:g}" for trial in trials}))
    sexes = {trial.subject.sex for trial in trials}
    table = "of the subject's sex" if "unspecified" not in sexes else "(the mean of both sexes)"
    if len(sexes) > 1 and "unspecified" in sexes:
        table = "of the subject's sex (the mean of both where it was not stated)"
    settings = [trial.settings for trial in trials]
    forms = [FILTERS[s.filter].format(cutoff_hz=s.cutoff_hz) for s in settings]
    filters = join_names(list(dict.fromkeys(forms)))
    locked = sorted({name for trial in trials for name in trial.locked})
    known = {
        f"{trial.subject.id}: {join_names(trial.overridden_segments)}"
        for trial in trials
        if trial.overridden_segments
    }
    own = f", but for those stated of single segments ({'; '.join(sorted(known))})" if known else ""
    kept = f" Coordinates that no marker shows were kept at neutral ({join_names(locked)})."
    return (
        "Motion was described by an open implementation of the Human Body Model (van den Bogert "
        "et al. 2013) with 46 coordinates. Each subject's body was built from a calibration pose "
        f"with the marker set {sets}: hip joint centres by {hips}, marker "
        f"centres {offsets} mm from the skin, segment inertias from de Leva's table (1996) "
        f"{table}{own}."
        f"{kept if locked else ''} The coordinates of each frame minimised the sum of squared "
        "distances between measured and modelled markers (Lu and O'Connor 1999). Coordinates and "
        f"the forces on the feet were low-passed alike by {filters} before velocities, "
        "accelerations and inverse dynamics were computed."
    )


def _forces(trials: Sequence[TrialSummary], study: Study | None) -> str:
    delays = {trial.settings.plate_delay_s for trial in trials}
    shifted = join_names(sorted(f"{1000 * delay:g}" for delay in delays))
    taken = f" {shifted} ms later than the markers" if delays != {0.0} else ""
    thresholds = join_names(sorted({f"{t.settings.contact_threshold_n:g}" for t in trials}))
    text = (
        f"The plates' wrenches were resampled to the markers' times{taken}"
        f"{_moved(study.file.treadmill) if study else ''} and given to the foot that stood there "
        f"(contact above {thresholds} N). The residual is the wrench that would have to act on the "
        "pelvis to close the equations of motion, about the middle of the hip joints, in lab axes "
        "(x forward, y right, z up)."
    )
    if not any(row.compensated for trial in trials for row in trial.residuals):
        return text + " No compensation for the treadmill's own inertia was applied."
    text += (
        " Every trial was processed twice from the same motion, with the plates as measured (no IC)"
        " and after inertia compensation (IC): each plate's wrench due to the treadmill's own "
        "motion was predicted by a linear model of accelerometer signals and subtracted in the "
        "plate's frame (Hnat et al. 2018)."
    )
    if study and study.file.treadmill.accelerometers:
        treadmill = study.file.treadmill
        count = len(treadmill.accelerometers)
        text += (
            f" The model used {count} triaxial accelerometer{'s' * (count > 1)} and was fitted to "
            "a recording of the empty, moving treadmill; its signals and the accelerations of "
            f"every trial were low-passed with zero phase (−3 dB at {treadmill.cutoff_hz:g} Hz)."
        )
    return text


def _moved(treadmill: Treadmill) -> str:
    platform_ = treadmill.platform
    if platform_ is None:
        return ""
    if platform_.markers:
        return (
            f", moved into the lab with the platform's pose from {len(platform_.markers)} markers,"
        )
    return ", moved into the lab with the platform's pose as commanded,"


def _cycles(trials: Sequence[TrialSummary], study: Study | None) -> str:
    text = (
        "Gait cycles ran from foot strike to foot strike of one foot. Gait events were the "
        "recordings' own or, where these had none, found from heel, toe and sacrum markers (Zeni "
        "et al. 2008)."
    )
    if study:
        rules = [_rule(name, rule) for name, rule in study.file.conditions.items()]
        text += f" Counted were {'; '.join(rules)}."
    numbers: dict[str, list[int]] = {}
    for trial in trials:
        count = sum(len(spans) for spans in trial.cycles.values())
        numbers.setdefault(trial.condition, []).append(count)
    found = [f"{name} {_range(counts)}" for name, counts in numbers.items()]
    return (
        f"{text} Cycles per trial: {', '.join(found)}. Each residual was summarised by its root "
        "mean square (RMS) over all samples of a trial's cycles; curves are normalised to 0–100 % "
        "of the cycle."
    )


def _rule(name: str, rule: Condition) -> str:
    if rule.perturbed:
        first = f"the first {rule.cycles} cycles" if rule.cycles else "the cycles"
        source = "the pulse channel" if rule.pulse_channel else "the platform's motion"
        return f"in {name} {first} of either foot that contain a perturbation (onset from {source})"
    first = f"the first {rule.cycles}" if rule.cycles else "all"
    after = f" after {rule.skip_s:g} s" if rule.skip_s else ""
    return f"in {name} {first} cycles of the right foot{after}"


def _tests(statistics: pd.DataFrame) -> list[str]:
    done = set(statistics.loc[statistics["p_corrected"].notna(), "test"])
    parts = []
    if "RM-ANOVA" in done:
        parts.append(
            "RMS residuals were compared by a repeated-measures analysis of variance, compensation "
            "(IC, no IC) × condition (baseline, sway, pitch), with the Greenhouse–Geisser "
            "correction where Mauchly's test rejected sphericity or could not be done."
        )
    if "paired t" in done:
        parts.append(
            f"The {len(PLANNED_PAIRS)} planned pairs (IC against no IC in every condition; sway "
            "IC and pitch IC against baseline without IC) were compared by paired t-tests and "
            "exact Wilcoxon signed-rank tests with Bonferroni correction. A residual was at "
            "baseline level if the upper end of the simultaneous 95 % confidence interval of its "
            f"difference from the baseline without IC was at most {100 * MARGIN:g} % of that "
            "baseline (non-inferiority; Schuirmann 1987)."
        )
    checks = [
        said
        for test, said in (
            ("sign-flip permutation", "sign-flip permutation tests"),
            ("aligned-rank RM-ANOVA", "an aligned-rank analysis of variance"),
            ("Friedman", "Friedman's test"),
        )
        if test in done
    ]
    if checks:
        parts.append(f"Results were checked by {join_names(checks)}.")
    for name in sorted(test for test in done if test.startswith("RM-ANOVA with ")):
        covariates = name.removeprefix("RM-ANOVA with ").replace("height_m", "stature")
        parts.append(f"The influence of {covariates} was tested by adding them as covariates.")
    return [" ".join([*parts, "The level of significance was 0.05."])] if parts else []


def _software(trials: Sequence[TrialSummary], statistics: pd.DataFrame) -> str:
    versions = trials[0].versions
    own = join_names(sorted({trial.versions["hbm-residuals"] for trial in trials}))
    others = [f"{name} {versions[name.lower()]}" for name in ("CasADi", "NumPy", "SciPy")]
    if statistics["p_corrected"].notna().any():
        others.append(f"pingouin {version('pingouin')}")
    return (
        f"All was computed with hbm-residuals {own} on Python {platform.python_version()} with "
        f"{join_names(others)}."
    )


def _origin(what: str, stated: list[bool], otherwise: str) -> str:
    if all(stated):
        return f"{what} was as stated"
    return f"{what} was {'as stated or, where it was not, ' * any(stated)}{otherwise}"


def _mean_sd(values: pd.Series, form: str) -> str:
    spread = f" ± {values.std():{form}}" if len(values) > 1 else ""
    return f"{values.mean():{form}}{spread}"


def _range(counts: list[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"
