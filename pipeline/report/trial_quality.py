"""Quality of a trial: what to check before its residuals are interpreted."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from pipeline.trial.residuals import MarkerRow, ThresholdRow, headline_rows
from pipeline.trial.summary import TrialSummary

MAX_MARKER_RMS_MM: Final = 20.0
MAX_MARKER_PEAK_MM: Final = 40.0
"""OpenSim's guideline for inverse kinematics: RMS error below 2 cm, largest below 4 cm."""
MAX_GAP_PERCENT: Final = 10.0
"""No published limit: above a tenth, much of a marker's path is interpolated or unknown."""
MAX_DELAY_S: Final = 0.010
"""No published limit: one frame of a 100 Hz camera."""

Rating = Literal["pass", "check", "fail", "none"]
SYMBOLS: Final[dict[Rating, str]] = {"pass": "✔", "check": "▲", "fail": "✖", "none": ""}


@dataclass(frozen=True, slots=True)
class Check:
    """One finding and its rating.

    Attributes
    ----------
    value
        As shown.
    rating
        "pass"; "check": to be looked at; "fail": outside a published limit; "none": no limit.
    detail
        What it consists of, such as the worst marker.
    """

    value: str
    rating: Rating
    detail: str = ""

    @property
    def symbol(self) -> str:
        """Symbol of the rating, which must not depend on colour alone."""
        return SYMBOLS[self.rating]


@dataclass(frozen=True, slots=True)
class Criterion:
    """One criterion of quality and its findings.

    Attributes
    ----------
    name
        Head of its column.
    checks
        One; one without and one with compensation; or one of forces and one of moments.
    """

    name: str
    checks: tuple[Check, ...]


def trial_quality(trial: TrialSummary) -> tuple[Criterion, ...]:
    """Rate a trial by its summary.

    Parameters
    ----------
    trial
        The trial's summary.

    Returns
    -------
    tuple of Criterion
        The same criteria in the same order for every trial.
    """
    unsolved = trial.unsolved_frames
    return (
        Criterion("Gait cycles", (_counted(trial),)),
        Criterion("Marker error (RMS)", (_marker_error(trial.markers),)),
        Criterion("Marker gaps", (_marker_gaps(trial.markers),)),
        Criterion("Delay of plates", (_delay(trial.delay_s, trial.delay_uncertainty_s),)),
        Criterion(
            "Unsolved frames",
            (Check(str(unsolved), "check" if unsolved else "pass", f"of {trial.frames}"),),
        ),
        Criterion("1σ of IC", _compensation(trial)),
        Criterion("Locked", (Check(str(len(trial.locked)), "none"),)),
        Criterion("Peak force", _peaks(trial.thresholds, "force")),
        Criterion("Peak moment", _peaks(trial.thresholds, "moment")),
    )


def _counted(trial: TrialSummary) -> Check:
    """Say how many gait cycles count, or which span, and for how much of it."""
    counts = {side: len(spans) for side, spans in trial.cycles.items() if len(spans)}
    shares = {row.valid_share for row in headline_rows(trial.residuals)}
    share = f"{100 * min(shares):.0f} % of frames" if shares and min(shares) < 1 else ""
    if trial.span is not None:
        value, sides = f"{trial.span[0]:.2f}–{trial.span[1]:.2f} s", "no gait cycles"
    else:
        value = f"{sum(counts.values())} of {trial.found_cycles}"
        sides = ", ".join(f"{n} {side}" for side, n in counts.items())
        sides += f"; {trial.part.name}" if trial.part else ""
    return Check(value, "none", "; ".join(filter(None, (sides, share))))


def _compensation(trial: TrialSummary) -> tuple[Check, ...]:
    """Say how uncertain the compensation makes residuals, at most; nothing where none is known."""
    spread = [
        (row.compensation_sd, row.unit)
        for row in headline_rows(trial.residuals)
        if row.compensation_sd is not None
    ]
    largest = {unit: max(sd for sd, own in spread if own == unit) for _, unit in spread}
    if not largest:
        return (Check("–", "none"),)
    return tuple(Check(f"{sd:.1f} {unit}", "none") for unit, sd in largest.items())


def _marker_error(markers: Sequence[MarkerRow]) -> Check:
    overall, seen = markers[-1], [row for row in markers[:-1] if row.seen]
    if not seen:
        return Check("unknown", "fail")
    worst = max(seen, key=lambda row: row.rms_mm)
    rating: Rating = "pass" if overall.rms_mm < MAX_MARKER_RMS_MM else "fail"
    if rating == "pass" and overall.peak_mm > MAX_MARKER_PEAK_MM:
        rating = "check"
    detail = f"{worst.marker} {worst.rms_mm:.1f}, peak {overall.peak_mm:.0f}"
    return Check(f"{overall.rms_mm:.1f} mm", rating, detail)


def _marker_gaps(markers: Sequence[MarkerRow]) -> Check:
    overall, single = markers[-1], markers[:-1]
    worst = max(single, key=lambda row: row.missing_percent)
    rating: Rating = "check" if worst.missing_percent > MAX_GAP_PERCENT else "pass"
    detail = f"{worst.marker} {worst.missing_percent:.1f} %" if worst.missing_percent else ""
    return Check(f"{overall.missing_percent:.1f} %", rating, detail)


def _peaks(thresholds: Sequence[ThresholdRow], quantity: str) -> tuple[Check, ...]:
    return tuple(
        Check(
            f"{'IC' if row.compensated else 'no IC'} {row.peak:.0f} of {row.limit:.0f} {row.unit}",
            "pass" if row.passed else "fail",
        )
        for row in thresholds
        if row.quantity == quantity
    )


def _delay(delay_s: float | None, uncertainty_s: float | None) -> Check:
    if delay_s is None:
        return Check("unknown", "check")
    spread = "" if uncertainty_s is None else f" ± {1000 * uncertainty_s:.1f}"
    rating: Rating = "check" if abs(delay_s) > MAX_DELAY_S else "pass"
    return Check(f"{1000 * delay_s:.1f}{spread} ms", rating)
