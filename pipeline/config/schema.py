"""What people state about a study, as types: settings, subjects, treadmill, conditions, trials."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from hbm.segments import Sex
from hbm.signals.filtering import Method
from pipeline.io.axes import parse_axes
from pipeline.io.units import acceleration_in_mps2

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]
Text = Annotated[str, Field(min_length=1)]
Delay = Annotated[float, Field(ge=-0.5, le=0.5)]
Coordinate = Annotated[float, Field(ge=-2, le=2)]
Point = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]
Labels = Annotated[tuple[Text, ...], Field(strict=False)]
Channels = Annotated[tuple[Text, Text, Text], Field(strict=False)]


class Stated(BaseModel):
    """Base of everything a person types: immutable, unknown keys and other types are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Settings(Stated):
    """How trials are processed; printed with every result."""

    cutoff_hz: Annotated[float, Field(gt=0, le=50)] = 6.0
    filter: Method = "zero_phase"
    marker_set: Text | None = None
    hip: Literal["harrington", "bell", "functional"] = "harrington"
    marker_offset_m: Annotated[float, Field(ge=0, le=0.05)] = 0.009
    plate_delay_s: Delay = 0.0
    contact_threshold_n: Annotated[float, Field(gt=0, le=200)] = 30.0


class Subject(Stated):
    """Who walked."""

    id: Name = "subject"
    sex: Sex = "unspecified"
    mass_kg: Annotated[float, Field(ge=10, le=400)] | None = None
    height_m: Annotated[float, Field(ge=0.5, le=2.6)] | None = None
    age_years: Annotated[float, Field(ge=0, le=120)] | None = None
    knee_width_m: Annotated[float, Field(ge=0.05, le=0.25)] | None = None
    ankle_width_m: Annotated[float, Field(ge=0.03, le=0.2)] | None = None


class Platform(Stated):
    """How the platform's pose is known: by markers on it, or by its commanded motion."""

    markers: Labels = ()
    sway_channel: Text | None = None
    pitch_channel: Text | None = None
    pivot_m: Point = (0.0, 0.0, 0.0)
    delay_s: Delay = 0.0

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels with the commanded motion, those that are stated."""
        return tuple(filter(None, (self.sway_channel, self.pitch_channel)))


class Belt(Stated):
    """How the belts' acceleration is compensated."""

    calibration: Text
    speed_channels: Annotated[Labels, Field(min_length=1)]
    cutoff_hz: Annotated[float, Field(gt=0, le=45)] = 10.0


class Treadmill(Stated):
    """The machine: its accelerometers, its calibration, its belts, its platform."""

    calibration: Text | None = None
    accelerometers: dict[Name, Channels] = Field(default_factory=dict)
    accelerometer_unit: Text | None = None
    accelerometer_delay_s: Delay = 0.0
    accelerometer_range_g: Annotated[float, Field(gt=0, le=200)] = 2.0
    cutoff_hz: Annotated[float, Field(gt=0, le=100)] = 20.0
    belt: Belt | None = None
    platform: Platform | None = None

    @field_validator("accelerometers")
    @classmethod
    def _different(cls, sensors: dict[str, tuple[str, str, str]]) -> dict[str, Any]:
        channels = [channel for three in sensors.values() for channel in three]
        if twice := sorted({c for c in channels if channels.count(c) > 1}):
            raise ValueError(f"each channel belongs to one axis, but {', '.join(twice)} is twice")
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
                "accelerometers: is missing; a calibration is of no use without; name the three "
                "channels of each sensor, as in the example of 'hbm init'"
            )
        return self


class Condition(Stated):
    """Which gait cycles of a condition count."""

    cycles: Annotated[int, Field(ge=1)] | None = None
    perturbed: bool = False
    pulse_channel: Text | None = None
    skip_s: Annotated[float, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _used(self) -> "Condition":
        if self.pulse_channel is not None and not self.perturbed:
            raise ValueError("pulse_channel is of no use without perturbed = true")
        return self


class Trial(Stated):
    """One recording with what belongs beside it, or the reason why there is none."""

    file: Text | None = None
    forces: Text | None = None
    record: Text | None = None
    exclude: Text | None = None

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the trial's files, those that are stated."""
        return tuple(filter(None, (self.file, self.forces, self.record)))


class StudyFile(Stated):
    """What ``study.toml`` says."""

    name: str = "study"
    axes: str | None = None
    rename: dict[Text, Text] = Field(default_factory=dict)
    settings: Settings = Settings()
    treadmill: Treadmill = Treadmill()
    conditions: Annotated[dict[Name, Condition], Field(min_length=1)]

    @field_validator("axes")
    @classmethod
    def _right_handed(cls, axes: str | None) -> str | None:
        if axes is not None:
            parse_axes(axes)
        return axes


class SubjectFile(Subject):
    """What a subject's file says."""

    id: Name
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
