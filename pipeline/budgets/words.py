"""Causes of residuals in words: names of groups, sizes, what to fix, a table, lines."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from compensation.inertia.sensors import QUANTILE_95
from hbm.numbers import read_numbers
from hbm.spatial import Array
from hbm.spelling import counted, listed, written
from pipeline.explain.budget import Budget, EstimatedCause, SharedCause, alike_in_plates
from pipeline.explain.cause import OF_PERSON, UNSEEN, groups
from pipeline.explain.linearise import LIMITS as OF_FRAMES
from pipeline.trial.residuals import AXES, UNITS
from pipeline.trial.result import TrialResult

LIMITS: Final = read_numbers("pipeline.budgets", "thresholds.toml", "fix")
NOTHING_CERTAIN: Final = "Beyond warnings, no certain fault explains much of a residual."
LATE: Final = "plates delayed"
MASS: Final = "body mass"
"""Names of causes that a person can state."""
WITH_MARKERS: Final = "95 % intervals are of the RMS that markers on trunk and arms would show."
CAPTION: Final = (
    "RMS with 95 % interval of measurement; percentage of the mean square ± 95 % interval. "
    "Negative: without this cause the residual would be larger."
)


class Share(NamedTuple):
    """A cause's part of the mean square of a residual, and half of its 95 % interval [%]."""

    percent: float
    half: float = 0.0

    def __str__(self) -> str:
        text = written(self.percent, "z.0f")
        return f"{text} ± {self.half:.0f}" if self.half >= 0.5 else text


Row = tuple[str, tuple[str | Share, ...]]
"""Head and cells of a row."""


def group_name(names: Sequence[str]) -> str:
    """Name groups of causes that cannot be distinguished.

    Examples
    --------
    >>> group_name(["zero", "place", "inertia"])
    "plates' zero, or plates' place and direction, or body's masses"
    >>> group_name(["inertia", "markers", "skin", "soft_tissue"])
    'body and markers'
    """
    return ", or ".join(groups()[name]["what"] for name in apart(names))


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
    read_in = {"s": (1000.0, "ms"), "m": (1000.0, "mm"), "1": (100.0, "%")}
    read_in["rad"] = (57.29577951308232, "°")
    factor, unit = read_in.get(cause.unit, (1.0, cause.unit))
    size, half = factor * cause.size, factor * QUANTILE_95 * cause.deviation
    # two digits of the interval, none beyond the unit
    digits = 2 if half < 0.95 else 1 if half < 9.5 else 0
    return f"{written(size, f'z.{digits}f')} ± {half:.{digits}f} {unit}"


@dataclass(frozen=True, slots=True)
class Fix:
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
        fall = f"from {self.before:.0f} to {self.after:.0f} {unit}"
        if round(self.before) == round(self.after) or self.before < 10:
            fall = f"from {self.before:.1f} to {self.after:.1f} {unit}"
        return f"{self.action} This alone would lower {self.axis} {fall}."


def what_to_fix_first(budget: Budget, result: TrialResult) -> tuple[Fix, ...]:
    """Find what to fix first.

    Parameters
    ----------
    budget
        What the residuals are made of.
    result
        The trial, processed with what is stated of it now.

    Returns
    -------
    tuple of Fix
        Certain faults of instruments, of the stated mass or of shoes; the one that lowers a
        residual most comes first. Each lowers one by 3 % at least, for which causes of one half
        explain the other. Other causes of the body are not named: walking takes one for another.
    """
    alike = alike_in_plates(budget.causes)
    fixes = [_fix(c, budget.rms, result) for c in budget.causes if c.name not in alike]
    # causes of one half of the cycles have to explain the other half
    holding = [fix for fix in fixes if fix and budget.held_out[AXES.index(fix.axis)] >= 0]
    return tuple(sorted(holding, key=lambda fix: fix.after / fix.before)[: LIMITS.most])


def _fix(cause: EstimatedCause, rms: Array, result: TrialResult) -> Fix | None:
    """Say what to do about a cause; None where it is not certain, or hardly lowers these RMS."""
    fall = cause.falls(rms)
    axis = int(fall.argmax())
    action = what_to_do(cause, result)
    if not action or not cause.is_certain or fall[axis] < LIMITS.least_fall:
        return None
    return Fix(cause.name, action, AXES[axis], float(rms[axis]), float(cause.left[axis]))


