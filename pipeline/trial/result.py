"""What is known of a trial once it has been processed: a type only."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from compensation.platform import PlatformPose
from hbm.body import Body
from hbm.dynamics import Dynamics
from hbm.motion import Motion
from hbm.notes import Note
from hbm.spatial import Array, Mask
from pipeline.config.schema import Settings, Subject
from pipeline.io.recording import Event


@dataclass(frozen=True, slots=True)
class TrialResult:
    """Everything that is known of a trial once it has been processed.

    Attributes
    ----------
    source
        The recording's file.
    subject, settings
        As stated.
    body
        The subject's body.
    motion
        Filtered motion with marker errors.
    measured
        Dynamics with the plates as measured.
    compensated
        Dynamics with the platform's artefacts removed; None without a calibration.
    ground
        Per variant ("measured", "compensated") the filtered wrench on each foot, (T, 6), lab axes
        about the lab origin.
    events
        Gait events.
    cycles
        Side -> start and stop of each gait cycle, (C, 2) [s].
    delay_s, delay_uncertainty_s
        How much later the plates are than the markers, and its standard error; NaN where unknown.
    platform
        The platform's pose, (T,) frames; None for a treadmill that stands still.
    ambiguous
        Frames in which the split of a plate between the feet is uncertain, (T,).
    onsets
        When the perturbations of a perturbed condition began, (P,) [s].
    overridden_segments
        Segments whose inertia is not by the table alone.
    notes
        Whatever was inferred, locked, filled or refused.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> result.motion.q.shape, result.measured.residual.shape
    ((800, 46), (800, 6))
    >>> sorted(result.ground["measured"])
    ['left_foot', 'right_foot']
    """

    source: Path
    subject: Subject
    settings: Settings
    body: Body
    motion: Motion
    measured: Dynamics
    compensated: Dynamics | None
    ground: dict[str, dict[str, Array]]
    platform: PlatformPose | None
    events: tuple[Event, ...]
    cycles: dict[str, Array]
    delay_s: float
    delay_uncertainty_s: float
    ambiguous: Mask
    notes: tuple[Note, ...]
    overridden_segments: tuple[str, ...] = ()
    onsets: Array = field(default_factory=lambda: np.empty(0))
