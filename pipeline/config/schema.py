"""What the files of a study state, as types: settings, subjects, treadmill, conditions, trials."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple, Self, get_args

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from hbm.calibration_pose.anatomy import MARKER_OFFSET_M
from hbm.markers import MarkerSet
from hbm.segments import Sex
from hbm.spelling import printable, shown
from pipeline.config.input_model import (
    AccelerationUnit,
    AxesText,
    Channels,
    DelayS,
    FilterCutoffHz,
    InputModel,
    Labels,
    LengthUnit,
    Mendings,
    Name,
    PlateUnitsText,
    PointM,
    Text,
)
from pipeline.config.live import Live
from pipeline.config.toml_file import ConditionName, FileName, RecordingName, SegmentsName
from pipeline.io.read_options import ReadOptions

Covariate = Literal["height_m", "mass_kg", "sex", "age_years"]
COVARIATES: Final[tuple[Covariate, ...]] = get_args(Covariate)
MAIN: Final = "main"
"""Name of the study's own way of processing among its variants."""
FigureFormat = Literal["pdf", "svg", "png", "tiff"]
FIGURE_FORMATS: Final[tuple[FigureFormat, ...]] = get_args(FigureFormat)
EventMethod = Literal["file", "zeni", "plates", "auto"]
"""Where a trial's gait events come from."""


class Settings(InputModel):
    """How trials are processed; printed with every result.

    Examples
    --------
    >>> Settings(cutoff_hz=8.0).filter
    'zero_phase'
    """

    marker_set: Text | None = Field(default=None, examples=["hbm2"])
    """Marker set: hbm2, pig, rajagopal, … (docs/marker_sets.md), or a TOML file; default:
    recognised from the labels."""
    cutoff_hz: Annotated[float, Field(ge=0.1, le=50)] = 6.0
    """Cut-off of the Butterworth low-pass on coordinates and forces alike."""
    filter: Literal["realtime", "zero_phase"] = "zero_phase"
    """zero_phase, or realtime: causal, as in the Human Body Model."""
    hip: Literal["harrington", "bell", "functional"] = "harrington"
    """Hip joint centres: harrington (2007), bell (1990) or functional."""
    marker_offset_m: Annotated[float, Field(ge=0, le=0.05)] = MARKER_OFFSET_M
    """Distance from the skin to a marker's centre."""
    plate_delay_s: DelayS | None = Field(default=None, examples=[0.0])
    """Delay of the plates relative to the markers; default: their calibration's, or none."""
    contact_threshold_n: Annotated[float, Field(gt=0, le=200)] = 30.0
    """Vertical force above which a foot is on a plate."""
    min_valid_share: Annotated[float, Field(gt=0, le=1)] = 0.5
    """Smallest share of used frames in a gait cycle, or in a recording without one."""
    events: EventMethod | None = Field(default=None, examples=["auto"])
    """Gait events: file, zeni, plates or auto; default: the file's if the feet agree, else auto."""


class Subject(InputModel):
    """The person who walked; a mass that is not stated is measured by the plates.

    Examples
    --------
    >>> Subject(id="sub01", sex="female", height_m=1.70).mass_kg is None
    True
    """

    id: Name = "subject"
    """Name of the subject, part of file names."""
    sex: Sex = "unspecified"
    """male, female or unspecified."""
    mass_kg: Annotated[float, Field(ge=10, le=400)] | None = Field(default=None, examples=[65.0])
    """Body mass with shoes, as plates carry it; default: measured by them, else the file's."""
    height_m: Annotated[float, Field(ge=0.5, le=2.6)] | None = Field(default=None, examples=[1.70])
    """Stature; default: the file's, or estimated from the legs."""
    age_years: Annotated[float, Field(ge=0, le=120)] | None = Field(default=None, examples=[26.0])
    """Age; a covariate."""
    knee_width_m: Annotated[float, Field(ge=0.05, le=0.25)] | None = Field(
        default=None, examples=[0.105]
    )
    """Knee width, without medial markers; default: the file's, or estimated."""
    ankle_width_m: Annotated[float, Field(ge=0.03, le=0.2)] | None = Field(
        default=None, examples=[0.072]
    )
    """Ankle width, without medial markers; default: the file's, or estimated."""
    shoe_mass_kg: Annotated[float, Field(ge=0, le=3)] | None = Field(default=None, examples=[0.3])
    """Mass of one shoe, 0 for bare feet; default: unknown, and not in the body model."""
    sole_height_m: Annotated[float, Field(ge=0, le=0.15)] = Field(default=0.0, examples=[0.025])
    """Thickness of the shoe's sole."""

    @model_validator(mode="after")
    def _shod(self) -> Self:
        if self.sole_height_m and not self.shoe_mass_kg:
            raise ValueError("sole_height_m: has no effect without shoe_mass_kg; weigh one shoe")
        return self


