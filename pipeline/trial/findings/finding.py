"""A finding: what is wrong, where, how large, by which evidence, and what mends it."""

from dataclasses import dataclass
from typing import Literal

from hbm.spatial import WRENCH_COMPONENTS
from pipeline.trial.findings.raw import RawFault, RawKind

JudgedKind = Literal[
    "gain", "reversed", "turned", "exchanged", "moved", "askew", "late", "all_late"
]
"""What may be wrong with plates that motion and feet judge."""
Kind = RawKind | JudgedKind


@dataclass(frozen=True, slots=True)
class Correction:
    """A correction that was tried on the whole chain, and what it leaves.

    Attributes
    ----------
    mendings
        As `mend_plates` states them.
    plate_delay_s
        As the settings state it; None where it stays.
    before, after
        RMS of the residual of all frames that count, (6,) [N, N·m].
    held_out_before, held_out_after
        The same of frames that the sizes were not fitted to.
    helps
        Whether it makes the residual smaller there, and none of its axes larger beyond noise.
    """

    mendings: tuple[str, ...]
    plate_delay_s: float | None
    before: tuple[float, ...]
    after: tuple[float, ...]
    held_out_before: tuple[float, ...]
    held_out_after: tuple[float, ...]
    helps: bool

    @property
    def effect(self) -> str:
        """Say what it does to the axis that it changes most: "My 38.8 → 6.1 N·m, …"."""
        axis = min(range(6), key=lambda k: self.after[k] / max(self.before[k], 1e-9))
        name, unit = WRENCH_COMPONENTS[axis], "N" if axis < 3 else "N·m"
        before, after = self.before[axis], self.after[axis]
        there, corrected = self.held_out_before[axis], self.held_out_after[axis]
        every = f"{name} {before:.1f} → {after:.1f} {unit}"
        return f"{every}, in other frames {there:.1f} → {corrected:.1f}"


@dataclass(frozen=True, slots=True)
class Finding:
    """One fault of plates, and those that the same evidence may mean.

    Attributes
    ----------
    kind
        Which.
    plates
        Numbers of the plates.
    component
        The channel of a gain or sign, or the angle of a turn [°].
    size, interval
        What corrects it, and half of its 95 % interval: factor of the channel less one, metres
        along x and y of the plate, radians, or seconds; empty for faults without a size.
    evidence
        By how much it is likelier than none: twice the logarithm of the odds; None where raw
        samples show it.
    channels
        Those of which raw samples show it.
    rivals
        Others that explain the same, and cannot be told from it in this trial.
    correction
        What was tried; None where nothing can be typed, or rivals are as likely.
    """

    kind: Kind
    plates: tuple[int, ...]
    component: str = ""
    size: tuple[float, ...] = ()
    interval: tuple[float, ...] = ()
    evidence: float | None = None
    channels: tuple[RawFault, ...] = ()
    rivals: tuple["Finding", ...] = ()
    correction: Correction | None = None
