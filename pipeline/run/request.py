"""A request to process one trial: its file and every option of the command line about it."""

from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BeforeValidator, Field

from hbm.spelling import short
from pipeline.config.schema import MAX_STOP, Condition, Interval, RecordingRules, Settings, Subject
from pipeline.config.toml_file import Model

NO_OPTIONS: Final = frozenset({"id", "age_years", "plate_delay_s"})
"""Fields that are not options: without effect on one trial, or typed in another unit."""


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

    @property
    def condition(self) -> Condition:
        """What counts; a ValueError where the span is not understood."""
        if self.span is None:
            return Condition()
        windows = {"all": "recording", "step": "step", "stance": "stance"}
        if (word := self.span.strip().lower()) in windows:
            return Condition.model_validate({"window": windows[word]})
        try:
            start, stop = (float(part) for part in self.span.split(","))
        except ValueError:
            start, stop = 0.0, 0.0
        if not 0 <= start < stop <= MAX_STOP:
            raise ValueError(
                f"--span {self.span!r}: expected step, stance, start and stop in seconds, such as "
                "5,15, or all"
            )
        return Condition(window=Interval(start, stop, "s"))

    def part(self, kind: type[Model], **other: object) -> Model:
        """Give the settings, the subject or the rules of the request, with some values replaced."""
        own = {name: getattr(self, name) for name in kind.model_fields}
        return kind.model_validate(own | other)

    @property
    def plate_delay(self) -> float | None:
        """Delay of the plates relative to the markers [s]; None where it is not stated."""
        return None if self.plate_delay_ms is None else self.plate_delay_ms / 1000
