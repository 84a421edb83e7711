"""``hbm simulate`` on the command line: the virtual laboratory alone."""

from pathlib import Path
from typing import Annotated

import typer


def simulate(
    folder: Annotated[Path, typer.Argument(help="Folder for the study, or for the table.")],
    setting: Annotated[
        Path | None,
        typer.Option(help="TOML with seed, [protocol] and [faults.…]; default: the thesis'."),
    ] = None,
    subjects: Annotated[
        int | None, typer.Option(min=1, max=9, help="How many of the nine people.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Equal seeds give equal files.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes side by side.")] = 2,
    ablation: Annotated[
        bool, typer.Option("--ablation", help="What each fault adds to each residual instead.")
    ] = False,
) -> None:
    """Simulate experiment 3: C3D files, study files, and the truth beside them."""
    from pipeline.cli import simulate as simulate_command

    stated = simulate_command.stated(setting, subjects=subjects, seed=seed, ablation=ablation)
    if ablation:
        simulate_command.ablate(folder, stated, jobs=jobs)
    else:
        simulate_command.simulate(folder, stated, jobs=jobs)
