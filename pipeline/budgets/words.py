"""Causes of residuals in words: what groups of them are called, what to do about them, sizes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from hbm.spatial import Array
from pipeline.explain.budget import EstimatedCause
from pipeline.explain.cause import OF_PERSON, CauseGroup
from pipeline.explain.shares import NORMAL_95
from pipeline.trial.residuals import AXES


@dataclass(frozen=True, slots=True)
class GroupWords:
    """How a group of causes is spoken of.

    Attributes
    ----------
    owner, what
        Its name in two parts, such as "plates'" and "zero"; the first may be empty.
    mend
        What to do about one of its causes, which takes the place of "{cause}"; empty where nothing
        in the laboratory changes it.
    know
        What tells the size of its causes in another way; empty where nothing simple does.
    """

    owner: str
    what: str
    mend: str = ""
    know: str = ""

    @property
    def name(self) -> str:
        """Its name, such as "plates' zero"."""
        return f"{self.owner} {self.what}".strip()


GROUPS: Final[Mapping[CauseGroup, GroupWords]] = {
    "zero": GroupWords(
        "plates'",
        "zero",
        "zero the plates ({cause})",
        "record 5 s of empty plates before the trial",
    ),
    "inertia": GroupWords(
        "body's",
        "masses",
        "check the body's masses and centres of mass ({cause})",
        "weigh the subject on scales and state mass_kg in the subject's file",
    ),
    "delay": GroupWords(
        "plates'",
        "delay",
        "measure the plates' delay ({cause})",
        "hit a plate with a hammer that carries a marker (hbm plates)",
    ),
    "gain": GroupWords(
        "plates'",
        "gain and cross-talk",
        "calibrate the plates with known weights ({cause})",
        "load the plates with known weights (hbm plates)",
    ),
    "place": GroupWords(
        "plates'",
        "place and direction",
        "measure again where the plates are ({cause})",
        "press a pole with markers on the plates at known points",
    ),
    "platform": GroupWords(
        "platform's",
        "pose",
        "check the platform's pose ({cause})",
        "record the platform at rest in neutral, with markers on it",
    ),
    "compensation": GroupWords(
        "",
        "compensation",
        "calibrate the moving treadmill again ({cause})",
        "record the empty treadmill in motion on the same day (hbm calibration check)",
    ),
    "markers": GroupWords(
        "",
        "joints and markers",
        "repeat the calibration pose, with all markers in place ({cause})",
        "record swinging thighs (--hip functional) and markers on both sides of knees and ankles",
    ),
    "skin": GroupWords("", "skin motion", "place the markers where skin moves less ({cause})"),
    "soft_tissue": GroupWords("", "soft tissue"),
    "filter": GroupWords("", "filter"),
}
"""By group, those first that are the easiest to find out in another way."""

PERSON: Final = GroupWords("", "body and markers", know=GROUPS["inertia"].know)
"""Of several groups of `OF_PERSON`."""

SHOWN_UNITS: Final[Mapping[str, tuple[float, str]]] = {
    "s": (1000.0, "ms"),
    "m": (1000.0, "mm"),
    "rad": (57.29577951308232, "°"),
    "1": (100.0, "%"),
}
"""Unit of a size -> factor and the unit that a person reads it in."""


def group_name(groups: Sequence[str]) -> str:
    """Name groups of causes that cannot be told apart.

    Examples
    --------
    >>> group_name(["zero", "place", "inertia"])
    "plates' zero, or their place and direction, or body's masses"
    >>> group_name(["inertia", "markers", "skin", "soft_tissue"])
    'body and markers'
    """
    words = _apart(groups)
    parts = [words[0].name]
    for before, own in pairwise(words):
        owner = "their" if own.owner and own.owner == before.owner else own.owner
        parts.append(f"{owner} {own.what}".strip())
    return ", or ".join(parts)


def how_to_tell_apart(groups: Sequence[str]) -> tuple[str, ...]:
    """Say what knowing would tell groups of causes apart.

    Parameters
    ----------
    groups
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
    apart = _apart(sorted(groups, key=[str(group) for group in GROUPS].index))
    return tuple([words.know for words in apart if words.know][: len(apart) - 1])


def are_apart(groups: Sequence[str]) -> bool:
    """Tell whether groups that are named together are more than one to their reader."""
    return len(_apart(groups)) > 1


def mending(group: str, cause: str) -> str:
    """Say what to do about a cause, such as "zero the plates (plate 1: zero of Fy)".

    Empty where nothing in the laboratory changes it.
    """
    return _words(group).mend.format(cause=cause)


def size_in_words(cause: EstimatedCause) -> str:
    """Give the size of a cause with its 95 % interval, such as "9.1 ± 5.7 ms"."""
    factor, unit = SHOWN_UNITS.get(cause.unit, (1.0, cause.unit))
    size, half = factor * cause.size, factor * NORMAL_95 * cause.deviation
    digits = 2 if half < 0.95 else 1 if half < 9.5 else 0
    return f"{size:.{digits}f} ± {half:.{digits}f} {unit}"


def shares_in_words(shares: Array) -> str:
    """List a share of each residual, (6,), such as that which is taken away.

    Examples
    --------
    >>> import numpy as np
    >>> shares_in_words(np.array([0.44, 0.26, -0.09, 0.65, 0.76, 0.47]))
    '44 % of Fx, 26 % of Fy, -9 % of Fz, 65 % of Mx, 76 % of My, 47 % of Mz (negative: they add)'
    """
    named = [f"{100 * s:z.0f} % of {axis}" for s, axis in zip(shares, AXES, strict=True)]
    return ", ".join(named) + " (negative: they add)" * bool((shares < 0).any())


def _apart(groups: Sequence[str]) -> list[GroupWords]:
    """Give the words of groups, those of the person as one."""
    person = [group for group in groups if group in OF_PERSON]
    if len(person) < 2:
        return [_words(group) for group in groups]
    return [
        PERSON if group == person[0] else _words(group)
        for group in groups
        if group not in person[1:]
    ]


def _words(group: str) -> GroupWords:
    """Give the words of a group; of one that is unknown here, its name."""
    known = {str(name): words for name, words in GROUPS.items()}
    return known.get(group) or GroupWords("", group.replace("_", " "), "{cause}")
