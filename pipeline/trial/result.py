"""What is known of a trial once it has been processed: types only."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import PlainSerializer, PlainValidator

from compensation.platform import PlatformPose
from hbm.body import Body
from hbm.dynamics import Dynamics
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.notes import Note, warnings_of
from hbm.spatial import WRENCH_COMPONENTS, Array, Indices, Mask
from pipeline.config.schema import Settings, Subject, TrialName, Unit
from pipeline.io.recording import Event, Plate
from pipeline.io.shown import Overview, Shown
from pipeline.trial.findings.finding import Finding
from pipeline.trial.quality import frames_within, free_of


def _note(stored: object) -> Note:
    return stored if isinstance(stored, Note) else Note.from_dict(stored)


StoredNote = Annotated[Note, PlainValidator(_note), PlainSerializer(Note.to_dict)]
"""A note that stands in JSON with its code, level, text and values."""
PACKAGES: Final = ("hbm-residuals", "casadi", "numpy", "scipy", "pandas", "pyarrow")


EventOrigin = Literal["", "file", "zeni", "plates", "calibrated", "motion"]
"""Of the file, of markers by Zeni, where plates say, of the feet's motion calibrated by plates, and
of the motion alone."""


@cache
def package_versions() -> Mapping[str, str]:
    """Give the versions of this program and of what computes and stores a trial."""
    return {name: version(name) for name in PACKAGES}


@dataclass(frozen=True, slots=True)
class CyclePart:
    """The part of each perturbed gait cycle that a condition asks for.

    Attributes
    ----------
    name
        "motion", or what was stated, such as "0.2 to 0.5 s" or "10 to 40 %".
    spans
        Side -> start and stop of the part of each gait cycle that counts [s], in the order of the
        cycles; NaN where a cycle has none.

    Examples
    --------
    >>> part = CyclePart("0.2 to 0.5 s", {"right": ((10.3, 10.6),)})
    >>> part.percent({"right": np.array([[10.0, 11.0]])}).round(1).tolist()
    [[30.0, 60.0]]
    """

    name: str
    spans: Mapping[str, tuple[tuple[float, float], ...]]

    def percent(self, cycles: Mapping[str, ArrayLike]) -> Array:
        """Give start and stop of the part of each of these gait cycles [% of the cycle], (C, 2)."""
        parts = [np.empty((0, 2))]
        for side, spans in self.spans.items():
            start, stop = np.reshape(cycles[side], (-1, 2)).T[..., None]
            parts.append(100 * (np.reshape(spans, (-1, 2)) - start) / (stop - start))
        return np.concatenate(parts)


@dataclass(frozen=True, slots=True)
class Procedure:
    """How a trial was processed where its settings leave that open; its Methods section says it.

    Attributes
    ----------
    mass
        Where the body mass is from, as `pipeline.trial.subject.body_mass` says.
    events
        What shows the gait events; empty where there are none.
    held
        Coordinates that a prior held near neutral.
    plate_calibration
        File by which the plates were corrected; empty without one.
    delays_corrected
        Whether it brought them forward by their delays.
    dynamic
        Whether a dynamic model compensated the plates.
    """

    mass: str = ""
    events: EventOrigin = ""
    held: tuple[str, ...] = ()
    plate_calibration: str = ""
    delays_corrected: bool = False
    dynamic: bool = False


@dataclass(frozen=True, slots=True, repr=False)
class TrialResult(Shown):
    """Everything that is known of a trial once it has been processed.

    `pipeline.run.store` writes it and reads it back.

    Attributes
    ----------
    source
        The recording's file.
    subject, settings
        As stated.
    body
        The subject's body.
    markers
        Marker trajectories as measured, at the T frames of the motion.
    first_frame
        Number of the first frame in the recording's own counting.
    plates
        Where the force plates are with the platform in neutral: without samples.
    motion
        Filtered motion with marker errors.
    solved
        Its coordinates before the filter, (T, 46) [m and rad]; a few lost frames are interpolated.
    variants
        Name -> dynamics: "measured" with the plates as measured and, with a calibration,
        "compensated" without what the treadmill's motion adds; the last is closest to the truth.
    ground
        Name of the variant -> foot -> filtered wrench on it, (T, 6) [N, N·m], lab axes about the
        lab origin.
    events
        Gait events.
    cycles
        Side -> start and stop of each gait cycle that counts, (C, 2) [s].
    found_cycles
        How many gait cycles the events of these sides show, counted or not.
    unit
        "cycle", or "step" or "stance" where ``cycles`` and ``found_cycles`` are these.
    span
        Start and stop of the stretch of the recording that counts in place of gait cycles [s]; None
        where gait cycles count.
    quality
        Why each frame does not count, (T,): flags of `pipeline.trial.quality.Quality`, 0 where
        nothing is doubtful. Where the foot is uncertain, the forces of the legs' coordinates are
        NaN; where filters settle, all of them.
    delay_s, delay_uncertainty_s
        How much later the plates are than the markers, and half of its 95 % interval; NaN where it
        is not determined.
    platform
        The platform's pose, (T,) frames; None for a treadmill that stands still.
    notes
        What was inferred, locked, filled or refused, for people.
    of_calibration
        Those on the treadmill's calibration, to be shown wherever the trial is used.
    shortage
        Why there are no residuals; empty where there are.
    findings
        What is wrong with plates, with the corrections that were tried.
    procedure
        How it was processed where the settings leave that open.
    overridden_segments
        Segments whose inertia is not by the table alone.
    onsets
        When the perturbations of a perturbed condition began, (P,) [s].
    part
        The part of the gait cycles that the condition asks for; None for all of them.
    uncertainty
        One standard deviation of the residual with compensation, due to the compensation, lab axes
        about the pelvis origin, (T, 6) [N, N·m]; None without a calibration of the platform.
    condition, recording, session
        Name of the condition; number of the recording where there are several, and the session
        where subjects came more than once; empty outside a study.
    key
        Digest of everything that the trial depends on (`pipeline.run.job.trial_key`); empty
        outside a study.
    versions
        Package -> version that the trial was processed with.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> result.motion.q.shape, result.measured.residual.shape
    ((800, 46), (800, 6))
    >>> sorted(result.ground["measured"])
    ['left_foot', 'right_foot']
    """

    source: Path
    subject: Subject
    settings: Settings
    body: Body
    markers: Markers
    first_frame: int
    plates: tuple[Plate, ...]
    motion: Motion
    solved: Array
    variants: Mapping[str, Dynamics]
    ground: dict[str, dict[str, Array]]
    platform: PlatformPose | None
    events: tuple[Event, ...]
    cycles: dict[str, Array]
    found_cycles: int
    span: tuple[float, float] | None
    quality: Indices
    delay_s: float
    delay_uncertainty_s: float
    notes: tuple[Note, ...]
    of_calibration: tuple[Note, ...] = ()
    shortage: str = ""
    findings: tuple[Finding, ...] = ()
    procedure: Procedure = Procedure()
    overridden_segments: tuple[str, ...] = ()
    onsets: Array = field(default_factory=lambda: np.empty(0))
    part: CyclePart | None = None
    unit: Unit = "cycle"
    uncertainty: Array | None = None
    condition: str = ""
    recording: str = ""
    session: str = ""
    key: str = ""
    versions: Mapping[str, str] = field(default_factory=package_versions)

    def __post_init__(self) -> None:
        if not self.variants:
            raise ValueError(f"{self.source.name}: no variant of the plates' wrenches")
        frames = len(self.motion.time), len(self.markers.time), len(self.quality)
        if len({*frames}) > 1:
            counts = "the motion has {} frames, the markers have {}, the quality has {}"
            raise ValueError(f"{self.source.name}: {counts.format(*frames)}")
        self.quality.setflags(write=False)

    @property
    def name(self) -> TrialName:
        """Which trial of its study it is."""
        return TrialName(self.subject.id, self.condition, self.recording)

    @property
    def measured(self) -> Dynamics:
        """The variant with the plates as measured."""
        return self.variants["measured"]

    @property
    def compensated(self) -> Dynamics | None:
        """The variant without what the treadmill's motion adds; None without a calibration."""
        return self.variants.get("compensated")

    @property
    def counts(self) -> Mask:
        """Frames whose residuals count, (T,)."""
        return free_of(self.quality)

    @property
    def spans(self) -> dict[str, Array]:
        """Side -> stretches that the condition asks for, (N, 2) [s]; a span is of no side."""
        if self.span:
            return {"": np.array([self.span])}
        of_sides = self.cycles if self.part is None else self.part.spans
        return {side: np.reshape(of_sides[side], (-1, 2)) for side in self.cycles}

    @property
    def counted(self) -> Mask:
        """Those of them that are in these stretches, (T,)."""
        return frames_within(self.motion.time, *self.spans.values()) & self.counts

    @property
    def title(self) -> str:
        """Of which file and whom it is, and its filter."""
        filtered = f"{self.settings.filter} Butterworth {self.settings.cutoff_hz:g} Hz"
        body = f"{self.body.mass:.1f} kg, {self.body.height_m:.2f} m"
        return f"{self.source.name}; {body}; {filtered}"

    def overview(self) -> Overview:
        """Give title, counts of frames and warnings, and RMS residuals of the frames that count."""
        counted, warnings = self.counted, len(warnings_of(self.notes))
        used = {name: one.residual[counted] for name, one in self.variants.items() if any(counted)}
        rows = {
            name: np.sqrt(np.mean(residual**2, axis=0)).round(1) for name, residual in used.items()
        }
        frames = f"{counted.sum()} of {len(counted)} frames count, {warnings} warnings in .notes"
        words = self.shortage or "RMS residuals [N, N·m], x forward, y right, z up:"
        return Overview(f"{self.title}\n{frames}\n{words}", WRENCH_COMPONENTS, rows)

    @property
    def engine(self) -> str:
        """Name and version of the engine of the inverse dynamics, the same for all variants."""
        return next(iter(self.variants.values())).engine
