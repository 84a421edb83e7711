"""Marker labels of any format: subject prefixes, labels that occur twice, renaming."""

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Container, Iterable, Mapping, Sequence
from functools import cache
from itertools import chain, count
from shlex import quote
from typing import Final

import numpy as np

from hbm.markers import MarkerSet, marker_sets, recognise_marker_set, renaming
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.spatial import Array, Mask
from hbm.spelling import listed, short
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Fact

SEPARATORS: Final = " _-.:"
"""Between a subject's prefix and a label."""
LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "labels")
AGAIN: Final = "\N{WORD JOINER}"
"""Added to a name in a file that occurred before, where names have to differ."""


def without_prefixes(
    labels: Sequence[str], options: ReadOptions
) -> tuple[dict[int, str], list[Note | Fact]]:
    """Remove the prefixes of subjects, as in "S01:LASIS" or "S01_LASIS".

    Parameters
    ----------
    labels
        As the file has them.
    options
        With the prefix of the subject wanted, where several subjects carry the same labels, or its
        number among the prefixes in the order of the file, from 1.

    Returns
    -------
    bare
        Index of a column or point -> its label, of the subject wanted and of all others that nobody
        else carries, such as a platform's.
    notes
        ``points_of_other_subjects`` where some are left out, and the fact that a beginning without
        a colon was removed.

    Raises
    ------
    ValueError
        Several subjects carry the same labels and none is chosen, or the chosen prefix is not
        there.

    Notes
    -----
    What stands before a colon is a prefix. Without one, it is what stands before labels of a marker
    set, where the labels are of none as they stand. Prefixes are often people's names, so that
    notes and messages count them and never show them.
    """
    owners = [label.rpartition(":")[0] for label in labels]
    bare = {k: label.rpartition(":")[2].rstrip(AGAIN) for k, label in enumerate(labels)}
    notes: list[Note | Fact] = []
    for stem in _stems([*bare.values()], options, owners):
        of_stem = [k for k, label in bare.items() if label.startswith(stem)]
        for k in of_stem:
            owners[k], bare[k] = stem, bare[k][len(stem) :].lstrip(SEPARATORS)
        if options.label_prefix is None:
            reason = f"{len(of_stem)} of {len(labels)} begin alike; that beginning is removed"
            notes.append(Fact("corrected", "labels", reason))
    prefixes = list(dict.fromkeys(filter(None, owners)))
    if options.label_prefix is not None:
        chosen = {str(k): owner for k, owner in enumerate(prefixes, start=1)}
        chosen |= {owner.rstrip(SEPARATORS): owner for owner in prefixes}
        prefix = chosen.get(options.label_prefix.rstrip(SEPARATORS))
        if prefix is None:
            raise ValueError(
                f"no label begins with the given prefix; it has {len(prefixes)}, numbered from 1: "
                "correct --label-prefix, or label_prefix in study.toml, or leave it out"
            )
        # other subjects carry the same labels; a platform, whose labels are its own, is no subject
        of_subject = {label for k, label in bare.items() if owners[k] == prefix}
        others = {owners[k] for k, label in bare.items() if label in of_subject} - {prefix}
        kept = {
            k: label
            for k, label in bare.items()
            if owners[k] not in others or (not owners[k] and label not in of_subject)
        }
        if left_out := len(bare) - len(kept):
            notes.append(Note.of("points_of_other_subjects", points=left_out))
        bare = kept
    carried = {(label, owners[k]) for k, label in bare.items()}
    carriers = Counter(label for label, _ in carried)
    if alike := {owner for label, owner in carried if carriers[label] > 1}:
        numbers = [str(k) for k, owner in enumerate(prefixes, start=1) if owner in alike]
        raise ValueError(
            f"{len(alike)} subjects carry the same labels: choose one by the prefix of its labels "
            f"or by its number in the file ({listed(numbers)}), for example --label-prefix "
            f'{numbers[0]}, or label_prefix = "{numbers[0]}" in study.toml'
        )
    return bare, notes


def _known(options: ReadOptions) -> frozenset[str]:
    """Give the labels that mean something, in lower case: those of marker sets and to rename."""
    return labels_with(options.marker_set).union(map(str.casefold, options.rename))


