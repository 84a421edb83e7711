"""What is typed as options: one trial, which is a study in memory, or a live session."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from hbm.markers import read_marker_set
from hbm.spelling import short
from pipeline.config.input_model import InputModel
from pipeline.config.live import LOOPBACK, own_address
from pipeline.config.schema import (
    Condition,
    Platform,
    RecordingRules,
    Settings,
    StudyFile,
    Subject,
    SubjectFile,
    Treadmill,
)
from pipeline.config.toml_file import Model
from pipeline.io.input_file import is_file, open_file, read_text

if TYPE_CHECKING:
    from pipeline.config.study import Study
    from pipeline.trial.chain import Chain
    from pipeline.trial.ground.laboratory import Laboratory
    from pipeline.trial.result import TrialResult

NO_OPTIONS: Final = frozenset({"id", "age_years", "plate_delay_s"})
"""Fields that are not options: without effect on one trial, or typed in another unit."""
ONE: Final = "trial"
"""Name of the only condition."""
SPANS: Final = {"all": "recording", "step": "step", "stance": "stance"}
"""Words of --span, and the windows of a condition."""


def _renamed(pairs: Any) -> Any:
    """Read labels and those wanted from options such as LASI=LASIS."""
    if not isinstance(pairs, list | tuple):
        return pairs
    rename: dict[str, str] = {}
    for pair in pairs:
        old, sign, new = (part.strip() for part in pair.partition("="))
        if not (old and sign and new):
            raise ValueError(f"{short(pair)}: expected OLD=NEW, such as LASI=LASIS")
        if rename.setdefault(old, new) != new:
            raise ValueError(f"{short(old)} has two new labels")
    return rename


class RecordingRequest(RecordingRules):
    """How recordings are to be read, as typed."""

    rename: Annotated[dict[str, str], BeforeValidator(_renamed)] = Field(default_factory=dict)
    """OLD=NEW: a label in the files and the one wanted; repeatable."""
    accelerometer: tuple[str, ...] = ()
    """SENSOR=X,Y,Z: channels of an accelerometer; default: as in the calibration, or named as
    Acc1.X; repeatable."""


class TrialRequest(Settings, Subject, RecordingRequest):
    """One trial to process, and how, as typed: settings, subject and rules, and the files.

    The options of the command line are made from these fields: ``--mass-kg`` is ``mass_kg``.
    """

    trial: Path
    """The trial: C3D, TRC, D-Flow, .mox, Nexus ASCII, Qualisys TSV or XDF, by its content."""
    static: Path | None = None
    """Calibration pose; default: the trial itself."""
    forces: Path | None = None
    """Ground reaction forces (.mot, .forces) of a .trc trial; plates of a Qualisys export."""
    record: Path | None = None
    """D-Flow record file of a D-Flow mocap file."""
    hip_trial: Path | None = None
    """Recording in which the thighs swing, for --hip functional."""
    segments: Path | None = None
    """TOML with known segment inertias: prostheses, braces, scans."""
    plate_delay_ms: Annotated[float, Field(ge=-500, le=500)] | None = None
    """Delay of the plates relative to the markers; default: their calibration's, or none."""
    span: str | None = None
    """What is used in place of gait cycles: step, stance, start and stop in s, e.g. 5,15, or all;
    default: where there is no gait cycle steps, else stances, else all."""
    plate_calibration: Path | None = None
    """Calibration of the plates by known weights (hbm plates)."""
    calibration: Path | None = None
    """Calibration of the moving treadmill (hbm calibration fit)."""
    platform_markers: str = ""
    """Markers on a moving platform, e.g. PLAT1,PLAT2,PLAT3."""

    @model_validator(mode="after")
    def _hips(self) -> Self:
        if self.hip_trial is not None and self.hip != "functional":
            raise ValueError("hip_trial: has no effect without --hip functional")
        return self

    def study(self) -> "Study":
        """One trial of one subject, but for its laboratory; files are named as typed.

        A ValueError or OSError where span or marker set cannot be used.
        """
        from pipeline.config.study import Study

        name, marker_set = self.marker_set, None
        if name is not None and (name.endswith(".toml") or is_file(Path(name))):
            marker_set, name = read_marker_set(read_text(Path(name)), Path(name).stem), None
        delay_s = None if self.plate_delay_ms is None else self.plate_delay_ms / 1000
        settings = self._part(Settings, marker_set=name, plate_delay_s=delay_s)
        files = {"file": self.trial, "forces": self.forces, "record": self.record}
        trial = {key: str(path) for key, path in files.items() if path is not None}
        person = self._part(SubjectFile, trials={ONE: trial})
        file = self._part(StudyFile, settings=settings, conditions={ONE: self._condition()})
        return Study(Path(), file, {person.id: person}, marker_set)

    def _part(self, kind: type[Model], **others: object) -> Model:
        """Give what a file of a study would state of what is typed, and others."""
        typed = {name: value for name, value in self if name in kind.model_fields}
        named = {name: str(value) for name, value in typed.items() if isinstance(value, Path)}
        return kind.model_validate(typed | named | others)

    def _condition(self) -> Condition:
        if self.span is None:
            return Condition()
        word = self.span.strip().lower()
        try:
            window = SPANS.get(word) or [float(part) for part in word.split(",")]
            return Condition.model_validate({"window": window})
        except ValueError:
            raise ValueError(
                f"--span {self.span!r}: expected step, stance, start and stop in seconds, such as "
                "5,15, or all"
            ) from None


