"""What is known of a trial besides its frames: what reports, tables and the console need."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import ConfigDict, PlainSerializer, PlainValidator, TypeAdapter, ValidationError

from compensation.inertia.quality import OF_CALIBRATION
from hbm.engines.engine import EngineUsed
from hbm.notes import Note
from hbm.spelling import short
from pipeline.config.schema import Settings, Subject
from pipeline.trial.residuals import (
    MarkerRow,
    ResidualRow,
    ThresholdRow,
    marker_rows,
    residual_rows,
    threshold_rows,
)
from pipeline.trial.result import CyclePart, TrialResult
from pipeline.trial.window import shortage

FORMAT_VERSION: Final = 8
"""Of stored trials, summary and frames together; raised with every change of what they hold."""
STRICT_JSON: Final = ConfigDict(strict=True, extra="forbid", ser_json_inf_nan="constants")
"""Nothing unknown, nothing of another type; NaN is written as such."""
PACKAGES: Final = ("hbm-residuals", "casadi", "numpy", "scipy", "pandas", "pyarrow")


def _note(stored: object) -> Note:
    return stored if isinstance(stored, Note) else Note.from_dict(stored)


StoredNote = Annotated[Note, PlainValidator(_note), PlainSerializer(Note.to_dict)]
"""A note that stands in JSON with its code, level, text and values."""


@dataclass(frozen=True, slots=True)
class TrialSummary:
    """What is known of a processed trial besides its frames.

    Attributes
    ----------
    version
        `FORMAT_VERSION` of the program that made it.
    key
        Digest of everything that went into the trial (`pipeline.run.job.trial_key`).
    source
        Name of the recording's file.
    condition, subject, settings
        As stated.
    versions
        Package -> version the trial was processed with.
    engine
        The engine of the inverse dynamics, and how well the other one agrees.
    body_mass_kg, height_m
        As stated or, where they were not, weighed and estimated.
    marker_set
        Name of the marker set.
    locked
        Coordinates that no marker shows; they stay at zero.
    overridden_segments
        Segments whose inertia is not by the table alone.
    notes
        What was inferred, locked, filled or refused.
    delay_s, delay_uncertainty_s
        How much later the plates are than the markers, and half of its 95 % interval; None where it
        is not determined.
    frames, unsolved_frames
        Number of frames, and of those without a solution of the inverse kinematics.
    cycles
        Side -> start and stop of each gait cycle that counts [s].
    found_cycles
        How many gait cycles the events of these sides show, counted or not.
    part
        The part of these cycles that the condition asks for; None for all of them.
    span
        Start and stop of what counts in place of gait cycles [s]; None where these count.
    residuals
        RMS, mean, peak of every residual over what counts, and over the whole gait cycles where a
        part of them counts; empty where nothing does.
    thresholds
        Peak residuals beside the limits of Hicks et al. (2015).
    markers
        Every marker's distance from the model; the last row is over all markers.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT_JSON

    version: int
    key: str
    source: str
    condition: str
    subject: Subject
    settings: Settings
    versions: Mapping[str, str]
    engine: EngineUsed
    body_mass_kg: float
    height_m: float
    marker_set: str
    locked: tuple[str, ...]
    overridden_segments: tuple[str, ...]
    notes: tuple[StoredNote, ...]
    delay_s: float | None
    delay_uncertainty_s: float | None
    frames: int
    unsolved_frames: int
    cycles: Mapping[str, tuple[tuple[float, float], ...]]
    found_cycles: int
    part: CyclePart | None
    span: tuple[float, float] | None
    residuals: tuple[ResidualRow, ...]
    thresholds: tuple[ThresholdRow, ...]
    markers: tuple[MarkerRow, ...]

    @property
    def of_calibration(self) -> tuple[Note, ...]:
        """What to know of the treadmill's calibration wherever the trial is used."""
        return tuple(note for note in self.notes if note.code in OF_CALIBRATION)

    @property
    def shortage(self) -> str:
        """Why the trial has no residuals; empty where it has."""
        return shortage(self.notes)

    def to_json(self) -> bytes:
        """Give the summary as JSON; numbers come back exactly."""
        return _JSON.dump_json(self)

    @staticmethod
    def from_json(text: bytes) -> "TrialSummary":
        """Read a summary back.

        Raises
        ------
        ValueError
            If it is of another format, or anything is missing, unknown or of another type.
        """
        require_format(text)
        try:
            return _JSON.validate_json(text)
        except ValidationError as error:
            raise ValueError(fault_of(error)) from error


_JSON: Final = TypeAdapter(TrialSummary)


def fault_of(error: ValidationError) -> str:
    """Give where stored JSON is at fault, and why, for the first of its faults."""
    first = error.errors()[0]
    return f"{'.'.join(str(part) for part in first['loc'])}: {first['msg'].lower()}"


def require_format(text: bytes) -> None:
    """Refuse the JSON of another format than `FORMAT_VERSION` with a ValueError."""
    try:
        stored = json.loads(text)
    except ValueError as error:
        raise ValueError(f"not valid JSON: {error}") from error
    except RecursionError as error:
        raise ValueError("not valid JSON: it is nested too deeply") from error
    found = stored.get("version") if isinstance(stored, dict) else None
    if found != FORMAT_VERSION:
        known = short(found) if isinstance(found, int) else "unknown"
        raise ValueError(
            f"written by another version of hbm (format {known}; this one reads "
            f"format {FORMAT_VERSION})"
        )


def summarise(result: TrialResult, condition: str, key: str) -> TrialSummary:
    """Summarise a processed trial.

    Parameters
    ----------
    result
        The trial.
    condition
        Name of its condition.
    key
        Digest of everything that went into it; empty for a trial outside a study.

    Returns
    -------
    TrialSummary
        What is known of it besides its frames.
    """
    return TrialSummary(
        version=FORMAT_VERSION,
        key=key,
        source=result.source.name,
        condition=condition,
        subject=result.subject,
        settings=result.settings,
        versions={name: version(name) for name in PACKAGES},
        engine=result.engine,
        body_mass_kg=result.body.mass,
        height_m=result.body.height_m,
        marker_set=result.body.marker_set.name,
        locked=result.body.locked,
        overridden_segments=result.overridden_segments,
        notes=result.notes,
        delay_s=_known(result.delay_s),
        delay_uncertainty_s=_known(result.delay_uncertainty_s),
        frames=len(result.motion.time),
        unsolved_frames=int(np.count_nonzero(~result.motion.converged)),
        cycles={side: tuple(map(tuple, spans.tolist())) for side, spans in result.cycles.items()},
        found_cycles=result.found_cycles,
        part=result.part,
        span=result.span,
        residuals=residual_rows(result, condition),
        thresholds=threshold_rows(result),
        markers=marker_rows(result),
    )


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