@cache
def labels_with(marker_set: MarkerSet | None) -> frozenset[str]:
    """Give the labels of all shipped sets and of another, in lower case."""
    sets = [*marker_sets().values(), *filter(None, [marker_set])]
    labels = (label for chosen in sets for marker in chosen.markers for label in marker.labels)
    return frozenset(map(str.casefold, labels))


def _are_of_a_set(labels: Sequence[str], options: ReadOptions) -> bool:
    names = _renamed(labels, options)
    if table := options.marker_set:
        return 2 * len(table.present(names).markers) >= len(table.markers)
    try:
        return bool(recognise_marker_set(names))
    except ValueError:
        return False


def _stems(labels: Sequence[str], options: ReadOptions, owners: Sequence[str]) -> list[str]:
    """Give the beginnings without which labels are of a marker set; or the one that is stated."""
    prefix = options.label_prefix
    if prefix is None and _are_of_a_set(labels, options):
        return []
    meaningful, fewest = _known(options), LIMITS.fewest_of_a_subject
    # what stands before the longest end of each label that means something
    before = (
        next((label[:k] for k in range(1, len(label)) if label[k:].casefold() in meaningful), "")
        for label in labels
    )
    often = [stem for stem, n in Counter(before).items() if stem and n >= fewest]
    of_stem = {s: [label[len(s) :] for label in labels if label.startswith(s)] for s in often}
    stems = [stem for stem, rest in of_stem.items() if _are_of_a_set(rest, options)]
    if stems or prefix is None or prefix.rstrip(SEPARATORS) in owners:
        return stems
    return [prefix] if any(label.startswith(prefix) for label in labels) else []


def join_trajectories(
    labels: Mapping[int, str], position: Array, options: ReadOptions
) -> tuple[dict[str, int], list[Fact]]:
    """Make one trajectory of those that have one label, in place.

    Parameters
    ----------
    labels
        Place in the file, from 0 -> label, of each column of the positions; labels that differ in
        upper and lower case or spaces are one.
    position
        (T, M, 3) [m]; gaps are NaN.
    options
        With the labels that mean something.

    Returns
    -------
    columns
        Label -> column, of each trajectory that remains. Where one label has several, these are
        numbered from the second on, as LPSIS_2.
    facts
        "joined": they are never seen at once, or agree to 1 mm where they are. "in_doubt": they are
        in different places at once, and no marker set has the numbered label, or that of the other
        side occurs once.
    """
    # labels of trajectories that nobody labelled, such as "*12", "U 3" or "Unlabelled_7"
    unlabelled = re.compile(r"\*.*|(u|un\w*)[ _*.-]*\d*", re.IGNORECASE)
    meaningful, places, facts = _known(options), [place + 1 for place in labels], list[Fact]()
    names = dict(enumerate(labels.values()))
    alike: dict[str, list[int]] = defaultdict(list)
    for column, name in names.items():
        alike["".join(name.split()).casefold()].append(column)
    for label, (first, *others) in alike.items():
        if not others or unlabelled.fullmatch(label):
            continue
        # the spelling of a marker set, if one of them has it
        spellings = [names[column] for column in (first, *others)]
        meant = (spelling for spelling in spellings if spelling.casefold() in meaningful)
        name = names[first] = next(meant, spellings[0])
        is_seen = np.isfinite(position[:, first, 0])
        one = [f"{places[first]} ({_when(is_seen)})"]
        for column in others:
            # parts of one trajectory are never seen at once; copies of it are at the same place
            is_seen_too = np.isfinite(position[:, column, 0])
            both = is_seen & is_seen_too
            away_m = np.linalg.norm(position[:, column] - position[:, first], axis=-1)[both]
            if away_m.max(initial=0.0) > LIMITS.largest_rounding:
                names[column] = second = free_name(name, {*names.values()})
                # sets with two markers of one name have them on both sides
                twin = {"l": "r", "r": "l"}.get(label[0], "") + label[1:]
                if f"{label}_2" not in meaningful or len(alike.get(twin, ())) == 1:
                    reason = (
                        f"trajectories {places[first]} and {places[column]} have this label, "
                        f"{1000 * np.median(away_m):.0f} mm apart in {len(away_m)} frames; the "
                        f"second is read as {short(second)}; if it is right, --rename "
                        f"{quote(f'{name}=OTHER')} --rename {quote(f'{second}={name}')}"
                    )
                    facts.append(Fact("in_doubt", f"marker {short(name)}", reason))
                continue
            position[is_seen_too & ~is_seen, first] = position[is_seen_too & ~is_seen, column]
            is_seen |= is_seen_too
            one.append(f"{places[column]} ({_when(is_seen_too)})")
            del names[column]
        if len(one) > 1:
            reason = f"trajectories {listed(one)} have this label"
            facts.append(Fact("joined", f"marker {short(name)}", reason))
    return numbered(names), facts


