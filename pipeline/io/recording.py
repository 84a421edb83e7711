"""Types of what a file holds once it has been read."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal, SupportsInt

import numpy as np

from hbm.calibration_pose.anatomy import LimbMeasures
from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array, read_only, transform_wrench
from hbm.spelling import listed
from pipeline.io.read_options import ReadOptions
from pipeline.io.shown import Overview, Shown

Doubt = Literal["in_doubt", "impossible_samples", "rename_without_label"]
FactKind = Literal["joined", "left_out", "missing", "corrected", Doubt]
"""What was done on reading, or is in doubt; also the codes of their notes."""
MIN_MARKERS: Final = 9
"""Fewer are on a treadmill, not on a body."""


@dataclass(frozen=True, slots=True)
class Fact:
    """What reading a file joined, left out, took as missing or corrected, or what is in doubt.

    Attributes
    ----------
    kind
        What was done; of what is "in_doubt" nothing was.
    of
        Of what: "plate 2", "marker LPSIS", "case.mot, line 6506".
    reason
        What was seen there, and what follows of it.
    plate
        Whether it is about a force plate.

    Examples
    --------
    >>> str(Fact("left_out", "plate 2", "FORCE_PLATFORM:TYPE does not describe it"))
    'plate 2: not used: FORCE_PLATFORM:TYPE does not describe it'
    """

    kind: FactKind
    of: str
    reason: str
    plate: bool = field(default=False, compare=False)

    @property
    def note(self) -> Note:
        """The note about it, for people."""
        return Note.of(self.kind, of=self.of, reason=self.reason)

    def __str__(self) -> str:
        return self.note.text


def impossible_samples(names: Sequence[str], counts: Iterable[SupportsInt]) -> list[Fact]:
    """Say how many samples of which channels were made gaps; nothing where there are none."""
    of = {name: int(n) for name, n in zip(names, counts, strict=True) if int(n)}
    if not of:
        return []
    total = sum(of.values())
    what = f"{total} samples that cannot have been measured are gaps"
    if total == 1:
        what = "1 sample that cannot have been measured is a gap"
    channels = ", ".join(f"{name} {count}" for name, count in of.items())
    return [Fact("impossible_samples", channels, what)]


@contextmanager
def saying(remarks: Iterable[Note | Fact]) -> Iterator[None]:
    """Add to a later error the facts found on reading: it may be a consequence."""
    try:
        yield
    except ValueError as error:
        for fact in dict.fromkeys(note for note in remarks if isinstance(note, Fact)):
            if str(fact) not in str(error):
                error.add_note(f"on reading, {fact}")
        raise


PlateFrame = Literal["recorded", "plate", "lab"]
"""Where the plates of a file with compensated plates are; see `Compensation`."""


@dataclass(frozen=True, slots=True)
class Plate:
    """One force plate with the wrench that acted on the subject.

    Attributes
    ----------
    number
        The plate's number in its file, from 1.
    time
        Sample times, (N,) [s], on the recording's clock.
    wrench_in_plate
        Action on the subject in the plate's own axes about the centre of its surface,
        (N, 6) [N, N·m].
    rotation
        Orientation of the plate in the lab with the platform in neutral (columns: the plate's
        axes), (3, 3).
    center
        Centre of the plate's surface with the platform in neutral, (3,) [m].
    corners
        Corners of the surface with the platform in neutral, (4, 3) [m].
    units
        Of forces, moments and, where these come from centres of pressure, of the latter, as they
        were read: "N,Nmm" or "N,Nm,mm"; empty where they are not known.
    transducer
        Where the file's moments are about, from the centre of the surface, plate axes, (3,) [m].
    """

    number: int
    time: Array
    wrench_in_plate: Array
    rotation: Array
    center: Array
    corners: Array
    units: str = ""
    transducer: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        samples = len(self.time)
        shapes = {"time": (samples,), "wrench_in_plate": (samples, 6), "transducer": (3,)}
        shapes |= {"rotation": (3, 3), "center": (3,), "corners": (4, 3)}
        for name, shape in shapes.items():
            value = read_only(getattr(self, name))
            if value.shape != shape:
                raise ValueError(
                    f"plate {self.number}: {name} must have shape {shape}, got {value.shape}"
                )
            object.__setattr__(self, name, value)

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]."""
        return _rate_hz(self.time)

    @classmethod
    def at_origin(cls, number: int, time: Array, wrench: Array, units: str = "") -> "Plate":
        """Make a plate of which only the wrench in the lab about its origin is known, (N, 6)."""
        return cls(number, time, wrench, np.eye(3), np.zeros(3), np.full((4, 3), np.nan), units)

    @property
    def place(self) -> "Plate":
        """The same plate without samples: where it lies."""
        return replace(self, time=np.empty(0), wrench_in_plate=np.empty((0, 6)))

    def turned(self, to_lab: Array) -> "Plate":
        """Give the same plate where its place is turned by a rotation, (3, 3)."""
        rotation, center = to_lab @ self.rotation, to_lab @ self.center
        return replace(self, rotation=rotation, center=center, corners=self.corners @ to_lab.T)

    @property
    def wrench(self) -> Array:
        """Action on the subject in lab axes about the lab origin, platform in neutral, (N, 6)."""
        return transform_wrench(self.wrench_in_plate, self.rotation, self.center)


