"""The Methods section of a study, generated from its settings, with the works that it cites."""

import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import Final, cast

import pandas as pd

from hbm.engines.engine import EngineName, EngineUsed
from hbm.signals.filtering import Method
from pipeline.config.schema import Condition, Treadmill
from pipeline.config.study import Study
from pipeline.figures.residuals import mean_part
from pipeline.report.references import references
from pipeline.report.statistics_methods import statistics_methods
from pipeline.report.windows import described
from pipeline.run.load import Results
from pipeline.run.provenance import engines_of
from pipeline.statistics.design import Design
from pipeline.statistics.headline import join_names
from pipeline.trial.gait.perturbations import MIN_PLATFORM_SPEED_MPS
from pipeline.trial.quality import settling_s
from pipeline.trial.summary import TrialSummary

HIP_METHODS: Final = {
    "harrington": ("the regression equations of Harrington et al. (2007)", "harrington2007"),
    "bell": ("the regression equations of Bell et al. (1990)", "bell1990"),
    "functional": ("symmetrical centre of rotation estimation (Ehrig et al. 2006)", "ehrig2006"),
}
"""Setting -> how hip joint centres are located, and the key of its reference."""
FILTERS: Final[dict[Method, str]] = {
    "zero_phase": "a second-order Butterworth low-pass filter applied forward and backward (−3 dB "
    "at {cutoff_hz:g} Hz after both passes)",
    "realtime": "a causal second-order Butterworth low-pass filter (cut-off {cutoff_hz:g} Hz, as "
    "in the real-time filter of the Human Body Model)",
}
MASS_ORIGINS: Final = {
    "mass_stated": "as stated",
    "mass_weighed": "measured by the force plates in the steadiest second of standing still",
    "mass_of_file": "as stated in the recording",
}
"""Note -> where body mass came from."""
MOTION: Final = (
    "detected from the motion of the feet relative to the ground that carries them, between the "
    "turning points of Zeni et al. (2008)"
)
EVENT_ORIGINS: Final = {
    "events_of_file": "those of the recordings",
    "events_from_markers": "detected from heel, toe and sacrum markers (Zeni et al. 2008)",
    "events_of_plates": "detected where the force of a plate that carries one foot alone passes "
    "20 N",
    "events_calibrated": f"{MOTION}, and timed, or calibrated for each foot, by the instants at "
    "which the force of a plate that carries one foot alone passes 20 N",
    "events_uncalibrated": MOTION,
}
"""Note -> where gait events came from."""
CORRECTIONS: Final = ("plates_corrected", "plate_delays_calibrated")
"""Codes of the notes on what the plates' calibration changed."""
SEXES: Final = {"male": "male", "female": "female", "unspecified": "of unspecified sex"}


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
    trials = list(results.summaries.values())
    return [
        _participants(results, design),
        _kinematics(trials),
        _forces(trials, study),
        _gait_cycles(trials, study, design),
        *statistics_methods(statistics, design),
        _software(trials, statistics),
    ]


def cited(results: Results) -> list[str]:
    """Give the keys of the works that the Methods cite, and of the thesis, in order."""
    trials = results.summaries.values()
    used = {HIP_METHODS[trial.settings.hip][1] for trial in trials}
    unused = {key for _, key in HIP_METHODS.values()} - used
    if not any("pinocchio" in (trial.engine.name, trial.engine.other) for trial in trials):
        unused.add("carpentier2019")
    notes = {note.code for trial in trials for note in trial.notes}
    if not any("Zeni" in EVENT_ORIGINS[code] for code in notes & EVENT_ORIGINS.keys()):
        unused.add("zeni2008")
    return [key for key in references() if key not in unused]


def _participants(results: Results, design: Design) -> str:
    people = results.subjects
    sexes = people["sex"].value_counts()
    counts = [f"{sexes[sex]} {words}" for sex, words in SEXES.items() if sex in sexes]
    measures = [
        f"{name} {_mean_sd(people[column], form)} {unit}"
        for name, column, form, unit in (
            ("age", "age_years", ".0f", "years"),
            ("stature", "height_m", ".2f", "m"),
            ("body mass", "mass_kg", ".1f", "kg"),
        )
        if people[column].notna().all()
    ]
    conditions = design.in_order(condition for _, condition in results.summaries)
    stated = [trial.subject for trial in results.summaries.values()]
    codes = {note.code for trial in results.summaries.values() for note in trial.notes}
    mass = ", or ".join(words for code, words in MASS_ORIGINS.items() if code in codes)
    height = _origin(
        "stature",
        [person.height_m is not None for person in stated],
        "estimated from leg length",
    )
    return (
        f"The analysis included {len(people)} subject{'s' * (len(people) > 1)} "
        f"({'; '.join([', '.join(counts), *measures])}) in the "
        f"condition{'s' * (len(conditions) > 1)} {join_names(conditions)}. Body mass was {mass}; "
        f"{height}."
    )


