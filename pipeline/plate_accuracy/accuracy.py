"""Experiment 1: how far plates are off under known weights, per condition."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd

from compensation import (
    Delay,
    Linearity,
    PlateAlignment,
    center_of_pressure,
    fit_line_orthogonal,
    hammer_delay,
    linearity,
)
from hbm.spatial import Array
from pipeline.config.plate_study import BeltSide, PlatesStudy
from pipeline.plate_accuracy.faults import Estimate, estimates
from pipeline.plate_accuracy.trials import (
    UNALIGNED,
    WeightTrial,
    align,
    read_hammer,
    read_weight,
    static_places,
)
from pipeline.statistics.factorial import anova, box_cox, compare_levels

QUANTITIES: Final = ("COPx", "COPy", "Fx", "Fy", "Fz", "Mx", "My", "Mz")
ZONES: Final = ("back", "middle", "front")
FEWEST: Final = 20
"""Samples that a zone of the belt must have."""
FACTORS: Final = ("speed_mps", "position_m", "mass_kg")


@dataclass(frozen=True, slots=True)
class Experiment1:
    """What experiment 1 found.

    Attributes
    ----------
    study
        What was stated.
    trials
        The weights.
    errors
        One row per recording, zone ("all", back, middle, front third of the belt) and quantity:
        the conditions, difference and orthogonal RMSE [m, N, N·m]. Lab axes.
    places
        Belt -> centres of pressure and markers of a weight put down, (n, 2) [m] each.
    alignments, delays, linearities
        Belt -> result, where it could be had.
    estimates
        Single faults with their uncertainty.
    tests, pairs
        Box–Cox exponent and three-way ANOVA per quantity; pairs of levels, Bonferroni.
    """

    study: PlatesStudy
    trials: tuple[WeightTrial, ...]
    errors: pd.DataFrame
    places: dict[BeltSide, tuple[Array, Array]]
    alignments: dict[BeltSide, PlateAlignment]
    delays: dict[BeltSide, Delay]
    linearities: dict[BeltSide, Linearity]
    estimates: tuple[Estimate, ...]
    tests: pd.DataFrame
    pairs: pd.DataFrame


def check_plates(study: PlatesStudy) -> Experiment1:
    """Hold plates against known weights.

    Parameters
    ----------
    study
        The study.

    Returns
    -------
    Experiment1
        All findings.

    Raises
    ------
    ValueError
        If a recording cannot be used; the message names it.

    Notes
    -----
    Source: van de Loosdrecht (2018), II.A and D.1–D.2: static calibration after Goldberg et al.
    (2009), RMSE by difference and by total least squares, linearity, delay by hammer blows.
    """
    file = study.file
    belts: list[BeltSide] = [b for b in ("left", "right") if any(w.belt == b for w in file.weights)]
    found = {belt: static_places(study, belt) for belt in belts}
    places = {belt: pair for belt, pair in found.items() if pair is not None}
    alignments = {belt: align(*pair) for belt, pair in places.items()}
    trials = tuple(
        read_weight(study, weight, alignments.get(weight.belt, UNALIGNED))
        for weight in file.weights
    )
    delays: dict[BeltSide, Delay] = {
        blows.belt: hammer_delay(*read_hammer(study, blows.file, blows.belt))
        for blows in file.hammer
    }
    errors = accuracy(trials)
    tests, pairs = differences(errors)
    return Experiment1(
        study=study,
        trials=trials,
        errors=errors,
        places=places,
        alignments=alignments,
        delays=delays,
        linearities={
            belt: straight
            for belt in belts
            if (straight := _linearity(trials, belt, file.full_scale_n)) is not None
        },
        estimates=estimates(trials, alignments, delays, file.full_scale_n),
        tests=tests,
        pairs=pairs,
    )


def accuracy(trials: Sequence[WeightTrial]) -> pd.DataFrame:
    """Give the errors of every recording, as `Experiment1.errors` describes."""
    rows = []
    for trial in trials:
        stated = trial.weight.model_dump()
        measured, truth = quantities(trial.measured), quantities(trial.truth)
        edges = np.linspace(*trial.reach, 4)
        zone = np.clip(np.digitize(trial.marker[:, 0], edges) - 1, 0, 2)
        zones = {label: trial.used & (zone == k) for k, label in enumerate(ZONES)}
        for name, inside in {"all": trial.used, **zones}.items():
            if np.count_nonzero(inside) < FEWEST:
                continue
            for k, quantity in enumerate(QUANTITIES):
                m, t = measured[inside, k], truth[inside, k]
                error = {
                    "difference": float(np.sqrt(np.mean((m - t) ** 2))),
                    "orthogonal": fit_line_orthogonal(m, t).rmse,
                }
                rows.append({**stated, "zone": name, "quantity": quantity, **error})
    return pd.DataFrame(rows)


def quantities(wrench: Array) -> Array:
    """Give centre of pressure along and across [m], forces and moments [N, N·m], (T, 8)."""
    threshold = 0.2 * float(np.median(np.abs(wrench[:, 2])))
    return np.hstack([center_of_pressure(wrench, threshold)[:, :2], wrench])


def differences(errors: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Test speed, position and weight on the orthogonal errors with supports.

    Parameters
    ----------
    errors
        As in `Experiment1`.

    Returns
    -------
    tests
        quantity, exponent (Box–Cox λ), effect, df, f, p, partial_eta_squared.
    pairs
        quantity, factor, first, second, p_bonferroni. Empty where a factor has one level or there
        are too few recordings.
    """
    whole = errors[errors["zone"] == "all"]
    supported = whole[whole["supports"]] if whole["supports"].any() else whole
    used = [f for f in FACTORS if supported[f].nunique() > 1]
    tests, pairs = [], []
    for quantity, part in supported.groupby("quantity", sort=False):
        if not used or len(part) < 3 * sum(part[f].nunique() for f in used):
            continue
        sizes = part["orthogonal"].to_numpy()
        transformed = box_cox(sizes / np.exp(np.log(sizes).mean()))  # λ is the same in any unit
        data = part.assign(y=transformed.values)
        table = anova(data, "y", used).query("effect != 'residual'")
        tests.append(table.assign(quantity=quantity, exponent=transformed.exponent))
        for factor in used:
            compared = compare_levels(data, "y", used, factor)
            pairs.append(compared.assign(quantity=quantity, factor=factor))
    if not tests:
        return pd.DataFrame(), pd.DataFrame()
    columns = ["quantity", "exponent", "effect", "df", "f", "p", "partial_eta_squared"]
    return (
        pd.concat(tests, ignore_index=True)[columns],
        pd.concat(pairs, ignore_index=True)[
            ["quantity", "factor", "first", "second", "p_bonferroni"]
        ],
    )


def loads(trials: Sequence[WeightTrial], belt: BeltSide) -> tuple[Array, Array]:
    """Give the mean known and measured vertical force of a belt's recordings, (n,) [N] each."""
    chosen = [t for t in trials if t.weight.belt == belt]
    known = np.array([t.truth[t.used, 2].mean() for t in chosen])
    measured = np.array([t.measured[t.used, 2].mean() for t in chosen])
    return known, measured


def _linearity(
    trials: Sequence[WeightTrial], belt: BeltSide, full_scale: float
) -> Linearity | None:
    known, measured = loads(trials, belt)
    masses = {t.weight.mass_kg for t in trials if t.weight.belt == belt}
    return linearity(known, measured, full_scale) if len(masses) >= 3 and len(known) > 3 else None
