"""One light for a session: good, look or stop, with one sentence: what is wrong and what to do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from hbm.model import Body
from hbm.notes import Note
from hbm.spelling import listed
from pipeline.trial.quality import Quality
from pipeline.viewer.live import Colour

SOME: Final = 0.1
MOST: Final = 0.5
"""Shares of the frames of two seconds that are not used: above SOME look, above MOST stop."""
MIDDLE_M: Final = 0.02
"""From the middle of the body; markers that are nearer are neither left nor right."""
STOPPING: Final[Mapping[str, str]] = {
    "live_stream_silent": "Stream {stream} is not received: start its program or check its cable",
    "live_stamps_repeat": "Time stamps of stream {stream} repeat: start its program again",
    "accelerometer_dead": "Platform sensor {sensors} is dead: check its power and its cable",
    "accelerometer_turned": "Platform sensor {angles_deg} is turned: mount it as before",
    "accelerometers_swapped": "Sensors {first} and {second} are swapped: swap their cables",
    "live_plate_saturated": "Plate {plate} is saturated: choose a larger range",
    "live_plate_not_zero": "Plate {plate} reads {rest_n:.0f} N without load: step off and zero it",
    "live_markers_misfit": "Markers are {error_mm:.0f} mm from the body: check labels and subject",
}
"""Code of a note -> sentence, the most urgent first. While one holds, no gait cycle is used."""
OF_NOTES: Final[Mapping[str, str]] = {
    **STOPPING,
    "live_marker_gone": "{marker}",
    "live_plates_late": (
        "Plates are {delay_ms:.0f} ms later than the markers: set plate_delay_s = {delay_s:.3f}"
    ),
    "live_start_unknown": "{stream} may be {frame_ms:.0f} ms off: measure it, set plate_delay_s",
    "accelerometer_clipped": "Platform sensor {shares} is clipped: choose a larger range",
    "calibration_range_exceeded": (
        "The platform moves more than in its calibration: calibrate with larger motion"
    ),
    "live_weight_differs": (
        "Plates carry {carried_kg:.0f} of {mass_kg:.0f} kg: feet on the plates, hands off the rail"
    ),
    "live_foot_uncertain": (
        "Pressure is under neither foot: check the places of the plates and the axes"
    ),
}
"""The same with those for which one looks. Others do not change the light."""
OF_FRAMES: Final[Mapping[Quality, str]] = {
    Quality.MARKERS_FROZEN: "Markers do not change: does the cameras' program measure?",
    Quality.POSE_UNKNOWN: "Pelvis or trunk is hidden: check cameras and markers",
    Quality.LIMB_UNSEEN: "A leg or the pelvis is hidden: check cameras and markers",
    Quality.PLATFORM_UNKNOWN: "The platform's markers are hidden: check the cameras",
    Quality.LATE: "Samples come too late: close other programs or raise wait_s in [live]",
    Quality.FORCES_UNKNOWN: "Plates, sensors or belts send gaps: check their program",
    Quality.NOT_CARRIED: "A foot is beside its plate: ask the subject to walk on the plates",
    Quality.SETTLING: "The filters start: wait a second",
}
"""Why frames are not used -> sentence, the cause before what follows from it."""
WITHOUT_SAMPLES: Final = Quality.LATE | Quality.FORCES_UNKNOWN | Quality.PLATFORM_UNKNOWN
EXPLAINS: Final[Mapping[str, Quality]] = {
    "live_marker_gone": Quality.POSE_UNKNOWN | Quality.LIMB_UNSEEN,
    "live_stream_silent": WITHOUT_SAMPLES,
    "live_stamps_repeat": WITHOUT_SAMPLES,
}
"""Note -> why frames are not used where it holds: then the note has the sentence."""
URGENCY: Final[Sequence[Colour]] = ("good", "look", "stop")


@dataclass(frozen=True, slots=True)
class Light:
    """The light: its colour, and one sentence."""

    colour: Colour
    sentence: str


@dataclass(frozen=True, slots=True)
class LiveState:
    """What a session is like now.

    Attributes
    ----------
    used, required
        Gait cycles, or steps: how many are used so far, and how many the session is for.
    noun
        "gait cycles" or "steps".
    steady
        Whether frames have come for more than two seconds.
    notes
        What is wrong now.
    not_used
        Reason -> share of the frames of the last two seconds that are not used for it.
    sides
        Marker -> "left" or "right"; those in the middle are absent.
    """

    used: int
    required: int
    noun: str = "gait cycles"
    steady: bool = True
    notes: Sequence[Note] = ()
    not_used: Mapping[Quality, float] = field(default_factory=dict)
    sides: Mapping[str, str] = field(default_factory=dict)


def light(state: LiveState) -> Light:
    """Give the light of a session: of all that is wrong, the most urgent has the sentence.

    Good: nothing to do. Look: the measurement goes on, with a fault that is worth mending. Stop:
    what is measured now cannot be used.

    Examples
    --------
    >>> light(LiveState(12, 25))
    Light(colour='good', sentence='12 of 25 gait cycles used')
    >>> gone = Note.of("live_marker_gone", marker="LASIS", gone_s=0.5)
    >>> light(LiveState(12, 25, notes=[gone], sides={"LASIS": "left"}))
    Light(colour='look', sentence='LASIS is hidden: turn the left camera or re-attach the marker')
    """
    shares = state.not_used if state.steady else {}
    reasons = {r: share for r in OF_FRAMES if (share := shares.get(r, 0.0)) > SOME}
    codes = {note.code for note in state.notes}
    if Quality.NOT_CARRIED in reasons:
        codes.discard("live_weight_differs")  # its cause is known
    found = list[Light]()
    for code in (code for code in OF_NOTES if code in codes):
        colour, sentence = _of_note(code, state)
        explained = [r for r in reasons if r in EXPLAINS.get(code, Quality(0))]
        if any(reasons.pop(reason) > MOST for reason in explained):
            colour = "stop"
        found.append(Light(colour, sentence))
    for reason, share in reasons.items():
        settles = reason is Quality.SETTLING or share <= MOST
        found.append(Light("look" if settles else "stop", OF_FRAMES[reason]))
    if not state.steady and not found:
        return Light("look", "Starting: wait for two seconds of frames")
    done = f"{state.used} of {state.required} {state.noun} used"
    good = Light("good", f"{done}: end with Ctrl-C" if state.used >= state.required else done)
    most = max((*found, good), key=lambda each: URGENCY.index(each.colour))
    more = f" (+{len(found) - 1} more)" * (len(found) > 1)
    return Light(most.colour, f"{most.sentence}{more}")


def _of_note(code: str, state: LiveState) -> tuple[Colour, str]:
    """Give colour and sentence of the notes of a code."""
    notes = [note for note in state.notes if note.code == code]
    colour: Colour = "stop" if code in STOPPING else "look"
    if code == "live_marker_gone":
        return colour, _hidden([str(note.values["marker"]) for note in notes], state.sides)
    values = dict[str, object](notes[0].values)
    for name, value in notes[0].values.items():
        if isinstance(value, Mapping):
            values[name] = listed(value)
        elif isinstance(value, float) and name.endswith(("_s", "_m")):
            values[f"{name[:-1]}m{name[-1]}"] = 1000 * value
    if code == "live_markers_misfit" and values["left_out"] != "none":
        return "look", f"Markers are not where they were: re-attach {values['left_out']}"
    return colour, OF_NOTES[code].format_map(values)


def _hidden(markers: Sequence[str], sides: Mapping[str, str]) -> str:
    """Say which markers are hidden, and what to do."""
    several = len(markers) > 1
    names = listed(markers) if len(markers) <= 3 else f"{len(markers)} markers"
    of = {sides.get(marker, "") for marker in markers}
    side = f"{of.pop()} " if len(of) == 1 and all(of) else ""
    return (
        f"{names} {'are' if several else 'is'} hidden: turn the {side}camera or re-attach the "
        f"marker{'s' if several else ''}"
    )


def marker_sides(body: Body) -> dict[str, str]:
    """Give the side of each marker that is not in the middle of the body."""
    sides = {}
    for name, segment, place in zip(
        body.markers, body.marker_segment, body.marker_position, strict=True
    ):
        if segment.startswith(("left", "right")):
            sides[name] = segment.split("_")[0]
        elif abs(place[1]) > MIDDLE_M:
            sides[name] = "left" if place[1] > 0 else "right"
    return sides
