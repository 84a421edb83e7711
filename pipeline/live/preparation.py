"""What has to be known before the first frame: the body, the places of plates, the streams."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.model import Body
from hbm.notes import Note
from hbm.plausibility.motion import implausible
from hbm.spatial import GRAVITY_MPS2, Array
from hbm.spelling import listed, short
from pipeline.config.live import Live
from pipeline.config.schema import Settings, SubjectFile, Treadmill
from pipeline.config.study import Study, read_study
from pipeline.config.toml_file import read_segments
from pipeline.io.read import read_recording
from pipeline.io.recording import Plate, Recording
from pipeline.io.stated import Stated
from pipeline.live.replay import ANALOG, MARKERS, PLATES
from pipeline.live.stream import Samples, StatedPlate, StreamDescription
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory, read_calibration
from pipeline.trial.study_files import read_study_laboratory
from pipeline.trial.subject import (
    MAX_STILL_EXTENT_M,
    MIN_MASS_KG,
    body_mass,
    median_extent,
    subject_body,
)

MAX_DISTANCE_M: Final = 0.003
"""Between the centres of one plate: 3 mm change moments by 2 N·m under a body of 75 kg."""
MAX_ANGLE_DEG: Final = 0.5
"""Between its axes: half a degree turns 6 N of the body weight into a horizontal force."""


@dataclass(frozen=True, slots=True)
class PlacedPlates:
    """The plates of a session.

    Attributes
    ----------
    plates
        Where they lie, without samples, in the order of their numbers.
    live
        Which streams and channels are what, with the channels that the streams state.
    notes
        ``live_plate_elsewhere`` for each plate that streams and static recording have at different
        places.
    """

    plates: tuple[Plate, ...]
    live: Live
    notes: tuple[Note, ...] = ()


def place_plates(
    stated: Sequence[StatedPlate], static: Recording | None, live: Live
) -> PlacedPlates:
    """Find out where the plates lie, and which channels are theirs.

    Parameters
    ----------
    stated
        As the streams describe them.
    static
        Recording of the calibration pose, if there is one.
    live
        As the study states it; what it states of channels counts more than what streams state.

    Returns
    -------
    PlacedPlates
        A place that a stream states counts more than that of the static recording: it is of now,
        and of the axes in which the stream's own channels are. Where the study names other channels
        for the plate, it does not count.

    Raises
    ------
    ValueError
        Neither knows a place, or several streams state one plate's.

    Examples
    --------
    >>> time, still = np.empty(0), np.empty((0, 6))
    >>> corners = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / 4
    >>> plate = Plate(1, time, still, np.eye(3), np.zeros(3), corners)
    >>> channels = ("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1")
    >>> found = place_plates([StatedPlate("1", channels, plate)], None, Live())
    >>> found.plates[0].center.tolist(), found.live.channels_of(1)[2]
    ([0.0, 0.0, 0.0], 'Fz1')
    """
    used = [each for each in stated if live.plates.get(each.number, each.channels) == each.channels]
    placed = [each.number for each in used if each.place is not None]
    if several := sorted({number for number in placed if placed.count(number) > 1}):
        raise ValueError(f"several streams state the place of plate {listed(several)}")
    recorded = {str(plate.number): plate.place for plate in static.plates} if static else {}
    received = {each.number: each.place for each in used if each.place is not None}
    places = recorded | received
    if not places:
        raise ValueError(_unknown(stated, static))
    channels = {each.number: each.channels for each in stated if each.channels}
    file = static.source.name if static is not None else ""
    return PlacedPlates(
        tuple(sorted(places.values(), key=lambda plate: plate.number)),
        live.model_copy(update={"plates": channels | live.plates}),
        _elsewhere(received, recorded, file),
    )


def _elsewhere(
    received: Mapping[str, Plate], recorded: Mapping[str, Plate], file: str
) -> tuple[Note, ...]:
    """Compare the places of plates that are stated twice."""
    notes = []
    for number in sorted(received.keys() & recorded.keys()):
        now, then = received[number], recorded[number]
        if not (np.isfinite(now.corners).all() and np.isfinite(then.corners).all()):
            continue  # of one only the wrench about the lab's origin is known, not its place
        distance_m = float(np.linalg.norm(now.center - then.center))
        cosine = (np.trace(now.rotation.T @ then.rotation) - 1) / 2
        angle_deg = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
        if distance_m > MAX_DISTANCE_M or angle_deg > MAX_ANGLE_DEG:
            values = {"distance_m": distance_m, "angle_deg": angle_deg}
            notes.append(Note.of("live_plate_elsewhere", plate=number, **values, file=file))
    return tuple(notes)


def _unknown(stated: Sequence[StatedPlate], static: Recording | None) -> str:
    """Say why no place is known, and what to do."""
    why = [f"plate {short(each.number)}: {each.problem}" for each in stated if each.problem]
    streams = "; ".join(why) or "the streams state none (desc/plates/plate)"
    file = "no static file is stated" if static is None else f"{static.source.name} has none"
    return (
        f"the places of the plates are not known: {streams}; {file}; state a recording that has "
        "them: --static FILE, or static in the subject's file"
    )


POSE_S: Final = 1.2
"""A second of standing still, in which the body is built and weighed, and a little more."""
EVERY_S: Final = 0.1
"""Between looks."""


class PoseFinder:
    """Watches streams until a subject stands still on the plates, with all markers in sight.

    Parameters
    ----------
    live
        Which streams and channels are what.
    streams
        What is received.
    plates
        Places of the plates.

    Attributes
    ----------
    why_not
        What is amiss as long as no pose is found, in words.
    """

    def __init__(
        self, live: Live, streams: Sequence[StreamDescription], plates: Sequence[Plate]
    ) -> None:
        self._streams = {stream.name: stream for stream in streams}
        self._markers = live.markers or next(s.name for s in streams if s.kind == "markers")
        self._live, self._plates = live, plates
        self._kept: dict[str, deque[Samples]] = {stream.name: deque() for stream in streams}
        self._looked_s = -np.inf
        self.why_not = f"stream {self._markers} has sent too few frames"

    def add(self, samples: Samples) -> Recording | None:
        """Take what arrived; give the pose's recording once the last 1.2 s show it."""
        kept = self._kept.get(samples.stream)
        if kept is None or not len(samples.time):
            return None
        kept.append(samples)
        while samples.time[-1] - kept[0].time[-1] > POSE_S:
            kept.popleft()
        if samples.stream != self._markers or samples.time[-1] - self._looked_s < EVERY_S:
            return None
        self._looked_s = float(samples.time[-1])
        return self._pose()

    def _pose(self) -> Recording | None:
        time, position = self._joined(self._markers)
        if time[-1] - time[0] < POSE_S - EVERY_S:
            return None
        names = self._streams[self._markers].labels
        markers = Markers(time - time[0], names, position.reshape(len(time), len(names), 3))
        seen = np.isfinite(markers.position).all(axis=(0, 2))
        if not seen.any():
            self.why_not = "no marker is seen all the time"
            return None
        extent_m = median_extent(markers.position[:, seen])
        if extent_m > MAX_STILL_EXTENT_M:
            self.why_not = (
                f"the markers moved by {1000 * extent_m:.0f} mm within {POSE_S:g} s, at most "
                f"{1000 * MAX_STILL_EXTENT_M:.0f} mm are standing still"
            )
            return None
        plates = [self._plate(plate, float(time[0])) for plate in self._plates]
        standing = [plate for plate in plates if plate is not None]
        carried_n = sum(float(np.mean(plate.wrench[:, 2])) for plate in standing)
        if len(standing) < len(plates):
            self.why_not = "a plate has sent nothing"
            return None
        if not carried_n >= MIN_MASS_KG * GRAVITY_MPS2:
            self.why_not = f"the plates carry {carried_n:.0f} N, which is nobody"
            return None
        return Recording(Path("calibration pose"), markers, tuple(standing))

    def _plate(self, plate: Plate, start_s: float) -> Plate | None:
        """Give a plate with what it read lately; None where it sends nothing."""
        channels = self._live.channels_of(plate.number)
        for stream in self._streams.values():
            if set(channels) <= set(stream.labels) and self._kept[stream.name]:
                time, values = self._joined(stream.name)
                columns = [stream.labels.index(channel) for channel in channels]
                wrench = values[:, columns]
                return replace(plate, time=time - start_s, wrench_in_plate=wrench)
        return None

    def _joined(self, stream: str) -> tuple[Array, Array]:
        kept = self._kept[stream]
        time = np.concatenate([samples.time for samples in kept])
        values = np.concatenate([samples.values for samples in kept])
        order = np.unique(time, return_index=True)[1]
        return time[order], values[order]


