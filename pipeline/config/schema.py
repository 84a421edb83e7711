"""What the files of a study state, as types: settings, subjects, treadmill, conditions, trials.

The bounds of the quantities catch a value in another unit or a typing error; they are wider than
anything that is measured in a gait laboratory.
"""

from pathlib import Path
from typing import Annotated, Final, Literal, get_args

from pydantic import (
    AfterValidator,
    Field,
    field_validator,
    model_validator,
)

from hbm.calibration_pose.anatomy import MARKER_OFFSET_M
from hbm.engines.engine import EngineName
from hbm.markers import MarkerSet
from hbm.segments import Sex
from hbm.signals.filtering import Method
from hbm.spelling import printable
from pipeline.config.input_model import InputModel, Text
from pipeline.config.live import Live
from pipeline.config.window import Interval, Window
from pipeline.io.axes import parse_axes
from pipeline.io.stated import PlateUnits, Stated
from pipeline.io.units import acceleration_in_mps2, length_in_m
from pipeline.statistics.design import COMPENSATION, Correction

MAX_NAME: Final = 64
"""Characters; names of subject and condition together are part of the name of a file."""
RESERVED: Final = (
    "con",
    "prn",
    "aux",
    "nul",
    *(f"{p}{n}" for p in ("com", "lpt") for n in range(10)),
)
"""Devices of Windows: no file there may have such a name, whatever follows after a full stop."""
Labels = Annotated[tuple[Text, ...], Field(strict=False)]
Channels = Annotated[tuple[Text, Text, Text], Field(strict=False)]
"""Labels of a sensor's x, y and z channels."""


def _file_name(name: str) -> str:
    if name.partition(".")[0].lower() in RESERVED:
        raise ValueError(f"{name!r} is the name of a device on Windows; choose another")
    if name.endswith("."):
        raise ValueError(f"{name!r} ends in a full stop, which Windows leaves out; choose another")
    return name


def _axes(axes: str) -> str:
    parse_axes(axes)
    return axes


def _length_unit(unit: str) -> str:
    length_in_m(unit)
    return unit


def _plate_units(units: str) -> str:
    PlateUnits.parse(units)
    return units


Name = Annotated[
    str,
    Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=MAX_NAME),
    AfterValidator(_file_name),
]
"""Part of a file name on every operating system."""
AxesText = Annotated[str, AfterValidator(_axes)]
"""Lab directions of the files' x, y and z axis, such as "left,back,up"."""
LengthUnit = Annotated[str, AfterValidator(_length_unit)]
PlateUnitsText = Annotated[str, AfterValidator(_plate_units)]
"""Units of force and moment, such as "N,Nmm", and of centres of pressure as a third."""
DelayS = Annotated[float, Field(ge=-0.5, le=0.5)]
"""Two devices of one laboratory disagree by some tens of milliseconds."""
CoordinateM = Annotated[float, Field(ge=-2, le=2)]
"""Within a treadmill and its frame."""
PointM = Annotated[tuple[CoordinateM, CoordinateM, CoordinateM], Field(strict=False)]
MotionCutoffHz = Annotated[float, Field(ge=0.1, le=50)]
"""At most the Nyquist frequency of markers at 100 Hz."""
BeltCutoffHz = Annotated[float, Field(ge=0.1, le=45)]
"""Below the Nyquist frequency of belt speeds at 100 Hz, by the margin that the filter needs."""
CalibrationCutoffHz = Annotated[float, Field(ge=0.1, le=100)]
"""A treadmill's frame has no motion of its own worth calibrating beyond it."""
ForceThresholdN = Annotated[float, Field(gt=0, le=200)]
"""Above the noise of any plate, below the weight of any subject."""
ShareOfCycle = Annotated[float, Field(gt=0, le=1)]
MarkerOffsetM = Annotated[float, Field(ge=0, le=0.05)]
"""Markers have radii of 2 to 25 mm; the rest is their base."""
MassKg = Annotated[float, Field(ge=10, le=400)]
HeightM = Annotated[float, Field(ge=0.5, le=2.6)]
TimeS = Annotated[float, Field(ge=0)]
AgeYears = Annotated[float, Field(ge=0, le=120)]
KneeWidthM = Annotated[float, Field(ge=0.05, le=0.25)]
AnkleWidthM = Annotated[float, Field(ge=0.03, le=0.2)]
Covariate = Literal["height_m", "mass_kg", "sex", "age_years"]
COVARIATES: Final[tuple[Covariate, ...]] = get_args(Covariate)
AccelerometerRangeG = Annotated[float, Field(gt=0, le=200)]


EventMethod = Literal["file", "zeni", "plates", "auto"]
"""Where a trial's gait events come from."""


