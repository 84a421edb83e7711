"""What is wrong with a session, and its one light: good, look or stop, with one sentence."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Final

from compensation.inertia.sensors import SensorFault
from hbm.notes import Note
from hbm.numbers import read_numbers
from pipeline.trial.quality import Quality
from pipeline.viewer.live import Colour

LIMITS: Final = read_numbers("pipeline.live", "thresholds.toml", "session")
WITHOUT_SAMPLES: Final = Quality.LATE | Quality.FORCES_UNKNOWN | Quality.PLATFORM_UNKNOWN


class Kind(Enum):
    """Kinds of findings, the most urgent first; the catalogue of notes has their sentences.

    Attributes
    ----------
    note_code
        In the catalogue.
    subject
        What in its sentences names the subject; empty where there is one at most.
    stops
        Whether no gait cycle is used while it holds.
    frames
        Why frames are not used where it holds: they need no sentence of their own then.
    """

    STREAM_SILENT = "live_stream_silent", "stream", True, WITHOUT_SAMPLES
    STAMPS_REPEAT = "live_stamps_repeat", "stream", True, WITHOUT_SAMPLES
    SENSOR_DEAD = SensorFault.DEAD, "", True
    SENSOR_TURNED = SensorFault.TURNED, "", True
    SENSORS_SWAPPED = SensorFault.SWAPPED, "", True
    PLATE_SATURATED = "live_plate_saturated", "plate", True
    PLATE_NOT_ZERO = "live_plate_not_zero", "plate", True
    MARKERS_MISFIT = "live_markers_misfit", "", True
    MARKERS_LEFT_OUT = "live_markers_left_out"
    MARKER_GONE = "live_marker_gone", "markers", False, Quality.POSE_UNKNOWN | Quality.LIMB_UNSEEN
    PLATES_LATE = "live_plates_late"
    SENSOR_CLIPPED = SensorFault.CLIPPED
    RANGE_EXCEEDED = SensorFault.BEYOND_RANGE
    WEIGHT_DIFFERS = "live_weight_differs"
    FOOT_UNCERTAIN = "live_foot_uncertain"
    RESIDUALS_HIGH = "live_residuals_high"
    # of frames alone: the cause before what follows from it
    MARKERS_FROZEN = "live_markers_frozen", "", False, Quality.MARKERS_FROZEN
    POSE_UNKNOWN = "live_pose_unknown", "", False, Quality.POSE_UNKNOWN
    LIMB_UNSEEN = "live_limb_unseen", "", False, Quality.LIMB_UNSEEN
    PLATFORM_UNKNOWN = "live_platform_unknown", "", False, Quality.PLATFORM_UNKNOWN
    LATE = "live_late", "", False, Quality.LATE
    FORCES_UNKNOWN = "live_forces_unknown", "", False, Quality.FORCES_UNKNOWN
    NOT_CARRIED = "live_not_carried", "", False, Quality.NOT_CARRIED
    SETTLING = "live_settling", "", False, Quality.SETTLING
    # said once: the light does not change
    MARKERS_ABSENT = "live_markers_absent", "stream"
    CLOCK_SET = "live_clock_set", "stream"
    START_UNKNOWN = "live_start_unknown", "stream"
    FRAMES_UNREAD = "live_frames_unread"
    CONNECTION_LOST = "live_connection_lost"

    def __init__(self, code: str, subject: str = "", stops: bool = False, frames: int = 0) -> None:
        self.note_code, self.subject, self.stops = code, subject, stops
        self.frames = Quality(frames)


OF_FRAMES: Final = {k.frames: k for k in Kind if k.frames and k.name in Quality.__members__}
"""Why frames are not used -> what says so where nothing else does."""
OF_SENSORS: Final = {SensorFault(k.note_code): k for k in Kind if k.note_code in set(SensorFault)}


Key = tuple[Kind, tuple[str, ...]]
"""Kind and subject of a finding."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is wrong.

    Attributes
    ----------
    kind
        What.
    subject
        Markers, plate or stream that it is about; empty where its kind names none.
    values
        What else its sentences state, by name.

    Examples
    --------
    >>> print(Finding(Kind.PLATE_NOT_ZERO, ("1",), {"rest_n": 13.0}).note)
    plate 1: reads 13.0 N without load
    """

    kind: Kind
    subject: tuple[str, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def key(self) -> Key:
        """What tells it from others, whatever its values are now."""
        return self.kind, self.subject

    @property
    def note(self) -> Note:
        """Give it in words."""
        subject = {self.kind.subject: self.subject} if self.kind.subject else {}
        return Note.of(self.kind.note_code, **subject, **self.values)


def light(
    findings: Iterable[Finding],
    not_used: Mapping[Quality, float],
    done: str,
    *,
    steady: bool = True,
) -> tuple[Colour, str]:
    """Give the light of a session: of all that is wrong, the most urgent has the sentence.

    Good: nothing to do, and no residual exceeds healthy walking. Look: the measurement goes on,
    with a fault that is worth mending. Stop: what is measured now cannot be used.

    Parameters
    ----------
    findings
        What is wrong now.
    not_used
        Reason -> share of the frames of the last two seconds that are not used for it.
    done
        The gait cycles used so far, in words, and what to do once they are enough.
    steady
        Whether frames have come for more than two seconds.

    Examples
    --------
    >>> light([], {}, "12 of 25 gait cycles used")
    ('good', '12 of 25 gait cycles used')
    >>> gone = Finding(Kind.MARKER_GONE, ("LASIS",), {"gone_s": 0.5})
    >>> light([gone], {}, "12 of 25 gait cycles used")
    ('look', 'LASIS is hidden: turn a camera or re-attach the marker')
    """
    fractions = {reason: not_used.get(reason, 0.0) for reason in OF_FRAMES}
    # filters that settle at the start are no fault
    reasons = {r: part for r, part in fractions.items() if part > LIMITS.some_frames and steady}
    of_kind = dict[Kind, list[Finding]]()
    for finding in findings:
        of_kind.setdefault(finding.kind, []).append(finding)
    if Quality.NOT_CARRIED in reasons:
        of_kind.pop(Kind.WEIGHT_DIFFERS, None)  # its cause is known
    shown = list[tuple[Colour, str]]()
    for kind in Kind:
        if OF_FRAMES.get(kind.frames) is kind and kind.frames in reasons:
            of_kind[kind] = [Finding(kind)]
        if kind in of_kind:
            # a kind answers for the frames that it costs: later kinds do not name them again
            largest = max((reasons.pop(r) for r in [*reasons] if r in kind.frames), default=0.0)
            stops = kind.stops or (largest > LIMITS.most_frames and kind is not Kind.SETTLING)
            first, subject = of_kind[kind][0], of_kind[kind][0].subject
            if kind is Kind.MARKER_GONE:  # one sentence for all of them
                subject = tuple(name for marker in of_kind[kind] for name in marker.subject)
            note = replace(first, subject=subject).note
            shown.append(("stop" if stops else "look", note.light))
    if not shown:
        starting: tuple[Colour, str] = "look", "Starting: wait for two seconds of frames"
        return ("good", done) if steady else starting
    # kinds stand in the order of urgency; whatever stops comes before what does not
    colour, sentence = next((fault for fault in shown if fault[0] == "stop"), shown[0])
    return colour, f"{sentence} (+{len(shown) - 1} more)" if len(shown) > 1 else sentence
