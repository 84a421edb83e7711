"""The verdicts of a study in sentences."""

from collections.abc import Iterator, Sequence

from pipeline.statistics.design import CONFIDENCE, EXPERIMENT_3, MIN_SUBJECTS, Design
from pipeline.statistics.sample_size import MAX_SUBJECTS, POWER
from pipeline.statistics.verdict import Verdict


def headlines(found: Sequence[Verdict], design: Design = EXPERIMENT_3) -> tuple[str, ...]:
    """Summarise the verdicts of a study: a sentence per condition, and one on what is missing.

    Parameters
    ----------
    found
        Verdicts of all conditions.
    design
        The design that they are of.

    Returns
    -------
    tuple of str
        The compared conditions first, then the reference; at the end, where verdicts are
        inconclusive, how many subjects would decide them. So few subjects that no exact test can
        become significant are called a demonstration there, and only there. Last, where intervals
        of measurement are known, where they leave open on which side of the margin a residual is.
    """
    compared = [v for v in found if v.n >= MIN_SUBJECTS]
    subjects = max((v.n for v in compared), default=0)
    undecided = [v for v in compared if v.answer == "inconclusive"]
    few = len(design.pairs) * 2.0 ** (1 - subjects) > 1 - CONFIDENCE
    order = [*design.others, design.reference]
    sentences = [
        f"{headline(compared, condition, design, name_undecided=not few)}."
        for condition in order
        if any(v.condition == condition and (not few or v not in undecided) for v in compared)
    ]
    if undecided:
        verb = "is" if len(undecided) == 1 else "are"
        result = f"{len(undecided)} of {len(compared)} comparisons {verb} inconclusive"
        if few:
            result = f"{subjects} subjects are a demonstration: {result}"
        sentences.append(f"{result}. {_enough(undecided)}.")
    return (*sentences, *_uncertain(compared, order, design))


def _uncertain(compared: Sequence[Verdict], order: Sequence[str], design: Design) -> Iterator[str]:
    """Say where errors of measurement leave open on which side of the margin a residual is."""
    parts = []
    for condition in order:
        of_condition = [v for v in compared if v.condition == condition and v.measurement]
        named = [v.axis for v in of_condition if v.measurement and v.measurement.contains_margin]
        every = 1 < len(named) == len(of_condition)
        if named:
            parts.append(f"{'all residuals' if every else join_names(named)} in {condition}")
    if parts:
        yield (
            f"For {', and '.join(parts)}, errors of usual size alone could turn the verdict: by "
            f"measurement, the residual may be on either side of the margin of "
            f"{100 * design.margin:g} %."
        )


def _enough(undecided: Sequence[Verdict]) -> str:
    """Say how many subjects would decide the comparisons that are inconclusive."""
    lacking = [v for v in undecided if v.lacks_subjects]
    needed = [v.needed for v in lacking if v.needed is not None]
    sentences = []
    if needed:
        them, they_are = ("it", "it is") if len(needed) == 1 else ("them", "they are")
        which = them if len(needed) == len(undecided) else f"{len(needed)} of them"
        sentences.append(
            f"With the variance between subjects, {max(needed)} would show {which} to be at the "
            f"level of the reference, if {they_are} there ({100 * POWER:g} % power)"
        )
    if never := len(lacking) - len(needed):
        which = "them" if never == len(undecided) else f"{never} of them"
        sentences.append(f"Subjects differ so much that {MAX_SUBJECTS} would not decide {which}")
    if enough := len(undecided) - len(lacking):
        sentences.append(
            f"For {enough}, these subjects would have been enough if there were no difference: "
            "there may be one"
        )
    return ". ".join(sentences)


def headline(
    found: Sequence[Verdict],
    condition: str,
    design: Design = EXPERIMENT_3,
    *,
    name_undecided: bool = True,
) -> str:
    """Summarise a condition's verdicts in one sentence.

    Parameters
    ----------
    found
        Verdicts of all conditions.
    condition
        The condition to summarise.
    design
        The design that they are of.
    name_undecided
        Whether to name the residuals whose verdict is inconclusive.

    Returns
    -------
    str
        How many residuals are at baseline with compensation, and the names of the others.
    """
    own = [v for v in found if v.condition == condition]
    named = {a: [v.axis for v in own if v.answer == a] for a in ("above", "inconclusive")}
    at_baseline = sum(v.answer == "at baseline" for v in own)
    if not at_baseline and not any(named.values()):
        return f"In {condition}, there are too few subjects for a comparison"
    back, above = f"at {level_name(design)}", "above it"
    if condition == design.reference:
        back, above = f"increased by no more than {100 * design.margin:g} %", "increased"
    compensated = " with compensation" * design.compensated
    verb = "is" if at_baseline == 1 else "are"
    parts = [f"{at_baseline} of {len(own)} residuals {verb} {back}{compensated}"]
    if named["above"]:
        verb = "is" if len(named["above"]) == 1 else "are"
        parts.append(f"{join_names(named['above'])} {verb} {above}")
    if named["inconclusive"] and name_undecided:
        subjects = max(v.n for v in own)
        result = f"result is inconclusive with {subjects} subjects"
        parts.append(f"for {join_names(named['inconclusive'])}, the {result}")
    return f"In {condition}, " + "; ".join(parts)


def level_name(design: Design) -> str:
    """Name the reference's level in a sentence: "baseline level", or "the level of barefoot"."""
    return (
        "baseline level" if design.reference == "baseline" else f"the level of {design.reference}"
    )


def join_names(names: Sequence[str]) -> str:
    """Join names as in a sentence, with "and" before the last."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