class RecordingRules(InputModel):
    """How recordings are to be read, where their files do not say it themselves, or wrongly.

    Examples
    --------
    >>> RecordingRules(units="mm", plate_units="N,Nmm").options().plate_units
    'N,Nmm'
    """

    axes: AxesText | None = Field(default=None, examples=["left,back,up"])
    """Where the files' x, y, z point, e.g. left,back,up; default: inferred."""
    units: LengthUnit | None = Field(default=None, examples=["mm"])
    """Unit of the markers, e.g. mm; default: the files'."""
    plate_units: PlateUnitsText | None = Field(default=None, examples=["N,Nmm"])
    """Units of the plates' forces, moments and, where given, centres of pressure, e.g. N,Nmm or
    N,Nmm,mm; default: the files'."""
    mend_plates: Mendings = Field(default=(), examples=[["2: turn 90"]])
    """Mend a plate: '3: reverse Fx', '2: turn 90', '1: exchange 2', '2: unwrap Mz'; '1: gain Fz
    0.97' (a factor), '1: zero Fx 2.5' (subtracted), '1: drift' (its zero is followed), '1: move x
    -0.008' (metres, along an axis of the plate); repeatable."""
    label_prefix: Text | None = Field(default=None, examples=["S01"])
    """Label prefix of the subject, or its number, where several carry the same labels."""
    marker_stream: Text | None = Field(default=None, examples=["Cameras"])
    """Stream that holds the markers, where several of an XDF file do."""
    rename: dict[Text, Text] = Field(default_factory=dict, examples=[{"LASI": "LASIS"}])
    """Label in the files, without prefix, and the label wanted."""

    def options(self, marker_set: MarkerSet | None = None) -> ReadOptions:
        """Give what is stated to those who read files, with the set that the markers are of."""
        rules = {name: getattr(self, name) for name in RecordingRules.model_fields}
        return ReadOptions(**rules, marker_set=marker_set)


class Platform(InputModel):
    """How the platform's pose is known: from markers on it, or from its commanded motion.

    Sway to the left and pitch with the front going down are positive. Leave it out for a treadmill
    that does not move.

    Examples
    --------
    >>> Platform(sway_channel="Sway", pitch_channel="Pitch", pivot_m=(0.0, 0.0, -0.3)).channels
    ('Sway', 'Pitch')
    """

    markers: Labels = Field(default=(), examples=[["PLAT1", "PLAT2", "PLAT3", "PLAT4"]])
    """Three markers or more on the platform."""
    sway_channel: Text | None = Field(default=None, examples=["Sway"])
    """Channel of the commanded sway, in place of markers and less exact."""
    pitch_channel: Text | None = Field(default=None, examples=["Pitch"])
    """Channel of the commanded pitch."""
    pivot_m: PointM = (0.0, 0.0, 0.0)
    """A point on the pitch axis, in the lab; for channels."""
    delay_s: DelayS = 0.0
    """Delay of the channels relative to the motion; negative where the platform lags behind its
    command."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels with the commanded motion, those that are stated."""
        return tuple(filter(None, (self.sway_channel, self.pitch_channel)))


