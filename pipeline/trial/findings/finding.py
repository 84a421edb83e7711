"""A finding: what is wrong, where, how large, by which evidence, and what mends it."""

from dataclasses import dataclass
from typing import Final, Literal

from hbm.numbers import read_numbers
from hbm.spatial import WRENCH_COMPONENTS
from pipeline.trial.findings.raw import RawFault, RawKind

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "finding")

JudgedKind = Literal[
    "gain", "reversed", "turned", "exchanged", "moved", "askew", "late", "all_late", "mass"
]
"""What may be wrong with plates that motion and feet judge, or with the body mass."""
Kind = RawKind | JudgedKind | Literal["zero", "drift"]


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
        """Say what it does to the axis that it changes most: "My 38.8 → 6.1 N·m, …".

        Where it does not help, also to the one that it makes larger by most.
        """
        kept, held_out = (
            [after / max(before, 1e-9) for before, after in zip(*rms, strict=True)]
            for rms in ((self.before, self.after), (self.held_out_before, self.held_out_after))
        )
        larger = [*map(max, kept, held_out)]
        text = self._of_axis(kept.index(min(kept)))
        if not self.helps and max(larger) > LIMITS.largest_growth:
            text += f"; but {self._of_axis(larger.index(max(larger)))}"
        return text

    def _of_axis(self, k: int) -> str:
        every = f"{WRENCH_COMPONENTS[k]} {self.before[k]:.1f} → {self.after[k]:.1f}"
        others = f"{self.held_out_before[k]:.1f} → {self.held_out_after[k]:.1f}"
        return f"{every} {'N' if k < 3 else 'N·m'}, in other frames {others}"


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
        The channel of a gain or sign, the angle of a turn [°], what else is not zero besides the
        vertical force, or the channels whose zeros drift.
    size, interval
        What corrects it, and half of its 95 % interval: factor of the channel less one, metres
        along x and y of the plate, radians, or seconds; empty for faults without a size. Of zeros
        what each plate reads [N], without an interval; of those that drift the change of each
        channel over `span_s` [N, N·m], with its 95 % interval.
    evidence
        By how much it is likelier than none: twice the logarithm of the odds; None where raw
        samples or unloaded plates show it.
    channels
        Those of which raw samples show it.
    rivals
        Others that explain the same, and cannot be told from it in this trial.
    correction
        What was tried; None where nothing can be typed, or rivals are as likely.
    span_s
        Of a zero that drifts: the first and the last time at which the unloaded plate shows it.
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
    span_s: tuple[float, float] | None = None

    @property
    def of_load(self) -> bool:
        """Whether the plate measures its load wrongly, beyond zero and single samples."""
        if self.kind == "drift":
            sizes = dict(zip(self.component.split(", "), self.size, strict=True))
            return bool(abs(sizes.get("Fz", 0.0)) > LIMITS.largest_drift)
        return self.kind not in ("zero", "lost")
