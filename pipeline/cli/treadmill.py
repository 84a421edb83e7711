"""The treadmill on the command line: calibration (fit, signals, rank) and plates."""

import json
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import Axes, Out, PlateUnits, Seed, Simulate, Units

if TYPE_CHECKING:
    from rich.table import Table

    from compensation import Calibration


def fit(
    recording: Annotated[Path, typer.Argument(help="The empty, moving treadmill.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Calibration file to write (.json).")],
    axes: Axes = None,
    units: Units = None,
    plate_units: PlateUnits = None,
    cutoff_hz: Annotated[
        float,
        typer.Option(min=0.1, max=100, help="Low-pass of fit and trials, zero phase (-3 dB)."),
    ] = 20.0,
    accelerometer_unit: Annotated[
        str | None, typer.Option(help="g or m/s²; default: as the file says.")
    ] = None,
) -> None:
    """Fit a calibration to a recording of the empty, moving treadmill."""
    from compensation import Calibration, check_calibration, to_json
    from pipeline.cli.terminal import note_line, plain_console, print_table
    from pipeline.config.schema import RecordingRules, Treadmill
    from pipeline.config.validation import check_options
    from pipeline.io.units import acceleration_in_mps2
    from pipeline.io.write import write_text
    from pipeline.run.job import file_digest
    from pipeline.trial.ground.accelerometers import find_accelerometers
    from pipeline.trial.ground.calibration_recording import fit_calibration, read_empty

    console = plain_console()
    if out.is_dir():
        raise ValueError(f"--out {out}: is a folder; name the file to write, such as lab.json")
    rules = {"axes": axes, "units": units, "plate_units": plate_units}
    empty = read_empty(recording, check_options(RecordingRules, rules).stated())
    sensors = find_accelerometers(empty)
    if accelerometer_unit is not None:
        acceleration_in_mps2(accelerometer_unit)
    treadmill = check_options(
        Treadmill,
        {
            "accelerometers": sensors,
            "accelerometer_unit": accelerometer_unit,
            "cutoff_hz": cutoff_hz,
        },
    )
    try:
        calibration = fit_calibration(empty, treadmill)
    except ValueError as error:
        text = str(error)
        if "unknown acceleration unit" in text:
            text += "; if that is not their unit, use --accelerometer-unit g"
        raise ValueError(text if recording.name in text else f"{recording.name}: {text}") from error
    provenance = {
        "recording": recording.name,
        "sha256": file_digest(recording),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "program": f"hbm-residuals {version('hbm-residuals')}",
        "channels": json.dumps(sensors),
        "accelerometer_unit": accelerometer_unit or "",
    }
    write_text(to_json(Calibration(calibration.plates, provenance)), out)
    setup = next(iter(calibration.plates.values())).setup
    method = setup.filter_method if setup is not None else ""
    console.print(f"accelerometers: {', '.join(sensors)}; low-pass {cutoff_hz:g} Hz, {method}")
    print_table(_fit_table(calibration), console)
    doubts = [
        note
        for plate, model in calibration.plates.items()
        for note in check_calibration(model, plate)
    ]
    for note in doubts:
        console.print(note_line(note), soft_wrap=True)
    if doubts:
        advice = "do not use it before that is explained"
    else:
        advice = f"next: hbm residuals TRIAL --calibration {out} --platform-markers M1,M2,M3"
    console.print(f"written to {out}; {advice}", soft_wrap=True)


def _fit_table(calibration: "Calibration") -> "Table":
    """Lay out how well a calibration explains its own recording."""
    from rich.table import Table

    from hbm.spatial import WRENCH_COMPONENTS

    table = Table(title="The empty plates, before and after compensation (calibration recording)")
    for name in ("plate", "component", "RMS", "after", "less", "R²"):
        table.add_column(name, justify="left" if name in ("plate", "component") else "right")
    for name, model in calibration.plates.items():
        for k, component in enumerate(WRENCH_COMPONENTS):
            unit = "N" if k < 3 else "N·m"
            table.add_row(
                name,
                component,
                f"{model.rms_measured[k]:.1f} {unit}",
                f"{model.rms_compensated[k]:.2f} {unit}",
                f"{model.rms_reduction[k]:.1f} %",
                f"{model.r_squared[k]:.4f}",
            )
        table.caption = f"rank {model.rank} of {len(model.gain)}, condition {model.condition:.0f}"
    return table


