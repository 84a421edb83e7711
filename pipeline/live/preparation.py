"""What has to be known before the first frame: the study, the body, the places of plates."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hbm.model import Body
from hbm.notes import Note
from hbm.plausibility.motion import implausible
from pipeline.config.live import Live
from pipeline.config.schema import Settings, SubjectFile, Treadmill
from pipeline.config.study import Study, read_study
from pipeline.config.toml_file import read_segments
from pipeline.io.read import read_as_stated
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.live.places import PlacedPlates, place_plates
from pipeline.live.sources.recorded import ANALOG, MARKERS, PLATES
from pipeline.live.stream import StatedPlate
from pipeline.trial.ground.calibration_file import read_calibration
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.study_files import read_study_laboratory
from pipeline.trial.subject_body import subject_body
from pipeline.trial.weighing import body_mass


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
        """Place the plates that streams describe, as `pipeline.live.places.place_plates`."""
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
            As `pipeline.trial.subject_body.subject_body`; or the mass is not known.
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
            hip_trial=read_as_stated(study.path(hip_trial), self.stated)
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
        recording = read_as_stated(static, Stated()) if static else None
        person, still = SubjectFile(id="subject", trials={}), Laboratory(Treadmill())
        return Preparation(None, person, Settings(), Live(), still, recording)
    read = read_study(study.parent if study.is_file() else study, recordings=False)
    person = read.subject(subject) if subject else _only_subject(read)
    laboratory = read_study_laboratory(read)
    if calibration is not None:
        fitted = read_calibration(calibration, read.file.treadmill, read.stated, laboratory.plates)
        laboratory = replace(laboratory, calibration=fitted)
    path = static or (read.path(person.static) if person.static else None)
    recording = read_as_stated(path, read.stated) if path else None
    return Preparation(read, person, read.file.settings, read.file.live, laboratory, recording)


def _only_subject(study: Study) -> SubjectFile:
    if len(study.subjects) != 1:
        raise ValueError(
            f"the study has {len(study.subjects)} subjects; state who walks: --subject, one of "
            f"{', '.join(study.subjects)}"
        )
    return next(iter(study.subjects.values()))