def study_lines(
    causes: Sequence[SharedCause], results: Mapping[str, TrialResult]
) -> tuple[str, ...]:
    """Say which faults trials share, those of the laboratory first, and what to do.

    Parameters
    ----------
    causes
        As `pipeline.explain.joint.explain_together` gives them.
    results
        Name of a trial -> its result.
    """
    alike = alike_in_plates(shared.cause for shared in causes)
    lines = [*alike_lines(alike, {shared.cause.name: shared.rms for shared in causes})]
    for shared in causes:
        cause, trials = shared.cause, shared.trials
        fix = None if cause.name in alike else _fix(cause, shared.rms, results[trials[0]])
        if fix is not None:
            owner = shared.name.removesuffix(cause.name)
            count = f" ({len(trials)} trials)" * (len(trials) > 1)
            held = " It does not lower the residuals of other trials: do not apply it."
            lines.append(f"{owner}{fix}{count}{held * (not shared.holds)}")
    return tuple(lines)


def alike_lines(
    alike: Mapping[str, Sequence[EstimatedCause]], rms: Mapping[str, Array]
) -> Iterator[str]:
    """Say which gains all plates have alike, where one of them by itself would be certain.

    Together they are not: what the body model of all subjects lacks, such as shoes, looks the same.
    ``rms`` is that of the residuals, (6,), by the name of a cause.
    """
    for name, gains in alike.items():
        fall = max(gain.falls(rms[gain.name]).max() for gain in gains)
        # once for all of them
        is_first, is_certain = name == gains[0].name, any(gain.is_certain for gain in gains)
        if is_first and fall >= LIMITS.least_fall and is_certain:
            plates = "all plates alike" if len(gains) > 1 else "the only plate"
            faults = listed(dict.fromkeys(gain.fault for gain in gains))
            sizes = [f"{gain.name.partition(':')[0]} {size_in_words(gain)}" for gain in gains]
            yield (
                f"Not certain: {faults}{gains[0].directed} of {plates}, {listed(sizes)}. What the "
                "body model lacks in all subjects, such as shoes that are not stated, looks the "
                "same; compare with known weights (hbm plates)."
            )


def what_to_do(cause: EstimatedCause, result: TrialResult) -> str:
    """Say what is wrong and what to do; empty where nothing in the laboratory changes it."""
    is_more, component = cause.size > 0, cause.name.split()[-1]
    signed, size = size_in_words(cause), size_in_words(replace(cause, size=abs(cause.size)))
    if cause.name == LATE and not result.procedure.plate_calibration:
        delay_s = (result.settings.plate_delay_s or 0.0) + cause.size
        setting = f"plate_delay_s = {delay_s:.3f} (--plate-delay-ms {1000 * delay_s:.0f})"
        return f"The plates are {size} {'late' if is_more else 'early'}; set {setting}."
    if cause.name == MASS:
        large, mass_kg = "large" if is_more else "small", result.body.mass / (1 + cause.size)
        return (
            f"The body mass is {size} too {large}; weigh the subject: {mass_kg:.1f} kg would fit."
        )
    sentences = {
        ": gain of": "{plate} reads {size} too {much} {where}; recalibrate it.",
        ": Fz in": "{plate}: {signed} of its vertical force appears in {of}; recalibrate it.",
        ": zero of": "{plate} reads {signed} in {of} without load; zero it.",
        ": place along": "{plate}: position {size} too {far} along its {of} axis; measure it "
        "again.",
        ": direction about": "{plate}: orientation {size} too {far} about its {of}; measure it.",
    }
    for words, sentence in sentences.items():
        if words in cause.name:
            of = component + cause.directed
            return sentence.format(
                plate=cause.name.partition(":")[0].capitalize(),
                size=size,
                signed=signed,
                much="much" if is_more else "little",
                far="far" if is_more else "little",
                of=of,
                where="vertically" if component == "Fz" else f"in {of}",
            )
    if cause.group == "shoes" and not is_more and not result.subject.shoe_mass_kg:
        return ""  # no shoe weighs less than none: the foot's own mass is wrong
    mend = groups()[cause.group].get("mend", "").format(cause=f"{cause.name} {signed}")
    return f"{mend[:1].upper()}{mend[1:]}." if mend else ""


