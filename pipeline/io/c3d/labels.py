"""Labels of a C3D file: points, which are markers or outputs of another program; channels."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from hbm.notes import Note
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.labels import rename_markers

OUTPUT_GROUPS: Final = (
    "ANGLES",
    "FORCES",
    "MOMENTS",
    "POWERS",
    "REACTIONS",
    "SCALARS",
    "MODELED_MARKERS",
)
OUTPUT_NAME: Final = re.compile(r"(Angles?|Moments?|Forces?|Powers?|NormalisedGRF)$")
SEGMENT_FRAME_SUFFIXES: Final = ("O", "A", "L", "P")
"""Vicon's four points of a segment frame: origin, anterior, lateral, proximal."""


@dataclass(frozen=True, slots=True)
class PointLabels:
    """The points of a file by what they are.

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
    notes: tuple[Note, ...]


def sort_labels(
    parameters: Parameters,
    n_points: int,
    *,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
) -> PointLabels:
    """Separate markers from outputs of other programs, and remove subject prefixes.

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
            notes.append(Note.of("points_of_other_subjects", points=left_out, subject=subject))
    else:
        wanted = list(owners)
    bare = {k: labels[k].rpartition(":")[2] for k in wanted}
    owners_of: dict[str, set[str]] = {}
    for k, name in bare.items():
        owners_of.setdefault(name, set()).add(owners[k])
    alike = {owner for several in owners_of.values() if len(several) > 1 for owner in several}
    if alike:
        raise ValueError(
            f"several subjects carry the same labels: {', '.join(sorted(alike))}; "
            f'choose one, for example subject="{min(filter(None, alike))}"'
        )
    if subjects:
        notes.append(Note.of("subject_prefixes_removed", subjects=subjects))

    computed = _outputs(parameters, labels, bare)
    outputs = _unique({k: bare[k] for k in wanted if k in computed}, notes)
    markers = _unique({k: bare[k] for k in wanted if k not in computed}, notes)
    markers = rename_markers(markers, rename or {})
    if outputs:
        notes.append(Note.of("model_outputs_set_aside", points=len(outputs)))
    return PointLabels(markers, outputs, subject or next(iter(subjects), ""), tuple(notes))


def channel_labels(parameters: Parameters, count: int) -> tuple[list[str], list[str]]:
    """Give label and unit of each analog channel; a number and nothing where there are none."""
    names = parameters.texts("ANALOG", "LABELS")[:count]
    units = parameters.texts("ANALOG", "UNITS")[:count]
    names += [f"channel_{k + 1}" for k in range(len(names), count)]
    return names, units + [""] * (count - len(units))


def _labels(parameters: Parameters, n_points: int) -> tuple[list[str], list[Note]]:
    labels = parameters.texts("POINT", "LABELS")[:n_points]
    labels += [""] * (n_points - len(labels))
    nameless = [k for k, label in enumerate(labels) if not label]
    for k in nameless:
        labels[k] = f"unlabelled_{k + 1}"
    notes = [Note.of("points_without_label", points=len(nameless))] if nameless else []
    return labels, notes


def _outputs(parameters: Parameters, labels: Sequence[str], bare: Mapping[int, str]) -> set[int]:
    listed = {name for group in OUTPUT_GROUPS for name in parameters.texts("POINT", group)}
    names = set(bare.values())
    stems = {
        name[:-1]
        for name in names
        if len(name) > 1 and all(name[:-1] + suffix in names for suffix in SEGMENT_FRAME_SUFFIXES)
    }
    return {
        k
        for k, name in bare.items()
        if labels[k] in listed
        or name in listed
        or OUTPUT_NAME.search(name)
        or (name[-1:] in SEGMENT_FRAME_SUFFIXES and name[:-1] in stems)
    }


def _unique(names: Mapping[int, str], notes: list[Note]) -> dict[str, int]:
    """Give every point a label of its own, and note where one had to be numbered."""
    unique: dict[str, int] = {}
    occurrences: Counter[str] = Counter()
    for k, name in names.items():
        occurrences[name] += 1
        free = name
        while free in unique:
            occurrences[name] += free != name
            free = f"{name}_{occurrences[name]}"
        if free != name:
            notes.append(Note.of("label_repeated", label=name, new_label=free))
        unique[free] = k
    return unique