def _kinematics(trials: Sequence[TrialSummary]) -> str:
    settings = [trial.settings for trial in trials]
    marker_sets = _each(trial.marker_set for trial in trials)
    hips = _each(HIP_METHODS[s.hip][0] for s in settings)
    offsets = _each(f"{1000 * s.marker_offset_m:g}" for s in settings)
    filters = _each(FILTERS[s.filter].format(cutoff_hz=s.cutoff_hz) for s in settings)
    sexes = {trial.subject.sex for trial in trials}
    sex = "for the subject's sex"
    if "unspecified" in sexes:
        sex = "(mean of both sexes)" if len(sexes) == 1 else f"{sex} (mean of both if unspecified)"
    overridden = {
        f"{trial.subject.id}: {join_names(trial.overridden_segments)}"
        for trial in trials
        if trial.overridden_segments
    }
    own = f", except for stated values ({'; '.join(sorted(overridden))})" if overridden else ""
    locked = sorted({name for trial in trials for name in trial.locked})
    held = f" Coordinates without markers were held at neutral ({join_names(locked)})."
    deviations = [
        cast(Mapping[str, float], note.values["deviation_deg"])
        for trial in trials
        for note in trial.notes
        if note.code == "coordinates_uncertain"
    ]
    weak = sorted({f"{name} {sd:.0f}°" for each in deviations for name, sd in each.items()})
    prior = f" and of priors about neutral (SD: {join_names(weak)})" if weak else ""
    return (
        "Kinematics were described by an open-source implementation of the Human Body Model (van "
        "den Bogert et al. 2013) with 46 degrees of freedom. Each subject's model was built from a "
        f"calibration pose with the marker set {marker_sets}. Hip joint centres were located by "
        f"{hips}; marker centres were {offsets} mm from the skin; segment inertial parameters were "
        f"those of de Leva (1996) {sex}{own}. {_trunk(trials)}{held if locked else ''} Inverse "
        "kinematics minimised the sum of squared distances between measured and modelled markers "
        f"in each frame (Lu and O'Connor 1999){prior}. Coordinates and ground reaction wrenches "
        "were filtered alike with "
        f"{filters} before velocities, accelerations and inverse dynamics were computed. "
        + " ".join(_mechanics(engine) for engine in engines_of([t.engine for t in trials]))
    )


def _trunk(trials: Sequence[TrialSummary]) -> str:
    """State the end points of the trunk's segments, and where one of them was inferred."""
    inferred = {
        f"{note.values['level']} from {note.values['shown']}"
        for trial in trials
        for note in trial.notes
        if note.code == "trunk_level_from_proportions"
    }
    text = (
        "Her upper trunk extends from the cervicale (C7) to the xiphoid process, her mid trunk "
        "from there to the navel, both taken at their levels on the trunk's longitudinal axis"
    )
    if inferred:
        levels = join_names(sorted(inferred))
        text += (
            f"; where no marker showed a level, it followed from her mean proportions ({levels})"
        )
    return f"{text}."


def _mechanics(engine: EngineUsed) -> str:
    """Say how the equations of motion were solved and verified."""
    text = (
        "The equations of motion were solved by the recursive Newton–Euler algorithm with "
        f"{_engine(engine.name, engine.version)}"
    )
    if engine.other is None:
        return f"{text}."
    return (
        f"{text} and verified in {engine.frames} frames with a second implementation "
        f"({_engine(engine.other, engine.other_version)}): generalised forces and residuals agreed "
        f"to {engine.difference:.0e} of each frame's largest force and moment."
    )


def _engine(name: EngineName, version: str) -> str:
    if name == "pinocchio":
        return f"Pinocchio {version} (Carpentier et al. 2019)"
    return f"equations generated with {version.replace('casadi', 'CasADi')}"


