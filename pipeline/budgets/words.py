"""Causes of residuals in words: names of groups, sizes, what to mend, a table of shares, lines."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pipeline.explain.budget import Budget, EstimatedCause
from pipeline.explain.cause import OF_PERSON, groups
from pipeline.explain.linearise import MIN_CYCLES
from pipeline.explain.shares import NORMAL_95
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.residuals import AXES, UNITS
from pipeline.trial.result import TrialResult

MIN_FALL: Final = 0.03
"""Share of a residual's RMS that mending a cause has to take away to be worth a word."""
MAX_MENDINGS: Final = 3
LATE: Final = "plates are late"
MASS: Final = "body mass"
"""Names of causes that a person can state."""
MAX_CAUSES: Final = 5
"""Named one by one; the file has all."""
CAPTION: Final = (
    "RMS with its 95 % interval of measurement; shares of the mean square in % ± 95 % interval. A "
    "negative share: without this cause the residual would be larger."
)
Column = tuple[str, tuple[str, ...]]
"""Head and cells of a column."""


SHOWN_UNITS: Final[Mapping[str, tuple[float, str]]] = {
    "s": (1000.0, "ms"),
    "m": (1000.0, "mm"),
    "rad": (57.29577951308232, "°"),
    "1": (100.0, "%"),
}
"""Unit of a size -> factor and the unit that a person reads it in."""


def group_name(names: Sequence[str]) -> str:
    """Name groups of causes that cannot be told apart.

    Examples
    --------
    >>> group_name(["zero", "place", "inertia"])
    "plates' zero, or their place and direction, or body's masses"
    >>> group_name(["inertia", "markers", "skin", "soft_tissue"])
    'body and markers'
    """
    parts, before = list[str](), ""
    for words in map(groups().__getitem__, apart(names)):
        owner = words.get("owner", "")
        shown = "their" if owner and owner == before else owner
        parts.append(f"{shown} {words['what']}".strip())
        before = owner
    return ", or ".join(parts)


def apart(names: Sequence[str]) -> list[str]:
    """Give groups that are more than one to their reader: those of the person are one."""
    person = [name for name in names if name in OF_PERSON]
    if len(person) < 2:
        return list(names)
    return ["person" if name == person[0] else name for name in names if name not in person[1:]]


def how_to_tell_apart(names: Sequence[str]) -> tuple[str, ...]:
    """Say what knowing would tell groups of causes apart.

    Parameters
    ----------
    names
        Groups that a trial cannot tell apart.

    Returns
    -------
    tuple of str
        For all of them but one, the easiest first: what tells their sizes in another way. Body and
        markers count as one.

    Examples
    --------
    >>> how_to_tell_apart(["gain", "zero"])
    ('record 5 s of empty plates before the trial',)
    """
    separate = apart(sorted(names, key=[*groups()].index))
    ways = [groups()[name]["know"] for name in separate if "know" in groups()[name]]
    return tuple(ways[: len(separate) - 1])


def size_in_words(cause: EstimatedCause) -> str:
    """Give the size of a cause with its 95 % interval, such as "9.1 ± 5.7 ms"."""
    factor, unit = SHOWN_UNITS.get(cause.unit, (1.0, cause.unit))
    size, half = factor * cause.size, factor * NORMAL_95 * cause.deviation
    digits = 2 if half < 0.95 else 1 if half < 9.5 else 0
    return f"{size:.{digits}f} ± {half:.{digits}f} {unit}"


@dataclass(frozen=True, slots=True)
class Mending:
    """What to do about a cause of certain size, and what that would change.

    Attributes
    ----------
    cause
        Its name.
    action
        What to do.
    axis
        The residual that falls most, as a share of itself.
    before, after
        Its RMS now and without the cause [N, N·m].
    """

    cause: str
    action: str
    axis: str
    before: float
    after: float

    def __str__(self) -> str:
        unit = UNITS[AXES.index(self.axis)]
        return f"{self.action} ({self.axis} {self.before:.1f} → {self.after:.1f} {unit})"


