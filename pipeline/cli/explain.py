"""What residuals are made of, on the command line: of one trial, or of a study's results."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from pipeline.cli.options import (
    RESULT,
    Jobs,
    require_folder,
    require_no_options,
    takes_trial_request,
)
from pipeline.cli.terminal import PlainConsole, announcer, counts_of, follow_trials, print_table
from pipeline.run.request import TrialRequest

if TYPE_CHECKING:
    from pipeline.budgets.explanation import Explanation


@takes_trial_request
def explain(
    request: TrialRequest,
    out: Annotated[Path | None, Option(help="For one trial; default: results.")] = None,
    jobs: Jobs = 1,
) -> int:
    """Say what the pelvis residuals of a trial are made of, how sure that is, and what to mend.

    TRIAL may be a results folder of 'hbm run': all trials of the study are explained, from their
    recordings, and 'hbm report' shows it. Nothing is corrected.
    """
    if request.trial.is_dir():
        return _explain_results(request, out, jobs)
    return _explain_trial(request, out or Path("results"))


def _explain_trial(request: TrialRequest, out: Path) -> int:
    from pipeline.budgets.explanation import BANDS_SUFFIX as BANDS
    from pipeline.budgets.explanation import SUFFIX, explain, write_bands, write_explanation
    from pipeline.figures.explained import bands_figure, budget_figure
    from pipeline.figures.style import save_figure
    from pipeline.run.one_trial import process_request

    if request.trial.suffix == RESULT:
        raise ValueError(
            f"{request.trial} is a result, and only the recording shows what its residuals are "
            "made of; give the recording, or the results folder of a study"
        )
    console = PlainConsole()
    require_folder(out)
    trial = process_request(request, announcer(console))
    explanation = explain(trial.recording, trial.laboratory, trial.result)
    name, bands = request.trial.stem, explanation.budget.bands
    write_explanation(explanation, out / f"{name}{SUFFIX}")
    save_figure(budget_figure(explanation.budget), out / f"{name}_explained")
    assert bands is not None  # it was not read from a file
    write_bands(bands, out / f"{name}{BANDS}")
    save_figure(bands_figure(bands, request.trial.name), out / f"{name}_bands")
    print_explanation(explanation, console)
    console.say(
        f"written to {out}: {name}{SUFFIX} (all numbers), {name}{BANDS} (residuals over time), "
        f"{name}_explained and {name}_bands as .png and .svg"
    )
    return 0


def print_explanation(explanation: "Explanation", console: PlainConsole) -> None:
    """Print what a trial's residuals are made of: a row of shares per cause, and lines."""
    from rich.table import Table

    from pipeline.budgets.words import CAPTION, budget_table

    title, axes, causes = budget_table(explanation.budget)
    table = Table(title=title, caption=CAPTION, box=None, padding=(0, 1, 0, 0))
    table.add_column("", max_width=20)  # six residuals share the other 60 of 80 columns
    for axis in axes:
        table.add_column(axis.replace(", ", "\n"), justify="right", no_wrap=True)
    for head, cells in causes:
        table.add_row(head, *cells)
    print_table(table, console)
    for line in explanation.lines():
        console.print(line)
    console.say_notes(explanation.budget.notes)


def _explain_results(request: TrialRequest, out: Path | None, jobs: int) -> int:
    from pipeline.budgets.study import explain_planned, plan_explanations, study_of, up_to_date
    from pipeline.run.processes import keep_freed_memory

    folder = request.trial
    require_no_options(request, "the results of a study, whose files state everything")
    if out is not None:
        raise ValueError(f"leave out --out: explanations of a study go to {folder / 'explained'}")
    console = PlainConsole()
    keep_freed_memory()
    planned = plan_explanations(study_of(folder), folder)
    outcomes = explain_planned(planned, folder, jobs=jobs, announce=announcer(console))
    finished = follow_trials(outcomes, len(planned), "explaining", "explained", console)
    for job in planned:
        explanation = up_to_date(job.target, job.key)
        if explanation:
            console.say(f"{job.name}: {next(explanation.lines())}")
    console.say(f"{counts_of(finished, 'explained')}; next: hbm report {folder}")
    return int(any(outcome.failure is not None for outcome in finished))
