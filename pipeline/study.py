"""What a person states about a study: settings and subjects, checked when they are made."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from hbm.filtering import Method
from hbm.segments import Sex


class Stated(BaseModel):
    """Base of everything a person types: immutable, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Settings(Stated):
    """How trials are processed; printed with every result."""

    cutoff_hz: Annotated[float, Field(gt=0, le=50)] = 6.0
    filter: Method = "zero_phase"
    marker_set: str | None = None
    hip: Literal["harrington", "bell"] = "harrington"
    marker_offset_m: Annotated[float, Field(ge=0, le=0.05)] = 0.009
    plate_delay_s: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    contact_threshold_n: Annotated[float, Field(gt=0, le=200)] = 30.0


class Subject(Stated):
    """Who walked."""

    id: str = "subject"
    sex: Sex = "unspecified"
    mass_kg: Annotated[float, Field(ge=10, le=400)] | None = None
    height_m: Annotated[float, Field(ge=0.5, le=2.6)] | None = None
