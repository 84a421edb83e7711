"""A treadmill's calibration on the command line."""

import hashlib
import json
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from rich.console import Console
from rich.table import Table

from compensation import Calibration, to_json
from pipeline.config.schema import Treadmill
from pipeline.config.validation import check_options
from pipeline.io.units import acceleration_in_mps2
from pipeline.io.write import whole_file
from pipeline.trial.ground.accelerometers import find_accelerometers
from pipeline.trial.ground.laboratory import (
    fit_calibration,
    read_empty,
)

COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


def fit(
    recording_file: Path,
    out: Path,
    *,
    axes: str | None,
    cutoff_hz: float,
    accelerometer_unit: str | None = None,
) -> None:
    """Fit a calibration to a recording of the empty, moving treadmill and write it as JSON.

    Parameters
    ----------
    recording_file
        File with plates and accelerometers.
    out
        JSON file to write.
    axes
        Where the file's axes point; not needed.
    cutoff_hz
        Low-pass of both signals before the fit, and of the accelerations of every trial that the
        calibration compensates [Hz]. Zero phase: the fit has to know no delay.
    accelerometer_unit
        Of the accelerometers' channels, here and in trials; None for what the files say.

    Raises
    ------
    ValueError, OSError
        If the file cannot be used.
    """
    console = Console(highlight=False, markup=False)
    if out.is_dir():
        raise ValueError(f"--out {out}: is a folder; name the file to write, such as lab.json")
    recording = read_empty(recording_file, axes)
    sensors = find_accelerometers(recording)
    if accelerometer_unit is not None:
        acceleration_in_mps2(accelerometer_unit)
    stated = {"accelerometer_unit": accelerometer_unit, "cutoff_hz": cutoff_hz}
    treadmill = check_options(Treadmill, {"accelerometers": sensors, **stated})
    try:
        calibration = fit_calibration(recording, treadmill)
    except ValueError as error:
        text = str(error)
        if "unknown acceleration unit" in text:
            text += "; if that is not their unit, say --accelerometer-unit g"
        raise ValueError(
            text if recording_file.name in text else f"{recording_file.name}: {text}"
        ) from error
    facts = {
        "recording": recording_file.name,
        "sha256": hashlib.sha256(recording_file.read_bytes()).hexdigest(),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "program": f"hbm-residuals {version('hbm-residuals')}",
        "channels": json.dumps(sensors),
        "accelerometer_unit": accelerometer_unit or "",
    }
    with whole_file(out) as temporary:
        temporary.write_text(to_json(Calibration(calibration.plates, facts)), encoding="utf-8")
    setup = next(iter(calibration.plates.values())).setup
    method = setup.filter_method if setup is not None else ""
    console.print(f"accelerometers: {', '.join(sensors)}; low-pass {cutoff_hz:g} Hz, {method}")
    console.print(account(calibration))
    for name, model in calibration.plates.items():
        for warning in model.warnings:
            console.print(f"- {name}: {warning}", soft_wrap=True)
    doubtful = any(model.warnings for model in calibration.plates.values())
    console.print(
        f"written to {out}; "
        + (
            "do not use it before that is explained"
            if doubtful
            else f"next: hbm residuals TRIAL --calibration {out} --platform-markers M1,M2,M3"
        ),
        soft_wrap=True,
    )


def account(calibration: Calibration) -> Table:
    """Lay out how well a calibration explains its own recording."""
    table = Table(title="The empty plates, before and after compensation (calibration recording)")
    for name in ("plate", "component", "RMS", "after", "less", "R²"):
        table.add_column(name, justify="left" if name in ("plate", "component") else "right")
    for name, model in calibration.plates.items():
        for k, component in enumerate(COMPONENTS):
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