class Belt(InputModel):
    """How the plates are compensated for the belts' acceleration, before sway and pitch."""

    calibration: FileName = Field(examples=["belts.c3d"])
    """The empty treadmill, belts accelerating at random."""
    speed_channels: Annotated[Labels, Field(min_length=1)] = Field(
        examples=[["Belt.Left", "Belt.Right"]]
    )
    """Channel of belt speed for each plate, or one for all."""
    cutoff_hz: Annotated[float, Field(ge=0.1, le=45)] = 10.0
    """Low-pass on belt acceleration and pitch moment."""


SENSORS: Final = {
    s: [f"Acc{k}.{a}" for a in "XYZ"] for k, s in ((1, "rear_left"), (2, "front_right"))
}
"""An example."""


class CalibrationFit(InputModel):
    """How a calibration of the moving treadmill is fitted."""

    accelerometer_unit: AccelerationUnit | None = Field(default=None, examples=["g"])
    """g or m/s²; default: as the file says."""
    inertia_model: Literal["auto", "static", "dynamic"] = "auto"
    """static, dynamic, or auto: dynamic where clearly and safely better."""
    cutoff_hz: FilterCutoffHz = 20.0
    """Low-pass of the calibration, and of plates and accelerometers in trials; well above that of
    the settings."""


