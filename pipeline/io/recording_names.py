"""What names of recordings say: a day, a pose, and fields that say whose and of what they are.

Patterns and words are in ``recording_names.toml``.
"""

import re
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Final, NamedTuple
from unicodedata import normalize

from hbm.spelling import packaged_toml, without_accents

READ: Final = packaged_toml("pipeline.io", "recording_names.toml")
PATTERNS: Final = {name: re.compile(text, re.VERBOSE) for name, text in READ["pattern"].items()}
USUAL: Final = {word for words in READ["words"].values() for word in words}
DIGITS: Final = "0123456789"


class RecordingName(NamedTuple):
    """What the name of a recording says.

    Attributes
    ----------
    kind
        "pose", "functional" or, of a trial, nothing.
    day
        Its digits; empty without one.
    fields
        All else, in order.
    candidates
        Places of the fields that may say whose it is.
    sure
        Whether the first of them does: the only number of a person, after usual words at most.

    Examples
    --------
    >>> name = RecordingName.of("2024-05-03_P01_slow walk_2.c3d")
    >>> name.day, name.fields, name.read(0)
    ('20240503', ['P01', 'slow', 'walk', '2'], ('P01', 'slow-walk'))
    """

    kind: str
    day: str
    fields: list[str]
    candidates: list[int]
    sure: bool

    @classmethod
    def of(cls, file: str) -> "RecordingName":
        """Read the name of a file, relative to a folder."""
        text = normalize("NFC", str(PurePosixPath(file).with_suffix("")))
        day, kinds = PATTERNS["day"].search(text), ("functional", "pose")
        kind = next((kind for kind in kinds if PATTERNS[kind].search(text)), "")
        for pattern in ("day", *kinds):
            text = PATTERNS[pattern].sub("_", text)
        person = PATTERNS["person"]
        text = person.sub(lambda number: f"_{re.sub('[-_ ]', '', number[0])}_", text)
        fields = [part for part in PATTERNS["between"].split(text) if part.strip(".'’")]
        if day and not kind and all(map(_usual, fields)):  # it may be what a person is called
            fields.insert(0, day[0])
        first = {0} if fields and fields[0][0].isdecimal() and not kind else set[int]()
        candidates = sorted(first | {k for k, field in enumerate(fields) if not _usual(field)})
        sure = [k for k, f in enumerate(fields) if person.fullmatch(f)] == (candidates[:1] or None)
        return cls(kind, re.sub(r"\D", "", day[0]) if day else "", fields, candidates, sure)

    def read(self, place: int) -> tuple[str, str]:
        """Give the person by the field at a place, with a number behind it, and the condition."""
        person, rest = self.fields[place], self.fields[place + 1 :]
        if not self.sure and len(rest) == 1 and rest[0].isdecimal():
            person, rest = f"{person}{rest[0]}", []
        return person, condition([*self.fields[:place], *rest])


def condition(fields: Sequence[str]) -> str:
    """Give what fields of a name say of the condition; the last number is that of a repetition."""
    *words, last = fields or [""]
    level = "." in last or _bare(last) in READ["words"]["numbered"]
    words.append(last if level else last.rstrip(DIGITS))
    return "-".join(
        word for word in words if _bare(word) not in ("", *READ["words"]["trial"])
    ).lower()


def _bare(word: str) -> str:
    """Give a word in small letters, without accents and the number that ends it."""
    return without_accents(word).casefold().rstrip(DIGITS)


def _usual(field: str) -> bool:
    """Tell whether a field is a number, or what trials are usually called."""
    words = re.findall(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+", without_accents(field))
    return USUAL.issuperset(word.casefold() for word in words)
