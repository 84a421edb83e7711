"""Marker labels of any format: subject prefixes, renaming, whether a marker set fits."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hbm.notes import Note
from hbm.spelling import listed, short
from pipeline.io.stated import Stated


@dataclass(frozen=True, slots=True)
class Labels:
    """Labels of a file without the prefixes of subjects.

    Attributes
    ----------
    bare
        Index of a column or point -> its label; those of other subjects are left out.
    subject
        The prefix of the subject, empty where there is none.
    notes
        What was removed or left out.
    """

    bare: dict[int, str]
    subject: str
    notes: tuple[Note, ...]


def without_prefixes(labels: Sequence[str], prefix: str | None) -> Labels:
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
    Labels
        Of the subject wanted, and all others that nobody else carries, such as a platform's.

    Raises
    ------
    ValueError
        Several subjects carry the same labels and none is chosen, or the chosen prefix is not
        there.

    Notes
    -----
    Prefixes are often people's names, so that notes and messages count them and never show them.
    """
    owners = {k: label.rpartition(":")[0] for k, label in enumerate(labels)}
    bare = {k: label.rpartition(":")[2] for k, label in enumerate(labels)}
    prefixes = list(dict.fromkeys(filter(None, owners.values())))
    notes = []
    if prefix is not None:
        prefix = _chosen(prefix, prefixes)
        own = {bare[k] for k in bare if owners[k] == prefix}
        others = {owners[k] for k in bare if owners[k] not in ("", prefix) and bare[k] in own}
        kept = {
            k: label
            for k, label in bare.items()
            if owners[k] not in others and (owners[k] or label not in own)
        }
        if left_out := len(bare) - len(kept):
            notes.append(Note.of("points_of_other_subjects", points=left_out))
        bare = kept
    owners_of: dict[str, set[str]] = {}
    for k, label in bare.items():
        owners_of.setdefault(label, set()).add(owners[k])
    alike = {owner for several in owners_of.values() if len(several) > 1 for owner in several}
    if alike:
        numbers = [str(k) for k, each in enumerate(prefixes, start=1) if each in alike]
        raise ValueError(
            f"{len(alike)} subjects carry the same labels: choose one by the prefix of its labels "
            f"or by its number in the file ({listed(numbers)}), for example --label-prefix "
            f'{numbers[0]}, or label_prefix = "{numbers[0]}" in study.toml'
        )
    return Labels(bare, prefix or next(iter(prefixes), ""), tuple(notes))


def _chosen(prefix: str, prefixes: Sequence[str]) -> str:
    """Give the prefix that is stated by itself or by its number."""
    numbered = {str(k): each for k, each in enumerate(prefixes, start=1)}
    if prefix not in prefixes and prefix not in numbered:
        there = f"it has {len(prefixes)}, numbered from 1" if prefixes else "its labels have none"
        raise ValueError(
            f"no label begins with the stated prefix; {there}: correct --label-prefix, or "
            "label_prefix in study.toml, or leave it out"
        )
    return prefix if prefix in prefixes else numbered[prefix]


def marker_columns(
    labels: Sequence[str], stated: Stated
) -> tuple[dict[str, int], str, tuple[Note, ...]]:
    """Give the markers of a text file under the labels wanted.

    Parameters
    ----------
    labels
        As the file has them, one per marker.
    stated
        What a person states about the file.

    Returns
    -------
    markers
        Label -> index of the marker.
    subject
        The prefix that was removed, empty where there was none.
    notes
        What was removed, left out or not found.

    Raises
    ------
    ValueError
        As `without_prefixes` and `rename_markers`, or several markers have the same label.
    """
    found = without_prefixes(labels, stated.label_prefix)
    counts = Counter(found.bare.values())
    if twice := sorted(label for label, count in counts.items() if count > 1):
        raise ValueError(f"several markers have the same label: {listed(twice)}")
    markers, notes = rename_markers({label: k for k, label in found.bare.items()}, stated)
    return markers, found.subject, (*found.notes, *notes)


def rename_markers(
    markers: Mapping[str, int], stated: Stated
) -> tuple[dict[str, int], tuple[Note, ...]]:
    """Give markers the labels wanted, and see whether they are of the stated marker set.

    Parameters
    ----------
    markers
        Label -> index of the point.
    stated
        What a person states about the file.

    Returns
    -------
    markers
        New label -> index, in the same order; labels that are not renamed stay.
    notes
        ``labels_not_renamed`` where labels to rename are not there.

    Raises
    ------
    ValueError
        Two labels become the same, or none is of the stated marker set.
    """
    rename = stated.rename
    names = [rename.get(name, name) for name in markers]
    if twice := sorted(name for name, count in Counter(names).items() if count > 1):
        raise ValueError(f"renaming gives several markers the same label: {listed(twice)}")
    table = stated.marker_set
    if table is not None and names and not table.present(names).markers:
        raise ValueError(
            f"none of the {len(table.segment)} labels of marker set {short(table.name)} "
            f"({listed(list(table.segment)[:3])}, …) is there; labels there: {listed(names[:5])}; "
            "give the right --marker-set, or --rename the labels"
        )
    absent = [short(name) for name in rename if name not in markers]
    notes = (Note.of("labels_not_renamed", labels=absent),) if absent else ()
    return dict(zip(names, markers.values(), strict=True)), notes
