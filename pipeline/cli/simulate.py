"""The virtual laboratory on the command line: a study, or the table of what each fault adds."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from hbm.kernels.native import kernels
from pipeline.io.write import write_csv
from pipeline.virtual_lab.protocol.setting_file import read_setting
from pipeline.virtual_lab.protocol.walking_protocol import SHORT, Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study


def stated(
    path: Path | None, *, subjects: int | None, seed: int | None, ablation: bool = False
) -> Setting:
    """Read a setting and put what was typed in its place.

    Parameters
    ----------
    path
        TOML file; None for the thesis' protocol in a usual laboratory.
    subjects, seed
        Instead of the file's, where given.
    ablation
        Whether the setting is for an ablation, whose trials are short where no file is given.

    Returns
    -------
    Setting
        Checked.

    Raises
    ------
    ValueError, OSError
        If the file is not there or wrong.
    """
    if path is not None:
        setting = read_setting(path.read_text(encoding="utf-8-sig"))
    else:
        setting = Setting(protocol=SHORT if ablation else Protocol())
    changes: dict[str, Any] = {} if seed is None else {"seed": seed}
    if subjects is not None:
        changes["protocol"] = setting.protocol.model_copy(update={"subjects": subjects})
    return setting.model_copy(update=changes)


def simulate(folder: Path, setting: Setting, *, jobs: int) -> None:
    """Simulate a study with progress and say where it is; nothing is written over."""
    if folder.is_dir() and any(folder.iterdir()):
        raise ValueError(f"{folder}: is not empty; name a new folder, nothing is written over")
    console = Console(highlight=False, markup=False)
    kernels(lambda sentence: console.print(sentence, style="dim"))
    with _progress(console) as progress:
        task = progress.add_task("simulating", total=None)
        simulate_study(
            folder,
            setting,
            lambda name, done, total: progress.update(task, completed=done, total=total),
            jobs,
        )
    console.print(f"written to {folder}; next: hbm run {folder}", soft_wrap=True)


def ablate(folder: Path, setting: Setting, *, jobs: int) -> None:
    """Switch one fault on at a time; write the table and its figure."""
    from pipeline.figures.style import save_figure
    from pipeline.virtual_lab.analysis.ablation import ablation
    from pipeline.virtual_lab.analysis.ablation_figure import ablation_figure

    console = Console(highlight=False, markup=False)
    folder.mkdir(parents=True, exist_ok=True)
    subjects = setting.protocol.subjects
    kernels(lambda sentence: console.print(sentence, style="dim"))
    with _progress(console) as progress:
        task = progress.add_task("one fault at a time", total=None)
        table = ablation(
            setting,
            subjects,
            progress=lambda name, done, total: progress.update(task, completed=done, total=total),
            jobs=jobs,
        )
    write_csv(table, folder / "ablation.csv")
    save_figure(ablation_figure(table, subjects), folder / "ablation")
    console.print(f"written to {folder}: ablation.csv, ablation.png, ablation.svg", soft_wrap=True)


def _progress(console: Console) -> Progress:
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    return Progress(*columns, console=console)
