"""C3D files -> Recording: units, axes, labels and plates are settled here, once.

The file is parsed here (`header`, `data`): every count and offset is checked against the file's
size before it is used, so that a damaged file gives one line of error. The native library ezc3d
1.7.2 is a second reader only (`second_reader`). Of the sample files it refuses the SGI ones and
takes 34 s and 12.6 GB to refuse one with a broken parameter section; it reads a truncated file
short without a warning, and one in 400 files with random damage ends the interpreter.
"""

from pathlib import Path
from typing import Final

import numpy as np

from hbm.calibration_pose.anatomy import LimbMeasures
from hbm.coordinates import SIDES
from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array, frozen
from pipeline.io.axes import mean_force, parse_axes, settle_axes
from pipeline.io.c3d.compensation import read_compensation
from pipeline.io.c3d.data import Samples, missing_share, read_samples
from pipeline.io.c3d.events import read_events
from pipeline.io.c3d.force_plates import PlateLayout, plate_layouts
from pipeline.io.c3d.header import Header, read_header
from pipeline.io.c3d.labels import PointLabels, channel_labels, sort_labels
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.input_file import naming
from pipeline.io.recording import Analog, Compensation, Metadata, Plate, Preview, Recording
from pipeline.io.stated import Stated, as_stated

BEGINNING_FRAMES: Final = 1000
"""Ten seconds at 100 Hz: enough gait to infer axes, weigh the subject and find events."""
SAMPLED_FRAMES: Final = 500
"""Frames in which missing markers are counted: shares are known to 2 % (one SD of 0.5 at most)."""
MEASURES: Final = {
    "BODYMASS": (1.0, 5.0, 500.0),
    "HEIGHT": (1e-3, 0.3, 2.7),
    "LEGLENGTH": (1e-3, 0.1, 1.5),
    "KNEEWIDTH": (1e-3, 0.01, 0.5),
    "ANKLEWIDTH": (1e-3, 0.01, 0.5),
    "ELBOWWIDTH": (1e-3, 0.01, 0.3),
    "WRISTWIDTH": (1e-3, 0.01, 0.2),
    "HANDTHICKNESS": (1e-3, 0.005, 0.1),
    "SHOULDEROFFSET": (1e-3, 0.005, 0.2),
}
"""PROCESSING parameter, without the L or R before it -> factor to SI from the file's kg and mm, and
bounds beyond which it is not stated (zero) or in another unit [kg or m]."""


def read_c3d(
    path: str | Path, stated: Stated | str | None = None, *, max_frames: int | None = None
) -> Recording:
    """Read a C3D file.

    Parameters
    ----------
    path
        The file, of any maker and byte order.
    stated
        What is stated about it: axes, units, labels. A text states the axes alone, such as
        ``"left,back,up"``; up is checked against markers and plates. Where they are not stated they
        are inferred, and the notes state them.
    max_frames
        Read no more than these first frames; by default all.

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
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> recording = pipeline.read_c3d("walk.c3d")
    >>> len(recording.markers.names), recording.plates[0].rate_hz
    (46, 1000.0)
    """
    path = Path(path)
    with naming(path):
        return _read(path, as_stated(stated), max_frames)


def preview_c3d(path: Path, stated: Stated) -> Preview:
    """Preview a C3D file without reading all of it; parameters and errors are `read_c3d`'s."""
    beginning = read_c3d(path, stated, max_frames=BEGINNING_FRAMES)
    header, parameters = read_header(path)
    share = missing_share(path, header, SAMPLED_FRAMES)
    markers = sort_labels(parameters, header.n_points, stated).markers
    missing = {name: float(share[k]) for name, k in markers.items()}
    return Preview(beginning, header.frames, missing)


def _read(path: Path, stated: Stated, max_frames: int | None) -> Recording:
    header, parameters = read_header(path)
    samples = read_samples(path, header, parameters, max_frames)
    labels = sort_labels(parameters, header.n_points, stated)
    unit = parameters.text("POINT", "UNITS")
    metre, unit_notes = stated.marker_unit(unit) if labels.markers else (1.0, ())
    names, units = channel_labels(parameters, header.channels)
    plates, plate_notes = plate_layouts(parameters, names, units, stated)
    wrenches = [plate.wrench(samples.analog[:, plate.channels]) for plate in plates]

    position = samples.points[:, list(labels.markers.values())]
    position *= metre
    stated.check_span(position, unit)
    axes, axes_notes = settle_axes(
        stated.axes,
        position,
        tuple(labels.markers),
        marker_set=stated.marker_set,
        plate_normals=[plate.rotation[:, 2] for plate in plates],
        plate_forces=[
            plate.rotation @ mean_force(wrench[:, :3])
            for plate, wrench in zip(plates, wrenches, strict=True)
        ],
        screen_up=parameters.text("POINT", "Y_SCREEN"),
    )
    to_lab = parse_axes(axes)
    in_lab = np.moveaxis(frozen(to_lab @ np.moveaxis(position, 0, -1)), -1, 0)
    time = np.arange(len(position)) / samples.rate_hz
    analog_time = np.arange(len(samples.analog)) / samples.analog_rate_hz
    first_frame, frame_notes = _first_frame(header, parameters)
    events, event_notes = read_events(header, parameters, (first_frame - 1) / samples.rate_hz)
    if events and frame_notes:
        raise ValueError(
            f"{frame_notes[0]}: one of them is wrong, and with it the times of all events; correct "
            "or delete the events in the capture software and export the file again"
        )
    compensation = read_compensation(parameters)
    return Recording(
        source=path,
        markers=Markers(time, tuple(labels.markers), in_lab),
        plates=tuple(
            _plate(plate, wrench, analog_time, to_lab)
            for plate, wrench in zip(plates, wrenches, strict=True)
        ),
        analog=_other_channels(samples, names, units, plates, analog_time),
        events=events,
        first_frame=first_frame,
        metadata=_metadata(parameters, labels),
        model_outputs={name: samples.points[:, k] for name, k in labels.outputs.items()},
        compensation=compensation,
        stated=stated,
        notes=(
            *axes_notes,
            *header.notes,
            *samples.notes,
            *unit_notes,
            *labels.notes,
            *frame_notes,
            *event_notes,
            *plate_notes,
            *_baseline_notes(parameters, plates),
            *_compensation_notes(compensation),
        ),
    )