@dataclass(frozen=True, slots=True)
class PreparedBody:
    """A body, and what is to be said of it."""

    body: Body
    notes: tuple[Note, ...]


@dataclass(frozen=True, slots=True)
class Preparation:
    """What is stated about a session.

    Attributes
    ----------
    study
        The study; None where only files are stated.
    person
        Who walks, and that person's files.
    settings, live, laboratory
        How frames are computed, what streams are, the treadmill and its calibrations.
    static
        Recording of the calibration pose; None where the subject shows it live.
    """

    study: Study | None
    person: SubjectFile
    settings: Settings
    live: Live
    laboratory: Laboratory
    static: Recording | None

    @property
    def stated(self) -> Stated:
        """What is stated of axes, labels and units."""
        return self.study.stated if self.study is not None else Stated()

    @property
    def notes(self) -> tuple[Note, ...]:
        """What is to be said of the treadmill and its calibration."""
        notes, calibration = self.laboratory.notes, self.laboratory.calibration
        if calibration is None:
            return notes
        level = self.laboratory.treadmill.platform is None
        return (
            *calibration.notes,
            *notes,
            *([Note.of("platform_taken_as_level")] if level else []),
        )

    @property
    def streams(self) -> tuple[str, tuple[str, ...]]:
        """Names of the stream of markers and of the others, as stated or as replays call them."""
        treadmill, stated = self.laboratory.treadmill, self.live
        channels = treadmill.platform is not None and bool(treadmill.platform.channels)
        needed = bool(treadmill.accelerometers) or treadmill.belt is not None or channels
        return stated.markers or MARKERS, stated.analog or (PLATES, *[ANALOG] * needed)

    def placed(self, stated: Sequence[StatedPlate]) -> PlacedPlates:
        """Place the plates that streams describe, as `pipeline.live.preparation.place_plates`."""
        return place_plates(stated, self.static, self.live)

    def body(self, pose: Recording | None = None) -> PreparedBody:
        """Build the subject's body.

        Parameters
        ----------
        pose
            Recording of the calibration pose; by default the static file.

        Raises
        ------
        ValueError
            As `pipeline.trial.subject.subject_body`; or the mass is not known.
        """
        pose = pose or self.static
        if pose is None:
            raise ValueError("no calibration pose: state --static FILE, or show it live: --pose")
        pose = with_corrected_plates(pose, self.laboratory.plates)
        subject, study = self.person.person, self.study
        mass = body_mass(subject, pose)
        hip_trial = self.person.hip_trial
        segments = self.person.segments
        body = subject_body(
            pose,
            subject,
            self.settings,
            mass.mass_kg,
            marker_set=study.marker_set if study else None,
            hip_trial=read_recording(study.path(hip_trial), self.stated)
            if study and hip_trial
            else None,
            segments=read_segments(study.path(segments)) if study and segments else None,
        )
        return PreparedBody(body, (mass.note, *body.notes, *implausible(body)))


