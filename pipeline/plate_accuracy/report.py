"""Experiment 1 as a part of the laboratory's page and as files: errors, Table I, calibration."""

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from compensation import PlateCalibration, PlateCalibrations, center_of_pressure
from compensation.accuracy import orthogonal_rmse
from compensation.plate_calibration import to_json
from hbm.numbers import read_numbers
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS, Array
from pipeline.config.plate_study import FILE, PlatesFile, WeightRecording
from pipeline.figures.style import drawing, in_style, save_figure
from pipeline.io.input_file import file_digest
from pipeline.io.write import write_csv, write_text
from pipeline.plate_accuracy.accuracy import PlateAccuracy, mean_loads
from pipeline.plate_accuracy.response import LIMITS, STANCE, PlateResponse, rms
from pipeline.plate_accuracy.trials import SLOW_CUTOFF_HZ, THESIS_FILTER, WeightTrial
from pipeline.plate_accuracy.verdict import TOTAL, PlateVerdict, judge
from pipeline.report.blocks import Check, Drawn, Table
from pipeline.report.laboratory import Part, frame_table
from pipeline.statistics.factorial import anova, compare_levels, residuals

EFFECTS: Final = read_numbers("pipeline.plate_accuracy", "thresholds.toml", "effects")
COLUMNS: Final = {
    "COPx (mm)": ("COPy", 1000.0),
    "COPy (mm)": (None, 1.0),
    "COPz (mm)": ("COPx", 1000.0),
    "Fx (N)": ("Fy", 1.0),
    "Fy (N)": ("Fz", 1.0),
    "Fz (N)": ("Fx", 1.0),
    "Mx (Nm)": ("My", 1.0),
    "My (Nm)": ("Mz", 1.0),
    "Mz (Nm)": ("Mx", 1.0),
}
"""The thesis' columns (x right, y up, z back) -> quantity in lab axes (x forward, y left, z up)."""


def write_report(accuracy: PlateAccuracy, out: Path) -> Part:
    """Write tables, figures, and ``plate_calibration.json`` where one is needed.

    Parameters
    ----------
    accuracy
        The results.
    out
        Folder to write to.

    Returns
    -------
    Part
        For the laboratory's page: whether each plate is fit for inverse dynamics, and why.
    """
    errors, verdicts, file = trial_errors(accuracy.trials), judge(accuracy), accuracy.study.file
    tests, pairs, remarks = condition_effects(errors)
    faults = pd.DataFrame(accuracy.faults).drop(columns="degrees_of_freedom", errors="ignore")
    thesis = table_1(errors)
    write_csv(thesis, out / "table_1.csv")
    write_csv(errors, out / "errors.csv")
    write_csv(faults, out / "faults.csv")
    rows = [
        [verdict.belt, one.name, one.size, one.low, one.high, one.limit, one.unit, one.status]
        for verdict in verdicts
        for one in (*verdict.judged, *verdict.corrected)
    ]
    columns = ["belt", "error", "size", "low", "high", "limit", "unit", "status"]
    write_csv(pd.DataFrame(rows, columns=columns), out / "judged.csv")
    if len(tests):
        write_csv(tests, out / "anova.csv")
        write_csv(pairs, out / "pairs.csv")
    text = (
        "Measured against known load; shaded: loads of a walking person of "
        f"{file.body_mass_kg:g} kg above the largest recorded one, extrapolated."
    )
    figure = linearity_figure(accuracy.trials, verdicts, file.body_mass_kg)
    drawn = [Drawn(text, save_figure(figure, out / "figures" / "linearity"))]
    for verdict in verdicts:
        response = accuracy.responses.get(verdict.belt)
        if response is not None:
            trials = [
                trial for trial in accuracy.trials_in_use if trial.weight.belt == verdict.belt
            ]
            figure = map_figure(response, trials, verdict.calibration, file)
            text = (
                f"{verdict.belt.title()} plate: error of the vertical force and of the centre of "
                f"pressure (arrows: direction) under {file.body_mass_kg:g} kg at each place; dots: "
                "recorded weights."
            )
            save_figure(figure, out / "figures" / f"map_{verdict.belt}")
            drawn.append(Drawn(text, drawing(figure, "png")))
    plates = tuple(one.calibration for one in verdicts if one.calibration is not None)
    if plates:
        provenance = {
            "study": file.name,
            "sha256": file_digest(accuracy.study.folder / FILE),
            "made": datetime.now(UTC).isoformat(timespec="seconds"),
            "program": f"hbm-residuals {version('hbm-residuals')}",
        }
        write_text(to_json(PlateCalibrations(plates, provenance)), out / "plate_calibration.json")
    note = (
        "Total errors: RMS over the loads of one foot in walking of a person of "
        f"{file.body_mass_kg:g} kg, a minute after zeroing; moments about a centre of mass 1 m "
        "above the belt. Errors of the given masses, of the marker above a weight and of "
        "center_height_m are not in the intervals."
    )
    tables = [errors_table(verdicts, note), errors_table(verdicts, totals=False)]
    # a weight on a belt has no vertical acceleration: what its truth has is noise of the marker
    noise_n = np.mean([np.std(trial.truth[trial.used, 2]) for trial in accuracy.trials])
    slow_noise_n = np.mean([trial.slow_noise[0] for trial in accuracy.trials])
    note = (
        "Root mean square errors. Axes of the thesis: x to the right, y up, z back. Orthogonal "
        "errors (TLLS) with supports, unless set otherwise, if there are such recordings. Filter: "
        f"{file.cutoff_hz:g} Hz, as in the thesis ({THESIS_FILTER}); these errors hold the noise "
        f"of the marker, which is differentiated twice: {noise_n:.1f} N in each axis. Below "
        f"{SLOW_CUTOFF_HZ:g} Hz it is {slow_noise_n:.2f} N: those rows judge the plates, moments "
        "about their centres."
    )
    tables.append(frame_table("Table I", thesis, 1, note))
    if len(tests):
        text = (
            "Orthogonal errors after a Box–Cox transform, type III, main effects; thirds of the "
            "belt (zone) within recordings. Pairs of levels, Bonferroni-corrected, are in "
            f"pairs.csv. {'; '.join(remarks)}"
        )
        tables.append(frame_table("Effects of the conditions", tests, 3, text))
    return Part("plates", [one.table for one in verdicts], tables, drawn)