class Treadmill(CalibrationFit):
    """The machine: its accelerometers, its calibration, its belts, its platform.

    Examples
    --------
    >>> sensors = {"rear_left": ("Acc1.X", "Acc1.Y", "Acc1.Z")}
    >>> Treadmill(calibration="empty.c3d", accelerometers=sensors).accelerometer_range_g
    2.0
    """

    calibration: FileName | None = Field(default=None, examples=["calibration.c3d"])
    """Recording of the empty, moving treadmill (.c3d), or a calibration fitted to one (.json)."""
    beside: Annotated[tuple[FileName, ...], Field(strict=False)] = Field(
        default=(), examples=[["walking_right.c3d", "walking_left.c3d", "boards.c3d"]]
    )
    """Recordings of people beside an empty plate, fitted with the calibration recording."""
    check: FileName | None = Field(default=None, examples=["empty_day2.c3d"])
    """The empty treadmill on another day: is the calibration still valid?."""
    accelerometer_range_g: Annotated[float, Field(gt=0, le=200)] = 2.0
    """Largest acceleration that the accelerometers can measure."""
    accelerometer_delay_s: DelayS | None = Field(default=None, examples=[0.0])
    """Delay of the accelerometers relative to the plates; default: estimated from the calibration
    recording."""
    accelerometers: dict[Name, Channels] = Field(default_factory=dict, examples=[SENSORS])
    """Sensor and its x, y and z channels."""
    belt: Belt | None = None
    platform: Platform | None = None

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files that are stated."""
        of_belt = self.belt.calibration if self.belt is not None else None
        return tuple(filter(None, (self.calibration, self.check, of_belt, *self.beside)))

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

    @model_validator(mode="after")
    def _complete(self) -> "Treadmill":
        if self.calibration and Path(self.calibration).suffix.lower() not in (".c3d", ".json"):
            raise ValueError(f"calibration must be a .c3d or .json file, got {self.calibration!r}")
        if self.calibration and not self.accelerometers:
            raise ValueError(
                "accelerometers: is missing; a calibration has no effect without; name the three "
                "channels of each sensor, as 'hbm init NEW_FOLDER --all' shows"
            )
        if self.beside and Path(self.calibration or "").suffix.lower() != ".c3d":
            raise ValueError(
                "beside: is fitted together with a calibration that is a recording (.c3d); a "
                "fitted one (.json) holds it if 'hbm calibration fit' was given --beside"
            )
        if self.check and not self.calibration:
            raise ValueError("check: has no effect without a calibration to check")
        if self.check and self.check == self.calibration:
            raise ValueError(
                "check: is the recording that the calibration is fitted to; give one of another day"
            )
        return self


class Plates(InputModel):
    """The force plates."""

    calibration: FileName | None = Field(default=None, examples=["plate_calibration.json"])
    """What 'hbm plates' found with known weights: a 6x6 matrix, an offset and a delay of each
    plate."""

    @field_validator("calibration")
    @classmethod
    def _json(cls, name: str | None) -> str | None:
        if name is not None and Path(name).suffix.lower() != ".json":
            raise ValueError(f"must be a .json file, as 'hbm plates' writes it, got {name!r}")
        return name


MAX_STOP: Final = 1e6
"""Seconds; no recording is longer."""


@dataclass(frozen=True, slots=True)
class Interval:
    """Start and stop of what counts.

    In seconds from the recording's first frame or, in a perturbed condition, from the onset of each
    perturbation; or in percent of the perturbed gait cycle.

    Examples
    --------
    >>> print(Interval(10.0, 40.0, "%"))
    10 to 40 %
    """

    start: float
    stop: float
    unit: Literal["s", "%"]

    def __str__(self) -> str:
        return f"{self.start:g} to {self.stop:g} {self.unit}"


Unit = Literal["cycle", "step", "stance"]
"""What a trial is cut into: from a foot's strike to its next strike, to the other foot's, or to its
own foot off."""
NOUNS: Final[dict[Unit, str]] = {"cycle": "gait cycle", "step": "step", "stance": "stance"}
WindowName = Literal["cycle", "step", "stance", "motion", "recording"]


def _window(value: object) -> object:
    if isinstance(value, Interval) or value in get_args(WindowName):
        return value
    bounds = value if isinstance(value, list | tuple) and len(value) == 2 else ()
    percent = re.compile(r"\s*(-?\d+(?:\.\d+)?)\s*%\s*", re.ASCII)
    percents = [percent.fullmatch(bound) for bound in bounds if isinstance(bound, str)]
    numbers = [float(match[1]) for match in percents if match]
    numbers += [b for b in bounds if isinstance(b, int | float) and not isinstance(b, bool)]
    if len(numbers) != 2 or len(percents) == 1:
        raise ValueError(
            'must be "cycle", "step", "stance", "motion", "recording", [start_s, stop_s] or '
            f'["10 %", "40 %"], got {shown(value)}'
        )
    unit: Literal["s", "%"] = "%" if percents else "s"
    start, stop = numbers
    if start < 0:
        raise ValueError(f"must not begin before zero, got {shown(value)}")
    if not start < stop <= MAX_STOP:
        raise ValueError(f"must be [start, stop] with start < stop, got {shown(value)}")
    if unit == "%" and stop > 100:
        raise ValueError(f"ends beyond 100 % of the gait cycle, got {shown(value)}")
    return Interval(float(start), float(stop), unit)


Window = Annotated[WindowName | Interval, BeforeValidator(_window)]
"""Gait cycles, steps, stances, the part of gait cycles while the platform moves, all of the
recording, or an interval."""
WantedWindow = Unit | Literal["recording"] | tuple[float, float] | None
"""What is to count; None for gait cycles or, where there is none, steps, stances or all."""


class Condition(InputModel):
    """What of a condition is analysed: gait cycles, a part of them, or a span of the recording.

    Examples
    --------
    >>> Condition(cycles=50, skip_s=10.0).perturbed
    False
    >>> Condition(window=(5.0, 15.0)).wanted
    (5.0, 15.0)
    >>> print(Condition(perturbed=True, window=("10 %", "40 %")).part)
    10 to 40 %
    """

    cycles: Annotated[int, Field(ge=1, le=1_000_000)] | None = Field(default=None, examples=[20])
    """How many gait cycles are analysed; default: all."""
    skip_s: Annotated[float, Field(ge=0, le=MAX_STOP)] = 0.0
    """Time left out at the start."""
    perturbed: bool = Field(default=False, examples=[True])
    """Only gait cycles that contain a perturbation."""
    pulse_channel: Text | None = Field(default=None, examples=["Perturbation"])
    """Channel that rises at each onset; default: the platform's motion."""
    window: Window | None = Field(default=None, examples=["motion"])
    """What is used: "cycle"; "step", to the other foot's strike; "stance"; "recording"; or a span
    [start_s, stop_s]. Of perturbed gait cycles: "motion", while the platform moves fast; [start_s,
    stop_s] from each onset; or ["10 %", "40 %"] of each. Default: gait cycles; where none is
    complete steps, stances, or the whole recording."""

    @model_validator(mode="after")
    def _used(self) -> "Condition":
        if self.pulse_channel is not None and not self.perturbed:
            raise ValueError("pulse_channel has no effect without perturbed = true")
        in_seconds = isinstance(self.window, Interval) and self.window.unit == "s"
        part = self.window == "motion" or (isinstance(self.window, Interval) and not in_seconds)
        if part and not self.perturbed:
            raise ValueError(
                f'window "{self.window}" is a part of perturbed gait cycles; set perturbed = '
                "true, or another window"
            )
        if self.window not in (None, "cycle", self.part) and self._selects_cycles:
            raise ValueError(
                "cycles, perturbed and skip_s select gait cycles, which this window replaces; "
                "leave them or the window out"
            )
        return self

    @property
    def wanted(self) -> WantedWindow:
        """The window; gait cycles where certain ones are asked for, which nothing can replace."""
        if self.part or (self.window is None and self._selects_cycles):
            return "cycle"
        if isinstance(self.window, Interval):
            return self.window.start, self.window.stop
        return None if self.window == "motion" else self.window

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
    """Which conditions the report compares, and how.

    Without it: baseline, sway and pitch where they are stated, or else all conditions in their
    order, the first as reference. Compensation is a second factor where there is a calibration, in
    the pairs as 'IC' and 'no IC'; without, pairs are such as "sway - baseline".

    Examples
    --------
    >>> Comparison(levels=("barefoot", "boots"), reference="barefoot").margin
    0.2
    """

    factor: Name = "condition"
    """What the conditions are levels of, as tables name it."""
    levels: Annotated[Labels, Field(min_length=2)] | None = Field(
        None, examples=[["baseline", "sway", "pitch"]]
    )
    """Conditions to compare, in order."""
    reference: Text | None = Field(default=None, examples=["baseline"])
    """Level that the others are compared with; default: the first."""
    pairs: Labels | None = Field(
        None, examples=[["sway IC - sway no IC", "pitch IC - pitch no IC", "pitch IC - sway IC"]]
    )
    """Planned pairs of cells."""
    correction: Literal["bonferroni", "holm"] = "bonferroni"
    """Of their p-values for the number of pairs: bonferroni or holm."""
    covariates: Annotated[tuple[Covariate, ...], Field(strict=False)] | None = Field(
        None, examples=[["sex", "height_m"]]
    )
    """Any of height_m, mass_kg, sex, age_years; default: sex and stature."""
    margin: Annotated[float, Field(gt=0, le=1)] = 0.2
    """Share of the reference residual by which a residual may exceed it and still be at its
    level."""
    weigh: Literal["cycle", "recording"] = "cycle"
    """What is equal in a subject's value over several recordings: each gait cycle or each
    recording."""
    group: Literal["group", "sex"] | None = Field(default=None, examples=["group"])
    """Key of the subjects' files that tells groups apart: group or sex."""

    @model_validator(mode="after")
    def _once(self) -> "Comparison":
        for key in ("levels", "pairs", "covariates"):
            names = getattr(self, key) or ()
            if repeated := sorted({name for name in names if names.count(name) > 1}):
                raise ValueError(f"{key}: {', '.join(repeated)} is given more than once")
        if self.factor in ("IC", "group", *COVARIATES):
            raise ValueError(f"factor: {self.factor} is the name of another factor; choose another")
        if self.group is not None and self.group in (self.covariates or ()):
            raise ValueError(f"covariates: {self.group} is the grouping already")
        return self