def most_worth_mending(
    budget: Budget, result: TrialResult, laboratory: Laboratory
) -> tuple[Mending, ...]:
    """Find what is most worth mending.

    Parameters
    ----------
    budget
        What the residuals are made of.
    result, laboratory
        The trial and its laboratory: what is stated of them now.

    Returns
    -------
    tuple of Mending
        Causes whose 95 % interval excludes zero and without which a residual would be smaller, the
        one with the largest share first; none that nothing in the laboratory changes. A delay or a
        mass is given as the line that states it.
    """
    found = []
    for cause in budget.causes:
        fall = 1 - cause.left / budget.rms
        axis = int(fall.argmax())
        if cause.is_certain and fall[axis] >= MIN_FALL:
            action = _stated(cause, result, laboratory)
            rms = float(budget.rms[axis]), float(cause.left[axis])
            if action:
                found.append((fall[axis], Mending(cause.name, action, AXES[axis], *rms)))
    found.sort(key=lambda each: -each[0])
    return tuple(own for _, own in found[:MAX_MENDINGS])


def _stated(cause: EstimatedCause, result: TrialResult, laboratory: Laboratory) -> str:
    """Give the line that states a cause, or what to do where there is none."""
    calibrated = laboratory.plates is not None
    if cause.name == LATE and not calibrated:
        delay_s = (result.settings.plate_delay_s or 0.0) + cause.size
        return f"state plate_delay_s = {delay_s:.3f} under [settings]"
    if cause.name == MASS:
        mass_kg = result.body.mass / (1 + cause.size)
        return f"state mass_kg = {mass_kg:.1f} of the subject, once scales confirm it"
    return (
        groups()[cause.group].get("mend", "").format(cause=f"{cause.name} {size_in_words(cause)}")
    )


def budget_table(budget: Budget) -> tuple[str, tuple[str, ...], list[Column]]:
    """Lay out what a trial's residuals are made of.

    Returns
    -------
    title
        Which trial, and what of it.
    axes
        Heads of the rows: the residuals.
    columns
        Heads and cells of the others: the RMS, one for each group of causes, the rest.
    """
    plates = "compensated plates" if budget.compensated else "plates as measured"
    counts = "no gait cycles"
    if budget.cycles:
        counts = f"{budget.cycles} of {budget.found_cycles} gait cycles of one side"
    title = (
        f"Pelvis residuals of {budget.source.name} and what they are made of, {plates}, {counts}"
    )
    interval = [f"{low:.1f}–{high:.1f}" for low, high in zip(budget.low, budget.high, strict=True)]
    columns = [("RMS", tuple(f"{value:.1f}" for value in budget.rms)), ("95 %", tuple(interval))]
    for group in budget.groups:
        head, own = group_name(group.groups), [c for c in budget.causes if c.group in group.groups]
        if len(own) == 1:
            head = f"{head}: {size_in_words(own[0])}"
        columns.append((head, tuple(map(_share, group.share, group.deviation))))
    columns.append(("not explained", tuple(f"{100 * share:z.0f}" for share in budget.unexplained)))
    return title, tuple(f"{axis}, {unit}" for axis, unit in zip(AXES, UNITS, strict=True)), columns


def _share(share: float, deviation: float) -> str:
    """Write a share with its 95 % interval, where that is not 0."""
    half, text = 100 * NORMAL_95 * deviation, f"{100 * share:z.0f}"
    return f"{text} ± {half:.0f}" if half >= 0.5 else text


def budget_lines(budget: Budget, mendings: Sequence[Mending]) -> Iterator[str]:
    """Say what a table of shares does not: sizes, what to mend, what is merged, the check."""
    certain = [cause for cause in budget.causes if cause.is_certain][:MAX_CAUSES]
    if certain:
        named = [f"{cause.name} {size_in_words(cause)}" for cause in certain]
        yield f"Largest causes (size ± 95 % interval): {'; '.join(named)}."
    else:
        yield "No single cause is certain: the 95 % interval of every size contains zero."
    if mendings:
        yield f"Most worth mending: {'; '.join(map(str, mendings))}."
    else:
        yield "Nothing is clearly worth mending: no certain cause makes much of a residual."
    for group in budget.groups:
        if len(apart(group.groups)) > 1:
            ways = how_to_tell_apart(group.groups)
            how = f": {'; '.join(ways)}" if ways else ""
            yield f"This trial cannot tell apart {group_name(group.groups)}{how or ' from it'}."
    of = "cycles" if budget.cycles >= MIN_CYCLES else "frames"
    shares = zip(budget.held_out, AXES, strict=True)
    taken = ", ".join(f"{100 * share:z.0f} % of {axis}" for share, axis in shares)
    yield (
        f"Held-out check: the causes found in one half of the {of} take away of the mean square of "
        f"the other half {taken}{' (negative: they add)' * bool((budget.held_out < 0).any())}."
    )
