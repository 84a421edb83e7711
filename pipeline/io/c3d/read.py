"""C3D files -> Recording: units, axes, labels and plates are settled here, once."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np

from hbm.calibration_pose.anatomy import LimbMeasures
from hbm.coordinates import SIDES
from hbm.markers import recognise_marker_set
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.spatial import Array, frozen
from hbm.spelling import short
from pipeline.io.axes import settle_axes
from pipeline.io.c3d.data import BY_HEADER, BY_TRIAL, Header, read_header, read_samples
from pipeline.io.c3d.force_plates import PlateLayout, plate_layouts
from pipeline.io.c3d.parameters import Parameters, Value
from pipeline.io.columns import FileMarkers, recording_of, settle_markers
from pipeline.io.input_file import naming
from pipeline.io.labels import numbered, without_prefixes
from pipeline.io.mended_plates import mended_plates
from pipeline.io.read_options import ReadOptions, as_stated
from pipeline.io.recording import (
    Analog,
    Compensation,
    Event,
    Fact,
    Metadata,
    Plate,
    PlateFrame,
    Recording,
    impossible_samples,
    saying,
)

KINDS: Final = {
    **dict.fromkeys(
        ("footstrike", "heelstrike", "initialcontact", "fs", "hs", "ic"), "foot_strike"
    ),
    **dict.fromkeys(("footoff", "toeoff", "fo", "to"), "foot_off"),
}
"""Letters of a label without its side -> kind of event."""
SIDE_WORDS: Final = {"left": "left", "l": "left", "right": "right", "r": "right"}
LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "persons")
GROUP: Final = "HBM_RESIDUALS"
OF_SUBJECT: Final = {
    "mass_kg": ("BODYMASS", 1.0, 5.0, 500.0),
    "height_m": ("HEIGHT", 1e-3, 0.3, 2.7),
}
OF_LIMB: Final = {
    "leg_length_m": ("LEGLENGTH", 1e-3, 0.1, 1.5),
    "knee_width_m": ("KNEEWIDTH", 1e-3, 0.01, 0.5),
    "ankle_width_m": ("ANKLEWIDTH", 1e-3, 0.01, 0.5),
    "elbow_width_m": ("ELBOWWIDTH", 1e-3, 0.01, 0.3),
    "wrist_width_m": ("WRISTWIDTH", 1e-3, 0.01, 0.2),
    "hand_thickness_m": ("HANDTHICKNESS", 1e-3, 0.005, 0.1),
    "shoulder_offset_m": ("SHOULDEROFFSET", 1e-3, 0.005, 0.2),
}
"""Attribute -> PROCESSING parameter, without the L or R before it, factor to SI from the file's kg
and mm, and bounds beyond which it is not stated (zero) or in another unit [kg or m]."""


def sort_labels(
    header: Header, options: ReadOptions
) -> tuple[dict[int, str], dict[str, int], list[Note | Fact]]:
    """Separate markers from outputs of other programs, and remove subject prefixes.

    Parameters
    ----------
    header
        Of the file.
    options
        What a person states about labels.

    Returns
    -------
    markers
        Index of the point -> label.
    outputs
        Name -> index of the point.
    notes
        As `pipeline.io.labels.without_prefixes` gives them, with its errors.

    Notes
    -----
    Outputs are the points listed in POINT:ANGLES, MOMENTS and the like, those so named, and
    Vicon's segment frames: four points named by one stem and O, A, L, P.
    """
    parameters, n_points = header.parameters, header.frame.points
    labels = parameters.texts("POINT", "LABELS")[:n_points]
    labels += [""] * (n_points - len(labels))
    labels = [label or f"unlabelled_{k + 1}" for k, label in enumerate(labels)]
    bare, notes = without_prefixes(labels, options)
    groups = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "REACTIONS", "SCALARS", "MODELED_MARKERS")
    computed = {name for group in groups for name in parameters.texts("POINT", group)}
    names = {*bare.values()}
    # a segment frame has four points: origin, anterior, lateral, proximal
    for stem in {name[:-1] for name in names if len(name) > 1}:
        frame = {stem + suffix for suffix in "OALP"}
        computed |= frame if frame <= names else set()
    of_outputs = re.compile(r"(Angles?|Moments?|Forces?|Powers?|NormalisedGRF)$")
    computed |= {*filter(of_outputs.search, names)}
    outputs = {k: name for k, name in bare.items() if {labels[k], name} & computed}
    return {k: n for k, n in bare.items() if k not in outputs}, numbered(outputs), notes


def read_events(header: Header, start_s: float) -> tuple[tuple[Event, ...], list[Note | Fact]]:
    """Give the foot strikes and foot offs of a file, on the clock of its first frame.

    ``start_s`` is the time of that frame on the file's own clock [s]. The note ``events_left_out``
    where there are others; a Fact where `merge_events` joins some. A ValueError where EVENT:TIMES
    holds neither minutes and seconds nor seconds of the events.
    """
    parameters = header.parameters
    times = parameters.numbers("EVENT", "TIMES")
    labels = [label for label, _ in header.events]
    contexts: list[str] = []
    seconds = np.array([time for _, time in header.events])
    if times.size:
        labels, contexts = (parameters.texts("EVENT", name) for name in ("LABELS", "CONTEXTS"))
        seconds = _seconds(times, len(labels))
    events = []
    texts = zip_longest(labels, contexts, [""] * len(seconds), fillvalue="")
    for time, (label, context, _) in zip(seconds.tolist(), texts, strict=False):
        kind, side = kind_and_side(label)
        by_context = SIDE_WORDS.get(context.lower(), "")
        if kind and np.isfinite(time) and (side or by_context) and side in ("", by_context or side):
            events.append(Event(time - start_s, kind, by_context or side))
    single, facts = merge_events(events)
    others = len(seconds) - len(events)
    return single, [*facts, *([Note.of("events_left_out", events=others)] if others else [])]


def merge_events(events: Sequence[Event]) -> tuple[tuple[Event, ...], list[Fact]]:
    """Take events of one kind and foot that no swing can part as one.

    A foot is on the ground from the first of such strikes to the last of such foot offs.

    Examples
    --------
    >>> twice = [Event(1.0, "foot_strike", "left"), Event(1.02, "foot_strike", "left")]
    >>> events, facts = merge_events(twice)
    >>> len(events), facts[0].of
    (1, '1 of 2 gait events')
    """
    last_s, single = dict[tuple[str, str], float](), list[Event]()
    # strikes in the order of time, foot offs backwards: the first of each is kept
    signs = {"foot_strike": 1, "foot_off": -1}
    for event in sorted(events, key=lambda event: signs[event.label] * event.time):
        foot = event.label, event.side
        if abs(event.time - last_s.get(foot, np.inf)) >= LIMITS.shortest_swing:
            last_s[foot] = event.time
            single.append(event)
    reason = f"less than {LIMITS.shortest_swing:g} s from another one of the same kind and foot"
    joined = Fact("joined", f"{len(events) - len(single)} of {len(events)} gait events", reason)
    return tuple(single), [joined] * (len(single) < len(events))


def _seconds(times: Array, labelled: int) -> Array:
    """Give the times of the events [s]: minutes and seconds in two rows or in turn, or seconds."""
    if times.ndim == 2 and len(times) == 2:
        return np.asarray(60 * times[0] + times[1])
    flat = times.ravel(order="F")
    if len(flat) == 2 * labelled and (flat[::2] % 1 == 0).all():
        return 60 * flat[::2] + flat[1::2]
    if len(flat) == labelled or not labelled:
        return flat
    raise ValueError(
        f"EVENT:TIMES holds {len(flat)} numbers for {labelled} labels, expected minutes and "
        "seconds of each event; correct the events in the capture software, or delete them to use "
        "those that the markers show"
    )


def kind_and_side(label: str) -> tuple[str, str]:
    """Give kind and side that a label states, such as "Left Foot Strike" or "RHS"; "" if not."""
    side, kind = "|".join(SIDE_WORDS), "|".join(KINDS)
    words = "".join(re.findall("[a-z]", label.lower()))
    match = re.fullmatch(rf"(?P<before>{side})?(?P<kind>{kind})(?P<after>{side})?", words)
    if match is None:
        return "", ""
    sides = {SIDE_WORDS[word] for word in (match["before"], match["after"]) if word}
    return (KINDS[match["kind"]], "".join(sides)) if len(sides) < 2 else ("", "")


def compensation_group(compensation: Compensation) -> dict[str, Value]:
    """Give the group's parameters; what is not known is left out."""
    values = {f.name.upper(): getattr(compensation, f.name) for f in fields(compensation)}
    members: dict[str, Value] = {n: v for n, v in values.items() if isinstance(v, str) and v}
    members["PLATES"] = np.array(compensation.plates, int)
    if compensation.cutoff_hz is not None:
        members["CUTOFF_HZ"] = np.array([compensation.cutoff_hz])
    return members


