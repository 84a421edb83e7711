"""Labels of a C3D file: points, which are markers or outputs of another program; channels."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from hbm.notes import Note
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.labels import rename_markers, without_prefixes
from pipeline.io.stated import Stated

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
    notes: list[Note]


def sort_labels(parameters: Parameters, n_points: int, stated: Stated) -> PointLabels:
    """Separate markers from outputs of other programs, and remove subject prefixes.

    Parameters
    ----------
    parameters
        Parameters of the file.
    n_points
        Number of points per frame.
    stated
        What a person states about labels.

    Returns
    -------
    PointLabels
        Markers under unique names, outputs, and notes.

    Raises
    ------
    ValueError
        As `pipeline.io.labels.without_prefixes` and `rename_markers`.

    Notes
    -----
    Outputs are the points listed in POINT:ANGLES, MOMENTS and the like, those so named, and
    Vicon's segment frames: four points named by one stem and O, A, L, P.
    """
    labels = parameters.texts("POINT", "LABELS")[:n_points]
    labels += [""] * (n_points - len(labels))
    labels = [label or f"unlabelled_{k + 1}" for k, label in enumerate(labels)]
    bare, subject, notes = without_prefixes(labels, stated.label_prefix)
    computed = _outputs(parameters, labels, bare)
    outputs = _unique({k: name for k, name in bare.items() if k in computed})
    markers = _unique({k: name for k, name in bare.items() if k not in computed})
    renamed, rename_notes = rename_markers(markers, stated)
    return PointLabels(renamed, outputs, subject, [*notes, *rename_notes])


def channel_labels(parameters: Parameters, count: int) -> tuple[list[str], list[str]]:
    """Give label and unit of each analog channel; a number and nothing where there are none."""
    names = parameters.texts("ANALOG", "LABELS")[:count]
    units = parameters.texts("ANALOG", "UNITS")[:count]
    names += [f"channel_{k + 1}" for k in range(len(names), count)]
    return names, units + [""] * (count - len(units))


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


def _unique(names: Mapping[int, str]) -> dict[str, int]:
    """Give every point a label of its own; labels that occur again are numbered."""
    unique: dict[str, int] = {}
    for k, name in names.items():
        free, number = name, 2
        while free in unique:
            free = f"{name}_{number}"
            number += 1
        unique[free] = k
    return unique
