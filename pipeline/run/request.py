"""A request to process one trial: its file and every option of the command line about it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np


@dataclass(frozen=True, slots=True)
class Help:
    """What the command line shows about a field: its meaning, and the bounds of a number."""

    text: str
    min: float | None = None
    max: float | None = None


@dataclass(frozen=True, slots=True)
class TrialRequest:
    """One trial to process, and how, as typed.

    The command line's options are made from these fields: ``--mass-kg`` is ``mass_kg``. What each
    one means is stated with it; settings and subject are checked when the request is processed.
    """

    trial: Annotated[
        Path, Help("The trial: C3D, TRC, D-Flow, .mox, Nexus ASCII or XDF, recognised by content.")
    ]
    static: Annotated[Path | None, Help("Calibration pose; default: the trial itself.")] = None
    forces: Annotated[Path | None, Help("Ground reaction forces (.mot) of a .trc trial.")] = None
    record: Annotated[Path | None, Help("D-Flow record file of a D-Flow mocap file.")] = None
    mass_kg: Annotated[
        float | None, Help("Body mass; default: measured by the plates, else the file's.")
    ] = None
    sex: Annotated[str, Help("male, female or unspecified.")] = "unspecified"
    height_m: Annotated[
        float | None, Help("Stature; default: the file's, or estimated from the legs.")
    ] = None
    knee_width_m: Annotated[
        float | None, Help("Knee width, without medial markers; default: the file's or estimated.")
    ] = None
    ankle_width_m: Annotated[float | None, Help("Ankle width, in the same way.")] = None
    axes: Annotated[
        str | None, Help("Where the file's x, y, z point, e.g. left,back,up; default: inferred.")
    ] = None
    rename: Annotated[
        tuple[str, ...], Help("OLD=NEW: a label in the files and the one wanted; repeatable.")
    ] = ()
    label_prefix: Annotated[
        str | None,
        Help("Label prefix of the subject, or its number, where several carry the same labels."),
    ] = None
    marker_stream: Annotated[
        str | None, Help("Stream that holds the markers, where several of an XDF file do.")
    ] = None
    units: Annotated[str | None, Help("Unit of the markers, e.g. mm; default: the file's.")] = None
    plate_units: Annotated[
        str | None,
        Help("Units of the plates' forces and moments, e.g. N,Nmm; default: the file's."),
    ] = None
    marker_set: Annotated[
        str | None, Help("Name of a marker set, or a TOML file with your own.")
    ] = None
    marker_offset_m: Annotated[float, Help("Distance from the skin to a marker's centre.")] = 0.009
    hip: Annotated[str, Help("Hip centres: harrington, bell or functional.")] = "harrington"
    hip_trial: Annotated[
        Path | None, Help("Recording in which the thighs swing, for --hip functional.")
    ] = None
    segments: Annotated[
        Path | None, Help("TOML with known segment inertias: prostheses, shoes, scans.")
    ] = None
    filter: Annotated[str, Help("zero_phase, or realtime as in the lab.")] = "zero_phase"
    cutoff_hz: Annotated[float, Help("Cut-off frequency of the filter.")] = 6.0
    plate_delay_ms: Annotated[
        float | None,
        Help(
            "Delay of the plates relative to the markers; default: their calibration's, or none.",
            min=-500,
            max=500,
        ),
    ] = None
    contact_threshold_n: Annotated[
        float, Help("Vertical force above which a foot is on a plate.")
    ] = 30.0
    min_valid_share: Annotated[
        float,
        Help("Smallest share of frames that count in a gait cycle, or a recording without one."),
    ] = 0.5
    events: Annotated[
        str | None,
        Help("Gait events: file, zeni, plates or auto; default: the file's if any, else auto."),
    ] = None
    span: Annotated[
        str | None,
        Help(
            "What counts in place of gait cycles: start and stop in s, e.g. 5,15, or all; "
            "default: all where there is no gait cycle."
        ),
    ] = None
    engine: Annotated[
        str | None,
        Help("Of the inverse dynamics: pinocchio or kernels; default: pinocchio where installed."),
    ] = None
    plate_calibration: Annotated[
        Path | None, Help("Calibration of the plates by known weights (hbm plates).")
    ] = None
    calibration: Annotated[
        Path | None, Help("Calibration of the moving treadmill (hbm calibration fit).")
    ] = None
    accelerometer: Annotated[
        tuple[str, ...],
        Help(
            "SENSOR=X,Y,Z: channels of an accelerometer, if not as in the calibration; repeatable."
        ),
    ] = ()
    platform_markers: Annotated[
        str, Help("Markers on a moving platform, e.g. PLAT1,PLAT2,PLAT3.")
    ] = ""

    @property
    def window(self) -> Literal["recording"] | tuple[float, float] | None:
        """What counts in place of gait cycles; a ValueError where that is not understood."""
        if self.span is None:
            return None
        if self.span.strip().lower() == "all":
            return "recording"
        try:
            start, stop = (float(part) for part in self.span.split(","))
        except ValueError:
            start, stop = 0.0, 0.0
        if not 0 <= start < stop < np.inf:
            raise ValueError(
                f"--span {self.span!r}: expected start and stop in seconds, such as 5,15, or all"
            )
        return start, stop

    @property
    def plate_delay_s(self) -> float | None:
        """Delay of the plates relative to the markers [s]; None where it is not stated."""
        return None if self.plate_delay_ms is None else self.plate_delay_ms / 1000