def read_compensation(parameters: Parameters) -> Compensation | None:
    """Read what was subtracted from a file's plates; None where they are as measured.

    A ValueError where the group says something that this version does not know.
    """
    if GROUP not in parameters.groups:
        return None
    names = {field.name for field in fields(Compensation)} - {"plates", "cutoff_hz"}
    texts: dict[str, Any] = {name: parameters.text(GROUP, name.upper()) for name in names}
    if texts["frame"] not in get_args(PlateFrame):
        raise ValueError(
            f"{GROUP}:FRAME is {short(texts['frame'])!r}, expected one of "
            f"{', '.join(get_args(PlateFrame))}; another version of this program wrote it"
        )
    plates = tuple(parameters.integers(GROUP, "PLATES").ravel().tolist())
    cutoff_hz = next(map(float, parameters.numbers(GROUP, "CUTOFF_HZ").flat), None)
    return Compensation(**texts, plates=plates, cutoff_hz=cutoff_hz)


def read_c3d(path: str | Path, options: ReadOptions | str | None = None) -> Recording:
    """Read a C3D file.

    Parameters
    ----------
    path
        The file, of any maker and byte order.
    options
        What is stated about it: axes, units, labels. A text states the axes alone, such as
        ``"left,back,up"``; up is checked against markers and plates. Where they are not stated they
        are inferred, and the notes state them.

    Returns
    -------
    Recording
        SI units, lab axes (X forward, Y left, Z up), the file's own origin. Times start at 0 at
        the first frame. Plate wrenches are the action on the subject, about the centre of the
        plate's surface in the plate's axes. Mass and lengths in the metadata are those of the
        PROCESSING group (kg and mm in the file) where they are plausible in those units.

    Raises
    ------
    ValueError
        The file is not C3D, damaged, truncated, or says something that this reader will not guess:
        unknown units, contradictory rates or axes, ambiguous subjects. One line.
    OSError
        The file cannot be opened.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> recording = pipeline.read_c3d("walk.c3d")
    >>> len(recording.markers.names), recording.plates[0].rate_hz
    (46, 1000.0)
    """
    path = Path(path)
    with naming(path):
        return read_c3d_file(path, as_stated(options).of_file(path.name))


