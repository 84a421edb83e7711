"""The command line's treadmill side: experiments 1 and 2, and calibration."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import Axes, Out, Seed

calibration_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)


@calibration_app.callback()
def calibration() -> None:
    """Calibrate a moving treadmill: what its empty plates measure."""


@calibration_app.command()
def fit(
    recording: Annotated[Path, typer.Argument(help="The empty, moving treadmill.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Calibration file to write (.json).")],
    axes: Axes = None,
    cutoff_hz: Annotated[
        float,
        typer.Option(min=0.1, max=100, help="Low-pass of fit and trials, zero phase (-3 dB)."),
    ] = 20.0,
    accelerometer_unit: Annotated[
        str | None, typer.Option(help="g or m/s²; default: as the file says.")
    ] = None,
) -> None:
    """Fit a calibration to a recording of the empty, moving treadmill."""
    from pipeline.cli import calibration as calibration_commands

    calibration_commands.fit(
        recording, out, axes=axes, cutoff_hz=cutoff_hz, accelerometer_unit=accelerometer_unit
    )


@calibration_app.command()
def signals(
    out: Annotated[Path, typer.Argument(help="Folder for the signals.")],
    kind: Annotated[str, typer.Option(help="pitch_sway, belt, validation or all of them.")] = "all",
    rate_hz: Annotated[float, typer.Option(min=100, max=10000, help="Samples per second.")] = 100.0,
    seed: Seed = 0,
    sway_m: Annotated[float, typer.Option(help="The machine's largest sway.")] = 0.05,
    sway_m_per_s: Annotated[float, typer.Option(help="Its speed.")] = 0.31,
    sway_m_per_s2: Annotated[float, typer.Option(help="Its acceleration.")] = 5.0,
    pitch_deg: Annotated[float, typer.Option(help="The machine's largest pitch.")] = 10.0,
    pitch_deg_per_s: Annotated[float, typer.Option(help="Its speed.")] = 50.0,
    pitch_deg_per_s2: Annotated[float, typer.Option(help="Its acceleration.")] = 600.0,
    belt_m_per_s: Annotated[float, typer.Option(help="The belts' largest speed.")] = 6.0,
    belt_m_per_s2: Annotated[float, typer.Option(help="Their acceleration.")] = 15.0,
) -> None:
    """Write calibration and validation signals for the machine: CSV and pictures."""
    from compensation import Limits
    from pipeline.cli import ranking as ranking_commands

    limits = Limits(
        sway_m,
        sway_m_per_s,
        sway_m_per_s2,
        pitch_deg,
        pitch_deg_per_s,
        pitch_deg_per_s2,
        belt_m_per_s,
        belt_m_per_s2,
    )
    ranking_commands.signals(out, kind=kind, rate_hz=rate_hz, seed=seed, limits=limits)


@calibration_app.command()
def rank(
    folder: Annotated[
        Path,
        typer.Argument(
            help="With calibration/ and validation/, belt_calibration/ and belt_validation/ (.c3d)."
        ),
    ],
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Fill the folder from the virtual laboratory first.")
    ] = False,
    plate: Annotated[int, typer.Option(min=1, help="The empty plate that is scored.")] = 1,
    cutoff_hz: Annotated[
        float, typer.Option(help="Low-pass for pitch and sway, as in fit.")
    ] = 20.0,
    belt_channel: Annotated[str, typer.Option(help="Channel with the belt speed.")] = "BeltSpeed",
    belt_cutoff_hz: Annotated[float, typer.Option(help="Real-time low-pass for the belts.")] = 10.0,
    axes: Axes = None,
    seed: Seed = 0,
    out: Out = Path("ranking"),
) -> None:
    """Rank calibration trials by what they leave of the validation trials."""
    from pipeline.calibration_ranking.trials import Rules
    from pipeline.cli import ranking as ranking_commands

    rules = Rules(plate, cutoff_hz, belt_channel, belt_cutoff_hz, axes)
    ranking_commands.rank(folder, out, rules=rules, simulate=simulate, seed=seed)


def plates(
    study: Annotated[Path, typer.Argument(help="Folder with plates.toml and its recordings.")],
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Fill the folder from the virtual laboratory first.")
    ] = False,
    seed: Seed = 0,
    out: Out = Path("plates"),
) -> None:
    """Check force plates against known weights: fit for inverse dynamics or not, and why."""
    from pipeline.cli import plates as plates_commands

    plates_commands.run(study, out, simulate=simulate, seed=seed)
