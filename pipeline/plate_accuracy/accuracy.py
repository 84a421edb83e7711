"""Experiment 1: errors of force plates under known weights, and how they depend on conditions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pandas as pd
from scipy import stats

from compensation import (
    Delay,
    Linearity,
    PlateAlignment,
    center_of_pressure,
    linearity,
    orthogonal_rmse,
)
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.plate_study import BeltSide, PlatesStudy
from pipeline.io.write import markdown
from pipeline.plate_accuracy.faults import FaultEstimate, estimate_faults
from pipeline.plate_accuracy.response import PlateResponse, fit_response
from pipeline.plate_accuracy.trials import (
    LOADED_SHARE,
    UNALIGNED,
    HammerTrace,
    WeightTrial,
    align,
    read_hammer_delay,
    read_weight,
    static_places,
)
from pipeline.statistics.factorial import anova, compare_levels, residuals

FACTORS: Final = ("belt", "profile", "speed_mps", "position_m", "mass_kg")
MIN_TRIALS_PER_COEFFICIENT: Final = 3
"""Of an analysis of variance."""
MIN_BLOCKS: Final = 5
"""Recordings in which thirds of the belt can be compared."""
LAB_NOTE: Final = "Lab axes: x forward, y left, z up."
TEST_COLUMNS: Final = (
    *("quantity", "exponent", "shapiro_w", "shapiro_p", "effect", "df", "df_error", "f", "p"),
    "partial_eta_squared",
)
PAIR_COLUMNS: Final = ("quantity", "factor", "first", "second", "p_bonferroni")


@dataclass(frozen=True, slots=True)
class ConditionEffects:
    """Analyses of variance of the orthogonal errors.

    Attributes
    ----------
    tests
        One row per quantity and effect: quantity, exponent (Box–Cox λ), shapiro_w and shapiro_p
        (Shapiro–Wilk test of the model's residuals), effect, df, df_error, f, p,
        partial_eta_squared. The effect "zone" is the third of the belt, antero-posterior.
    pairs
        Pairs of levels, Bonferroni-corrected: quantity, factor, first, second, p_bonferroni.
    remarks
        What was not tested.
    """

    tests: pd.DataFrame
    pairs: pd.DataFrame
    remarks: tuple[str, ...] = ()


def reported_errors(errors: pd.DataFrame) -> pd.DataFrame:
    """Give the errors of the recordings with supports, or of all where none has supports."""
    return errors[errors["supports"] == errors["supports"].any()]


def condition_effects(errors: pd.DataFrame) -> ConditionEffects:
    """Test what the orthogonal errors depend on, in the recordings with supports if there are any.

    Parameters
    ----------
    errors
        As in `pipeline.plate_accuracy.accuracy.PlateAccuracy`.

    Returns
    -------
    ConditionEffects
        Empty, with a remark, where there are too few recordings.

    Notes
    -----
    Per quantity two analyses of variance of type III, main effects, after a Box–Cox transform. Of
    whole recordings: belt, profile, speed, position and weight, as far as they vary. Of the thirds
    of the belt within recordings: the third, with the recording as a block, since thirds of one
    recording share its weight, speed and noise.

    Deviations from the original: van de Loosdrecht (2018, II.A.4) tests with three factors, which
    leaves belt and profile in the error, and does not state whether the transformed data were
    normal.
    """
    supported, factors = reported_errors(errors), list(FACTORS)
    whole, thirds = (supported[(supported["zone"] == "all") == entire] for entire in (True, False))
    varied = [factor for factor in factors if whole[factor].nunique() > 1]
    coefficients = 1 + sum(whole[factor].nunique() - 1 for factor in varied)
    tests, pairs, remarks = [], [], []
    for label, data, used, tested in (
        ("whole recordings", whole, varied, varied),
        ("thirds of the belt", thirds, ["file", "zone"], ["zone"]),
    ):
        analysed = False
        for quantity, part in data.groupby("quantity", sort=False):
            if data is thirds:
                part = part[part.groupby("file")["zone"].transform("nunique") > 1]
                enough = part["file"].nunique() >= MIN_BLOCKS
            else:
                enough = bool(used) and len(part) >= MIN_TRIALS_PER_COEFFICIENT * coefficients
            if not enough:
                continue
            analysed = True
            try:
                table, compared = _analyse(str(quantity), part, used, tested)
            except ValueError as error:
                remarks.append(f"{quantity}, {label}: not tested: {error}")
                continue
            tests.append(table)
            pairs.append(compared)
        if not analysed:
            remarks.append(f"{label}: not tested, too few recordings, or nothing varies")
    return ConditionEffects(
        _joined(tests, TEST_COLUMNS), _joined(pairs, PAIR_COLUMNS), tuple(remarks)
    )


def _joined(tables: list[pd.DataFrame], columns: Sequence[str]) -> pd.DataFrame:
    if not tables:
        return pd.DataFrame(columns=list(columns))
    return pd.concat(tables, ignore_index=True)[list(columns)]


def _analyse(
    quantity: str, data: pd.DataFrame, factors: Sequence[str], tested: Sequence[str]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Give tests and pairs of one quantity; ``tested`` are the factors of interest."""
    sizes = data["orthogonal"].to_numpy()
    if not (sizes > 0).all():
        raise ValueError("a Box–Cox transform needs positive values, none missing")
    transformed, exponent = stats.boxcox(sizes / stats.gmean(sizes))  # λ is the same in any unit
    data = data.assign(y=transformed)
    table = anova(data, "y", factors)
    normal = stats.shapiro(residuals(data, "y", factors))
    tests = table[table["effect"].isin(tested)].assign(
        quantity=quantity,
        exponent=exponent,
        shapiro_w=normal.statistic,
        shapiro_p=normal.pvalue,
        df_error=table["df"].iloc[-1],
    )
    pairs = [
        compare_levels(data, "y", factors, factor).assign(quantity=quantity, factor=factor)
        for factor in tested
    ]
    return tests, pd.concat(pairs)


def effects_section(effects: ConditionEffects) -> list[str]:
    """Give the paragraphs of the page on the effects of the conditions."""
    lines = ["## Effects of the conditions"]
    if len(effects.tests):
        lines += [
            f"{LAB_NOTE} Orthogonal errors after a Box–Cox transform (exponent), analysis of "
            "variance of type III, main effects. The thirds of the belt (zone: antero-posterior "
            "position) are compared within recordings; all others between recordings. shapiro_p "
            "is the Shapiro–Wilk test of the residuals. Pairs of levels, Bonferroni-corrected, are "
            "in pairs.csv.",
            markdown(effects.tests, 3),
        ]
    remarks = "\n".join(f"- {remark}" for remark in effects.remarks)
    return [*lines, remarks] if remarks else lines


QUANTITIES: Final = ("COPx", "COPy", *WRENCH_COMPONENTS)
ZONES: Final = ("back", "middle", "front")
"""Thirds of the belt."""
MIN_ZONE_SAMPLES: Final = 20
"""Of a recording in a third of the belt, 0.2 s: fewer give no error there."""
MIN_MASSES: Final = 3
MIN_LOADS: Final = 4
"""Different weights, and recordings, for a linearity."""


@dataclass(frozen=True, slots=True)
class PlateAccuracy:
    """The results of experiment 1.

    Attributes
    ----------
    study
        As stated.
    trials
        The recordings of weights.
    errors
        One row per recording, zone ("all", back, middle, front third of the belt) and quantity:
        the conditions, RMSE by difference and orthogonal RMSE [m, N, N·m]. Lab axes.
    places
        Belt -> centres of pressure and markers of a weight at rest, (n, 2) [m] each.
    alignments, delays, hammer_traces, linearities, responses
        Belt -> result, where there are recordings for it.
    faults
        Single faults with their uncertainty.
    effects
        Of the conditions on the errors.
    """

    study: PlatesStudy
    trials: tuple[WeightTrial, ...]
    errors: pd.DataFrame
    places: dict[BeltSide, tuple[Array, Array]]
    alignments: dict[BeltSide, PlateAlignment]
    delays: dict[BeltSide, Delay]
    hammer_traces: dict[BeltSide, HammerTrace]
    linearities: dict[BeltSide, Linearity]
    responses: dict[BeltSide, PlateResponse]
    faults: tuple[FaultEstimate, ...]
    effects: ConditionEffects

    @property
    def trials_in_use(self) -> tuple[WeightTrial, ...]:
        """Of every plate, the recordings with supports, or all where none has supports."""
        return _in_use(self.trials)


def check_plates(study: PlatesStudy) -> PlateAccuracy:
    """Compare plates with known weights.

    Parameters
    ----------
    study
        The study.

    Returns
    -------
    PlateAccuracy
        All results.

    Raises
    ------
    ValueError
        If a recording cannot be used; the message names it.

    Notes
    -----
    Source: van de Loosdrecht (2018), II.A and D.1–D.2: static calibration after Goldberg et al.
    (2009), RMSE by difference and by total least squares, linearity, delay by impacts of a hammer.
    """
    found = examine_plates(study)
    errors = trial_errors(found.trials)
    return replace(found, errors=errors, effects=condition_effects(errors))


def examine_plates(study: PlatesStudy) -> PlateAccuracy:
    """Compare plates with known weights, without errors per recording and their statistics."""
    file = study.file
    belts: list[BeltSide] = [b for b in ("left", "right") if any(w.belt == b for w in file.weights)]
    found = {belt: static_places(study, belt) for belt in belts}
    places = {belt: pair for belt, pair in found.items() if pair is not None}
    alignments = {belt: align(*pair) for belt, pair in places.items()}
    trials = tuple(
        read_weight(study, weight, alignments.get(weight.belt, UNALIGNED))
        for weight in file.weights
    )
    struck = {impacts.belt: read_hammer_delay(study, impacts) for impacts in file.hammer}
    delays = {belt: delay for belt, (delay, _) in struck.items()}
    linearities = {belt: _linearity(_in_use(trials), belt, file.full_scale_n) for belt in belts}
    fitted = {
        belt: fit_response(
            [trial for trial in _in_use(trials) if trial.weight.belt == belt],
            alignments.get(belt, UNALIGNED),
            file.full_scale_n,
            height_stated=file.height_stated,
        )
        for belt in belts
    }
    responses = {belt: one for belt, one in fitted.items() if one is not None}
    return PlateAccuracy(
        study=study,
        trials=trials,
        errors=pd.DataFrame(),
        places=places,
        alignments=alignments,
        delays=delays,
        hammer_traces={belt: trace for belt, (_, trace) in struck.items()},
        linearities={belt: one for belt, one in linearities.items() if one is not None},
        responses=responses,
        faults=estimate_faults(
            trials, responses, alignments, delays, height_stated=file.height_stated
        ),
        effects=ConditionEffects(pd.DataFrame(), pd.DataFrame()),
    )


def _in_use(trials: tuple[WeightTrial, ...]) -> tuple[WeightTrial, ...]:
    supported = {trial.weight.belt for trial in trials if trial.weight.supports}
    return tuple(t for t in trials if t.weight.supports == (t.weight.belt in supported))


def trial_errors(trials: Sequence[WeightTrial]) -> pd.DataFrame:
    """Give the errors of every recording, as `PlateAccuracy.errors` describes."""
    rows = []
    for trial in trials:
        stated = trial.weight.model_dump()
        measured, truth = quantities(trial.measured), quantities(trial.truth)
        edges = np.linspace(*trial.belt_ends, len(ZONES) + 1)
        zone = np.clip(np.digitize(trial.marker[:, 0], edges) - 1, 0, len(ZONES) - 1)
        zones = {label: trial.used & (zone == k) for k, label in enumerate(ZONES)}
        for name, inside in {"all": trial.used, **zones}.items():
            if np.count_nonzero(inside) < MIN_ZONE_SAMPLES:
                continue
            for k, quantity in enumerate(QUANTITIES):
                m, t = measured[inside, k], truth[inside, k]
                error = {
                    "difference": float(np.sqrt(np.mean((m - t) ** 2))),
                    "orthogonal": orthogonal_rmse(m, t),
                }
                rows.append({**stated, "zone": name, "quantity": quantity, **error})
    return pd.DataFrame(rows)


def quantities(wrench: Array) -> Array:
    """Give centre of pressure along and across [m], forces and moments [N, N·m], (T, 8)."""
    threshold = LOADED_SHARE * float(np.median(np.abs(wrench[:, 2])))
    return np.hstack([center_of_pressure(wrench, threshold)[:, :2], wrench])


def mean_loads(trials: Sequence[WeightTrial], belt: BeltSide) -> tuple[Array, Array]:
    """Give the mean known and measured vertical force of a belt's recordings, (n,) [N] each."""
    chosen = [t for t in trials if t.weight.belt == belt]
    known = np.array([t.truth[t.used, 2].mean() for t in chosen])
    measured = np.array([t.measured[t.used, 2].mean() for t in chosen])
    return known, measured


def _linearity(
    trials: Sequence[WeightTrial], belt: BeltSide, full_scale: float
) -> Linearity | None:
    known, measured = mean_loads(trials, belt)
    masses = {t.weight.mass_kg for t in trials if t.weight.belt == belt}
    if len(masses) < MIN_MASSES or len(known) < MIN_LOADS:
        return None
    return linearity(known, measured, full_scale)