class Settings(InputModel):
    """How trials are processed; printed with every result.

    Attributes
    ----------
    cutoff_hz, filter
        Low-pass on coordinates and forces alike; 6 Hz as in the Human Body Model.
    marker_set
        A shipped marker set or a TOML file; None recognises it from the labels.
    hip
        How hip joint centres are located.
    marker_offset_m
        From the skin to a marker's centre; by default a marker of 14 mm on a base of 2 mm.
    plate_delay_s
        Delay of the plates' time stamps relative to the markers'; None for that of the plates'
        calibration, or none.
    contact_threshold_n
        Vertical force above which a foot is on a plate.
    min_valid_share
        Share of a gait cycle's frames that have to count (the plates carry the subject and the
        filters have settled); with less it is left out, with more those frames count. The same of
        a recording that is used because it has no gait cycle; with less there are no residuals.
    events
        Where gait events come from: "file", as recorded; "zeni", turns of heel and toe; "plates",
        where a plate carries one foot alone; "auto", the motion of the feet and the plates
        together. None takes the file's where it has some, else "auto".
    engine
        What computes the inverse dynamics; None for Pinocchio where it can be imported, else the
        kernels.

    Examples
    --------
    >>> Settings(cutoff_hz=8.0).filter
    'zero_phase'
    """

    cutoff_hz: MotionCutoffHz = 6.0
    filter: Method = "zero_phase"
    marker_set: Text | None = None
    hip: Literal["harrington", "bell", "functional"] = "harrington"
    marker_offset_m: MarkerOffsetM = MARKER_OFFSET_M
    plate_delay_s: DelayS | None = None
    contact_threshold_n: ForceThresholdN = 30.0
    min_valid_share: ShareOfCycle = 0.5
    events: EventMethod | None = None
    engine: EngineName | None = None


class Subject(InputModel):
    """The person who walked; a mass that is not stated is measured by the plates.

    Examples
    --------
    >>> Subject(id="sub01", sex="female", height_m=1.70).mass_kg is None
    True
    """

    id: Name = "subject"
    sex: Sex = "unspecified"
    mass_kg: MassKg | None = None
    height_m: HeightM | None = None
    age_years: AgeYears | None = None
    knee_width_m: KneeWidthM | None = None
    ankle_width_m: AnkleWidthM | None = None


class Platform(InputModel):
    """How the platform's pose is known: from markers on it, or from its commanded motion.

    Examples
    --------
    >>> Platform(sway_channel="Sway", pitch_channel="Pitch", pivot_m=(0.0, 0.0, -0.3)).channels
    ('Sway', 'Pitch')
    """

    markers: Labels = ()
    sway_channel: Text | None = None
    pitch_channel: Text | None = None
    pivot_m: PointM = (0.0, 0.0, 0.0)
    delay_s: DelayS = 0.0

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels with the commanded motion, those that are stated."""
        return tuple(filter(None, (self.sway_channel, self.pitch_channel)))


class Belt(InputModel):
    """How the plates are compensated for the belts' acceleration."""

    calibration: Text
    speed_channels: Annotated[Labels, Field(min_length=1)]
    cutoff_hz: BeltCutoffHz = 10.0


class Treadmill(InputModel):
    """The machine: its accelerometers, its calibration, its belts, its platform.

    ``beside`` are recordings of people beside an empty plate, fitted together with a calibration
    that is a recording. ``check`` is an empty recording of another day, with which the calibration
    is compared. Without ``accelerometer_delay_s`` the calibration estimates the accelerometers'
    delays. Without ``inertia_model`` = "static" or "dynamic" it chooses the better one
    (docs/calibration.md).

    Examples
    --------
    >>> sensors = {"rear_left": ("Acc1.X", "Acc1.Y", "Acc1.Z")}
    >>> Treadmill(calibration="empty.c3d", accelerometers=sensors).accelerometer_range_g
    2.0
    """

    calibration: Text | None = None
    beside: Labels = ()
    check: Text | None = None
    accelerometers: dict[Name, Channels] = Field(default_factory=dict)
    accelerometer_unit: Text | None = None
    accelerometer_delay_s: DelayS | None = None
    accelerometer_range_g: AccelerometerRangeG = 2.0
    cutoff_hz: CalibrationCutoffHz = 20.0
    inertia_model: Literal["auto", "static", "dynamic"] = "auto"
    belt: Belt | None = None
    platform: Platform | None = None

    @property
    def files(self) -> dict[str, str]:
        """Names of the files that are stated, by the key that states them."""
        stated = {
            "calibration": self.calibration,
            "check": self.check,
            "belt.calibration": self.belt.calibration if self.belt is not None else None,
        }
        stated |= {f"beside[{number}]": name for number, name in enumerate(self.beside)}
        return {key: name for key, name in stated.items() if name}

    @property
    def calibrated(self) -> bool:
        """Whether trials are processed with compensation too."""
        return self.calibration is not None or self.belt is not None

    @field_validator("accelerometers")
    @classmethod
    def _different(cls, sensors: dict[str, Channels]) -> dict[str, Channels]:
        channels = [channel for of_sensor in sensors.values() for channel in of_sensor]
        if repeated := sorted({c for c in channels if channels.count(c) > 1}):
            raise ValueError(
                f"each channel belongs to one axis of one sensor, but {', '.join(repeated)} is "
                "named more than once"
            )
        return sensors

    @field_validator("accelerometer_unit")
    @classmethod
    def _known_unit(cls, unit: str | None) -> str | None:
        if unit is not None:
            acceleration_in_mps2(unit)
        return unit

    @model_validator(mode="after")
    def _complete(self) -> "Treadmill":
        if self.calibration and Path(self.calibration).suffix.lower() not in (".c3d", ".json"):
            raise ValueError(f"calibration must be a .c3d or .json file, got {self.calibration!r}")
        if self.calibration and not self.accelerometers:
            raise ValueError(
                "accelerometers: is missing; a calibration has no effect without; name the three "
                "channels of each sensor, as in the example of 'hbm init'"
            )
        if self.beside and Path(self.calibration or "").suffix.lower() != ".c3d":
            raise ValueError(
                "beside: is fitted together with a calibration that is a recording (.c3d); a "
                "fitted one (.json) holds it if 'hbm calibration fit' was given --beside"
            )
        if self.check and not self.calibration:
            raise ValueError("check: has no effect without a calibration to check")
        return self