class Figures(InputModel):
    """How the figures of the report are written, such as for a journal.

    Examples
    --------
    >>> Figures(width_mm=85.0).of_one_column
    True
    """

    formats: Annotated[tuple[FigureFormat, ...], Field(strict=False)] = ("png", "svg")
    """Files of each figure: pdf, svg, png, tiff."""
    width_mm: Annotated[float, Field(ge=80, le=300)] | None = Field(default=None, examples=[85.0])
    """One column of a journal is about 85, two are 180; default: a page on the screen."""
    font_pt: Annotated[float, Field(ge=5, le=14)] | None = Field(default=None, examples=[8.0])
    """Size of the letters; default: 7 in one column, 8 in two, else 9."""
    dpi: Annotated[int, Field(ge=300, le=1200)] | None = Field(default=None, examples=[600])
    """Resolution of PNG and TIFF; default: 300, or 150 if nothing is stated of figures."""
    decimals: Literal["point", "comma"] = "point"
    """Sign before decimals: point or comma."""

    @property
    def of_one_column(self) -> bool:
        """Whether panels have to stand below each other."""
        # columns of journals are 80 to 95 mm wide, two of them 165 mm or more
        return self.width_mm is not None and self.width_mm < 120.0


class PlateContact(InputModel):
    """Whose foot was on a plate, where the centre of pressure cannot tell."""

    plate: Annotated[int, Field(ge=1, le=99)] = Field(examples=[1])
    """Number of the plate in the file, from 1."""
    time_s: Annotated[float, Field(ge=0, le=MAX_STOP)] = Field(examples=[3.2])
    """Any instant of the contact, from the first frame."""
    foot: Literal["left", "right"] = Field(examples=["left"])
    """left or right."""