class LiveRequest(InputModel):
    """How a session is run, or a recording replayed, as typed."""

    study: Path | None = None
    """Folder of the study, with [live]."""
    subject: str | None = None
    """Who walks; default: the only one."""
    static: Path | None = None
    """Calibration pose, and places of plates."""
    calibration: Path | None = None
    """In place of the study's."""
    pose: bool = False
    """Build the body from a pose shown now."""
    out: Path | None = None
    """New folder; default: live/TIME."""
    view: bool = False
    """Show the body in a window."""
    web: bool = False
    """Show the body to a browser here."""
    page_host: Annotated[str, AfterValidator(own_address)] = LOOPBACK
    """This computer's address for the page with the light; another one opens it to a network."""
    qualisys: str | None = None
    """ADDRESS[:PORT] of QTM; not LSL."""
    listen: str | None = None
    """This computer's address for streams; default: the study's."""
    sender: tuple[str, ...] = ()
    """Computer to receive from, of several; repeatable."""
    cycles: Annotated[int, Field(ge=1)] | None = None
    """Gait cycles to measure; default: the study's, else 25."""
    duration_s: Annotated[float, Field(ge=0.1)] | None = None
    """Default: until Ctrl-C."""
    replay: Path | None = None
    """Only play this recording as streams."""
    forces: Path | None = None
    """MOT file of a TRC file to replay."""
    record: Path | None = None
    """D-Flow record file to replay."""
    speed: Annotated[float, Field(ge=0.01, le=20)] = 1.0
    """Of --replay."""


def chain_of(request: TrialRequest) -> "Chain":
    """Read the files of a trial; a ValueError or OSError says what is wrong with which."""
    from pipeline.trial.process import trial_chain

    study = request.study()
    (name,) = study.trials
    read = request.trial, request.forces, request.record, request.static, request.hip_trial
    for path in filter(None, read):
        open_file(path).close()  # of a file that is not there, the system says the most
    with _naming_file(request):
        return trial_chain(study, name, _laboratory(request))


def process(
    request: TrialRequest, chain: "Chain", announce: Callable[[str], None] | None = None
) -> "TrialResult":
    """Process a trial; `announce` is called with a sentence when something takes long.

    Errors are those of `process_chain`.
    """
    from hbm.kernels.native import kernels
    from pipeline.trial.process import process_chain

    kernels(announce)
    study = request.study()
    (name,) = study.trials
    with _naming_file(request):
        return process_chain(chain, study, name)


@contextmanager
def _naming_file(request: TrialRequest) -> Iterator[None]:
    """Say of an error which trial is processed."""
    try:
        yield
    except ValueError as error:
        if request.trial.name not in str(error):
            error.add_note(f"while processing {request.trial.name}")
        vars(error).setdefault("filename", str(request.trial))
        raise


def _laboratory(request: TrialRequest) -> "Laboratory":
    """Read the treadmill: calibrations and platform markers."""
    from pipeline.config.plate_correction import read_plate_correction
    from pipeline.trial.ground.accelerometers import stated_accelerometers
    from pipeline.trial.ground.calibrations import read_laboratory
    from pipeline.trial.ground.laboratory import Laboratory

    markers = marker_names(request.platform_markers)
    file = request.plate_calibration
    plates = read_plate_correction(file) if file is not None else None
    if request.calibration is not None:
        accelerometers = stated_accelerometers(request.accelerometer)
        return read_laboratory(request.calibration, markers, accelerometers, plates)
    if request.accelerometer:
        raise ValueError("--accelerometer has no effect without --calibration")
    platform = Platform(markers=markers) if markers else None
    return Laboratory(Treadmill(platform=platform), plates=plates)


def marker_names(typed: str) -> tuple[str, ...]:
    """Read names that are separated by commas."""
    return tuple(filter(None, map(str.strip, typed.split(","))))