def _forces(trials: Sequence[TrialSummary], study: Study | None) -> str:
    delays = {trial.settings.plate_delay_s or 0.0 for trial in trials}
    lag = ""
    if delays != {0.0}:
        lag = f", taking into account a delay of {_each(f'{1000 * d:g}' for d in delays)} ms,"
    thresholds = _each(f"{t.settings.contact_threshold_n:g}" for t in trials)
    treadmill = study.file.treadmill if study else None
    text = (
        f"{_corrected_plates(trials)}Force plate wrenches were resampled to the marker times{lag}"
        f"{_platform_pose(treadmill)} and assigned to the foot in contact (threshold {thresholds} "
        "N). The pelvis residual is the wrench that has to act on the pelvis to satisfy the "
        "equations of motion; it is given about the midpoint of the hip joints in lab axes (x "
        "forward, y right, z up)."
    )
    if not any(row.compensated for trial in trials for row in trial.residuals):
        return f"{text} Treadmill inertia was not compensated."
    text += (
        " Each trial was processed twice with the same kinematics: with the force plate wrenches "
        "as measured (no IC) and after inertia compensation (IC), for which the wrench due to the "
        "treadmill's own motion was predicted for each plate by a linear model of accelerometer "
        f"signals{_differences(trials)} and subtracted in the plate's frame (Hnat et al. 2018)."
    )
    doubts = dict.fromkeys(note.text for trial in trials for note in trial.of_calibration)
    text += "".join(f" Note: {doubt}." for doubt in doubts)
    if treadmill is not None and treadmill.belt is not None:
        text += (
            " The pitch moment due to the belts' acceleration was predicted from the belt speed "
            "and subtracted too (Hnat and van den Bogert 2014)."
        )
    if treadmill is None or not treadmill.accelerometers:
        return text
    count = len(treadmill.accelerometers)
    return (
        f"{text} The model used {count} triaxial accelerometer{'s' * (count > 1)} and was fitted "
        "to a recording of the empty, moving treadmill; plates and accelerometers of this "
        f"recording{_also_of_trials(trials)} were low-pass filtered with zero phase (−3 dB at "
        f"{treadmill.cutoff_hz:g} Hz)."
    )


def _also_of_trials(trials: Sequence[TrialSummary]) -> str:
    """Say whether trials passed the calibration's filter too, which in real time they do not."""
    in_real_time = {trial.settings.filter == "realtime" for trial in trials}
    if in_real_time == {True}:
        return ""
    return " and of each trial" + " with that filter" * (True in in_real_time)


def _differences(trials: Sequence[TrialSummary]) -> str:
    """Say which differences of accelerations a dynamic model has beside the accelerations."""
    notes = [n for trial in trials for n in trial.notes if n.code == "compensated_dynamically"]
    lags = [values for n in notes if isinstance(values := n.values["lags_ms"], tuple)]
    if not lags:
        return ""
    return (
        f" and their second differences over {join_names(lags[0])} ms, fitted by ridge regression,"
    )


def _corrected_plates(trials: Sequence[TrialSummary]) -> str:
    """Say by which calibrations the plates were corrected, and which delays these state."""
    notes = [note.values for trial in trials for note in trial.notes if note.code in CORRECTIONS]
    if not notes:
        return ""
    files = _each(str(values["calibration"]) for values in notes)
    delays = {
        f"{1000 * delay_s:.1f} ms (plate {plate})"
        for values in notes
        if isinstance(by_plate := values.get("delays_s"), Mapping)
        for plate, delay_s in by_plate.items()
    }
    late = (
        f" and brought forward by their delay behind the cameras, {_each(delays)}" if delays else ""
    )
    return (
        "Force plate wrenches were corrected by a matrix and an offset per plate, found with known "
        f"weights on the belts ({files}){late}. "
    )


def _platform_pose(treadmill: Treadmill | None) -> str:
    if treadmill is None or treadmill.platform is None:
        return ""
    source = "as commanded"
    if treadmill.platform.markers:
        source = f"measured with {len(treadmill.platform.markers)} markers"
    return f", transformed to the lab frame with the platform's pose {source},"


