"""What a trial is processed from: its recordings, its subject, and what is known of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from hbm.markers import MarkerSet, recognise_marker_set
from hbm.segments import SegmentOverride
from hbm.spelling import shown
from pipeline.config.schema import Condition, PlateContact, Settings, Subject, Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.subject import MassUnknownError, body_mass

WANTED_PLATES = {
    ".trc": "give its file of forces, MOT or .forces (--forces, forces of the trial)",
    ".tsv": "put its files of forces, {stem}_f_1.tsv and so on, beside it",
}
"""Ending of a file without plates -> what to do; else it is to be exported with them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Inputs:
    """What a trial is processed from, as read and as stated.

    Attributes
    ----------
    recording, static, hip_trial
        The trial; the calibration pose, where it is another recording; and a recording in which the
        thighs swing, for functional hips.
    static_window_s
        Start and end of the pose [s]; by default its quietest second.
    subject, segments
        Who walked, and segments that are known better than from the table of inertias.
    marker_set
        A marker set of one's own.
    laboratory
        The treadmill and its calibrations.
    condition
        What of the trial counts.
    contacts
        Whose foot was on a plate, where a person knows better.
    """

    recording: Recording
    subject: Subject
    static: Recording | None = None
    static_window_s: tuple[float, float] | None = None
    hip_trial: Recording | None = None
    segments: Mapping[str, SegmentOverride] = field(default_factory=dict)
    marker_set: MarkerSet | None = None
    laboratory: Laboratory = field(default_factory=lambda: Laboratory(Treadmill()))
    condition: Condition = field(default_factory=Condition)
    contacts: tuple[PlateContact, ...] = ()

    def __post_init__(self) -> None:
        for name in ("recording", "static", "hip_trial"):
            recording = getattr(self, name)
            if not isinstance(recording, Recording | None):
                expected = f"{name}: expected a recording, got {shown(recording)}"
                raise TypeError(f"{expected}; read it first: {name}=hr.read(FILE)")

    def require_all(self, settings: Settings) -> None:
        """Say all at once, in a ValueError, that the trial lacks: frames, labels, plates, mass."""
        trial, standing = self.recording, self.static or self.recording
        faults = list[str]()
        if len(trial.markers.time) < 2:
            faults.append(f"{trial.source.name}: it is one frame; residuals need a motion")
        if self.marker_set is None and settings.marker_set is None:
            try:
                recognise_marker_set(standing.markers.names)
            except ValueError as unknown:
                faults.append(f"{standing.source.name}: {unknown}")
        if not trial.plates:
            file = trial.source
            what_to_do = WANTED_PLATES.get(file.suffix.lower(), "export it with its plates")
            faults.append(
                f"{file.name}: {trial.why_no_plates}; residuals need the ground reaction wrench: "
                f"{what_to_do.format(stem=file.stem)}"
            )
        if not faults:
            return
        try:
            body_mass(self.subject, standing, trial)
        except MassUnknownError:
            faults.append("the mass is missing too (--mass-kg)")
        raise ValueError("; ".join(faults))