def _plate(layout: PlateLayout, wrench: Array, time: Array, to_lab: Array) -> Plate:
    corners = layout.corners @ to_lab.T
    return Plate(
        number=layout.number,
        time=time,
        wrench_in_plate=frozen(wrench),
        rotation=to_lab @ layout.rotation,
        center=corners.mean(axis=0),
        corners=corners,
    )


def _other_channels(
    samples: Samples, names: list[str], units: list[str], plates: list[PlateLayout], time: Array
) -> Analog | None:
    taken = {channel for plate in plates for channel in plate.channels}
    rest = [k for k in range(len(names)) if k not in taken]
    if not rest:
        return None
    return Analog(
        time,
        tuple(names[k] for k in rest),
        tuple(units[k] for k in rest),
        frozen(samples.analog.T.take(rest, axis=0)).T,
    )


def _first_frame(header: Header, parameters: Parameters) -> tuple[int, tuple[Note, ...]]:
    """Give the number of the first frame, of which the header has 16 bits, and what differs."""
    start, in_header = (
        parameters.integers("TRIAL", "ACTUAL_START_FIELD").ravel(),
        header.first_frame,
    )
    if start.size != 2:
        return in_header, ()
    full = int(start[0] + 65536 * start[1])
    if in_header in (0, full % 65536, min(full, 65535)):
        return full, ()
    return in_header, (Note.of("first_frame_contradicted", header=in_header, trial=full),)


def _metadata(parameters: Parameters, labels: PointLabels) -> Metadata:
    software = parameters.texts("MANUFACTURER", "SOFTWARE")
    software += parameters.texts("MANUFACTURER", "VERSION_LABEL")
    return Metadata(
        subject=parameters.text("SUBJECTS", "NAMES") or labels.subject,
        marker_set=parameters.text("SUBJECTS", "MARKER_SETS"),
        manufacturer=parameters.text("MANUFACTURER", "COMPANY"),
        software=" ".join(software),
        mass_kg=_measure(parameters, "BODYMASS"),
        height_m=_measure(parameters, "HEIGHT"),
        limbs=_limbs(parameters),
    )


def _limbs(parameters: Parameters) -> dict[str, LimbMeasures]:
    """Give what was measured on each side, for the sides of which anything was."""
    limbs = {
        side: LimbMeasures(
            leg_length_m=_measure(parameters, "LEGLENGTH", letter),
            knee_width_m=_measure(parameters, "KNEEWIDTH", letter),
            ankle_width_m=_measure(parameters, "ANKLEWIDTH", letter),
            elbow_width_m=_measure(parameters, "ELBOWWIDTH", letter),
            wrist_width_m=_measure(parameters, "WRISTWIDTH", letter),
            hand_thickness_m=_measure(parameters, "HANDTHICKNESS", letter),
            shoulder_offset_m=_measure(parameters, "SHOULDEROFFSET", letter),
        )
        for side, letter in SIDES.items()
    }
    return {side: measures for side, measures in limbs.items() if measures != LimbMeasures()}


def _measure(parameters: Parameters, name: str, letter: str = "") -> float | None:
    """Give a measure of the subject in SI units; None where it is absent or implausible."""
    scale, lowest, highest = MEASURES[name]
    numbers = parameters.numbers("PROCESSING", letter + name)
    values = [float(value * scale) for value in numbers.flat]
    plausible = [value for value in values if lowest < value < highest]
    return plausible[-1] if plausible else None


def _baseline_notes(parameters: Parameters, plates: list[PlateLayout]) -> list[Note]:
    zero = parameters.integers("FORCE_PLATFORM", "ZERO").ravel()
    if plates and zero.size == 2 and 0 < zero[0] < zero[1]:
        return [Note.of("plate_baseline_not_subtracted", first=zero[0], last=zero[1])]
    return []


def _compensation_notes(done: Compensation | None) -> list[Note]:
    if done is None:
        return []
    return [
        Note.of(
            "plates_compensated_before",
            software=done.software,
            calibrations=tuple(
                filter(None, (done.calibration, done.belts, done.plate_calibration))
            ),
            frame="moving plates" if done.frame == "recorded" else "lab",
        )
    ]