def _when(is_seen: Mask) -> str:
    frames = np.flatnonzero(is_seen) + 1
    return f"frames {frames[0]}–{frames[-1]}" if len(frames) else "never seen"


def told_apart(names: Iterable[str], of_marker: re.Pattern[str]) -> list[str]:
    """Give names of columns that differ; markers that occur again have `AGAIN` after their label.

    The first group of the pattern that matches is the label.
    """
    different: list[str] = []
    for name in names:
        while name in different and (match := of_marker.fullmatch(name)):
            end = next(match.end(k) for k in range(1, 9) if match[k])
            name = name[:end] + AGAIN + name[end:]
        different.append(name)
    return different


def numbered(names: Mapping[int, str]) -> dict[str, int]:
    """Give every column a name of its own; names that occur again are numbered."""
    unique: dict[str, int] = {}
    for k, name in names.items():
        unique[free_name(name, unique)] = k
    return unique


def free_name(name: str, taken: Container[str]) -> str:
    """Give a name that is not taken: the name itself, else numbered from 2."""
    names = chain([name], (f"{name}_{number}" for number in count(2)))
    return next(free for free in names if free not in taken)


def rename_markers(
    markers: Mapping[str, int], options: ReadOptions
) -> tuple[dict[str, int], list[Fact], tuple[str, ...]]:
    """Give markers, label -> index, the labels wanted; labels that are not renamed stay.

    Where no marker set is stated and labels are of none, those with the same letters are read as
    one's, such as L_ASI and Left ASI as LASI; a fact says so. Also gives the labels to rename that
    are not there. A ValueError where two labels become the same, or none is
    of the stated marker set.
    """
    names = _renamed(markers, options)
    require_unique(names, "renaming gives several markers the same label")
    absent = (short(name) for name in options.rename if name not in markers and name[-1:] != "*")
    facts: list[Fact] = []
    table = options.marker_set
    if table is not None and names and not table.present(names).markers:
        raise ValueError(
            f"none of the {len(table.segment)} labels of marker set {short(table.name)} "
            f"({listed(list(table.segment)[:3])}, …) is there; labels there: {listed(names[:5])}; "
            "give the right --marker-set, or --rename the labels"
        )
    if table is None and (alike := renaming(tuple(names))):
        names = [alike.get(name, name) for name in names]
        pairs = listed(f"{short(name)} as {label}" for name, label in alike.items())
        reason = f"{len(alike)} have the letters of a marker set's: {pairs}"
        facts.append(Fact("corrected", "labels", reason))
    return dict(zip(names, markers.values(), strict=True)), facts, tuple(absent)


def _renamed(names: Collection[str], options: ReadOptions) -> list[str]:
    """Give labels as they are wanted, by labels and by beginnings such as L* = R*."""
    spelt, renamed = {name.casefold(): name for name in names}, dict[str, str]()
    for old, new in options.rename.items():
        begins, other = old[:-1].casefold(), new.removesuffix("*").casefold()
        for folded, name in spelt.items() if old.endswith("*") else ():
            if folded.startswith(begins) and (there := spelt.get(other + folded[len(begins) :])):
                renamed[name] = there
    renamed |= options.rename
    return [renamed.get(name, name) for name in names]


def require_unique(labels: Iterable[str], fault: str) -> None:
    """Refuse labels of which several are the same; the message names them after the fault."""
    if twice := sorted(label for label, count in Counter(labels).items() if count > 1):
        raise ValueError(f"{fault}: {listed(twice)}")
