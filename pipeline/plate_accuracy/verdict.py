"""The verdict of experiment 1: what speaks against the plates, and what is to be corrected."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from pipeline.plate_accuracy.accuracy import Experiment1
from pipeline.plate_accuracy.faults import Estimate

SHOWN_AS: Final = {"m": (1000.0, "mm"), "s": (1000.0, "ms"), "1": (100.0, "%")}


def verdict(found: Experiment1) -> tuple[bool, list[str], list[str]]:
    """Judge whether the plates are fit for inverse dynamics.

    Returns
    -------
    fit
        True if nothing that cannot be corrected exceeds its limit.
    against
        What exceeds its limit, as sentences.
    correct
        What must or may be corrected, and how.
    """
    limits, against, correct = found.study.file.limits, [], []
    supported = any(t.weight.supports for t in found.trials)
    in_use = f"vibration {'with' if supported else 'without'} supports"
    for one in found.estimates:
        if not one.found:
            continue
        size, name = abs(one.value), one.fault
        if (name == "angle" and size > limits.angle_deg) or (
            name.startswith("offset") and size > limits.offset_m
        ):
            correct.append(f"{said(one)}: align the {one.belt} plate with the cameras")
        elif name == "delay" and size > limits.delay_s:
            correct.append(f"{said(one)}: state plate_delay_s = {one.value:.4f} in study.toml")
        elif name == in_use and size > limits.cop_m:
            against.append(f"{said(one)}, more than {1000 * limits.cop_m:g} mm")
        elif name.startswith("vibration") and size > limits.cop_m:
            correct.append(f"{said(one)}: measure with the supports")
    for belt, straight in found.linearities.items():
        if straight.percent_of_full_scale > limits.nonlinearity_percent:
            against.append(
                f"{belt}: non-linearity {straight.nonlinearity:.1f} N, "
                f"{straight.percent_of_full_scale:.1f} % of full scale, more than "
                f"{limits.nonlinearity_percent:g} %"
            )
    whole = found.errors[found.errors["zone"] == "all"]
    whole = whole[whole["supports"] == whole["supports"].any()]
    means = whole.groupby(["belt", "quantity"])["orthogonal"].mean()
    noise = marker_share(found)
    for belt, quantity, value in means.reset_index().itertuples(index=False):
        limit = limits.cop_m if quantity.startswith("COP") else limits.force_n
        own = float(np.sqrt(max(value**2 - noise.get((belt, quantity), 0.0) ** 2, 0.0)))
        if quantity[0] != "M" and own > limit:
            shown = f"{1000 * own:.1f} mm" if quantity[0] == "C" else f"{own:.1f} N"
            most = f"{1000 * limit:g} mm" if quantity[0] == "C" else f"{limit:g} N"
            against.append(f"{belt}: {quantity} is off by {shown} RMS, more than {most}")
    return not against, against, correct


def marker_share(found: Experiment1) -> dict[tuple[str, str], float]:
    """Give the part of each orthogonal error that the marker's own noise makes, per belt.

    The weight does not leave the belt, so what its marker's vertical acceleration shows is noise;
    along the belt it is taken to be as large.
    """
    share: dict[tuple[str, str], float] = {}
    for belt in {t.weight.belt for t in found.trials}:
        trials = [t for t in found.trials if t.weight.belt == belt]
        force = float(np.mean([np.std(t.truth[t.used, 2]) for t in trials]))
        lever = found.study.file.center_height_m
        load = float(np.mean([np.mean(t.truth[t.used, 2]) for t in trials]))
        share[belt, "Fx"] = share[belt, "Fz"] = share[belt, "Fy"] = force
        share[belt, "COPx"] = share[belt, "COPy"] = lever * force / load
    return share


def said(one: Estimate) -> str:
    """Say an estimate with its 95 % uncertainty."""
    scale, unit = SHOWN_AS.get(one.unit, (1.0, one.unit))
    error = scale * one.uncertainty
    digits = max(1 - math.floor(math.log10(error)), 0) if error > 0 else 3
    text = f"{one.belt}: {one.fault} {scale * one.value:.{digits}f} ± {error:.{digits}f} {unit}"
    if np.isfinite(one.hz[0]):
        text += f" at {one.hz[0]:.2f} Hz in the centre of pressure along the belt"
    return text


def unexamined(found: Experiment1) -> list[str]:
    """Say what could not be examined on every plate, for want of recordings."""
    belts = {t.weight.belt for t in found.trials}
    lacking = {
        "alignment (static recordings)": belts - set(found.alignments),
        "delay (hammer blows)": belts - set(found.delays),
        "linearity (three weights)": belts - set(found.linearities),
        "cross-talk and drift (more recordings of weights)": belts
        - {e.belt for e in found.estimates if e.fault == "drift"},
    }
    return [f"{what} {' and '.join(sorted(lack))}" for what, lack in lacking.items() if lack]


def sentence(
    fit: bool, against: Sequence[str], correct: Sequence[str], lacking: Sequence[str]
) -> str:
    """Say the verdict in one sentence, from `verdict` and `unexamined`."""
    if not fit:
        return f"Not fit for inverse dynamics: {'; '.join(against)}."
    limited = f", as far as was examined (not: {'; '.join(lacking)})" if lacking else ""
    if correct:
        return f"Fit for inverse dynamics{limited} once corrected: {'; '.join(correct)}."
    return f"Fit for inverse dynamics{limited}."
