"""A calibration against a recording of another day, on the command line."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import Accelerometers, Axes, PlateCorrectionFile, PlateUnits, Units

if TYPE_CHECKING:
    from rich.table import Table

    from pipeline.trial.ground.calibration_check import CalibrationCheck


def check(
    calibration: Annotated[Path, typer.Argument(help="What 'hbm calibration fit' wrote (.json).")],
    recording: Annotated[Path, typer.Argument(help="The empty treadmill, moving, another day.")],
    axes: Axes = None,
    units: Units = None,
    plate_units: PlateUnits = None,
    accelerometer: Accelerometers = None,
    plate_calibration: PlateCorrectionFile = None,
) -> int:
    """Check a calibration with an empty recording of another day; exit code 1 if not valid."""
    from pipeline.cli.terminal import note_line, plain_console, print_table
    from pipeline.config.plate_correction import read_plate_correction
    from pipeline.config.schema import RecordingRules
    from pipeline.config.toml_file import check_options
    from pipeline.trial.ground.accelerometers import stated_accelerometers
    from pipeline.trial.ground.calibration_check import check_recording
    from pipeline.trial.ground.empty_plates import read_empty
    from pipeline.trial.ground.laboratory import read_laboratory

    plates = read_plate_correction(plate_calibration) if plate_calibration else None
    channels = stated_accelerometers(accelerometer or ())
    laboratory = read_laboratory(calibration, (), channels, plates)
    rules = {"axes": axes, "units": units, "plate_units": plate_units}
    stated, console = check_options(RecordingRules, rules).stated(), plain_console()
    empty = read_empty(recording, stated, any_forward=plates is None)
    found = check_recording(empty, laboratory)
    if found.plates:
        print_table(_table(found, recording.name), console)
    assert laboratory.calibration is not None
    for note in (*found.notes, *laboratory.calibration.notes):
        console.print(note_line(note), soft_wrap=True)
    return 0 if found.valid else 1


def _table(found: "CalibrationCheck", recording: str) -> "Table":
    """Lay out what the calibration and a new fit leave, and how far the zeros moved."""
    from rich.table import Table

    from compensation.inertia.quality import UNITS
    from hbm.spatial import WRENCH_COMPONENTS

    table = Table(title=f"{recording}, compensated by the calibration (below 6 Hz)")
    for name in ("plate", "component", "RMS left", "by a new fit", "zero changed by"):
        table.add_column(name, justify="left" if name in ("plate", "component") else "right")
    for plate, one in found.plates.items():
        for k, component in enumerate(WRENCH_COMPONENTS):
            numbers = one.left[k], one.left_by_new_fit[k], one.zero_change[k]
            table.add_row(plate, component, *(f"{x:.2f} {UNITS[k]}" for x in numbers))
    return table
