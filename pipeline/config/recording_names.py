"""What names of recordings say: a day, a pose, and fields that say whose and of what they are.

Patterns and words are in ``recording_names.toml``.
"""

import re
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Final, NamedTuple
from unicodedata import normalize

from hbm.spelling import packaged_toml, without_accents

READ: Final = packaged_toml("pipeline.config", "recording_names.toml")
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
        Its digits, else the session, such as ses01; empty without any.
    fields
        All else, in order.
    folders
        Those of its folders, in small letters.
    candidates
        Places of the fields that may say whose it is.
    sure
        Whether the first of them does: the only number of a person, after usual words at most.

    Examples
    --------
    >>> name = RecordingName.of("2024-05-03_P01_slow walk_2.c3d")
    >>> name.day, name.fields, name.read([0])
    ('20240503', ['P01', 'slow', 'walk', '2'], ('P01', 'slow-walk'))
    """

    kind: str
    day: str
    fields: list[str]
    folders: list[str]
    candidates: list[int]
    sure: bool

    @classmethod
    def of(cls, file: str) -> "RecordingName":
        """Read the name of a file, relative to a folder."""
        text = normalize("NFC", str(PurePosixPath(file).with_suffix("")))
        day, kinds = PATTERNS["day"].search(text), ("functional", "pose")
        kind = next((kind for kind in kinds if PATTERNS[kind].search(text)), "")
        for name in ("day", *kinds):
            text = PATTERNS[name].sub("_", text)
        person, occasion = PATTERNS["person"], PATTERNS["occasion"]
        for pattern in (person, occasion):
            text = pattern.sub(lambda number: f"_{re.sub('[-_ ]', '', number[0])}_", text)
        fields = [part for part in PATTERNS["between"].split(text) if part.strip(".'’")]
        # folders repeat what names say
        fields = [f for k, f in enumerate(fields) if f.isdecimal() or f not in fields[:k]]
        folders = PATTERNS["between"].split(text.casefold().rpartition("/")[0])
        days = "".join([day[0]] if day else filter(occasion.fullmatch, fields)).casefold()
        if day and not kind and all(map(usual, fields)):  # it may be what a person is called
            fields.insert(0, day[0])
        first = {0} if fields and fields[0][0].isdecimal() and not kind else set[int]()
        candidates = sorted(first | {k for k, field in enumerate(fields) if not usual(field)})
        sure = [k for k, f in enumerate(fields) if person.fullmatch(f)] == (candidates[:1] or None)
        return cls(kind, re.sub("[-_.]", "", days), fields, folders, candidates, sure)

    def read(self, places: Sequence[int]) -> tuple[str, str]:
        """Give the person by the fields at some places, and the condition by the others."""
        person = "-".join(self.fields[place] for place in places)
        return person, condition([f for k, f in enumerate(self.fields) if k not in places])

    def words(self, person: str) -> set[str]:
        """Give what its fields say beside the person; of a trial, without a repetition's number."""
        said = [f for f in self.fields if f.casefold() not in person.casefold().split("-")]
        return {word.casefold() for word in (said if self.kind else _unnumbered(said)) if word}

    def apart(self, trials: Sequence["RecordingName"], person: str) -> set[str]:
        """Give words of a pose by which it may not be of all these trials of a person.

        Some trials have the word and others do not; or none has, and one has another such word.
        """
        said, others = self.words(person), [trial for trial in trials if trial is not self]
        words = [trial.words(person) for trial in others]
        apart = {w for w in said if 0 < sum(w in of_trial for of_trial in words) < len(words)}
        if self.kind and any(trial.telling(trial.words(person) - said) for trial in others):
            apart |= self.telling(said.difference(*words))
        return apart

    def telling(self, words: set[str]) -> set[str]:
        """Give words that may say whose it is, or on what occasion it was made, as folders do."""
        return {w for w in words if not usual(w) or w in self.folders + READ["words"]["occasion"]}


def condition(fields: Sequence[str]) -> str:
    """Give what fields of a name say of the condition; the last number is that of a repetition."""
    nothing = ("", *READ["words"]["trial"])
    return "-".join(word for word in _unnumbered(fields) if _bare(word) not in nothing).lower()


def _unnumbered(fields: Sequence[str]) -> list[str]:
    """Give fields without the number that ends them, unless it is that of a level."""
    *words, last = fields or [""]
    level = "." in last or _bare(last) in READ["words"]["numbered"]
    return [*words, last if level else last.rstrip(DIGITS)]


def _bare(word: str) -> str:
    """Give a word in small letters, without accents and the number that ends it."""
    return without_accents(word).casefold().rstrip(DIGITS)


def usual(field: str) -> bool:
    """Tell whether a field is a number, or what trials are usually called."""
    words = re.findall(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+", without_accents(field))
    return USUAL.issuperset(word.casefold() for word in words)
