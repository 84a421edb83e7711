"""The treadmill on the command line: calibration (fit, check, signals, rank) and plates."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from pipeline.cli.options import Out, PlateCorrectionFile, Seed, Simulate, takes
from pipeline.cli.output import OUTPUT, plain_notes, tables_in
from pipeline.cli.request import RecordingRequest, marker_names
from pipeline.cli.terminal import PlainConsole, StepProgress, announcer, print_block
from pipeline.config.schema import CalibrationFit, Platform, Treadmill
from pipeline.io.input_file import file_digest, naming

if TYPE_CHECKING:
    from pipeline.io.recording import Recording
    from pipeline.report.laboratory import Part


def say_parts(
    console: PlainConsole, folder: Path, *parts: "Part", verdicts: tuple["Part", ...] = ()
) -> None:
    """Write parts into the page of a folder, and print their verdicts and tables of numbers.

    Those of ``verdicts`` are on the page alone.
    """
    from pipeline.report.laboratory import write_laboratory

    for part in parts:
        numbers = (block for block in part.tables if block.css_class == "numbers")
        for block in (*part.verdict, *numbers):
            print_block(block, console, narrow=True)
    console.say(f"page: {write_laboratory(folder, *parts, verdicts=verdicts)}")


class FitRequest(CalibrationFit, RecordingRequest):
    """A calibration to fit, and how, as typed."""

    recording: Path
    """The empty, moving treadmill."""
    platform_markers: str = ""
    """Markers on the platform: its sway and pitch, delay of the commands."""
    sway_channel: str | None = None
    """Channel of the commanded sway."""
    pitch_channel: str | None = None
    """Channel of the commanded pitch."""
    plate_calibration: Path | None = None
    """Calibration by hbm plates."""
    beside: tuple[Path, ...] = ()
    """People beside a plate that stays empty; repeatable."""
    check: tuple[Path, ...] = ()
    """As --beside, only to compare models by; repeatable."""


@takes(FitRequest)
def fit(
    request: FitRequest,
    out: Annotated[Path, Option("-o", "--out", help="Calibration file to write (.json).")],
) -> None:
    """Write laboratory.html beside it too: fit for which trials, and what it leaves."""
    from compensation import to_json
    from compensation.inertia.sensors import describe_sensors
    from pipeline.config.plate_correction import read_plate_correction
    from pipeline.io.write import write_text
    from pipeline.report.empty_treadmill import measure_empty
    from pipeline.report.laboratory import calibration_part
    from pipeline.trial.ground import accelerometers
    from pipeline.trial.ground import calibrations as of_empty
    from pipeline.trial.ground.laboratory import Laboratory, with_corrected_plates
    from pipeline.trial.ground.platform import command_delay
    from pipeline.trial.ground.wrenches import uncertainty_limits

    console = PlainConsole()
    if out.is_dir():
        raise ValueError(f"--out {out}: is a folder; name the file to write, such as lab.json")
    commands = Platform(sway_channel=request.sway_channel, pitch_channel=request.pitch_channel)
    markers = marker_names(request.platform_markers)
    if commands.channels and not markers:
        raise ValueError(
            "--sway-channel and --pitch-channel need --platform-markers, which time the commands"
        )
    options, file = request.options(), request.plate_calibration
    plates = read_plate_correction(file) if file else None

    def read(path: Path) -> "Recording":
        return of_empty.read_empty(path, options, any_forward=plates is None)

    empty = read(request.recording)
    sensors = accelerometers.stated_accelerometers(request.accelerometer)
    sensors = sensors or accelerometers.find_accelerometers(empty)
    how = {name: getattr(request, name) for name in CalibrationFit.model_fields}
    treadmill = Treadmill(accelerometers=sensors, **how)
    with naming(request.recording):
        with_people, compared = ([*map(read, paths)] for paths in (request.beside, request.check))
        calibration = of_empty.fit_calibration(empty, treadmill, plates, with_people, compared)
        timing = [command_delay(empty, markers, commands)] if commands.channels else []
    laboratory = Laboratory(treadmill, calibration, plates=plates)
    measured = measure_empty(empty, laboratory, Platform(markers=markers) if markers else None)
    provenance = {
        **calibration.provenance,
        **measured.motion,
        "sha256": file_digest(request.recording),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "program": f"hbm-residuals {version('hbm-residuals')}",
        "channels": json.dumps(sensors),
        "accelerometer_unit": request.accelerometer_unit or "",
    }
    calibration = replace(calibration, provenance=provenance)
    write_text(to_json(calibration), out)
    notes = [
        *calibration.notes,
        *with_corrected_plates(empty, plates).notes[len(empty.notes) :],
        *describe_sensors(calibration.sensors),
        *timing,
        *of_empty.plates_timed_apart(empty, treadmill, calibration.sensors, plates),
        *uncertainty_limits(measured.belts_mps, calibration),
    ]
    say_parts(console, out.parent, calibration_part(calibration, out, measured, notes))
    console.say_notes(notes)
    console.say(f"written to {out}")
    rows = [(name, row) for name in calibration.in_use for row in calibration.verdict[name]]
    OUTPUT.result.update(
        calibration=str(out),
        fit_for_trials=not calibration.notes,
        components=[{"plate": name, **row._asdict(), "verdict": row.verdict} for name, row in rows],
        notes=plain_notes(notes),
    )


def signals(
    kind: Annotated[str, Option(help="pitch_sway, belt, validation or all of them.")] = "all",
    rate_hz: Annotated[float, Option(min=100, max=10000, help="Samples per second.")] = 100.0,
    seed: Seed = 0,
    sway_m: Annotated[float, Option(help="Largest sway of the machine.")] = 0.05,
    sway_m_per_s: Annotated[float, Option(help="Largest sway speed.")] = 0.31,
    sway_m_per_s2: Annotated[float, Option(help="Largest sway acceleration.")] = 5.0,
    pitch_deg: Annotated[float, Option(help="Largest pitch.")] = 10.0,
    pitch_deg_per_s: Annotated[float, Option(help="Largest pitch speed.")] = 50.0,
    pitch_deg_per_s2: Annotated[float, Option(help="Largest pitch acceleration.")] = 600.0,
    belt_m_per_s: Annotated[float, Option(help="Largest belt speed.")] = 6.0,
    belt_m_per_s2: Annotated[float, Option(help="Largest belt acceleration.")] = 15.0,
    out: Out = Path("signals"),
) -> None:
    """Those that the machine can do are written, as CSV."""
    from compensation import MachineLimits
    from compensation.protocol import ADVISED_BELT_SIGNAL, ADVISED_PLATFORM_SIGNAL
    from pipeline.calibration_ranking.signal_files import KINDS, protocol_signals, write_signals

    if kind not in (*KINDS, "all"):
        raise ValueError(f"--kind must be one of {', '.join(KINDS)} or all, got {kind!r}")
    sway = sway_m, sway_m_per_s, sway_m_per_s2
    pitch = pitch_deg, pitch_deg_per_s, pitch_deg_per_s2
    limits = MachineLimits(*sway, *pitch, belt_m_per_s, belt_m_per_s2)
    console = PlainConsole()
    kinds = KINDS if kind == "all" else (kind,)
    drawn = {name: protocol_signals(name, seed, limits) for name in kinds}
    if not any(possible for possible, _ in drawn.values()):
        raise ValueError(f"the machine can do none of these: {drawn[kinds[0]][1][0]}")
    for name, (possible, beyond) in drawn.items():
        written = write_signals(possible, out / name, rate_hz)
        console.say(f"{len(written)} signals at {rate_hz:g} Hz in {out / name}")
        for line in beyond:
            console.say(f"not written, beyond the machine: {name} {line}")
    names = {signal.name for possible, _ in drawn.values() for signal in possible}
    advised = {ADVISED_PLATFORM_SIGNAL: "pitch and sway", ADVISED_BELT_SIGNAL: "belts"}
    first = [f"{name} ({of})" for name, of in advised.items() if name in names]
    console.say(
        "columns: sway to the left, pitch (positive lowers the front), speed of both belts; next: "
        f"record {' or '.join(first) or 'those written'} with the treadmill empty, and fit it (hbm "
        "calibration fit)"
    )


def checklist(study: Annotated[Path, Argument(help="Folder with study.toml.")]) -> None:
    """In their order; a recording is done where study.toml states it and its file is there."""
    from pipeline.config.study import read_laboratory
    from pipeline.report.laboratory import recordings_table

    print_block(recordings_table(study, read_laboratory(study)), PlainConsole())


@takes(RecordingRequest)
def rank(
    request: RecordingRequest,
    folder: Annotated[Path, Argument(help="With calibration/, validation/, belt_… (.c3d).")],
    simulate: Simulate = False,
    plate: Annotated[int, Option(min=1, help="The empty plate that is scored.")] = 1,
    cutoff_hz: Annotated[float, Option(help="Low-pass for pitch and sway, zero phase.")] = 16.0,
    belt_channel: Annotated[str, Option(help="Channel with the belt speed.")] = "BeltSpeed",
    belt_cutoff_hz: Annotated[float, Option(help="Real-time low-pass for the belts.")] = 10.0,
    seed: Seed = 0,
    out: Out = Path("ranking"),
) -> None:
    """Write ranks with intervals, and which trials are as good, as tables and laboratory.html."""
    from pipeline.calibration_ranking.report import write_results
    from pipeline.calibration_ranking.trials import RankingSettings, read_trials
    from pipeline.virtual_lab.protocol.calibration_trial import TRIALS, simulate_ranking

    console = PlainConsole()
    settings = RankingSettings(
        plate, cutoff_hz, belt_channel, belt_cutoff_hz, request.options(), request.accelerometer
    )
    if simulate:
        if folder.exists() and any(folder.rglob("*.c3d")):
            raise ValueError(f"{folder} has recordings already; simulate into a new folder")
        with StepProgress(console, "simulating", "recordings") as progress:
            for done, path in enumerate(simulate_ranking(folder, seed), 1):
                progress.show(path.name, done, TRIALS)
    with StepProgress(console, "reading", "recordings") as progress:
        trials = read_trials(folder, settings, progress.show)
    say_parts(console, out, write_results(trials, seed, out))
    OUTPUT.result.update(tables=tables_in(out))


def plates(
    study: Annotated[Path, Argument(help="Folder with plates.toml and its recordings.")],
    simulate: Simulate = False,
    seed: Seed = 0,
    out: Out = Path("plates"),
) -> None:
    """Judge whether each plate is fit for inverse dynamics, and why, in laboratory.html.

    Where a plate can be corrected, its calibration is written too.
    """
    from pipeline.config.plate_study import read_plates_study
    from pipeline.plate_accuracy.accuracy import check_plates
    from pipeline.plate_accuracy.report import write_report
    from pipeline.virtual_lab.protocol.known_weights import THESIS_ERRORS, simulate_plates

    console = PlainConsole()
    announce = announcer(console)
    if simulate:
        if study.exists() and any(study.iterdir()):
            raise ValueError(f"{study} is not empty; simulate into a new folder")
        announce("simulating recordings of known weights")
        simulate_plates(study, THESIS_ERRORS, seed=seed)
    experiment = read_plates_study(study)
    announce(f"reading {len(experiment.file.weights)} recordings of known weights")
    say_parts(console, out, write_report(check_plates(experiment), out))
    OUTPUT.result.update(tables=tables_in(out))


@takes(RecordingRequest)
def check(
    request: RecordingRequest,
    calibration: Annotated[Path, Argument(help="What 'hbm calibration fit' wrote (.json).")],
    recording: Annotated[Path, Argument(help="The empty treadmill, moving, another day.")],
    plate_calibration: PlateCorrectionFile = None,
    day: Annotated[
        datetime | None,
        Option(formats=["%Y-%m-%d"], help="Of the recording. [default: that of the file]"),
    ] = None,
) -> int:
    """Exit code 1 if it is not valid any more.

    Each check is a row of laboratory_checks.csv and of laboratory.html, beside the
    calibration.
    """
    from pipeline.config.plate_correction import read_plate_correction
    from pipeline.report.empty_treadmill import measure_empty
    from pipeline.report.laboratory import add_check, calibration_in_use, check_part
    from pipeline.trial.ground.accelerometers import stated_accelerometers
    from pipeline.trial.ground.calibrations import check_recording, read_empty, read_laboratory

    plates = read_plate_correction(plate_calibration) if plate_calibration else None
    channels = stated_accelerometers(request.accelerometer)
    laboratory = read_laboratory(calibration, (), channels, plates)
    assert laboratory.calibration is not None
    if laboratory.calibration.provenance.get("sha256") == file_digest(recording):
        raise ValueError(
            f"{recording}: the calibration was fitted to it; give a recording of another day"
        )
    console = PlainConsole()
    empty = read_empty(recording, request.options(), any_forward=plates is None)
    result = check_recording(empty, laboratory)
    made = add_check(calibration, recording, result, f"{day:%Y-%m-%d}" if day else None)
    measured = measure_empty(empty, laboratory) if result.plates else None
    say_parts(
        console,
        calibration.parent,
        check_part(laboratory.calibration, calibration, made, result, measured),
        verdicts=(calibration_in_use(laboratory.calibration, calibration),),
    )
    notes = (*result.notes, *laboratory.calibration.notes)
    console.say_notes(notes)
    checked = {name: one._asdict() | {"faults": one.faults} for name, one in result.plates.items()}
    OUTPUT.result.update(valid=result.valid, plates=checked, notes=plain_notes(notes))
    return 0 if result.valid else 1
