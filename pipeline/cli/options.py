"""Options and arguments that commands share."""

from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option("--out", help="Folder for what it writes.")]
Axes = Annotated[
    str | None,
    typer.Option(help="Where the file's x, y, z point, e.g. left,back,up; default: inferred."),
]
Seed = Annotated[int, typer.Option(min=0, help="Equal seeds give equal signals and results.")]
ResultsFolder = Annotated[Path, typer.Argument(help="Folder that hbm run wrote.")]
StudyFolder = Annotated[Path, typer.Argument(help="Folder with study.toml and subject files.")]
TrialFile = Annotated[
    Path, typer.Argument(help="The trial: C3D, TRC, D-Flow, .mox or Nexus ASCII, told by content.")
]
Static = Annotated[Path | None, typer.Option(help="Calibration pose; default: the trial itself.")]
Forces = Annotated[Path | None, typer.Option(help="Ground reaction forces (.mot) of a .trc trial.")]
Record = Annotated[Path | None, typer.Option(help="D-Flow record file beside a D-Flow mocap file.")]
MassKg = Annotated[float | None, typer.Option(help="Body mass; default: weighed by the plates.")]
Sex = Annotated[str, typer.Option(help="male, female or unspecified.")]
HeightM = Annotated[
    float | None, typer.Option(help="Stature; default: the file's, or from the legs.")
]
MarkerSetName = Annotated[
    str | None, typer.Option(help="Name of a marker set, or a TOML file with one's own.")
]
Hip = Annotated[str, typer.Option(help="Hip centres: harrington, bell or functional.")]
HipTrial = Annotated[
    Path | None, typer.Option(help="Recording in which the thighs swing, for --hip functional.")
]
Segments = Annotated[
    Path | None, typer.Option(help="TOML with what is known of segments: prostheses, shoes, scans.")
]
FilterMethod = Annotated[
    str, typer.Option("--filter", help="zero_phase, or realtime as in the lab.")
]
CutoffHz = Annotated[float, typer.Option(help="Cut-off of the filter.")]
PlateDelayMs = Annotated[
    float,
    typer.Option(min=-500, max=500, help="How much later the plates are than the markers."),
]
CalibrationFile = Annotated[
    Path | None, typer.Option(help="Calibration of the moving treadmill (hbm calibration fit).")
]
PlatformMarkers = Annotated[
    str, typer.Option(help="Markers on a moving platform, e.g. PLAT1,PLAT2,PLAT3.")
]


def listed(names: str) -> tuple[str, ...]:
    """Split names that were typed with commas between them."""
    return tuple(filter(None, map(str.strip, names.split(","))))
