"""Which frames of a trial count: where the pose is known and the plates carry the subject."""

from dataclasses import dataclass

import numpy as np

from hbm.notes import Note
from hbm.spatial import Mask, read_only


@dataclass(frozen=True, slots=True)
class Validity:
    """Frames in which the motion is known and all support of the body is measured.

    Attributes
    ----------
    motion
        Frames in which markers show pelvis and trunk, so that the pose is known, (T,); see
        `pipeline.trial.motion_check.known_frames`. Head, arms and legs without markers are
        interpolated; `hbm.motion.Motion.observed` marks them.
    plates
        Frames in which the plates carry the subject, (T,); see `pipeline.trial.weight_bearing`.

    Examples
    --------
    >>> validity = Validity(np.array([True, True, False]), np.array([True, False, False]))
    >>> validity.both.tolist()
    [True, False, False]
    """

    motion: Mask
    plates: Mask

    def __post_init__(self) -> None:
        for name in ("motion", "plates"):
            object.__setattr__(self, name, read_only(getattr(self, name), bool))
        if self.motion.shape != self.plates.shape or self.motion.ndim != 1:
            raise ValueError(
                f"validity: motion and plates must have the same shape (T,), got "
                f"{self.motion.shape} and {self.plates.shape}"
            )

    @property
    def both(self) -> Mask:
        """Frames that count, (T,)."""
        return np.asarray(self.motion & self.plates)


def validity_notes(validity: Validity) -> tuple[Note, ...]:
    """Say in how many frames the plates do not carry the subject, ``frames_not_carried``."""
    missing = int(np.count_nonzero(~validity.plates))
    if not missing:
        return ()
    return (Note.of("frames_not_carried", missing=missing, frames=len(validity.plates)),)