def signals(
    kind: Annotated[str, typer.Option(help="pitch_sway, belt, validation or all of them.")] = "all",
    rate_hz: Annotated[float, typer.Option(min=100, max=10000, help="Samples per second.")] = 100.0,
    seed: Seed = 0,
    sway_m: Annotated[float, typer.Option(help="Largest sway of the machine.")] = 0.05,
    sway_m_per_s: Annotated[float, typer.Option(help="Largest sway speed.")] = 0.31,
    sway_m_per_s2: Annotated[float, typer.Option(help="Largest sway acceleration.")] = 5.0,
    pitch_deg: Annotated[float, typer.Option(help="Largest pitch.")] = 10.0,
    pitch_deg_per_s: Annotated[float, typer.Option(help="Largest pitch speed.")] = 50.0,
    pitch_deg_per_s2: Annotated[float, typer.Option(help="Largest pitch acceleration.")] = 600.0,
    belt_m_per_s: Annotated[float, typer.Option(help="Largest belt speed.")] = 6.0,
    belt_m_per_s2: Annotated[float, typer.Option(help="Largest belt acceleration.")] = 15.0,
    out: Out = Path("signals"),
) -> None:
    """Write calibration and validation signals for the machine: CSV and figures."""
    from compensation import MachineLimits
    from compensation.signals.protocol import ADVISED_BELT_SIGNAL, ADVISED_PLATFORM_SIGNAL
    from pipeline.calibration_ranking.signal_files import KINDS, protocol_signals, write_signals
    from pipeline.cli.terminal import plain_console

    if kind not in (*KINDS, "all"):
        raise ValueError(f"--kind must be one of {', '.join(KINDS)} or all, got {kind!r}")
    limits = MachineLimits(
        sway_m,
        sway_m_per_s,
        sway_m_per_s2,
        pitch_deg,
        pitch_deg_per_s,
        pitch_deg_per_s2,
        belt_m_per_s,
        belt_m_per_s2,
    )
    console = plain_console()
    for name in KINDS if kind == "all" else (kind,):
        drawn = protocol_signals(name, seed, limits)
        written = write_signals(drawn, out / name, rate_hz, limits)
        console.print(f"{len(written)} signals at {rate_hz:g} Hz in {out / name}", soft_wrap=True)
    console.print(
        "columns: sway to the left, pitch (positive lowers the front), speed of both belts; next: "
        f"record one with the treadmill empty, {ADVISED_PLATFORM_SIGNAL} for pitch and sway or "
        f"{ADVISED_BELT_SIGNAL} for the belts, and fit it (hbm calibration fit), or several and "
        "rank them (hbm calibration rank)",
        soft_wrap=True,
    )


def rank(
    folder: Annotated[
        Path,
        typer.Argument(
            help="With calibration/ and validation/, belt_calibration/ and belt_validation/ (.c3d)."
        ),
    ],
    simulate: Simulate = False,
    plate: Annotated[int, typer.Option(min=1, help="The empty plate that is scored.")] = 1,
    cutoff_hz: Annotated[
        float, typer.Option(help="Low-pass for pitch and sway, zero phase (-3 dB).")
    ] = 16.0,
    belt_channel: Annotated[str, typer.Option(help="Channel with the belt speed.")] = "BeltSpeed",
    belt_cutoff_hz: Annotated[float, typer.Option(help="Real-time low-pass for the belts.")] = 10.0,
    axes: Axes = None,
    units: Units = None,
    plate_units: PlateUnits = None,
    seed: Seed = 0,
    out: Out = Path("ranking"),
) -> None:
    """Rank calibration trials by how well they compensate the validation trials."""
    from pipeline.calibration_ranking.experiment import rank_recordings
    from pipeline.calibration_ranking.report import write_results
    from pipeline.calibration_ranking.trials import RankingSettings
    from pipeline.cli.terminal import StepProgress, plain_console
    from pipeline.virtual_lab.protocol.ranking_study import TRIALS, simulate_ranking

    console = plain_console()
    settings = RankingSettings(
        plate, cutoff_hz, belt_channel, belt_cutoff_hz, axes, units, plate_units
    )
    if simulate:
        if folder.exists() and any(folder.rglob("*.c3d")):
            raise ValueError(f"{folder} has recordings already; simulate into a new folder")
        with StepProgress(console, "simulating", "recordings") as progress:
            for done, path in enumerate(simulate_ranking(folder, seed), 1):
                progress.show(path.name, done, TRIALS)
    with StepProgress(console, "reading", "recordings") as progress:
        found = rank_recordings(folder, settings, seed, progress.show)
    for sentence in write_results(found, out):
        console.print(sentence, soft_wrap=True)
    console.print(f"written to {out}: ranking.md, tables, figures", soft_wrap=True)


def plates(
    study: Annotated[Path, typer.Argument(help="Folder with plates.toml and its recordings.")],
    simulate: Simulate = False,
    seed: Seed = 0,
    out: Out = Path("plates"),
) -> None:
    """Check force plates against known weights: fit for inverse dynamics or not, and why."""
    from pipeline.cli.terminal import announcer, plain_console
    from pipeline.config.plate_study import read_plates_study
    from pipeline.plate_accuracy.accuracy import check_plates
    from pipeline.plate_accuracy.report import write_report
    from pipeline.plate_accuracy.verdict import describe
    from pipeline.virtual_lab.protocol.known_weights import THESIS_ERRORS, simulate_plates

    console = plain_console()
    announce = announcer(console)
    if simulate:
        if study.exists() and any(study.iterdir()):
            raise ValueError(f"{study} is not empty; simulate into a new folder")
        announce("simulating recordings of known weights")
        simulate_plates(study, THESIS_ERRORS, seed=seed)
    experiment = read_plates_study(study)
    announce(f"reading {len(experiment.file.weights)} recordings of known weights")
    found = check_plates(experiment)
    verdict = write_report(found, out)
    for fault in found.faults:
        if fault.significant:
            console.print(f"- {describe(fault)}", soft_wrap=True)
    console.print(verdict.sentence, soft_wrap=True)
    console.print(f"written to {out}: verdict.md, table_1, figures", soft_wrap=True)
