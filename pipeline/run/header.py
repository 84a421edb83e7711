"""What a stored trial holds besides its frames and its summary, so that it can be read back."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from pydantic import ConfigDict, PlainSerializer, PlainValidator, TypeAdapter, ValidationError

from hbm.markers import MarkerSet
from hbm.model import Body, joints_of
from hbm.segments import Inertia, Sex
from hbm.spatial import Array
from pipeline.io.recording import Event
from pipeline.trial.result import PlateSurface, TrialResult
from pipeline.trial.summary import STRICT_JSON, StoredNote, fault_of


def _array(numbers: Any) -> Array:
    return np.array(numbers, float)


def _plain(array: Array) -> list[Any]:
    plain: list[Any] = array.tolist()
    return plain


Numbers = Annotated[Array, PlainValidator(_array), PlainSerializer(_plain)]
"""An array, in JSON as nested lists of numbers that come back exactly."""


@dataclass(frozen=True, slots=True)
class StoredInertia:
    """An `hbm.segments.Inertia` for JSON."""

    mass: float
    center: Numbers
    tensor: Numbers


@dataclass(frozen=True, slots=True)
class StoredPlate:
    """A `PlateSurface` for JSON."""

    number: int
    center: Numbers
    corners: Numbers


@dataclass(frozen=True, slots=True)
class StoredBody:
    """An `hbm.Body` for JSON."""

    mass: float
    sex: Sex
    height_m: float
    marker_set: MarkerSet
    markers: tuple[str, ...]
    marker_segment: tuple[str, ...]
    marker_position: Numbers
    offsets: Mapping[str, Numbers]
    axes: Mapping[str, Numbers]
    segments: Mapping[str, StoredInertia]
    lengths: Mapping[str, float]
    locked: tuple[str, ...]
    notes: tuple[StoredNote, ...]

    def to_body(self) -> Body:
        """Give the body."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        joints = joints_of(own.pop("offsets"), own.pop("axes"))
        segments = {s: Inertia(i.mass, i.center, i.tensor) for s, i in self.segments.items()}
        return Body(**own | {"joints": joints, "segments": segments})


@dataclass(frozen=True, slots=True)
class TrialHeader:
    """What a trial's result needs besides its summary and its frames.

    Attributes
    ----------
    body
        The subject's body.
    markers
        Names of the measured markers.
    first_frame
        Number of the first frame in the recording's own counting.
    plates
        Where the force plates are.
    motion_markers
        Names of the markers the motion was solved from.
    feet
        Variant -> segments that its ground wrenches act on.
    platform_moves
        Whether there is a pose of the platform.
    events
        Gait events at their exact times.
    onsets
        When perturbations began [s].
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT_JSON

    body: StoredBody
    markers: tuple[str, ...]
    first_frame: int
    plates: tuple[StoredPlate, ...]
    motion_markers: tuple[str, ...]
    feet: Mapping[str, tuple[str, ...]]
    platform_moves: bool
    events: tuple[Event, ...]
    onsets: Numbers

    def to_json(self) -> bytes:
        """Give the header as JSON; numbers come back exactly."""
        return _JSON.dump_json(self)

    @staticmethod
    def from_json(text: bytes) -> "TrialHeader":
        """Read a header back; a ValueError says what is missing or of another type."""
        try:
            return _JSON.validate_json(text)
        except ValidationError as error:
            raise ValueError(fault_of(error)) from error


_JSON: Final = TypeAdapter(TrialHeader)


def header_of(result: TrialResult) -> TrialHeader:
    """Gather a result's header."""
    body = result.body
    own = {field.name: getattr(body, field.name) for field in fields(StoredBody)}
    segments = {s: StoredInertia(i.mass, i.center, i.tensor) for s, i in body.segments.items()}
    return TrialHeader(
        body=StoredBody(**own | {"segments": segments}),
        markers=result.markers.names,
        first_frame=result.first_frame,
        plates=tuple(StoredPlate(p.number, p.center, p.corners) for p in result.plates),
        motion_markers=result.motion.markers,
        feet={variant: tuple(feet) for variant, feet in result.ground.items()},
        platform_moves=result.platform is not None,
        events=result.events,
        onsets=result.onsets,
    )


def plates_of(header: TrialHeader) -> tuple[PlateSurface, ...]:
    """Give the plates of a header."""
    return tuple(PlateSurface(p.number, p.center, p.corners) for p in header.plates)
