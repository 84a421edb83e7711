"""What a study states of its comparison: checked, and as the design of its statistics."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from hbm.spelling import did_you_mean, listed, short
from pipeline.config.schema import COVARIATES, Comparison, StudyFile, SubjectFile
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
    stated = file.comparison
    grouped = stated is not None and stated.group == "group"
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
    if stated is None:
        return faults
    where, known = "study.toml: comparison", [*file.conditions]
    for level in stated.levels or ():
        if level not in known:
            hint = did_you_mean(level, known) or f"; there are {listed(known)}"
            faults.append(f"{where}.levels: no condition {short(level)!r}{hint}")
    levels = stated.levels or _unstated(file).conditions
    if stated.reference is not None and stated.reference not in levels:
        hint = did_you_mean(stated.reference, levels) or f"; there are {listed(levels)}"
        faults.append(f"{where}.reference: {short(stated.reference)!r} is no level{hint}")
    faults += _pair_faults(stated, _bare(file, stated, levels))
    return faults + _group_faults(stated, subjects)


def _pair_faults(stated: Comparison, design: Design) -> list[str]:
    faults = []
    for place, pair in enumerate(stated.pairs or ()):
        where, cells = f"study.toml: comparison.pairs: {short(pair)!r}", pair.split(PAIR)
        if len(cells) != 2 or cells[0] == cells[1]:
            example = PAIR.join(design.pairs[0]) if design.pairs else "A - B"
            faults.append(f"{where} is not two cells, such as {example!r}")
            continue
        if PAIR.join(reversed(cells)) in (stated.pairs or ())[:place]:
            faults.append(f"{where} is another pair turned round; leave one of them out")
        for cell in cells:
            if cell not in design.cells:
                hint = did_you_mean(cell, design.cells) or f"; there are {listed(design.cells)}"
                faults.append(f"{where}: no cell {short(cell)!r}{hint}")
    return faults


def _group_faults(stated: Comparison, subjects: Mapping[str, SubjectFile]) -> list[str]:
    if stated.group is None or not subjects:
        return []
    groups = {name: _group(person, stated.group) for name, person in subjects.items()}
    faults = [
        f"subject {name}: {stated.group}: is missing; comparison.group in study.toml tells groups "
        "apart by it"
        for name, group in groups.items()
        if group is None
    ]
    if not faults and len(set(groups.values())) == 1:
        (only,) = set(groups.values())
        faults = [
            f"study.toml: comparison.group: all subjects are in the group {short(only)!r}; "
            "a comparison needs two groups or more"
        ]
    return faults


def _group(person: SubjectFile, key: str) -> str | None:
    sex = None if person.sex == "unspecified" else person.sex
    return person.group if key == "group" else sex


def groups(file: StudyFile, subjects: Mapping[str, SubjectFile]) -> dict[str, str | None]:
    """Give the group of every subject, by the key that the comparison names; empty without one."""
    key = file.comparison.group if file.comparison is not None else None
    return {} if key is None else {name: _group(p, key) for name, p in subjects.items()}


def _unstated(file: StudyFile) -> Design:
    return unstated_design([*file.conditions], compensated=file.treadmill.calibrated)


def _bare(file: StudyFile, stated: Comparison, levels: Sequence[str]) -> Design:
    """Give the design of the levels and the reference alone."""
    calibrated = file.treadmill.calibrated
    return design_of(levels, compensated=calibrated, reference=stated.reference)


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
    unstated, stated = _unstated(file), file.comparison
    if stated is None:
        return unstated
    design = _bare(file, stated, stated.levels or unstated.conditions)
    pairs = design.pairs
    if stated.pairs is not None:
        cells = [pair.split(PAIR) for pair in stated.pairs]
        pairs = tuple((first, second) for first, second in cells)
    usual = tuple(name for name in design.covariates if name != stated.group)
    return replace(
        design,
        pairs=pairs,
        factor=stated.factor,
        correction=stated.correction,
        covariates=usual if stated.covariates is None else stated.covariates,
        margin=stated.margin,
        group=stated.group,
        weigh=stated.weigh,
    )