class TrialName(NamedTuple):
    """Which trial of a study.

    Attributes
    ----------
    subject, condition
        Whose, and under which condition.
    recording
        "01", "02", … where the subject has several recordings of the condition; else empty.

    Examples
    --------
    >>> name = TrialName("sub03", "sway", "02")
    >>> str(name), name.stem
    ('sub03 sway 02', 'sub03_sway_02')
    """

    subject: str
    condition: str
    recording: str = ""

    def __str__(self) -> str:
        return " ".join(filter(None, self))

    @property
    def stem(self) -> str:
        """Name of the trial's files, without their ending."""
        return "_".join(filter(None, self))


class Trial(InputModel):
    """One recording with the files that belong to it, or the reason why there is none.

    Where a subject has several recordings of a condition, state their ``files`` as a list, or a
    table each, [[trials.CONDITION]].
    """

    exclude: Text | None = None
    """Why the trial cannot be used; it stays in the table with this reason."""
    file: RecordingName | None = None
    """The recording."""
    forces: RecordingName | None = Field(default=None, examples=["sub01_baseline.mot"])
    """Ground reaction forces (.mot, .forces) of a .trc file."""
    record: RecordingName | None = Field(default=None, examples=["sub01_record.txt"])
    """Record module's file of D-Flow's mocap text."""
    session: Name | None = Field(default=None, examples=["day2"])
    """When it was recorded, where subjects came more than once."""
    window: Window | None = Field(default=None, examples=[[2.0, 30.0]])
    """Part of this recording that is used; default: that of the condition."""
    mend_plates: Mendings = Field(default=(), examples=[["1: zero Fx 2.5"]])
    """Mend a plate in this recording, after what the study states."""
    rename: dict[Text, Text] = Field(default_factory=dict, examples=[{"LKNE": "RKNE"}])
    """Label in this recording, and the label wanted, before what the study states."""
    contacts: Annotated[tuple[PlateContact, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _usable(self, info: ValidationInfo) -> "Trial":
        if info.context is not None and self.file is None and self.exclude is None:
            raise ValueError('needs a file, or exclude = "the reason why there is none"')
        return self

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the trial's files, those that are stated."""
        return tuple(filter(None, (self.file, self.forces, self.record)))


def recording_tables(value: object) -> tuple[Any, ...]:
    """Give the tables of a condition's recordings, stated as one table, as files or as tables."""
    if isinstance(value, list | tuple) and value:
        return tuple(value)
    if not isinstance(value, dict):
        raise ValueError(f"must be a table with a file, or a list of such, got {shown(value)}")
    if "files" not in value:
        return (value,)
    files, others = value["files"], {k: v for k, v in value.items() if k != "files"}
    if not isinstance(files, list) or not files:
        raise ValueError(f"files: must be a list of recordings, got {shown(files)}")
    of_one = [key for key in others if key not in ("session", "window")]
    if of_one:
        raise ValueError(
            f"{of_one[0]}: belongs to one recording; write a table for each, [[trials.CONDITION]]"
        )
    return tuple({"file": file, **others} for file in files)


Recordings = Annotated[tuple[Trial, ...], BeforeValidator(recording_tables)]
"""A subject's recordings of one condition."""


class Correction(InputModel):
    """What 'hbm explain --apply' corrected in this study, and why; the setting itself does it."""

    setting: Text
    """As it is stated."""
    cause: Text
    """What was found, with its 95 % interval."""
    trials: int
    """How many trials share it."""
    residual: Text
    """The one that it lowers most."""
    before: float
    """Its RMS over these trials."""
    after: float
    """Its RMS if only this is corrected, as explained."""
    held_out_percent: float
    """Of its mean square in trials or gait cycles in which the size was not found."""
    source: Text
    """Results that were explained."""


class StudyFile(RecordingRules):
    """The contents of ``study.toml``."""

    name: Annotated[str, AfterValidator(printable)] = "study"
    """Name of the study, in the report."""
    settings: Settings = Settings()
    plates: Plates = Plates()
    treadmill: Treadmill = Treadmill()
    live: Live = Live()
    conditions: Annotated[dict[Name, Condition], Field(min_length=1)]
    variants: dict[Name, dict[str, Any]] = Field(
        default_factory=dict, examples=[{"cutoff_10": {"cutoff_hz": 10.0}}]
    )
    """Other ways of processing: name, and the settings that differ; also treadmill.KEY and
    plates.KEY. Each is processed too, and the report says whether the conclusion depends on it."""
    comparison: Comparison | None = None
    figures: Figures = Figures()
    corrections: Annotated[tuple[Correction, ...], Field(strict=False, exclude=True)] = ()


class SubjectFile(Subject):
    """The contents of a subject's file."""

    id: Name
    """Name of the subject, part of file names."""
    group: Text | None = Field(default=None, examples=["before surgery"])
    """Group of the subject, where [comparison] in study.toml compares groups."""
    static: RecordingName | None = Field(default=None, examples=["sub01_static.c3d"])
    """Calibration pose; default: the quietest second of each trial."""
    hip_trial: RecordingName | None = Field(default=None, examples=["sub01_star.c3d"])
    """Recording in which both thighs swing, for settings.hip = "functional" in study.toml."""
    segments: SegmentsName | None = Field(default=None, examples=["sub01_segments.toml"])
    """TOML with known segment inertias: prostheses, braces, scans."""
    trials: dict[ConditionName, Recordings]

    @model_validator(mode="after")
    def _hips(self, info: ValidationInfo) -> "SubjectFile":
        hips = () if info.context is None else info.context.hips
        if "functional" in hips and self.hip_trial is None:
            raise ValueError(
                'hip_trial: is missing; settings.hip = "functional" in study.toml needs a '
                "recording in which both thighs swing"
            )
        if hips and "functional" not in hips and self.hip_trial is not None:
            raise ValueError('hip_trial: has no effect unless settings.hip = "functional"')
        return self

    @property
    def named_trials(self) -> dict[TrialName, Trial]:
        """All trials by name, also excluded ones; several recordings are numbered."""
        return {
            TrialName(self.id, condition, f"{number:02d}" if len(recordings) > 1 else ""): trial
            for condition, recordings in self.trials.items()
            for number, trial in enumerate(recordings, start=1)
        }

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files about the subject's body, those that are stated."""
        return tuple(filter(None, (self.static, self.hip_trial, self.segments)))

    @property
    def person(self) -> Subject:
        """The subject alone, without files."""
        return Subject.model_validate({name: getattr(self, name) for name in Subject.model_fields})