QUANTITIES: Final = ("COPx", "COPy", *WRENCH_COMPONENTS)
ZONES: Final = ("back", "middle", "front")
"""Thirds of the belt."""


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
        # thirds of the belt by the place of the weight; what is beyond its ends counts to the ends
        edges = np.linspace(*trial.belt_ends, len(ZONES) + 1)
        zone = np.clip(np.digitize(trial.marker[:, 0], edges) - 1, 0, len(ZONES) - 1)
        zones = {label: trial.used & (zone == k) for k, label in enumerate(ZONES)}
        for name, inside in {"all": trial.used, **zones}.items():
            if np.count_nonzero(inside) < EFFECTS.fewest_samples:
                continue
            for k, quantity in enumerate(QUANTITIES):
                m, t = measured[inside, k], truth[inside, k]
                sizes = float(rms(m - t)), orthogonal_rmse(m, t), float(rms(slow_error[inside, k]))
                rows.append((*conditions.values(), name, quantity, *sizes))
    columns = [*WeightRecording.model_fields, "zone", "quantity"]
    return pd.DataFrame(rows, columns=[*columns, "difference", "orthogonal", "slow"])


def quantities(wrench: Array) -> Array:
    """Give centre of pressure along and across [m], forces and moments [N, N·m], (T, 8)."""
    # without load there is no centre of pressure
    threshold = LIMITS.loaded * float(np.median(np.abs(wrench[:, 2])))
    return np.hstack([center_of_pressure(wrench, threshold)[:, :2], wrench])


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
    factors = ("belt", "profile", "speed_mps", "position_m", "mass_kg")
    varied = [factor for factor in factors if whole[factor].nunique() > 1]
    # main effects, each with one coefficient less than levels
    coefficients = 1 + sum(whole[factor].nunique() - 1 for factor in varied)
    needed = EFFECTS.recordings_per_coefficient * coefficients if varied else np.inf
    tests, pairs, remarks = [], [], []
    for label, data, least, used, tested in (
        ("whole recordings", whole, needed, varied, varied),
        ("thirds of the belt", thirds, EFFECTS.fewest_blocks, ["file", "zone"], ["zone"]),
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
    of_tests = [
        *("quantity", "exponent", "shapiro_w", "shapiro_p", "effect", "df", "df_error", "f", "p"),
        "partial_eta_squared",
    ]
    of_pairs = ["quantity", "factor", "first", "second", "p_bonferroni"]
    if not tests:
        return pd.DataFrame(columns=of_tests), pd.DataFrame(columns=of_pairs), remarks
    all_pairs = pd.concat(pairs, ignore_index=True)[of_pairs]
    return pd.concat(tests, ignore_index=True)[of_tests], all_pairs, remarks


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
    # the test assumes normal errors: it is the residuals that have to be normal
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


def errors_table(
    verdicts: Sequence[PlateVerdict], legend: str = "", *, totals: bool = True
) -> Table:
    """Give total errors before and after correction by their limits, or every single error."""
    rows: list[list[str | list[Check]]] = []
    for verdict in verdicts:
        after = {one.name.removesuffix(" after correction"): one for one in verdict.corrected}
        for one in verdict.judged:
            if one.name.startswith(TOTAL) == totals:
                left = [after[one.name].rated] if one.name in after else "–"
                names = [f"{verdict.belt} plate", one.name.removeprefix(f"{TOTAL} of ")]
                rows.append([*names, [one.rated], left, *one.texts[:0:-1], one.status])
    heads = ("Plate", "Error", "Before", "After", "Limit", "95 % interval", "Status")
    if totals:
        return Table("Total errors before and after correction", heads, rows, "numbers", legend)
    return Table("Single errors of the plates by their limits", heads, rows, "folded", legend)


def table_1(errors: pd.DataFrame) -> pd.DataFrame:
    """Lay out errors like the thesis' Table I.

    Parameters
    ----------
    errors
        As `trial_errors` gives them.

    Returns
    -------
    pandas.DataFrame
        First column "condition"; the others as `COLUMNS`. Means over recordings. Errors below
        `SLOW_CUTOFF_HZ`; then, at the study's cut-off, normal and orthogonal errors; from there on,
        orthogonal errors with supports (without, where there are none with).
    """
    whole = errors[errors["zone"] == "all"]
    rows = []
    ways = {f"Below {SLOW_CUTOFF_HZ:g} Hz": "slow", "Normal error": "difference"}
    for label, way in (ways | {"TLLS": "orthogonal"}).items():
        for supports, words in ((True, "support"), (False, "no support")):
            part = whole[whole["supports"] == supports]
            if len(part):
                rows.append(_row(f"{label} - {words}", part, way))
    reported = reported_errors(errors)
    chosen, zones = (reported[(reported["zone"] == "all") == entire] for entire in (True, False))
    for part, factor, form in (
        (chosen, "speed_mps", "speed = {:g} m/s"),
        (chosen, "position_m", "startpos = {:g} m"),
        (zones, "zone", "AP = {}"),
        (chosen, "mass_kg", "weight = {:.2f} kg"),
        (chosen, "profile", "profile = {}"),
        (chosen, "belt", "belt = {}"),
    ):
        rows += [
            _row(form.format(level), group, "orthogonal")
            for level, group in part.groupby(factor, sort=factor != "zone")
        ]
    return pd.DataFrame(rows)


def _row(condition: str, part: pd.DataFrame, way: str) -> dict[str, str | float]:
    means = part.groupby("quantity")[way].mean()
    return {"condition": condition} | {
        column: "-" if quantity is None else float(means[quantity]) * scale
        for column, (quantity, scale) in COLUMNS.items()
    }


def map_figure(
    response: PlateResponse,
    trials: Sequence[WeightTrial],
    calibration: PlateCalibration | None,
    file: PlatesFile,
) -> Figure:
    """Draw the errors of a plate over its surface under a person's weight.

    Parameters
    ----------
    response
        Of the plate.
    trials
        Its recordings.
    calibration
        Its correction; None to draw the errors as it is alone.
    file
        With the person's mass and the limits, up to which colours go at least.
    """
    center = trials[0].center
    places = np.vstack([trial.marker[trial.used, :2] for trial in trials]) - center[:2]
    along = (trials[0].belt_ends[1] - trials[0].belt_ends[0]) / 2
    across = np.abs(places[:, 1]).max()
    # along the whole belt, across it as far as weights were recorded
    grids = np.linspace(-along, along, 15), np.linspace(-across, across, 7)
    x, y = np.meshgrid(*grids, indexing="ij")
    weight = file.body_mass_kg * GRAVITY_MPS2
    off = {"as it is": place_errors(response, x.ravel(), y.ravel(), weight, None)}
    if calibration is not None:
        off["corrected"] = place_errors(response, x.ravel(), y.ravel(), weight, calibration)
    # one scale for both rows, up to the limit at least: a good plate is pale
    force = max(file.limits.force_n, *(np.abs(errors[:, 2]).max() for errors in off.values()))
    shift = max(file.limits.cop_m, *(np.hypot(*errors[:, :2].T).max() for errors in off.values()))
    with in_style():
        figure = Figure(figsize=(9, 1.7 * len(off) + 0.4), layout="constrained")
        panels = figure.subplots(len(off), 2, squeeze=False, sharex=True, sharey=True)
        for (name, errors), (left, right) in zip(off.items(), panels, strict=True):
            dx, dy, up = (errors[:, k].reshape(x.shape) for k in range(3))
            drawn = left.pcolormesh(x, y, up, cmap="RdBu_r", vmin=-force, vmax=force)
            figure.colorbar(drawn, ax=left, label="vertical force (N)")
            distance_mm = 1000 * np.hypot(dx, dy)
            drawn = right.pcolormesh(x, y, distance_mm, cmap="viridis", vmin=0, vmax=1000 * shift)
            figure.colorbar(drawn, ax=right, label="centre of pressure (mm)")
            for panel in (left, right):
                panel.plot(*places[::50].T, ".", color="black", ms=1.5, alpha=0.5)
                panel.set_title(name, loc="left")
            right.quiver(x, y, dx, dy, color="white", width=0.004, scale=10 * shift)
        for panel in panels[-1]:
            panel.set_xlabel("along the belt, forward → (m)")
        for panel in panels[:, 0]:
            panel.set_ylabel("left ↑ (m)")
    return figure


def place_errors(
    response: PlateResponse,
    x: Array,
    y: Array,
    force_n: float,
    calibration: PlateCalibration | None,
) -> Array:
    """Give the errors of centre of pressure [m] and force [N] at places, (n, 3).

    Places are along and across from the middle of the plate, (n,) [m] each; systematic errors
    alone.
    """
    # a vertical force at (x, y): Mx = y Fz, My = -x Fz about the plate's centre
    none = np.zeros_like(x)
    loads = np.column_stack([none, none, none + force_n, y * force_n, -x * force_n, none])
    reported = response.report(loads)[0]
    if calibration is not None:
        reported = calibration.correct(reported)
    place = center_of_pressure(reported, LIMITS.loaded * force_n)[:, :2]
    return np.column_stack([place - np.column_stack([x, y]), reported[:, 2] - force_n])


def linearity_figure(
    trials: Sequence[WeightTrial], verdicts: Sequence[PlateVerdict], mass_kg: float
) -> Figure:
    """Draw the difference of measured and known vertical force, and where extrapolation begins."""
    with in_style():
        figure = Figure(figsize=(9, 3), layout="constrained")
        panel = figure.subplots()
        for verdict, marker in zip(verdicts, "ox", strict=False):
            loads, measured = mean_loads(trials, verdict.belt)
            label = f"{verdict.belt} plate"
            panel.plot(loads, measured - loads, marker, ms=4, label=label)
        # from the largest recorded load of the plate with the least to the peak of walking
        begins = min(one.largest_n for one in verdicts)
        largest_n = STANCE.phases[:, 1].max() * mass_kg * GRAVITY_MPS2
        panel.axvspan(begins, largest_n, color="#fbf1cf", zorder=0)

        panel.axvline(begins, color="black", lw=0.9)
        panel.annotate(
            f" extrapolated above {begins:.0f} N",
            (begins, 0.92),
            xycoords=panel.get_xaxis_transform(),
        )
        panel.set_ylabel("measured − known (N)")
        panel.set_xlabel("known vertical force (N)")
        panel.legend(frameon=False)
    return figure
