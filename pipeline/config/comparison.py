"""What a study states of its comparison: checked, and as the design of its statistics."""

from collections.abc import Mapping
from dataclasses import replace

from hbm.spelling import short
from pipeline.config.schema import COVARIATES, Comparison, StudyFile, SubjectFile
from pipeline.config.toml_file import nearest
from pipeline.statistics.design import Design, design_of, unstated_design

PAIR = " - "
"""Between the two cells of a planned pair."""


def comparison_faults(file: StudyFile, subjects: Mapping[str, SubjectFile]) -> list[str]:
    """Check ``[comparison]`` against the conditions and the subjects.

    Parameters
    ----------
    file
        The contents of ``study.toml``.
    subjects
        Subject id -> contents of the subject's file.

    Returns
    -------
    list of str
        One line per fault.
    """
    comparison = file.comparison
    grouped = comparison is not None and comparison.group == "group"
    faults = [
        f'subject {name}: group: has no effect unless comparison.group = "group" in study.toml'
        for name, person in subjects.items()
        if person.group is not None and not grouped
    ]
    faults += [
        f"study.toml: conditions.{name}: is a key of a subject's file too; choose another name"
        for name in file.conditions
        if name in ("group", *COVARIATES)
    ]
    if comparison is None:
        return faults
    where, conditions = "study.toml: comparison", [*file.conditions]
    faults += [
        f"{where}.levels: no condition {short(level)!r}{nearest(level, conditions)}"
        for level in comparison.levels or ()
        if level not in conditions
    ]
    design = _design(file, comparison)
    if comparison.reference not in (None, *design.conditions):
        hint = nearest(comparison.reference, design.conditions)
        faults.append(f"{where}.reference: {short(str(comparison.reference))!r} is no level{hint}")
    return [*faults, *_pair_faults(comparison, design), *_group_faults(comparison, subjects)]


def _pair_faults(comparison: Comparison, design: Design) -> list[str]:
    faults = []
    for place, pair in enumerate(comparison.pairs or ()):
        where, cells = f"study.toml: comparison.pairs: {short(pair)!r}", pair.split(PAIR)
        if len(cells) != 2 or cells[0] == cells[1]:
            example = PAIR.join(design.pairs[0]) if design.pairs else "A - B"
            faults.append(f"{where} is not two cells, such as {example!r}")
            continue
        if PAIR.join(reversed(cells)) in (comparison.pairs or ())[:place]:
            faults.append(f"{where} is another pair turned round; leave one of them out")
        for cell in cells:
            if cell not in design.cells:
                hint = nearest(cell, design.cells)
                faults.append(f"{where}: no cell {short(cell)!r}{hint}")
    return faults


def _group_faults(wanted: Comparison, subjects: Mapping[str, SubjectFile]) -> list[str]:
    if wanted.group is None or not subjects:
        return []
    of_subject = {name: _group(person, wanted.group) for name, person in subjects.items()}
    faults = [
        f"subject {name}: {wanted.group}: is missing; comparison.group in study.toml tells groups "
        "apart by it"
        for name, group in of_subject.items()
        if group is None
    ]
    if not faults and len({*of_subject.values()}) == 1:
        only = short(str(of_subject.popitem()[1]))
        faults.append(
            f"study.toml: comparison.group: all subjects are in the group {only!r}; a comparison "
            "needs two groups or more"
        )
    return faults


def _group(person: SubjectFile, key: str) -> str | None:
    sex = None if person.sex == "unspecified" else person.sex
    return person.group if key == "group" else sex


def groups(file: StudyFile, subjects: Mapping[str, SubjectFile]) -> dict[str, str | None]:
    """Give the group of every subject, by the key that the comparison names; empty without one."""
    key = file.comparison.group if file.comparison is not None else None
    return {} if key is None else {name: _group(p, key) for name, p in subjects.items()}


def _design(file: StudyFile, comparison: Comparison | None) -> Design:
    """Give the design of the levels and the reference alone; without them, that of conditions."""
    calibrated = file.treadmill.calibrated
    # nobody is compared with a perturbation
    ordered = sorted(file.conditions, key=lambda name: file.conditions[name].perturbed)
    unstated = unstated_design(ordered, compensated=calibrated)
    if comparison is None:
        return unstated
    levels = comparison.levels or unstated.conditions
    return design_of(levels, compensated=calibrated, reference=comparison.reference)


def study_design(file: StudyFile) -> Design:
    """Give the design of a study, from what it states or from its conditions.

    Parameters
    ----------
    file
        The contents of ``study.toml``, checked.

    Returns
    -------
    Design
        As stated; without a ``[comparison]``, experiment 3's where the conditions are its, or else
        all conditions in their order. Compensation is a factor where there is a calibration.

    Examples
    --------
    >>> conditions = {"still": {}, "tilt": {}, "shake": {}}
    >>> study_design(StudyFile.model_validate({"conditions": conditions})).pairs
    (('tilt', 'still'), ('shake', 'still'))
    """
    comparison = file.comparison
    design = _design(file, comparison)
    if comparison is None:
        return design
    pairs = design.pairs
    if comparison.pairs is not None:
        cells = [pair.split(PAIR) for pair in comparison.pairs]
        pairs = tuple((first, second) for first, second in cells)
    usual = tuple(name for name in design.covariates if name != comparison.group)
    return replace(
        design,
        pairs=pairs,
        factor=comparison.factor,
        correction=comparison.correction,
        covariates=usual if comparison.covariates is None else comparison.covariates,
        margin=comparison.margin,
        group=comparison.group,
        weigh=comparison.weigh,
    )
