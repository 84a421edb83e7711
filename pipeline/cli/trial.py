"""One trial on the command line: residuals, export."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.cli.options import RESULT, Out, require_folder, takes_trial_request
from pipeline.cli.terminal import PlainConsole, announcer, counted, new_table, print_table
from pipeline.run.request import TrialRequest

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.trial.result import TrialResult


@takes_trial_request
def residuals(request: TrialRequest, out: Out = Path("results")) -> None:
    """Process one trial: print its pelvis residuals, write table, frames and figure."""
    from pipeline.figures.residuals import residual_figure
    from pipeline.figures.style import save_figure
    from pipeline.io.write import write_csv
    from pipeline.run.one_trial import process_request
    from pipeline.run.store import write_trial
    from pipeline.trial.residuals import cycles_of, residual_table

    if request.trial.suffix == RESULT:
        raise ValueError(
            f"{request.trial} is a result already; 'hbm view' shows it, 'hbm export' exports it"
        )
    console = PlainConsole()
    require_folder(out)
    result = process_request(request, announcer(console)).result
    name = request.trial.stem
    write_trial(replace(result, condition=name), out / f"{name}.parquet")
    write_csv(residual_table(result, name), out / f"{name}_residuals.csv")
    write_csv(cycles_of(result, name), out / f"{name}_cycles.csv")
    save_figure(residual_figure(result), out / f"{name}_residuals")
    print_result(result, console)
    console.say(
        f"written to {out}: {name}.parquet (frames), {name}_residuals.csv, .png and .svg, "
        f"{name}_cycles.csv (each gait cycle)"
    )
    if reason := result.shortage:
        raise ValueError(f"{request.trial.name}: there are no residuals: {reason}")


def print_result(result: "TrialResult", console: PlainConsole) -> None:
    """Print a trial's residuals, thresholds, marker errors and notes."""
    from pipeline.config.schema import NOUNS
    from pipeline.trial.residuals import marker_table, residual_table, rows_of, threshold_table

    rows = rows_of(residual_table(result, result.source.stem))
    if result.span:
        counts = f"{result.span[0]:.2f} to {result.span[1]:.2f} s"
    else:
        used = sum(map(len, result.cycles.values()))
        feet = f"the {next(iter(result.cycles))} foot" if len(result.cycles) == 1 else "both feet"
        counts = f"{used} of {counted(result.found_cycles, NOUNS[result.unit])} of {feet}"
    if rows:
        counts += f", {rows[0].n_frames} frames"
        counts += f" ({100 * rows[0].valid_share:.0f} %)" * (rows[0].valid_share < 1)
    table = new_table(
        f"Pelvis residuals, {result.source.name}, {counts} "
        f"({result.settings.filter} {result.settings.cutoff_hz:g} Hz)",
        ("plates", "axis"),
        *("RMS", "mean", "SD", "peak", "", "RMS %"),
        caption="x forward, y right, z up; moments about mid-hip; % of body weight, or of body "
        "weight × stature",
    )
    for row in rows:
        numbers = [f"{value:.1f}" for value in (row.rms, row.mean, row.sd, row.peak)]
        percent = f"{row.rms_percent:.2f}"
        table.add_row(_plates(row.compensated), row.axis, *numbers, row.unit, percent)
    if rows:
        print_table(table, console)
    for threshold in rows_of(threshold_table(result)):
        verdict = "passes" if threshold.passed else "FAILS"
        console.print(
            f"{verdict} Hicks (2015): peak residual {threshold.quantity} {threshold.peak:.1f} "
            f"{threshold.unit}, limit {threshold.limit:.1f} {threshold.unit} "
            f"({_plates(threshold.compensated)})"
        )
    console.print(_marker_errors(marker_table(result)))
    console.say_notes(result.notes)


def _marker_errors(table: "pd.DataFrame") -> str:
    """Say how far the markers are from the model, the farthest first; the last row is of all."""
    rms_mm = table.set_index("marker")["rms_mm"]
    single, overall_mm = rms_mm[:-1], rms_mm.iloc[-1]
    seen = single.dropna().sort_values(ascending=False, kind="stable")
    unseen = ", ".join(single.index[single.isna()])
    errors = ", ".join(f"{marker} {error:.1f}" for marker, error in seen.items())
    never = f"never seen: {unseen}"
    if seen.empty:
        return f"marker error unknown; {never}"
    text = f"marker error {overall_mm:.1f} mm RMS over {len(seen)} markers: {errors}"
    return f"{text}; {never}" if unseen else text


def _plates(compensated: bool) -> str:
    return "compensated" if compensated else "measured"
