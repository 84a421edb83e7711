"""What a person asks of one trial: its file and every option of the command line about it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated


@dataclass(frozen=True, slots=True)
class OptionHelp:
    """What a person reads about a field of a request, and the bounds of a number."""

    text: str
    min: float | None = None
    max: float | None = None


@dataclass(frozen=True, slots=True)
class TrialRequest:
    """One trial to process, and how, as typed.

    The command line's options are made from these fields: ``--mass-kg`` is ``mass_kg``. What each
    one means stands beside it; settings and subject are checked when the request is processed.
    """

    trial: Annotated[
        Path, OptionHelp("The trial: C3D, TRC, D-Flow, .mox or Nexus ASCII, recognised by content.")
    ]
    static: Annotated[Path | None, OptionHelp("Calibration pose; default: the trial itself.")] = (
        None
    )
    forces: Annotated[Path | None, OptionHelp("Ground reaction forces (.mot) of a .trc trial.")] = (
        None
    )
    record: Annotated[Path | None, OptionHelp("D-Flow record file beside a D-Flow mocap file.")] = (
        None
    )
    mass_kg: Annotated[float | None, OptionHelp("Body mass; default: weighed by the plates.")] = (
        None
    )
    sex: Annotated[str, OptionHelp("male, female or unspecified.")] = "unspecified"
    height_m: Annotated[
        float | None, OptionHelp("Stature; default: the file's, or estimated from the legs.")
    ] = None
    knee_width_m: Annotated[
        float | None,
        OptionHelp("Knee width where medial markers are missing; default: estimated."),
    ] = None
    ankle_width_m: Annotated[float | None, OptionHelp("Ankle width, in the same way.")] = None
    axes: Annotated[
        str | None,
        OptionHelp("Where the file's x, y, z point, e.g. left,back,up; default: inferred."),
    ] = None
    marker_set: Annotated[
        str | None, OptionHelp("Name of a marker set, or a TOML file with your own.")
    ] = None
    marker_offset_m: Annotated[
        float, OptionHelp("Distance from the skin to a marker's centre.")
    ] = 0.009
    hip: Annotated[str, OptionHelp("Hip centres: harrington, bell or functional.")] = "harrington"
    hip_trial: Annotated[
        Path | None, OptionHelp("Recording in which the thighs swing, for --hip functional.")
    ] = None
    segments: Annotated[
        Path | None, OptionHelp("TOML with known segment inertias: prostheses, shoes, scans.")
    ] = None
    filter: Annotated[str, OptionHelp("zero_phase, or realtime as in the lab.")] = "zero_phase"
    cutoff_hz: Annotated[float, OptionHelp("Cut-off frequency of the filter.")] = 6.0
    plate_delay_ms: Annotated[
        float, OptionHelp("How much later the plates are than the markers.", min=-500, max=500)
    ] = 0.0
    contact_threshold_n: Annotated[
        float, OptionHelp("Vertical force above which a foot is on a plate.")
    ] = 30.0
    calibration: Annotated[
        Path | None, OptionHelp("Calibration of the moving treadmill (hbm calibration fit).")
    ] = None
    platform_markers: Annotated[
        str, OptionHelp("Markers on a moving platform, e.g. PLAT1,PLAT2,PLAT3.")
    ] = ""

    @property
    def plate_delay_s(self) -> float:
        """How much later the plates are than the markers [s]."""
        return self.plate_delay_ms / 1000
