"""Labels of a C3D file's points: which are markers, which another program computed, whose."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.io.c3d.header import Parameters

OUTPUT_GROUPS = (
    "ANGLES",
    "FORCES",
    "MOMENTS",
    "POWERS",
    "REACTIONS",
    "SCALARS",
    "MODELED_MARKERS",
)
OUTPUT_NAME = re.compile(r"(Angles?|Moments?|Forces?|Powers?|NormalisedGRF)$")
BONE_SUFFIXES = ("O", "A", "L", "P")


@dataclass(frozen=True, slots=True)
class PointLabels:
    """What each point of a file is.

    Attributes
    ----------
    markers, outputs
        Name -> index of the point, for markers and for the outputs of other programs.
    subject
        The label prefix that was removed, empty where there was none.
    notes
        What was renamed, removed or set aside.
    """

    markers: dict[str, int]
    outputs: dict[str, int]
    subject: str
    notes: tuple[str, ...]


def sort_labels(
    parameters: Parameters,
    n_points: int,
    *,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
) -> PointLabels:
    """Tell markers from outputs of other programs and remove subject prefixes.

    Parameters
    ----------
    parameters
        Parameters of the file.
    n_points
        Number of points per frame.
    subject
        Prefix of the subject whose markers are wanted, needed only where two subjects carry the
        same labels.
    rename
        Label in the file (without prefix) -> label wanted.

    Returns
    -------
    PointLabels
        Markers under unique names, outputs, and notes.

    Raises
    ------
    ValueError
        Two subjects carry the same labels and none was chosen, the chosen one or a label to rename
        is not there, or two labels become the same by renaming.

    Notes
    -----
    Outputs are the points listed in POINT:ANGLES, MOMENTS and the like, those so named, and
    Vicon's segment frames: four points named by one stem and O, A, L, P.
    """
    labels, notes = _labels(parameters, n_points)
    owners = {k: label.rpartition(":")[0] for k, label in enumerate(labels)}
    subjects = sorted({owner for owner in owners.values() if owner})
    if subject is not None:
        if subject not in subjects:
            raise ValueError(
                f"no subject {subject!r}; present: {', '.join(subjects) or 'no label prefixes'}"
            )
        wanted = [k for k in owners if owners[k] in ("", subject)]
        if left_out := len(labels) - len(wanted):
            notes.append(f"{left_out} points of other subjects than {subject} were left out.")
    else:
        wanted = list(owners)
    bare = {k: labels[k].rpartition(":")[2] for k in wanted}
    owners_of: dict[str, set[str]] = {}
    for k, name in bare.items():
        owners_of.setdefault(name, set()).add(owners[k])
    shared = {owner for several in owners_of.values() if len(several) > 1 for owner in several}
    if shared:
        raise ValueError(
            f"several subjects carry the same labels: {', '.join(sorted(shared))}; "
            f'choose one, for example subject="{min(filter(None, shared))}"'
        )
    if subjects:
        notes.append(f"Subject prefixes were removed from the labels: {', '.join(subjects)}.")

    computed = _outputs(parameters, labels, bare)
    outputs = _unique({k: bare[k] for k in wanted if k in computed}, notes)
    markers = _unique({k: bare[k] for k in wanted if k not in computed}, notes)
    markers = renamed(markers, rename or {})
    if outputs:
        notes.append(f"{len(outputs)} points are outputs of another program, not markers.")
    return PointLabels(markers, outputs, subject or next(iter(subjects), ""), tuple(notes))


def _labels(parameters: Parameters, n_points: int) -> tuple[list[str], list[str]]:
    labels = parameters.texts("POINT", "LABELS")[:n_points]
    labels += [""] * (n_points - len(labels))
    nameless = [k for k, label in enumerate(labels) if not label]
    for k in nameless:
        labels[k] = f"unlabelled_{k + 1}"
    return labels, [f"{len(nameless)} points have no label."] if nameless else []


def _outputs(parameters: Parameters, labels: Sequence[str], bare: Mapping[int, str]) -> set[int]:
    listed = {name for group in OUTPUT_GROUPS for name in parameters.texts("POINT", group)}
    names = set(bare.values())
    stems = {
        name[:-1]
        for name in names
        if len(name) > 1 and all(name[:-1] + suffix in names for suffix in BONE_SUFFIXES)
    }
    return {
        k
        for k, name in bare.items()
        if labels[k] in listed
        or name in listed
        or OUTPUT_NAME.search(name)
        or (name[-1:] in BONE_SUFFIXES and name[:-1] in stems)
    }


def _unique(names: Mapping[int, str], notes: list[str]) -> dict[str, int]:
    unique: dict[str, int] = {}
    occurrences: Counter[str] = Counter()
    for k, name in names.items():
        occurrences[name] += 1
        free = name
        while free in unique:
            occurrences[name] += free != name
            free = f"{name}_{occurrences[name]}"
        if free != name:
            notes.append(f"Label {name} occurs again; that point is called {free}.")
        unique[free] = k
    return unique


def renamed(markers: Mapping[str, int], rename: Mapping[str, str]) -> dict[str, int]:
    """Give markers new labels.

    Parameters
    ----------
    markers
        Label -> index of the point.
    rename
        Old label -> new label; labels that it does not name stay.

    Returns
    -------
    dict[str, int]
        New label -> index, in the same order.

    Raises
    ------
    ValueError
        A label to rename is not there, or two labels become the same.
    """
    if absent := sorted(set(rename) - set(markers)):
        raise ValueError(
            f"no marker {', '.join(absent)} to rename; present: {', '.join(sorted(markers))}"
        )
    names = [rename.get(name, name) for name in markers]
    if twice := sorted(name for name, count in Counter(names).items() if count > 1):
        raise ValueError(f"renaming gives several markers the same label: {', '.join(twice)}")
    return dict(zip(names, markers.values(), strict=True))
