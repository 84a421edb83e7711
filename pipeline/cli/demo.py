"""The demonstration: experiment 3 on people who never lived, from C3D files to the report."""

import time
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from hbm.kernels.native import kernels
from pipeline.cli import results as result_commands
from pipeline.cli import study as study_commands
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study

SMALL = Protocol(subjects=3, baseline_s=40.0, pitch_s=60.0, waits_s=(12.0, 14.0, 12.0, 13.0))


def demo(out: Path, *, full: bool = False, jobs: int = 2) -> int:
    """Simulate a study, process it with and without compensation, report it.

    Parameters
    ----------
    out
        Folder for the study (``study``) and the results (``results``).
    full
        All nine people and the thesis' protocol (2.4 hours of walking) instead of three short ones.
    jobs
        Processes.

    Returns
    -------
    int
        Exit code: 0, or 1 if a trial failed.
    """
    console = Console(highlight=False, markup=False)
    study, results = out / "study", out / "results"
    out.mkdir(parents=True, exist_ok=True)
    kernels(lambda sentence: console.print(sentence, style="dim"))
    setting = Setting() if full else Setting(protocol=SMALL)
    begin = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("simulating a laboratory", total=None)
        simulate_study(
            study,
            setting,
            lambda name, done, total: progress.update(task, completed=done, total=total),
            jobs,
        )
    console.print(
        f"{setting.protocol.subjects} virtual people walked on a treadmill that sways and pitches; "
        f"their recordings are in {study} ({time.monotonic() - begin:.0f} s)",
        soft_wrap=True,
    )
    code = study_commands.run(study, results, jobs=jobs)
    study_commands.print_residuals(results)
    page = result_commands.report(results)
    recording = results / "viewer" / "sub01_sway.rrd"
    result_commands.view(results, subject="sub01", condition="sway", save=recording)
    console.print(
        f"open {page} in a browser; 'hbm view {results}' shows why a residual is what it is",
        soft_wrap=True,
    )
    return code
