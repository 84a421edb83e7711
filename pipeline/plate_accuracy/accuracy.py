"""Experiment 1: errors of force plates under known weights, and how they depend on conditions."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from scipy import stats

from compensation import Delay, center_of_pressure
from compensation.accuracy import Linearity, PlateAlignment, linearity, orthogonal_rmse
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.plate_study import BeltSide, PlatesStudy, WeightRecording
from pipeline.plate_accuracy.response import (
    FaultEstimate,
    PlateResponse,
    estimate_faults,
    fit_response,
    rms,
)
from pipeline.plate_accuracy.trials import (
    LOADED_SHARE,
    UNALIGNED,
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
TEST_COLUMNS: Final = [
    *("quantity", "exponent", "shapiro_w", "shapiro_p", "effect", "df", "df_error", "f", "p"),
    "partial_eta_squared",
]
PAIR_COLUMNS: Final = ["quantity", "factor", "first", "second", "p_bonferroni"]


def reported_errors(errors: pd.DataFrame) -> pd.DataFrame:
    """Give the errors of the recordings with supports, or of all where none has supports."""
    return errors[errors["supports"] == errors["supports"].any()]


def condition_effects(errors: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame, list[str]]:
    """Test what the orthogonal errors depend on, in the recordings with supports if there are any.

    Parameters
    ----------
    errors
        As `trial_errors` gives them.

    Returns
    -------
    tests
        One row per quantity and effect: quantity, exponent (Box–Cox λ), shapiro_w and shapiro_p
        (Shapiro–Wilk test of the model's residuals), effect, df, df_error, f, p,
        partial_eta_squared. The effect "zone" is the third of the belt, antero-posterior.
    pairs
        Pairs of levels, Bonferroni-corrected: quantity, factor, first, second, p_bonferroni.
    remarks
        What was not tested, and why.

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
    supported = reported_errors(errors)
    whole, thirds = (supported[(supported["zone"] == "all") == entire] for entire in (True, False))
    thirds = thirds[thirds.groupby("file")["zone"].transform("nunique") > 1]
    varied = [factor for factor in FACTORS if whole[factor].nunique() > 1]
    coefficients = 1 + sum(whole[factor].nunique() - 1 for factor in varied)
    needed = MIN_TRIALS_PER_COEFFICIENT * coefficients if varied else np.inf
    tests, pairs, remarks = [], [], []
    for label, data, least, used, tested in (
        ("whole recordings", whole, needed, varied, varied),
        ("thirds of the belt", thirds, MIN_BLOCKS, ["file", "zone"], ["zone"]),
    ):
        if data["file"].nunique() < least:
            remarks.append(f"{label}: not tested, too few recordings, or nothing varies")
            continue
        for quantity, part in data.groupby("quantity", sort=False):
            try:
                table, compared = _analyse(str(quantity), part, used, tested)
            except ValueError as error:
                remarks.append(f"{quantity}, {label}: not tested: {error}")
                continue
            tests.append(table)
            pairs.append(compared)
    if not tests:
        return pd.DataFrame(columns=TEST_COLUMNS), pd.DataFrame(columns=PAIR_COLUMNS), remarks
    all_pairs = pd.concat(pairs, ignore_index=True)[PAIR_COLUMNS]
    return pd.concat(tests, ignore_index=True)[TEST_COLUMNS], all_pairs, remarks


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
    trials, trials_in_use
        The recordings of weights: all, and of every plate those with supports, or all where none
        has supports.
    alignments, delays, linearities, responses
        Belt -> result, where there are recordings for it.
    faults
        Single faults with their uncertainty.
    """

    study: PlatesStudy
    trials: tuple[WeightTrial, ...]
    trials_in_use: tuple[WeightTrial, ...]
    alignments: dict[BeltSide, PlateAlignment]
    delays: dict[BeltSide, Delay]
    linearities: dict[BeltSide, Linearity]
    responses: dict[BeltSide, PlateResponse]
    faults: tuple[FaultEstimate, ...]


def check_plates(study: PlatesStudy) -> PlateAccuracy:
    """Compare plates with known weights; an error names the recording that cannot be used.

    Notes
    -----
    Source: van de Loosdrecht (2018), II.A and D.1–D.2: static calibration after Goldberg et al.
    (2009), RMSE by difference and by total least squares, linearity, delay by impacts of a hammer.
    """
    file = study.file
    belts: list[BeltSide] = [b for b in ("left", "right") if any(w.belt == b for w in file.weights)]
    places = {belt: static_places(study, belt) for belt in belts}
    alignments = {belt: align(*pair) for belt, pair in places.items() if pair is not None}
    trials = tuple(
        read_weight(study, weight, alignments.get(weight.belt, UNALIGNED))
        for weight in file.weights
    )
    delays = {impacts.belt: read_hammer_delay(study, impacts) for impacts in file.hammer}
    return compare(study, trials, alignments, delays)


def compare(
    study: PlatesStudy,
    trials: tuple[WeightTrial, ...],
    alignments: dict[BeltSide, PlateAlignment],
    delays: dict[BeltSide, Delay],
) -> PlateAccuracy:
    """Compare plates with known weights, given what was read of all recordings."""
    file, height = study.file, study.file.height_stated
    supported = {trial.weight.belt for trial in trials if trial.weight.supports}
    in_use = tuple(t for t in trials if t.weight.supports == (t.weight.belt in supported))
    linearities, responses = {}, {}
    for belt in dict.fromkeys(trial.weight.belt for trial in trials):
        own = [trial for trial in in_use if trial.weight.belt == belt]
        known, measured = mean_loads(own, belt)
        masses = {trial.weight.mass_kg for trial in own}
        if len(masses) >= MIN_MASSES and len(known) >= MIN_LOADS:
            linearities[belt] = linearity(known, measured, file.full_scale_n)
        alignment = alignments.get(belt, UNALIGNED)
        response = fit_response(own, alignment, file.full_scale_n, height_stated=height)
        if response is not None:
            responses[belt] = response
    faults = estimate_faults(trials, responses, alignments, delays, height_stated=height)
    return PlateAccuracy(study, trials, in_use, alignments, delays, linearities, responses, faults)


def trial_errors(trials: Sequence[WeightTrial]) -> pd.DataFrame:
    """Give one row per recording, zone ("all" or a third of the belt) and quantity.

    Columns: the given conditions, and RMSE by difference, orthogonal, and by difference of slow
    signals [m, N, N·m]. Lab axes; moments of slow signals about the centre of the plate.
    """
    rows = []
    for trial in trials:
        conditions = trial.weight.model_dump()
        measured, truth = quantities(trial.measured), quantities(trial.truth)
        slow_error = quantities(trial.slow_measured) - quantities(trial.slow_truth)
        edges = np.linspace(*trial.belt_ends, len(ZONES) + 1)
        zone = np.clip(np.digitize(trial.marker[:, 0], edges) - 1, 0, len(ZONES) - 1)
        zones = {label: trial.used & (zone == k) for k, label in enumerate(ZONES)}
        for name, inside in {"all": trial.used, **zones}.items():
            if np.count_nonzero(inside) < MIN_ZONE_SAMPLES:
                continue
            for k, quantity in enumerate(QUANTITIES):
                m, t = measured[inside, k], truth[inside, k]
                sizes = float(rms(m - t)), orthogonal_rmse(m, t), float(rms(slow_error[inside, k]))
                rows.append((*conditions.values(), name, quantity, *sizes))
    columns = [*WeightRecording.model_fields, "zone", "quantity"]
    return pd.DataFrame(rows, columns=[*columns, "difference", "orthogonal", "slow"])


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
