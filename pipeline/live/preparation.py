"""What has to be known before the first frame: the body, the places of plates, the streams."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np

from hbm.markers import Markers
from hbm.model import Body
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.plausibility.motion import implausible
from hbm.spatial import GRAVITY_MPS2
from hbm.spelling import short
from pipeline.config.live import Live
from pipeline.config.schema import Condition, StudyFile, SubjectFile
from pipeline.config.study import Study, read_study
from pipeline.io.read import read_recording
from pipeline.io.recording import Plate, Recording
from pipeline.live.chain import stated_streams
from pipeline.live.ground import PLATE_UNITS, AnalogStreams, SampleBuffer
from pipeline.live.replay import ANALOG, MARKERS, PLATES
from pipeline.live.stream import Arrivals, DescribedPlate, Samples, StreamDescription
from pipeline.trial.chain import Chain
from pipeline.trial.ground.calibrations import read_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.ground.platform import LEVEL
from pipeline.trial.inputs import Inputs
from pipeline.trial.study_files import read_body_files, read_study_laboratory
from pipeline.trial.subject import LIMITS as SUBJECT
from pipeline.trial.subject import median_extent

LIMITS: Final = read_numbers("pipeline.live", "thresholds.toml", "preparation")


class PlacedPlates(NamedTuple):
    """Plates without samples in the order of their numbers, their channels, and what is noted."""

    plates: tuple[Plate, ...]
    live: Live
    notes: tuple[Note, ...]


def place_plates(
    described: Sequence[DescribedPlate], static: Recording | None, live: Live
) -> PlacedPlates:
    """Find out where the plates lie, and which channels are theirs.

    A place that a stream states counts more than that of the static recording: it is of now, and of
    the axes in which the stream's own channels are; one that differs is noted. Where the study
    names other channels for the plate, it does not count. A ValueError says that neither knows a
    place, or that several streams state one plate's.
    """
    received = dict[str, Plate]()
    for one in described:
        if one.place is None or live.plates.get(one.number, one.channels) != one.channels:
            continue
        if one.number in received:
            raise ValueError(f"several streams give the place of plate {one.number}")
        received[one.number] = one.place
    recorded = {str(plate.number): plate.place for plate in static.plates} if static else {}
    places = recorded | received
    if not places:
        why = (f"plate {short(one.number)}: {one.problem}" for one in described if one.problem)
        streams = "; ".join(why) or "the streams have none (desc/plates/plate)"
        file = "no static file is given" if static is None else f"{static.source.name} has none"
        raise ValueError(
            f"the places of the plates are not known: {streams}; {file}; give a recording that "
            "has them: --static FILE, or static in the subject's file"
        )
    channels = {one.number: one.channels for one in described if one.channels}
    plates = tuple(sorted(places.values(), key=lambda plate: plate.number))
    notes = _elsewhere(received, recorded, static.source.name) if static else ()
    return PlacedPlates(plates, live.model_copy(update={"plates": channels | live.plates}), notes)


def _elsewhere(
    received: Mapping[str, Plate], recorded: Mapping[str, Plate], file: str
) -> tuple[Note, ...]:
    """Compare the places of plates that are stated twice."""
    notes = []
    for number in sorted(received.keys() & recorded.keys()):
        now, then = received[number], recorded[number]
        if not np.isfinite([now.corners, then.corners]).all():
            continue  # of one only the wrench about the lab's origin is known, not its place
        distance_m = float(np.linalg.norm(now.center - then.center))
        # the trace of a rotation is 1 + 2 cos of its angle
        cosine = (np.trace(now.rotation.T @ then.rotation) - 1) / 2
        angle_deg = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
        if distance_m > LIMITS.plate_distance or angle_deg > LIMITS.plate_angle:
            apart = {"distance_m": distance_m, "angle_deg": angle_deg}
            notes.append(Note.of("live_plate_elsewhere", plate=number, **apart, file=file))
    return tuple(notes)


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
        self._markers, analog = stated_streams(live, streams)
        self._arrivals = Arrivals(streams)
        frames = round(LIMITS.standing * self._markers.rate_hz)
        self._frames = SampleBuffer(3 * len(self._markers.labels), frames)
        self._analog, self._looked_s = AnalogStreams(analog), -np.inf
        six = [self._analog.find(live.channels_of(p.number), PLATE_UNITS) for p in plates]
        self._plates = list(zip(plates, six, strict=True))
        self.why_not = f"stream {self._markers.name} has sent too few frames"

    def add(self, samples: Samples) -> Recording | None:
        """Take what arrived; give the pose's recording once the last 1.2 s show it."""
        samples = self._arrivals.take(samples, perf_counter())
        if samples.stream != self._markers.name:
            self._analog.append(samples)
            return None
        self._frames.append(samples.time, samples.values)
        newest_s, full = self._frames.newest_s, len(self._frames.time) == self._frames.length
        if not full or newest_s - self._looked_s < 0.1:  # ten looks a second
            return None
        self._looked_s = newest_s
        try:
            return self._pose()
        except ValueError as why_not:
            self.why_not = str(why_not)
            return None

    def _pose(self) -> Recording:
        """Give what the last 1.2 s show; a ValueError says why that is no pose."""
        time, names = self._frames.time, self._markers.labels
        position, start_s = self._frames.values.reshape(len(time), len(names), 3), float(time[0])
        is_seen = np.isfinite(position).all(axis=(0, 2))
        if not is_seen.any():
            raise ValueError("no marker is seen all the time")
        extent_m = median_extent(position[:, is_seen])
        if extent_m > SUBJECT.still_extent:
            raise ValueError(
                f"the markers moved by {1000 * extent_m:.0f} mm within {LIMITS.standing:g} s, at "
                f"most {1000 * SUBJECT.still_extent:.0f} mm are standing still"
            )
        standing = []
        for plate, channels in self._plates:
            at, wrench = channels.samples(start_s, float(time[-1]))
            if not len(at):
                raise ValueError(f"plate {plate.number} has sent nothing")
            standing.append(replace(plate, time=at - start_s, wrench_in_plate=wrench))
        # the mean vertical force of all plates; NaN, where samples are missing, is nobody too
        carried_n = sum(float(np.mean(plate.wrench[:, 2])) for plate in standing)
        if not carried_n >= SUBJECT.least_mass * GRAVITY_MPS2:
            raise ValueError(f"the plates carry {carried_n:.0f} N, which is nobody")
        markers = Markers(time - start_s, names, position)
        return Recording(Path("calibration pose"), markers, tuple(standing))


