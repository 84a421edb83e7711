"""How good each trial is: what a reader should look at before believing its residuals."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from pipeline.trial.residuals import MarkerRow, ThresholdRow
from pipeline.trial.summary import TrialSummary

MARKER_RMS_MM: Final = 20.0
MARKER_PEAK_MM: Final = 40.0
"""OpenSim's guideline for inverse kinematics: RMS error below 2 cm, largest below 4 cm."""
GAP_PERCENT: Final = 10.0
DELAY_S: Final = 0.010
"""Own levels, of no authority: a tenth of a marker's samples, one frame of a 100 Hz camera."""

Light = Literal["good", "look", "bad", "none"]


@dataclass(frozen=True, slots=True)
class Check:
    """One thing to look at: what was found, and how that is.

    Attributes
    ----------
    value
        For a person.
    light
        "good"; "look" at it; "bad": outside a published limit; "none" where there is no limit.
    detail
        What stands behind it, such as the worst marker.
    """

    value: str
    light: Light
    detail: str = ""


def trial_checks(trial: TrialSummary) -> dict[str, list[Check]]:
    """Judge a trial by its summary.

    Parameters
    ----------
    trial
        The trial's summary.

    Returns
    -------
    dict
        What was looked at -> findings: one each, but of the peak residuals against the limits of
        Hicks et al. (2015) one without and one with compensation.
    """
    counts = {side: len(spans) for side, spans in trial.cycles.items() if len(spans)}
    sides = ", ".join(f"{n} {side}" for side, n in counts.items())
    unsolved = trial.unsolved_frames
    return {
        "Gait cycles": [Check(str(sum(counts.values())), "none", sides)],
        "Marker error (RMS)": [_marker_error(trial.markers)],
        "Marker gaps": [_gaps(trial.markers)],
        "Delay of plates": [_delay(trial.delay_s, trial.delay_uncertainty_s)],
        "Unsolved frames": [
            Check(str(unsolved), "look" if unsolved else "good", f"of {trial.frames}")
        ],
        "Locked": [Check(str(len(trial.locked)), "none")],
        "Peak force": _hicks(trial.thresholds, "force"),
        "Peak moment": _hicks(trial.thresholds, "moment"),
    }


def _marker_error(markers: Sequence[MarkerRow]) -> Check:
    every, single = markers[-1], markers[:-1]
    worst = max(single, key=lambda row: row.rms_mm)
    light: Light = "good" if every.rms_mm < MARKER_RMS_MM else "bad"
    if light == "good" and every.peak_mm > MARKER_PEAK_MM:
        light = "look"
    detail = f"{worst.marker} {worst.rms_mm:.1f}, peak {every.peak_mm:.0f}"
    return Check(f"{every.rms_mm:.1f} mm", light, detail)


def _gaps(markers: Sequence[MarkerRow]) -> Check:
    every, single = markers[-1], markers[:-1]
    worst = max(single, key=lambda row: row.missing_percent)
    light: Light = "look" if worst.missing_percent > GAP_PERCENT else "good"
    detail = f"{worst.marker} {worst.missing_percent:.1f} %"
    value = f"{every.missing_percent:.1f} %"
    return Check(value, light, detail if worst.missing_percent else "")


def _hicks(rows: Sequence[ThresholdRow], quantity: str) -> list[Check]:
    return [
        Check(
            f"{'IC' if row.compensated else 'no IC'} {row.peak:.0f} of {row.limit:.0f} {row.unit}",
            "good" if row.passed else "bad",
        )
        for row in rows
        if row.quantity == quantity
    ]


def _delay(delay_s: float | None, uncertainty_s: float | None) -> Check:
    if delay_s is None:
        return Check("unknown", "look")
    spread = "" if uncertainty_s is None else f" ± {1000 * uncertainty_s:.1f}"
    light: Light = "look" if abs(delay_s) > DELAY_S else "good"
    return Check(f"{1000 * delay_s:.1f}{spread} ms", light)
