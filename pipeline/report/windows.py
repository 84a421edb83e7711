"""What of its trials each condition's residuals are of, in one sentence."""

from typing import Final

import pandas as pd

from pipeline.statistics.verdict import join_names

DESCRIBED: Final = {
    "cycle": "whole gait cycles",
    "span": "spans of the recordings",
    "motion": "the time from the onset of each perturbation for which the platform moves fast",
}
"""Window -> what counts."""


def windows_sentence(residuals: pd.DataFrame) -> str:
    """Say over what the residuals of each condition are summarised.

    Parameters
    ----------
    residuals
        Long table with the columns condition and window, one window per trial.

    Returns
    -------
    str
        A sentence.

    Examples
    --------
    >>> table = pd.DataFrame({"condition": ["level", "sway"], "window": ["cycle", "10 to 40 %"]})
    >>> windows_sentence(table)  # doctest: +ELLIPSIS
    'RMS over whole gait cycles (level) and 10 to 40 % of the perturbed gait cycle (sway). ...'
    """
    conditions: dict[str, list[str]] = {}
    pairs = residuals[["window", "condition"]].drop_duplicates()
    for window, condition in pairs.itertuples(index=False):
        conditions.setdefault(window, []).append(condition)
    parts = [f"{described(name)} ({', '.join(own)})" for name, own in conditions.items()]
    if not parts:
        return ""
    unlike = (
        " Conditions differ in the part of the gait cycle that counts, and so may their residuals."
    )
    within = [name for name in conditions if name not in ("cycle", "span")]
    return f"RMS over {join_names(parts)}.{unlike * bool(within and len(conditions) > 1)}"


def described(window: str) -> str:
    """Say what a window is."""
    of_cycle = window.endswith("%")
    after = "of the perturbed gait cycle" if of_cycle else "after the onset of each perturbation"
    return DESCRIBED.get(window, f"{window} {after}")