def prepare(
    study: Path | None,
    subject: str | None,
    static: Path | None = None,
    calibration: Path | None = None,
) -> Preparation:
    """Read what is stated about a session.

    Parameters
    ----------
    study
        Folder of a study or its ``study.toml``.
    subject
        Its subject; may be left out where there is one.
    static
        Recording of the calibration pose; by default the subject's.
    calibration
        The moving treadmill's, which needs a study; by default the study's.

    Raises
    ------
    ValueError, OSError
        If a file cannot be read or used, it is not clear who the subject is, or a calibration is
        stated without the study that says where the platform is.
    """
    if study is None:
        if subject is not None:
            raise ValueError(f"--subject {subject} needs the study: --study FOLDER")
        if calibration is not None:
            raise ValueError(
                f"--calibration {calibration.name} needs the study: its [treadmill.platform] says "
                "by which markers or channels the platform is brought to the lab; state --study "
                "FOLDER"
            )
        recording = read_recording(static, Stated()) if static else None
        person, still = SubjectFile(id="subject", trials={}), Laboratory(Treadmill())
        return Preparation(None, person, Settings(), Live(), still, recording)
    read = read_study(study.parent if study.is_file() else study, recordings=False)
    person = read.subject(subject) if subject else _only_subject(read)
    laboratory = read_study_laboratory(read)
    if calibration is not None:
        fitted = read_calibration(calibration, read.file.treadmill, read.stated, laboratory.plates)
        laboratory = replace(laboratory, calibration=fitted)
    path = static or (read.path(person.static) if person.static else None)
    recording = read_recording(path, read.stated) if path else None
    return Preparation(read, person, read.file.settings, read.file.live, laboratory, recording)


def _only_subject(study: Study) -> SubjectFile:
    if len(study.subjects) != 1:
        raise ValueError(
            f"the study has {len(study.subjects)} subjects; state who walks: --subject, one of "
            f"{', '.join(study.subjects)}"
        )
    return next(iter(study.subjects.values()))
