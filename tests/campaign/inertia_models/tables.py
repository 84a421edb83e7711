"""What the models leave, as the tables of docs/inertia_models.md."""

from collections.abc import Sequence

import numpy as np

from hbm.spatial import WRENCH_COMPONENTS
from pipeline.virtual_lab.protocol.ranking_study import BYSTANDERS
from tests.campaign.inertia_models.cases import (
    BEST,
    MACHINES,
    MODELS,
    Judged,
)

GOAL = (2.0, 1.0)
"""Largest component that may be left beyond what is left on a rigid machine [N, N·m]."""
MAX_WORSE = 1.1
"""Factor by which a dynamic model that is taken may leave more than the static one of any trial."""


def pooled(found: Sequence[Judged], model: str, band: int) -> np.ndarray:
    """Give what a model leaves below 20 (0) or 6 Hz (1), root mean square over seeds, (6,)."""
    return np.sqrt(np.mean([getattr(one, model)[band] ** 2 for one in found], axis=0))


def norms(left: np.ndarray) -> tuple[float, float]:
    """Give the norms of force and moment [N, N·m]."""
    return float(np.linalg.norm(left[:3])), float(np.linalg.norm(left[3:]))


def worst_share(found: Sequence[Judged]) -> float:
    """Give the largest factor by which the dynamic model leaves more of a trial, of its norms."""
    return max(
        new / old
        for one in found
        for band in (0, 1)
        for new, old in zip(norms(one.dynamic[band]), norms(one.static[band]), strict=True)
    )


Group = tuple[str, str, int]
"""Machine, calibration, and number of accelerometers."""


def grouped(found: Sequence[Judged]) -> dict[Group, dict[str, list[Judged]]]:
    """Sort by machine, calibration and number of accelerometers, and by trial."""
    groups: dict[Group, dict[str, list[Judged]]] = {}
    for one in found:
        group = groups.setdefault((one.machine, one.calibration, one.sensors), {})
        group.setdefault(one.trial, []).append(one)
    return groups


def beyond_rigid(found: Sequence[Judged], machine: str) -> dict[str, np.ndarray]:
    """Give what the model that the best calibration chooses leaves beyond a rigid machine, (6,).

    That is what belts and rollers do to their own plate, drift and noise: no model of the platform
    removes it.
    """
    groups = grouped(found)
    here, rigid = groups[machine, *BEST], groups["rigid", *BEST]
    return {
        trial: np.sqrt(
            np.maximum(pooled(ones, "taken", 0) ** 2 - pooled(rigid[trial], "static", 0) ** 2, 0.0)
        )
        for trial, ones in here.items()
    }


def table(found: Sequence[Judged], band: int) -> list[str]:
    """Give what both models leave of every trial, a row per calibration and number of sensors."""
    rows = [
        f"| machine | calibration | sensors | {' | '.join(BYSTANDERS)} | worst | taken in |",
        f"|---|---|---:|{'---:|' * (len(BYSTANDERS) + 2)}",
    ]
    for (machine, name, count), trials in grouped(found).items():
        cells = []
        for trial in BYSTANDERS:
            old, new = (norms(pooled(trials[trial], model, band)) for model in MODELS)
            cells.append(f"{old[0]:.1f}, {old[1]:.2f} → {new[0]:.1f}, {new[1]:.2f}")
        every = [one for ones in trials.values() for one in ones]
        taken = 100 * np.mean([one.chosen == "dynamic" for one in every])
        cells += [f"× {worst_share(every):.2f}", f"{taken:.0f} %"]
        rows.append(f"| {machine} | {name} | {count} | {' | '.join(cells)} |")
    return rows


def components(found: Sequence[Judged]) -> list[str]:
    """Give every component that the best calibration leaves of every trial, below 20 and 6 Hz."""
    rows = [
        f"| machine | trial | model | {' | '.join(WRENCH_COMPONENTS)} |",
        f"|---|---|---|{'---:|' * 6}",
    ]
    for (machine, *group), trials in grouped(found).items():
        for trial, ones in trials.items() if tuple(group) == BEST else ():
            for model in MODELS:
                both = zip(pooled(ones, model, 0), pooled(ones, model, 1), strict=True)
                cells = " | ".join(f"{fast:.2f} ({slow:.2f})" for fast, slow in both)
                rows.append(f"| {machine} | {trial} | {model} | {cells} |")
    return rows


def places_table(found: dict[str, list[Judged]]) -> list[str]:
    """Give what both models leave of running and the rest, a row per arrangement."""
    rows = [
        f"| places | {' | '.join(BYSTANDERS)} |",
        f"|---|{'---:|' * len(BYSTANDERS)}",
    ]
    for name, every in found.items():
        (trials,) = grouped(every).values()
        cells = []
        for trial in BYSTANDERS:
            old, new = (norms(pooled(trials[trial], model, 0)) for model in MODELS)
            cells.append(f"{old[0]:.1f}, {old[1]:.2f} → {new[0]:.1f}, {new[1]:.2f}")
        rows.append(f"| {name} | {' | '.join(cells)} |")
    return rows


def unmet(found: Sequence[Judged]) -> list[str]:
    """Give what is demanded and not reached."""
    missed, groups = [], grouped(found)
    for (machine, name, count), trials in groups.items():
        taken = [one for ones in trials.values() for one in ones if one.chosen == "dynamic"]
        if taken and worst_share(taken) > MAX_WORSE:
            missed.append(
                f"{machine} machine, {name}, {count} sensors: where it is taken, the dynamic model "
                f"leaves up to {worst_share(taken):.2f} times as much as the static one"
            )
    for machine in MACHINES:
        for trial, left in beyond_rigid(found, machine).items():
            if left[:3].max() > GOAL[0] or left[3:].max() > GOAL[1]:
                missed.append(
                    f"{machine} machine, {trial}: components up to {left[:3].max():.2f} N and "
                    f"{left[3:].max():.2f} N·m beyond a rigid one"
                )
    return missed