@dataclass(frozen=True, slots=True)
class Preparation:
    """What is stated about a session.

    Attributes
    ----------
    study
        How frames are computed and what streams are; one in memory where only files are stated.
    person
        Who walks, and that person's files.
    laboratory
        The treadmill and its calibrations.
    static
        Recording of the calibration pose; None where the subject shows it live.
    """

    study: Study
    person: SubjectFile
    laboratory: Laboratory
    static: Recording | None

    @property
    def notes(self) -> tuple[Note, ...]:
        """What is to be said of the treadmill and its calibration."""
        laboratory = self.laboratory
        notes = laboratory.notes
        if laboratory.calibration is not None:
            notes = *laboratory.calibration.notes, *notes
            if laboratory.treadmill.platform is None:
                notes = *notes, Note.of("platform_pose", source=LEVEL)
        return notes

    @property
    def cycles(self) -> int | None:
        """How many gait cycles the conditions of the study analyse, at most; None if all."""
        conditions = self.study.file.conditions.values()
        return max((condition.cycles for condition in conditions if condition.cycles), default=None)

    @property
    def streams(self) -> tuple[str, tuple[str, ...]]:
        """Names of the stream of markers and of the others, as stated or as replays call them."""
        treadmill, live = self.laboratory.treadmill, self.study.file.live
        commanded = treadmill.platform is not None and treadmill.platform.channels
        needed = bool(treadmill.accelerometers or treadmill.belt or commanded)
        return live.markers or MARKERS, live.analog or (PLATES, *[ANALOG] * needed)

    def body(self, pose: Recording | None = None) -> tuple[Body, tuple[Note, ...]]:
        """Build the subject's body from a calibration pose, by default the static file.

        Notes say what is doubtful about it. A ValueError as of `pipeline.trial.subject`.
        """
        pose = pose or self.static
        if pose is None:
            raise ValueError("no calibration pose: give --static FILE, or show it live with --pose")
        study, (hip_trial, segments) = self.study, read_body_files(self.study, self.person)
        inputs = Inputs(
            recording=pose,
            subject=self.person.person,
            hip_trial=hip_trial,
            segments=segments or {},
            marker_set=study.marker_set,
            laboratory=self.laboratory,
        )
        chain = Chain(inputs, study.file.settings)
        return chain.body, (chain.mass.note, *chain.body.notes, *implausible(chain.body))


def _pose_file(study: Study, person: SubjectFile) -> Path | None:
    """Give the subject's calibration pose: the static file, else the first trial that there is."""
    trials = (trial.file for trial in person.named_trials.values() if trial.exclude is None)
    files = (study.path(name) for name in (person.static, *trials) if name)
    return next((path for path in files if path.is_file()), None)


def prepare(
    study: Path | None,
    subject: str | None,
    static: Path | None = None,
    calibration: Path | None = None,
) -> Preparation:
    """Read what is stated about a session.

    The study is a folder or its ``study.toml``; the subject may be left out where there is one; the
    static recording, of the calibration pose, is by default the subject's, or the first trial; the
    moving treadmill's calibration is the study's. A ValueError or OSError says that a file cannot
    be read or used, that it is not clear who the subject is, or that a calibration is stated
    without the study that says where the platform is.
    """
    if study is None:
        if subject is not None:
            raise ValueError(f"--subject {subject} needs the study: --study FOLDER")
        if calibration is not None:
            raise ValueError(
                f"--calibration {calibration.name} needs the study: its [treadmill.platform] says "
                "by which markers or channels the platform is brought to the lab; give --study "
                "FOLDER"
            )
        person = SubjectFile(id="subject", trials={})
        file = StudyFile(conditions={"live": Condition()})
        read = Study(Path(), file, {person.id: person}, None)
    else:
        read = read_study(study.parent if study.is_file() else study, recordings=False)
    if subject is None and len(read.subjects) != 1:
        raise ValueError(
            f"the study has {len(read.subjects)} subjects; choose who walks: --subject, one of "
            f"{', '.join(read.subjects)}"
        )
    person = read.subject(subject or next(iter(read.subjects)))
    laboratory = read_study_laboratory(read)
    if calibration is not None:
        fitted = read_calibration(calibration, read.file.treadmill, read.options, laboratory.plates)
        laboratory = replace(laboratory, calibration=fitted)
    path = static or _pose_file(read, person)
    recording = read_recording(path, read.options) if path else None
    return Preparation(read, person, laboratory, recording)