def _gait_cycles(trials: Sequence[TrialSummary], study: Study | None, design: Design) -> str:
    used = {note.code for trial in trials for note in trial.notes}
    origins = [origin for code, origin in EVENT_ORIGINS.items() if code in used]
    text = "Gait cycles were defined from foot strike to foot strike of the same foot."
    text += f" Gait events were {'; or '.join(origins)}." if origins else ""
    walking = [trial for trial in trials if trial.span is None]
    spans_s: dict[str, list[float]] = {}
    for trial in trials:
        if trial.span is not None:
            spans_s.setdefault(trial.condition, []).append(trial.span[1] - trial.span[0])
    if study:
        conditions = {trial.condition for trial in walking}
        rules = [
            _selection(name, rule)
            for name, rule in study.file.conditions.items()
            if name in conditions
        ]
        text += f" The analysed cycles were {'; '.join(rules)}." if rules else ""
    text += _parts(walking)
    numbers: dict[str, list[int]] = {}
    for trial in walking:
        count = sum(len(spans) for spans in trial.cycles.values())
        numbers.setdefault(trial.condition, []).append(count)
    counts = [f"{_range(numbers[name])} ({name})" for name in design.in_order(numbers)]
    if counts:
        text += f" Each trial contributed {join_names(counts)} gait cycles."
    if spans_s:
        spans = [f"{_seconds(spans_s[name])} ({name})" for name in design.in_order(spans_s)]
        text += (
            " In place of gait cycles, continuous parts of the recordings were analysed, of "
            f"{join_names(spans)}."
        )
    shares = _each(f"{100 * trial.settings.min_valid_share:g} %" for trial in trials)
    return (
        f"{text} Frames in which the force plates did not carry the subject were left out, and so "
        "were those near the ends of a recording or a gap, in which the filters had not settled "
        f"({_settling(trials)}), and gait cycles of which less than {shares} remained. Each "
        "residual was summarised by its root mean square (RMS) over all samples that remained; "
        "curves were normalised to 0–100 % of the gait cycle."
    )


def _parts(trials: Sequence[TrialSummary]) -> str:
    """Say which part of the cycles was analysed, and where in the cycle it was on average."""
    parts = {t.condition: t.part.name for t in trials if t.part}
    text = ""
    for condition, name in parts.items():
        rule = described(name)
        if name == "motion":
            rule += f" (above {MIN_PLATFORM_SPEED_MPS:g} m/s, by its pose; not its slow return)"
        text += f" Of the cycles in {condition}, only {rule} was analysed"
        mean = mean_part(t for t in trials if t.condition == condition)
        text += f", on average {mean[0]:.0f} to {mean[1]:.0f} % of the cycle." if mean else "."
    return text


def _settling(trials: Sequence[TrialSummary]) -> str:
    """Say for how long filters settle, for each setting of the trials."""
    times = [settling_s([(t.settings.filter, t.settings.cutoff_hz)]) for t in trials]
    return _each(
        f"within {after:.2f} s after a start{f' and {before:.2f} s before an end' * (before > 0)}"
        for after, before in times
    )


def _selection(condition: str, rule: Condition) -> str:
    if rule.perturbed:
        cycles = f"the first {rule.cycles} cycles" if rule.cycles else "the cycles"
        source = "the pulse channel" if rule.pulse_channel else "the platform's motion"
        return (
            f"in {condition} {cycles} of either foot that contained a perturbation (onset from "
            f"{source})"
        )
    cycles = f"the first {rule.cycles}" if rule.cycles else "all"
    start = f" after {rule.skip_s:g} s" if rule.skip_s else ""
    return f"in {condition} {cycles} cycles of the right foot{start}"


def _software(trials: Sequence[TrialSummary], statistics: pd.DataFrame) -> str:
    versions = trials[0].versions
    own = _each(trial.versions["hbm-residuals"] for trial in trials)
    packages = [f"{name} {versions[name.lower()]}" for name in ("CasADi", "NumPy", "SciPy")]
    if statistics["p_corrected"].notna().any():
        packages.append(f"pingouin {version('pingouin')}")
    return (
        f"All computations were performed with hbm-residuals {own} on Python "
        f"{platform.python_version()} with {join_names(packages)}."
    )


def _origin(quantity: str, stated: list[bool], otherwise: str) -> str:
    if all(stated):
        return f"{quantity} was as stated"
    return f"{quantity} was {'as stated or, where it was not, ' * any(stated)}{otherwise}"


def _each(texts: Iterable[str]) -> str:
    """Join texts that differ between trials."""
    return join_names(sorted(set(texts)))


def _mean_sd(values: pd.Series, form: str) -> str:
    spread = f" ± {values.std():{form}}" if len(values) > 1 else ""
    return f"{values.mean():{form}}{spread}"


def _seconds(durations: Sequence[float]) -> str:
    low, high = (f"{value:.1f}" for value in (min(durations), max(durations)))
    return f"{low} s" if low == high else f"{low} to {high} s"


def _range(counts: list[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"
