"""Marker labels of any format: subject prefixes, renaming, whether a marker set fits."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence

from hbm.notes import Note
from hbm.spelling import listed, short
from pipeline.io.stated import Stated


def without_prefixes(
    labels: Sequence[str], prefix: str | None
) -> tuple[dict[int, str], list[Note]]:
    """Remove the prefixes of subjects, as in "S01:LASIS".

    Parameters
    ----------
    labels
        As the file has them.
    prefix
        That of the subject wanted, where several subjects carry the same labels, or its number
        among the prefixes in the order of the file, from 1.

    Returns
    -------
    bare
        Index of a column or point -> its label, of the subject wanted and of all others that nobody
        else carries, such as a platform's.
    notes
        ``points_of_other_subjects`` where some are left out.

    Raises
    ------
    ValueError
        Several subjects carry the same labels and none is chosen, or the chosen prefix is not
        there.

    Notes
    -----
    Prefixes are often people's names, so that notes and messages count them and never show them.
    """
    owners = [label.rpartition(":")[0] for label in labels]
    bare = {k: label.rpartition(":")[2] for k, label in enumerate(labels)}
    prefixes = list(dict.fromkeys(filter(None, owners)))
    notes = []
    if prefix is not None:
        prefix = _chosen(prefix, prefixes)
        own = {label for k, label in bare.items() if owners[k] == prefix}
        others = {owners[k] for k, label in bare.items() if label in own} - {prefix}
        kept = {
            k: label
            for k, label in bare.items()
            if owners[k] not in others or (not owners[k] and label not in own)
        }
        if left_out := len(bare) - len(kept):
            notes.append(Note.of("points_of_other_subjects", points=left_out))
        bare = kept
    carriers: dict[str, set[str]] = defaultdict(set)
    for k, label in bare.items():
        carriers[label].add(owners[k])
    alike = {owner for several in carriers.values() if len(several) > 1 for owner in several}
    if alike:
        numbers = [str(k) for k, each in enumerate(prefixes, start=1) if each in alike]
        raise ValueError(
            f"{len(alike)} subjects carry the same labels: choose one by the prefix of its labels "
            f"or by its number in the file ({listed(numbers)}), for example --label-prefix "
            f'{numbers[0]}, or label_prefix = "{numbers[0]}" in study.toml'
        )
    return bare, notes


def _chosen(prefix: str, prefixes: Sequence[str]) -> str:
    """Give the prefix that is stated by itself or by its number."""
    numbered = {str(k): each for k, each in enumerate(prefixes, start=1)}
    if prefix not in prefixes and prefix not in numbered:
        there = f"it has {len(prefixes)}, numbered from 1" if prefixes else "its labels have none"
        raise ValueError(
            f"no label begins with the given prefix; {there}: correct --label-prefix, or "
            "label_prefix in study.toml, or leave it out"
        )
    return prefix if prefix in prefixes else numbered[prefix]


def marker_columns(labels: Sequence[str], stated: Stated) -> tuple[dict[str, int], list[Note]]:
    """Give the markers of a text file under the labels wanted.

    A ValueError as `without_prefixes` and `rename_markers`, or where several markers have the same
    label.
    """
    bare, notes = without_prefixes(labels, stated.label_prefix)
    require_unique(bare.values(), "several markers have the same label")
    markers, rename_notes = rename_markers({label: k for k, label in bare.items()}, stated)
    return markers, [*notes, *rename_notes]


def rename_markers(markers: Mapping[str, int], stated: Stated) -> tuple[dict[str, int], list[Note]]:
    """Give markers, label -> index, the labels wanted; labels that are not renamed stay.

    A ValueError where two labels become the same, or none is of the stated marker set. The note
    ``labels_not_renamed`` names labels to rename that are not there.
    """
    rename = stated.rename
    names = [rename.get(name, name) for name in markers]
    require_unique(names, "renaming gives several markers the same label")
    table = stated.marker_set
    if table is not None and names and not table.present(names).markers:
        raise ValueError(
            f"none of the {len(table.segment)} labels of marker set {short(table.name)} "
            f"({listed(list(table.segment)[:3])}, …) is there; labels there: {listed(names[:5])}; "
            "give the right --marker-set, or --rename the labels"
        )
    absent = [short(name) for name in rename if name not in markers]
    notes = [Note.of("labels_not_renamed", labels=absent)] if absent else []
    return dict(zip(names, markers.values(), strict=True)), notes


def require_unique(labels: Iterable[str], fault: str) -> None:
    """Refuse labels of which several are the same; the message names them after the fault."""
    if twice := sorted(label for label, count in Counter(labels).items() if count > 1):
        raise ValueError(f"{fault}: {listed(twice)}")
