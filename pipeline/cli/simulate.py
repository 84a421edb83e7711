"""The virtual laboratory on the command line: simulate, demo."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from pipeline.cli.options import Jobs, Out
from pipeline.cli.stopping import stoppable
from pipeline.cli.study import print_study_residuals, report, run, view
from pipeline.cli.terminal import PlainConsole, StepProgress, announcer, counted

if TYPE_CHECKING:
    from pipeline.virtual_lab.protocol.walking_protocol import Setting


def simulate(
    folder: Annotated[Path, Argument(help="For the study; may hold a simulated one.")],
    setting: Annotated[Path | None, Option(help="TOML file; or thesis.")] = None,
    subjects: Annotated[int | None, Option(min=1, max=9, help="How many of the nine.")] = None,
    seed: Annotated[int | None, Option(help="Equal seeds give equal files.")] = None,
    jobs: Annotated[int, Option(min=1, help="How many processes.")] = 2,
) -> None:
    """Simulate experiment 3: C3D files, study files, and the true values.

    Of a simulated study that is in the folder already, only what is missing is written. A setting
    is a TOML file with seed, [protocol] and [faults.…], or 'thesis': the faults that it states.
    """
    from pipeline.virtual_lab.protocol.walking_protocol import Setting, find_setting
    from pipeline.virtual_lab.protocol.walking_study import (
        folder_setting,
        missing_files,
        require_setting,
        study_files,
    )

    there = folder_setting(folder)
    chosen = find_setting(setting) if setting is not None else there or Setting()
    if seed is not None:
        chosen = chosen.model_copy(update={"seed": seed})
    if subjects is not None:
        protocol = chosen.protocol.model_copy(update={"subjects": subjects})
        chosen = chosen.model_copy(update={"protocol": protocol})
    if there is not None:
        require_setting(folder, there, chosen)
    start, missing = time.monotonic(), missing_files(folder, chosen)
    _simulate_study(folder, chosen, jobs, PlainConsole(), keep=True)
    recordings = sum(name.endswith(".c3d") for name in missing)
    PlainConsole().say(
        f"{counted(recordings, 'recording')} and {counted(len(missing) - recordings, 'other file')}"
        f" written to {folder} in {time.monotonic() - start:.0f} s, "
        f"{len(study_files(chosen)) - len(missing)} were there already; next: hbm run {folder}"
    )


def _simulate_study(
    folder: Path, setting: "Setting", jobs: int, console: PlainConsole, *, keep: bool = False
) -> None:
    from hbm.kernels.native import kernels
    from pipeline.virtual_lab.protocol.walking_study import simulate_study

    goes_on = "goes on" if keep else "begins again"
    with stoppable(lambda: f"the study is not complete; the same command {goes_on}"):
        kernels(announcer(console))
        with StepProgress(console, "simulating", "recordings") as progress:
            simulate_study(folder, setting, progress.show, jobs, keep=keep)


def demo(
    full: Annotated[bool, Option("--full", help="The thesis' 2.4 hours of walking.")] = False,
    jobs: Jobs = 2,
    out: Out = Path("demo"),
) -> int:
    """Simulate a study in the virtual laboratory and run experiment 3 on it."""
    from pipeline.virtual_lab.protocol.walking_protocol import DEMO, Setting

    console, start = PlainConsole(), time.monotonic()
    study, results = out / "study", out / "results"
    out.mkdir(parents=True, exist_ok=True)
    setting = Setting() if full else Setting(protocol=DEMO)
    _simulate_study(study, setting, jobs, console)
    console.say(
        f"{setting.protocol.subjects} simulated subjects walked on a treadmill that sways and "
        f"pitches; their recordings are in {study} ({time.monotonic() - start:.0f} s)"
    )
    code = run(study, jobs=jobs, out=results)
    report(results)
    print_study_residuals(results)
    view(results, "sub01", "sway", save=results / "viewer" / "sub01_sway.rrd")
    console.say(
        f"open {results / 'report.html'} in a browser; 'hbm view {results}' shows where the "
        "residuals come from"
    )
    return code
