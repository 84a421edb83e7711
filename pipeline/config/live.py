"""What a study states of live streams: which stream and which channel is what."""

from contextlib import suppress
from ipaddress import IPv4Address
from typing import Annotated, Final

from pydantic import AfterValidator, Field, model_validator

from hbm.spatial import WRENCH_COMPONENTS
from hbm.spelling import short
from pipeline.config.input_model import InputModel, Labels, Text

LOOPBACK: Final = "127.0.0.1"
Six = Annotated[tuple[Text, Text, Text, Text, Text, Text], Field(strict=False)]
PlateNumber = Annotated[str, Field(pattern=r"^[1-9][0-9]?$")]


def own_address(written: str) -> str:
    """Give an IPv4 address as it is written; ValueError if it is none that one computer can have.

    Examples
    --------
    >>> own_address("192.168.1.10")
    '192.168.1.10'
    """
    with suppress(ValueError):
        address = IPv4Address(written)
        if not (address.is_unspecified or address.is_multicast):
            return str(address)
    raise ValueError(
        f"{short(written)!r} is no IPv4 address of this computer, such as 192.168.1.10"
    )


class Live(InputModel):
    """Which streams are received while a trial is measured, and what their channels are.

    Examples
    --------
    >>> Live().channels_of(2)
    ('FP2.Fx', 'FP2.Fy', 'FP2.Fz', 'FP2.Mx', 'FP2.My', 'FP2.Mz')
    """

    markers: Text | None = Field(default=None, examples=["Markers"])
    """Stream of the markers; default: the only one."""
    analog: Labels = Field(default=(), examples=[["Plates", "Analog"]])
    """Streams of plates, accelerometers, belts and platform; default: all."""
    wait_s: Annotated[float, Field(gt=0, le=2)] = 0.2
    """How long a frame waits for samples that are late."""
    follow_zeros: bool = False
    """Subtract what each plate reads while no foot is on it, by the last such phases; for load
    cells that warm up."""
    listen: Annotated[str, AfterValidator(own_address)] = Field(
        default=LOOPBACK, examples=["192.168.1.10"]
    )
    """This computer's address in the laboratory's network; default: streams of this computer
    alone."""
    plates: dict[PlateNumber, Six] = Field(
        default_factory=dict,
        examples=[{"1": ["FP1.Fx", "FP1.Fy", "FP1.Fz", "FP1.Mx", "FP1.My", "FP1.Mz"]}],
    )
    """Plate and its Fx Fy Fz Mx My Mz, in its own axes about the centre of its surface; default: as
    streams state it, else FP1.Fx, FP1.Fy and so on."""

    @model_validator(mode="after")
    def _different(self) -> "Live":
        names = [name for name in (self.markers, *self.analog) if name]
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"stream {', '.join(repeated)} is named more than once")
        return self

    def channels_of(self, plate: int) -> tuple[str, ...]:
        """Give the six channels of a plate."""
        return self.plates.get(str(plate)) or tuple(f"FP{plate}.{c}" for c in WRENCH_COMPONENTS)
