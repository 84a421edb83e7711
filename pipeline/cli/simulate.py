"""The virtual laboratory on the command line: simulate, demo."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import Jobs, Out
from pipeline.cli.results import print_study_residuals, report, view
from pipeline.cli.study import run

if TYPE_CHECKING:
    from rich.console import Console

    from pipeline.virtual_lab.protocol.walking_protocol import Setting


def simulate(
    folder: Annotated[
        Path,
        typer.Argument(help="Folder for the study, or for the table; may hold a simulated study."),
    ],
    setting: Annotated[
        Path | None,
        typer.Option(
            help="TOML with seed, [protocol] and [faults.…], or 'thesis': what it states of its "
            "faults; default: its protocol."
        ),
    ] = None,
    subjects: Annotated[
        int | None, typer.Option(min=1, max=9, help="How many of the nine simulated subjects.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Equal seeds give equal files.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="How many processes.")] = 2,
    ablation: Annotated[
        bool,
        typer.Option("--ablation", help="Tabulate what each fault adds to each residual instead."),
    ] = False,
    table_3: Annotated[
        bool,
        typer.Option(
            "--table-3",
            help="Put the thesis' Table III beside simulated ones instead (half an hour of one "
            "core).",
        ),
    ] = False,
) -> None:
    """Simulate experiment 3: C3D files, study files, and the true values.

    Of a simulated study that is in the folder already, only what is missing is written.
    """
    from pipeline.virtual_lab.protocol.setting_file import find_setting
    from pipeline.virtual_lab.protocol.study_folder import folder_setting, require_setting
    from pipeline.virtual_lab.protocol.walking_protocol import SHORT, THESIS, Setting

    if ablation and table_3:
        raise ValueError("--ablation and --table-3 write different tables; choose one")
    there = None if ablation or table_3 else folder_setting(folder)
    if setting is not None:
        chosen = find_setting(setting)
    elif ablation or table_3:
        chosen = Setting(protocol=SHORT if ablation else THESIS)
    else:
        chosen = there or Setting()
    if seed is not None:
        chosen = chosen.model_copy(update={"seed": seed})
    if subjects is not None:
        protocol = chosen.protocol.model_copy(update={"subjects": subjects})
        chosen = chosen.model_copy(update={"protocol": protocol})
    if there is not None:
        require_setting(folder, there, chosen)
    if ablation:
        _write_ablation(folder, chosen, jobs)
    elif table_3:
        _write_table_3(folder, chosen, jobs)
    else:
        _complete_study(folder, chosen, jobs)


def _complete_study(folder: Path, setting: "Setting", jobs: int) -> None:
    """Write what is missing of a study; print what was written and what was there."""
    from pipeline.cli.terminal import counted, plain_console
    from pipeline.virtual_lab.protocol.study_folder import missing_files, study_files

    console, start = plain_console(), time.monotonic()
    missing, every = missing_files(folder, setting), study_files(setting)
    _simulate_study(folder, setting, jobs, console, keep=True)
    recordings = sum(name.endswith(".c3d") for name in missing)
    console.print(
        f"{counted(recordings, 'recording')} and {counted(len(missing) - recordings, 'other file')}"
        f" written to {folder} in {time.monotonic() - start:.0f} s, "
        f"{len(every) - len(missing)} were there already; next: hbm run {folder}",
        soft_wrap=True,
    )


def _simulate_study(
    folder: Path, setting: "Setting", jobs: int, console: "Console", *, keep: bool = False
) -> None:
    from hbm.kernels.native import kernels
    from pipeline.cli.stopping import stoppable
    from pipeline.cli.terminal import StepProgress, announcer
    from pipeline.virtual_lab.protocol.study_folder import missing_files, study_files
    from pipeline.virtual_lab.protocol.walking_study import simulate_study

    def state() -> str:
        if not keep:
            return "the study is not complete; the same command begins again"
        every = len(study_files(setting))
        there = every - len(missing_files(folder, setting))
        return f"written and kept are {there} of {every} files; the same command goes on"

    with stoppable(state):
        kernels(announcer(console))
        with StepProgress(console, "simulating", "recordings") as progress:
            simulate_study(folder, setting, progress.show, jobs, keep=keep)


def _write_ablation(folder: Path, setting: "Setting", jobs: int) -> None:
    """Switch one fault on at a time; write the table and its figure."""
    from hbm.kernels.native import kernels
    from pipeline.cli.stopping import stoppable
    from pipeline.cli.terminal import StepProgress, announcer, plain_console
    from pipeline.figures.style import save_figure
    from pipeline.io.write import write_csv
    from pipeline.virtual_lab.analysis.ablation import ablation
    from pipeline.virtual_lab.analysis.ablation_figure import ablation_figure

    console, subjects = plain_console(), setting.protocol.subjects
    folder.mkdir(parents=True, exist_ok=True)
    kernels(announcer(console))
    with (
        stoppable(lambda: "no table is written; the same command begins again"),
        StepProgress(console, "one fault at a time", "cases") as progress,
    ):
        table = ablation(setting, subjects, progress=progress.show, jobs=jobs)
    write_csv(table, folder / "ablation.csv")
    save_figure(ablation_figure(table, subjects), folder / "ablation")
    console.print(f"written to {folder}: ablation.csv, ablation.png, ablation.svg", soft_wrap=True)


def _write_table_3(folder: Path, setting: "Setting", jobs: int) -> None:
    """Simulate and process the studies that Table III is compared with; write page and table."""
    from hbm.kernels.native import kernels
    from pipeline.cli.stopping import stoppable
    from pipeline.cli.terminal import StepProgress, announcer, plain_console
    from pipeline.io.write import write_csv, write_text
    from pipeline.virtual_lab.analysis.reproduction import compared, reproduce
    from pipeline.virtual_lab.analysis.table_3_page import table_3_page

    console = plain_console()
    folder.mkdir(parents=True, exist_ok=True)
    kernels(announcer(console))
    with (
        stoppable(lambda: "no table is written; the same command begins again"),
        StepProgress(console, "Table III", "recordings and trials") as progress,
    ):
        found = reproduce(setting, progress=progress.show, jobs=jobs)
    write_csv(compared(found), folder / "table_3.csv")
    write_text(table_3_page(found), folder / "table_3.md")
    console.print(f"written to {folder}: table_3.csv, table_3.md", soft_wrap=True)


def demo(
    full: Annotated[
        bool, typer.Option("--full", help="The thesis' protocol: 2.4 hours of walking.")
    ] = False,
    jobs: Jobs = 2,
    out: Out = Path("demo"),
) -> int:
    """Simulate a study in the virtual laboratory and run experiment 3 on it."""
    from pipeline.cli.terminal import plain_console
    from pipeline.virtual_lab.protocol.walking_protocol import DEMO, Setting

    console, start = plain_console(), time.monotonic()
    study, results = out / "study", out / "results"
    out.mkdir(parents=True, exist_ok=True)
    setting = Setting() if full else Setting(protocol=DEMO)
    _simulate_study(study, setting, jobs, console)
    console.print(
        f"{setting.protocol.subjects} simulated subjects walked on a treadmill that sways and "
        f"pitches; their recordings are in {study} ({time.monotonic() - start:.0f} s)",
        soft_wrap=True,
    )
    code = run(study, jobs=jobs, out=results)
    print_study_residuals(results)
    report(results)
    view(results, "sub01", "sway", save=results / "viewer" / "sub01_sway.rrd")
    console.print(
        f"open {results / 'report.html'} in a browser; 'hbm view {results}' shows where the "
        "residuals come from",
        soft_wrap=True,
    )
    return code