def budget_table(budget: Budget) -> tuple[str, tuple[str, ...], list[Row]]:
    """Lay out what a trial's residuals are made of.

    Returns
    -------
    title
        Which trial, and what of it.
    axes
        Heads of the columns: the residuals.
    rows
        The RMS, its interval, a row for each group of causes, the rest.
    """
    plates = "compensated plates" if budget.compensated else "plates as measured"
    counts = "no gait cycles"
    if budget.cycles:
        cycles = counted(budget.found_cycles, "gait cycle")
        counts = f"{budget.cycles} of {cycles} of one side"
    title = f"Causes of the pelvis residuals of {budget.source.name}, {plates}, {counts}"
    interval = [f"{low:.1f}–{high:.1f}" for low, high in zip(budget.low, budget.high, strict=True)]
    rows: list[Row] = [("RMS", tuple(f"{value:.1f}" for value in budget.rms))]
    rows.append(("95 %", tuple(interval)))
    for group in budget.groups:
        head = group_name(group.groups)
        causes = [cause for cause in budget.causes if cause.group in group.groups]
        if len(causes) == 1:
            # the trial tells of it where it is surer than before
            is_known = causes[0].deviation < causes[0].usual
            head = f"{head}: {size_in_words(causes[0]) if is_known else 'unknown'}"
        rows.append((head, tuple(map(_share, group.share, group.deviation))))
    rows.append(("not explained", tuple(Share(100 * share) for share in budget.unexplained)))
    return title, tuple(f"{axis}, {unit}" for axis, unit in zip(AXES, UNITS, strict=True)), rows


def _share(share: float, deviation: float) -> Share:
    return Share(100 * share, 100 * QUANTILE_95 * deviation)


def budget_lines(budget: Budget, mendings: Sequence[Fix]) -> Iterator[str]:
    """Say what a table of shares does not: what to do, what the trial does not tell, the check."""
    rms = dict.fromkeys((cause.name for cause in budget.causes), budget.rms)
    yield from map(str, mendings) if mendings else [NOTHING_CERTAIN]
    yield from alike_lines(alike_in_plates(budget.causes), rms)
    faults = [cause for cause in budget.causes if cause.chance < 1 or cause.group == "delay"]
    unknown = list(dict.fromkeys(cause.fault for cause in faults if not cause.is_told))
    if unknown:
        count = sum(not cause.is_told for cause in faults)
        named = listed(sorted(unknown))
        yield f"Not determined by this trial, {count} of {len(faults)} possible faults: {named}."
    for group in budget.groups:
        surely = group.share - QUANTILE_95 * group.deviation
        axis = int(surely.argmax())
        if {*group.groups} <= UNSEEN and surely[axis] > 0:
            name, share = group_name(group.groups), _share(group.share[axis], group.deviation[axis])
            advice = "; ".join(groups()[unseen]["know"] for unseen in group.groups)
            yield f"{name[0].upper()}{name[1:]}: {share} % of {AXES[axis]}; {advice}."
        if len(apart(group.groups)) > 1:
            ways = how_to_tell_apart(group.groups)
            how = f": {'; '.join(ways)}" if ways else ""
            yield f"Not separable in this trial, {group_name(group.groups)}{how}."
    if any(cause.group in UNSEEN for cause in budget.causes):
        yield WITH_MARKERS
    of = "cycles" if budget.cycles >= OF_FRAMES.fewest_cycles else "frames"
    shares = zip(budget.held_out, AXES, strict=True)
    taken = ", ".join(f"{written(100 * share, 'z.0f')} % of {axis}" for share, axis in shares)
    yield (
        f"Held-out check: causes estimated in one half of the {of} explain of the other half's "
        f"mean square {taken}{' (negative: they add)' * bool((budget.held_out < 0).any())}."
    )