def read_c3d_file(path: Path, options: ReadOptions) -> Recording:
    """Read a C3D file as `read_c3d` does; errors do not name it."""
    header = read_header(path)
    parameters, channels = header.parameters, header.channels
    remarks: list[Note | Fact] = [*header.corrections]
    with saying(remarks):  # those that follow too
        samples = read_samples(header)
        first_frame, wrong_frame = _first_frame(header)
        remarks += [*samples.corrections, *wrong_frame]
        labels, outputs, label_notes = sort_labels(header, options)
        unit = parameters.text("POINT", "UNITS")
        markers = settle_markers(labels, unit, samples.points[:, [*labels]], options, label_notes)
        remarks += markers.notes
        remarks += impossible_samples([name for name, _ in channels], samples.impossible)
        try:
            layouts, of_plates = plate_layouts(header, options, markers.position)
        except ValueError as error:
            raise _with_faults_of_markers(error, markers, options) from error
        remarks += of_plates
        analog_time = np.arange(len(samples.analog)) / samples.analog_rate_hz
        plates = []
        for plate in layouts:
            wrench = frozen(plate.wrench(samples.analog[:, plate.channels]))
            place = plate.rotation, plate.corners.mean(axis=0), plate.corners, plate.units
            lever = -plate.origin if plate.kind in (2, 4) else np.zeros(3)
            plates.append(Plate(plate.number, analog_time, wrench, *place, lever))
        # mended, plates show the axes; the recording keeps them as they are until it is mended
        witnesses = mended_plates(plates, options.mend_plates) if plates else ()
        events, of_events = read_events(header, (first_frame - 1) / samples.rate_hz)
        remarks += of_events
        if events and any(fact.kind == "in_doubt" for fact in wrong_frame):
            raise ValueError(
                f"{wrong_frame[0]}: one of them is wrong, and with it the times of all events; "
                "correct or delete the events in the capture software and export the file again"
            )
        compensation = read_compensation(parameters)
        remarks += _plate_notes(parameters, layouts, compensation)
    taken = {channel for plate in layouts for channel in plate.channels}
    rest = [k for k in range(len(channels)) if k not in taken]
    names, units = (tuple(channels[k][part] for k in rest) for part in (0, 1))
    others = frozen(samples.analog.T.take(rest, axis=0)).T
    return recording_of(
        path,
        options,
        replace(markers, notes=()),
        np.arange(header.frames) / samples.rate_hz,
        placed=plates,
        witnesses=witnesses,
        units=[channels[k][1] for k in sorted(taken)],
        screen_up=parameters.text("POINT", "Y_SCREEN"),
        notes=remarks,
        analog=Analog(analog_time, names, units, others) if rest else None,
        events=events,
        first_frame=first_frame,
        metadata=_metadata(parameters),
        model_outputs={name: samples.points[:, k] for name, k in outputs.items()},
        compensation=compensation,
    )