class Plates(InputModel):
    """The force plates: the calibration that 'hbm plates' found with known weights."""

    calibration: Text | None = None

    @field_validator("calibration")
    @classmethod
    def _json(cls, name: str | None) -> str | None:
        if name is not None and Path(name).suffix.lower() != ".json":
            raise ValueError(f"must be a .json file, as 'hbm plates' writes it, got {name!r}")
        return name


class Condition(InputModel):
    """What of a condition is analysed: gait cycles, a part of them, or a span of the recording.

    Attributes
    ----------
    window
        "cycle": gait cycles; "recording": all of it, for standing; or a span [start_s, stop_s].
        Where it is not stated: gait cycles or, where a trial has none, its whole recording. Of
        perturbed gait cycles also a part: "motion", from each onset for as long as the platform
        moves fast; [start_s, stop_s] from each onset; or ["10 %", "40 %"] of each cycle.
    cycles
        How many gait cycles; None for all.
    perturbed, pulse_channel
        Whether only cycles that contain a perturbation count, and the channel that rises with it.
    skip_s
        Left out at the start.

    Examples
    --------
    >>> Condition(cycles=50, skip_s=10.0).perturbed
    False
    >>> Condition(window=(5.0, 15.0)).wanted
    (5.0, 15.0)
    >>> print(Condition(perturbed=True, window=("10 %", "40 %")).part)
    10 to 40 %
    """

    window: Window | None = None
    cycles: Annotated[int, Field(ge=1)] | None = None
    perturbed: bool = False
    pulse_channel: Text | None = None
    skip_s: Annotated[float, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _used(self) -> "Condition":
        if self.pulse_channel is not None and not self.perturbed:
            raise ValueError("pulse_channel has no effect without perturbed = true")
        in_seconds = isinstance(self.window, Interval) and self.window.unit == "s"
        if not (self.perturbed or in_seconds or self.window in (None, "cycle", "recording")):
            raise ValueError(
                f'window "{self.window}" is a part of perturbed gait cycles; state perturbed = '
                "true, or another window"
            )
        if self.window not in (None, "cycle", self.part) and self._selects_cycles:
            raise ValueError(
                "cycles, perturbed and skip_s select gait cycles, which this window replaces; "
                "leave them or the window out"
            )
        return self

    @property
    def wanted(self) -> Literal["cycle", "recording"] | tuple[float, float] | None:
        """The window; gait cycles where certain ones are asked for, which nothing can replace."""
        if self.part or (self.window is None and self._selects_cycles):
            return "cycle"
        if isinstance(self.window, Interval):
            return self.window.start, self.window.stop
        return "recording" if self.window == "recording" else self.window and "cycle"

    @property
    def part(self) -> Literal["motion"] | Interval | None:
        """The part of each perturbed gait cycle that counts; None for all of it."""
        if self.perturbed and (self.window == "motion" or isinstance(self.window, Interval)):
            return self.window
        return None

    @property
    def _selects_cycles(self) -> bool:
        return self.cycles is not None or self.perturbed or self.skip_s > 0


class Comparison(InputModel):
    """Which conditions are compared, and how; what is not stated is as in experiment 3.

    Attributes
    ----------
    factor
        What the conditions are levels of, as tables name it.
    levels
        The conditions to compare, in order; None for those of experiment 3 if the study has them,
        else for all.
    reference
        The level that the others are compared with; None for the first.
    pairs
        Planned pairs of cells, such as "sway IC - baseline no IC"; None for those of experiment 3.
    correction
        Of the p-values for the number of planned pairs.
    covariates
        Of one further analysis of variance; None for sex and stature.
    margin
        Share of the reference residual by which a residual may exceed it and still be at its
        level.
    group
        Key of the subjects' files that tells apart groups of subjects.

    Examples
    --------
    >>> Comparison(levels=("barefoot", "boots"), reference="barefoot").margin
    0.2
    """

    factor: Name = "condition"
    levels: Annotated[Labels, Field(min_length=2)] | None = None
    reference: Text | None = None
    pairs: Labels | None = None
    correction: Correction = "bonferroni"
    covariates: Annotated[tuple[Covariate, ...], Field(strict=False)] | None = None
    margin: Annotated[float, Field(gt=0, le=1)] = 0.2
    group: Literal["group", "sex"] | None = None

    @model_validator(mode="after")
    def _once(self) -> "Comparison":
        for key in ("levels", "pairs", "covariates"):
            stated = getattr(self, key) or ()
            if repeated := sorted({name for name in stated if stated.count(name) > 1}):
                raise ValueError(f"{key}: {', '.join(repeated)} is stated more than once")
        if self.factor in (COMPENSATION, "group", *COVARIATES):
            raise ValueError(f"factor: {self.factor} is the name of another factor; choose another")
        if self.group is not None and self.group in (self.covariates or ()):
            raise ValueError(f"covariates: {self.group} tells the groups apart already")
        return self


class PlateContact(InputModel):
    """Whose foot was on a plate, where the centre of pressure cannot tell.

    Attributes
    ----------
    plate
        Number of the plate in the file, from 1.
    time_s
        Any instant of the contact, from the recording's first frame.
    foot
        "left" or "right".
    """

    plate: Annotated[int, Field(ge=1, le=99)]
    time_s: TimeS
    foot: Literal["left", "right"]


class Trial(InputModel):
    """One recording with the files that belong to it, or the reason why there is none."""

    file: Text | None = None
    forces: Text | None = None
    record: Text | None = None
    contacts: Annotated[tuple[PlateContact, ...], Field(strict=False)] = ()
    exclude: Text | None = None

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the trial's files, those that are stated."""
        return tuple(filter(None, (self.file, self.forces, self.record)))


class RecordingRules(InputModel):
    """How recordings are to be read, where their files do not say it themselves, or wrongly.

    Attributes
    ----------
    axes
        Lab directions of the files' axes; None infers them.
    rename
        Label in the files, without the prefix of a subject -> label wanted.
    label_prefix
        Prefix of the subject wanted, or its number, where several carry the same labels.
    marker_stream
        Name of the stream that holds the markers, where several of an XDF file do.
    units
        Unit of the markers' positions.
    plate_units
        Units of the plates' channels.

    Examples
    --------
    >>> RecordingRules(units="mm", plate_units="N,Nmm").stated().plate_units
    'N,Nmm'
    """

    axes: AxesText | None = None
    rename: dict[Text, Text] = Field(default_factory=dict)
    label_prefix: Text | None = None
    marker_stream: Text | None = None
    units: LengthUnit | None = None
    plate_units: PlateUnitsText | None = None

    def stated(self, marker_set: MarkerSet | None = None) -> Stated:
        """Give what is stated to those who read files, with the set that the markers are of."""
        return Stated(
            axes=self.axes,
            rename=self.rename,
            label_prefix=self.label_prefix,
            marker_stream=self.marker_stream,
            units=self.units,
            plate_units=self.plate_units,
            marker_set=marker_set,
        )


class StudyFile(RecordingRules):
    """The contents of ``study.toml``."""

    name: Annotated[str, AfterValidator(printable)] = "study"
    settings: Settings = Settings()
    plates: Plates = Plates()
    treadmill: Treadmill = Treadmill()
    live: Live = Live()
    comparison: Comparison | None = None
    conditions: Annotated[dict[Name, Condition], Field(min_length=1)]


class SubjectFile(Subject):
    """The contents of a subject's file."""

    id: Name
    group: Text | None = None
    static: Text | None = None
    hip_trial: Text | None = None
    segments: Text | None = None
    trials: dict[str, Trial]

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files about the subject's body, those that are stated."""
        return tuple(filter(None, (self.static, self.hip_trial, self.segments)))

    @property
    def person(self) -> Subject:
        """The subject alone, without files."""
        return Subject.model_validate({name: getattr(self, name) for name in Subject.model_fields})
