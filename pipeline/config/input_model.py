"""The base of everything that a user types, and the quantities in it.

The bounds catch a value in another unit or a typing error; they are wider than anything that is
measured in a gait laboratory.
"""

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from hbm.spelling import printable, wrapped
from pipeline.config.toml_file import describe_faults
from pipeline.io.axes import parse_axes
from pipeline.io.read_options import parse_mending, parse_plate_units
from pipeline.io.units import acceleration_in_mps2, length_in_m

RESERVED: Final = {
    *("con", "prn", "aux", "nul"),
    *(f"{port}{n}" for port in ("com", "lpt") for n in range(10)),
}
"""Devices of Windows: no file there may have such a name, whatever follows after a full stop."""


class InputModel(BaseModel):
    """Base of everything that a user types: immutable; unknown keys and other types are refused.

    A field is the one statement of a setting: its bounds, its default, its unit (the end of its
    name) and its description, from which the template of `hbm init`, the options of the command
    line and the table in ``docs/conventions.md`` are made.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
    )

    def __init__(self, /, **values: Any) -> None:
        """Check what is stated; what is wrong is one line."""
        try:
            super().__init__(**values)
        except ValidationError as error:
            faults = "; ".join(describe_faults(error, type(self), values))
            raise ValueError(f"{type(self).__name__}: {faults}") from None

    # else pydantic would call it for models within models and files too
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __repr__(self) -> str:
        return wrapped(super().__repr__())

    __str__ = __repr__


def bounds_of(kind: type[InputModel], name: str) -> str:
    """Give the numbers that a setting may have, such as "0.1 to 50"; empty without both bounds."""
    field = _schema(kind)["properties"][name]
    schema = field["anyOf"][0] if "anyOf" in field else field
    least = schema.get("minimum", schema.get("exclusiveMinimum"))
    return f"{least:g} to {schema['maximum']:g}" if "maximum" in schema else ""


@cache
def _schema(kind: type[InputModel]) -> dict[str, Any]:
    """Give the JSON schema of a model, which takes longer than all that is read from it."""
    return kind.model_json_schema()


def _file_name(name: str) -> str:
    if name.partition(".")[0].lower() in RESERVED:
        raise ValueError(f"{name!r} is the name of a device on Windows; choose another")
    if name.endswith("."):
        raise ValueError(f"{name!r} ends in a full stop, which Windows leaves out; choose another")
    return name


def _readable(read: Callable[[str], object]) -> AfterValidator:
    """Accept a text that a function can read, as it is."""

    def check(text: str) -> str:
        read(text)
        return text

    return AfterValidator(check)


Text = Annotated[str, Field(min_length=1), AfterValidator(printable)]
Labels = Annotated[tuple[Text, ...], Field(strict=False)]
Channels = Annotated[tuple[Text, Text, Text], Field(strict=False)]
"""Labels of a sensor's x, y and z channels."""
Name = Annotated[
    str,
    # names of subject and condition together are part of the name of a file
    Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=64),
    AfterValidator(_file_name),
]
"""Part of a file name on every operating system."""
AxesText = Annotated[str, _readable(parse_axes)]
"""Lab directions of the files' x, y and z axis, such as "left,back,up"."""
LengthUnit = Annotated[str, _readable(length_in_m)]
PlateUnitsText = Annotated[str, _readable(parse_plate_units)]
"""Units of force and moment, such as "N,Nmm", and of centres of pressure as a third."""
AccelerationUnit = Annotated[str, _readable(acceleration_in_mps2)]
Mendings = Annotated[tuple[Annotated[str, _readable(parse_mending)], ...], Field(strict=False)]
DelayS = Annotated[float, Field(ge=-0.5, le=0.5)]
"""Two devices of one laboratory disagree by some tens of milliseconds."""
CoordinateM = Annotated[float, Field(ge=-2, le=2)]
"""Within a treadmill and its frame."""
PointM = Annotated[tuple[CoordinateM, CoordinateM, CoordinateM], Field(strict=False)]
FilterCutoffHz = Annotated[float, Field(ge=0.1, le=100)]
"""Of plates and accelerometers: a treadmill's frame has no motion worth knowing beyond it."""