@dataclass(frozen=True, slots=True)
class Event:
    """A gait event: ``label`` as "foot_strike" or "foot_off", ``side`` "left" or "right"."""

    time: float
    label: str
    side: str


@dataclass(frozen=True, slots=True)
class Analog:
    """Analog channels other than the plates' (accelerometers, belt speeds, pulses).

    Attributes
    ----------
    time
        Sample times, (N,) [s].
    names, units
        One per channel; units as the file writes them.
    values
        Samples, (N, K).
    """

    time: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", read_only(self.time))
        object.__setattr__(self, "values", read_only(self.values))
        if self.values.shape != (len(self.time), len(self.names)):
            raise ValueError(
                f"analog values must have shape ({len(self.time)}, {len(self.names)}), "
                f"got {self.values.shape}"
            )

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]."""
        return _rate_hz(self.time)

    def channel(self, name: str) -> Array:
        """Give one channel by name, (N,); a ValueError lists the channels that exist."""
        if (count := self.names.count(name)) != 1:
            fault = f"{count} analog channels are called" if count else "no analog channel"
            raise ValueError(f"{fault} {name!r}; present: {listed(self.names)}")
        return self.values[:, self.names.index(name)]


@dataclass(frozen=True, slots=True)
class Metadata:
    """What a file says of its subject's body; None or empty where it does not say.

    Attributes
    ----------
    mass_kg, height_m
        Body mass and stature.
    limbs
        Side -> what was measured on it.
    """

    mass_kg: float | None = None
    height_m: float | None = None
    limbs: Mapping[str, LimbMeasures] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "limbs", MappingProxyType(dict(self.limbs)))


@dataclass(frozen=True, slots=True)
class Compensation:
    """What was subtracted from the plates of a file after it had been recorded.

    Attributes
    ----------
    software
        Program and version that did it.
    plates
        Numbers of the plates, from 1.
    calibration, calibration_sha256
        Name and SHA-256 of the calibration of the moving platform; empty without one.
    belts, belts_sha256
        The same of the calibration of the belts.
    plate_calibration, plate_calibration_sha256
        The same of the calibration of the plates themselves.
    cutoff_hz
        Cut-off of the calibration's low-pass [Hz]: up to it the compensation is valid.
    filter
        Which low-pass plates and prediction went through before one was subtracted from the other.
    frame
        "recorded": wrenches in the plates' own moving frame, corners as recorded; "plate": corners
        in the mean pose of the platform; "lab": wrenches in the lab frame, corners as recorded.
    """

    software: str
    plates: tuple[int, ...]
    calibration: str = ""
    calibration_sha256: str = ""
    belts: str = ""
    belts_sha256: str = ""
    plate_calibration: str = ""
    plate_calibration_sha256: str = ""
    cutoff_hz: float | None = None
    filter: str = "none"
    frame: PlateFrame = "recorded"


@dataclass(frozen=True, slots=True, repr=False)
class Recording(Shown):
    """One trial as recorded, in SI units and lab axes (X forward, Y left, Z up).

    Attributes
    ----------
    source
        The file it came from.
    markers
        Marker trajectories; gaps are NaN. Subject prefixes are removed from the labels.
    plates
        Force plates in the file's order; empty where the file has none.
    analog
        All other analog channels.
    events
        Gait events in order of time; empty where the file has none.
    first_frame
        Number of the first frame in the file's own counting; times start at 0 there.
    metadata
        What the file says of its subject's body.
    model_outputs
        Angles, moments and powers that another program stored in the file: name -> (T, 3) in the
        file's own units.
    compensation
        What was subtracted from its plates before; None where they are as measured.
    options
        What a person stated about the file when it was read.
    axes
        Lab directions of the file's x, y and z, as they were stated or inferred.
    labels_absent
        Labels to rename that the file does not have.
    forces_beside
        Of a format without plates: the file beside it that seems to hold them, if there is one.
    facts
        What was joined, left out, made gaps or corrected on reading, or is in doubt.
    notes
        All of that in sentences, and what was inferred of units and names.

    Examples
    --------
    >>> import hbm, numpy as np, pipeline
    >>> time = np.arange(50) / 100
    >>> heel = hbm.Markers(time, ("LHEE",), np.zeros((50, 1, 3)))
    >>> pipeline.Recording("heel.c3d", heel)
    heel.c3d: 0.5 s
                  number    rate
    markers            1  100 Hz
    force plates       0       –
    channels           0       –
    events             0       –
    """

    source: Path
    markers: Markers
    plates: tuple[Plate, ...] = ()
    analog: Analog | None = None
    events: tuple[Event, ...] = ()
    first_frame: int = 1
    metadata: Metadata = field(default_factory=Metadata)
    model_outputs: Mapping[str, Array] = field(default_factory=dict)
    compensation: Compensation | None = None
    options: ReadOptions = field(default_factory=ReadOptions)
    axes: tuple[str, ...] = ()
    labels_absent: tuple[str, ...] = ()
    forces_beside: Path | None = None
    facts: tuple[Fact, ...] = ()
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "source", Path(self.source))
        object.__setattr__(self, "model_outputs", MappingProxyType(dict(self.model_outputs)))
        object.__setattr__(self, "events", tuple(sorted(self.events, key=lambda e: e.time)))

    def overview(self) -> Overview:
        """Give file and duration; number and rate of what was recorded."""
        markers, plates, analog = self.markers, self.plates, self.analog
        rows = {
            "markers": (len(markers.names), f"{markers.rate_hz:g} Hz"),
            "force plates": (len(plates), f"{plates[0].rate_hz:g} Hz" if plates else "–"),
            "channels": (len(analog.names), f"{analog.rate_hz:g} Hz") if analog else (0, "–"),
            "events": (len(self.events), "–"),
        }
        title = f"{self.source.name}: {len(markers.time) / markers.rate_hz:.1f} s"
        return Overview(title, ("number", "rate"), rows)

    @property
    def why_no_plates(self) -> str:
        """Why it has no plates, for messages where it has none."""
        if unused := [str(f) for f in self.facts if f.plate and f.kind == "left_out"]:
            return f"no force plate can be used ({'; '.join(unused)})"
        file = self.forces_beside
        remedy = f"; {file.name} beside it seems to: --forces {file.name}" if file else ""
        return f"the file has no force plates{remedy}"


def _rate_hz(time: Array) -> float:
    return (len(time) - 1) / float(time[-1] - time[0])