def _with_faults_of_markers(
    plates: ValueError, markers: FileMarkers, options: ReadOptions
) -> ValueError:
    """Give the fault of plates together with those of labels or axes, which come before it."""
    if len(markers.names) < LIMITS.fewest_markers:  # of plates alone
        return plates
    try:
        if options.marker_set is None:
            recognise_marker_set(markers.names)
        settle_axes(options.axes, markers.position, markers.names, marker_set=options.marker_set)
    except ValueError as error:
        return type(error)(f"{error}; and {plates}")
    return plates


def _first_frame(header: Header) -> tuple[int, list[Fact]]:
    """Give the number of the first frame, of which the header has 16 bits, and what differs.

    Where the number of frames by one of the two places is wrong, the first one of the other counts.
    """
    start = header.parameters.integers("TRIAL", "ACTUAL_START_FIELD").ravel()
    in_header = header.first_frame
    full = int(start @ [1, 65536]) if start.size == 2 else in_header
    if in_header in (0, full, full % 65536, min(full, 65535)):
        return full, []
    wrong = {fact.of for fact in header.corrections}
    by_header, by_trial = BY_HEADER in wrong, BY_TRIAL in wrong
    used = full if by_header and not by_trial else in_header
    places = f"{in_header} by the header, {full} by TRIAL:ACTUAL_START_FIELD, {used} used"
    return used, [Fact("in_doubt" if by_header == by_trial else "corrected", "first frame", places)]


def _metadata(parameters: Parameters) -> Metadata:
    limbs = {
        side: LimbMeasures(**_measures(parameters, letter, OF_LIMB))
        for side, letter in SIDES.items()
    }
    return Metadata(
        **_measures(parameters, "", OF_SUBJECT),
        limbs={side: limb for side, limb in limbs.items() if limb != LimbMeasures()},
    )


def _measures(
    parameters: Parameters, letter: str, table: Mapping[str, tuple[str, float, float, float]]
) -> dict[str, float]:
    """Give measures of the subject in SI units, without those that are absent or implausible."""
    measures = {}
    for attribute, (name, scale, lowest, highest) in table.items():
        for number in parameters.numbers("PROCESSING", letter + name).flat:
            if lowest < number * scale < highest:
                measures[attribute] = float(number * scale)
    return measures


def _plate_notes(
    parameters: Parameters, plates: list[PlateLayout], done: Compensation | None
) -> list[Note]:
    """Note a baseline that is not subtracted, and what was subtracted before."""
    notes = []
    zero = parameters.integers("FORCE_PLATFORM", "ZERO").ravel()
    if plates and zero.size == 2 and 0 < zero[0] < zero[1]:
        notes.append(Note.of("plate_baseline_not_subtracted", first=zero[0], last=zero[1]))
    if done is not None:
        names = done.calibration, done.belts, done.plate_calibration
        notes.append(
            Note.of(
                "plates_compensated_before",
                software=done.software,
                calibrations=tuple(filter(None, names)),
                frame="moving plates" if done.frame == "recorded" else "lab",
            )
        )
    return notes
