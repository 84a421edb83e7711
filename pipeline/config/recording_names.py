"""What names of recordings say: whose they are, of what, on which day, and whether of a pose.

Patterns and words are in ``recording_names.toml``; a pattern that somebody states decides instead.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations
from pathlib import PurePosixPath
from typing import Final, NamedTuple
from unicodedata import normalize

from hbm.spelling import listed, packaged_toml, shown, without_accents

READ: Final = packaged_toml("pipeline.config", "recording_names.toml")
PATTERNS: Final = {name: re.compile(text, re.VERBOSE) for name, text in READ["pattern"].items()}
USUAL: Final = {word for words in READ["words"].values() for word in words}
DIGITS: Final = "0123456789"
WORD: Final = re.compile(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+")
ROLES: Final = ("subject", "condition", "recording")
"""What ``{…}`` in a pattern may stand for."""
BOUNDARIES: Final = {r"(?:(?<=\d)(?=\D)|(?<=\D)(?=\d))": "+", r"(?-i:(?<=[a-z])(?=[A-Z]))": "+?"}
"""Between two places without a mark: the last of digits and letters, else the first capital."""
TIME: Final = re.compile("[Tt][0-9]")
"""A time of measurement, such as T1, before further fields."""


class Said(NamedTuple):
    """What a name says: of whom, of what, and on which day."""

    person: str
    condition: str
    session: str = ""


class Field(NamedTuple):
    """A part of a name between marks, and where it begins and ends."""

    text: str
    start: int
    stop: int


class RecordingName(NamedTuple):
    """What the name of a recording says.

    Attributes
    ----------
    stem
        The name with its folders, without suffix.
    kind
        "pose", "functional" or, of a trial, nothing.
    day
        Its digits, else the session, such as ses01; empty without any.
    parts
        Days and all else, in order.
    fields
        All else; what folders and names both say stands once.
    candidates
        Places of the fields that may say whose it is.
    sure
        Whether the first of them does: the only number of a person, after usual words at most.

    Examples
    --------
    >>> name = RecordingName.of("2024-05-03_P01_slow walk_2.c3d")
    >>> name.day, name.fields, name.read([0]).condition
    ('20240503', ['P01', 'slow', 'walk', '2'], 'slow-walk')
    """

    stem: str
    kind: str
    day: str
    parts: list[Field]
    fields: list[str]
    candidates: list[int]
    sure: bool

    @classmethod
    def of(cls, file: str) -> "RecordingName":
        """Read the name of a file, relative to a folder."""
        text = stem = normalize("NFC", str(PurePosixPath(file).with_suffix("")))
        parts_of = dict[str, list[Field]]()
        for name in ("day", "functional", "pose", "person", "occasion"):
            matches = [*PATTERNS[name].finditer(text)]
            parts_of[name] = [Field(re.sub("[-_. ]", "", m[0]), *m.span()) for m in matches]
            text = PATTERNS[name].sub(lambda match: "_" * len(match[0]), text)
        marks = [*PATTERNS["between"].finditer(text)]
        ends = [0, *(end for mark in marks for end in mark.span()), len(text)]
        words = (Field(text[a:b], a, b) for a, b in zip(ends[::2], ends[1::2], strict=True))
        days, people, occasions = (parts_of[name] for name in ("day", "person", "occasion"))
        kind = next((name for name in ("functional", "pose") if parts_of[name]), "")
        parts = sorted(
            [*people, *occasions, *(w for w in words if w.text.strip(".'’"))], key=_start
        )
        if days and not kind and all(usual(part.text) for part in parts):
            parts, people = sorted([*days, *parts], key=_start), days  # what a person is called
        fields = [part.text for part in parts]
        fields = [f for k, f in enumerate(fields) if f.isdecimal() or f not in fields[:k]]
        numbered = [k for k, field in enumerate(fields) if field in {one.text for one in people}]
        unusual = [k for k, field in enumerate(fields) if not usual(field) or k in numbered]
        counting = [k for k, f in enumerate(fields[:-1]) if f.isdecimal() and _counts(fields, k)]
        if not kind:  # a number before others may be a person's
            unusual += [k for k in counting if k == 0 or not people]
        candidates = sorted({*unusual})
        day = "".join(one.text for one in days[:1] or occasions).casefold()
        sure = people != days and numbered == (candidates[:1] or None)
        return cls(stem, kind, day, sorted({*days, *parts}, key=_start), fields, candidates, sure)

    @property
    def folders(self) -> list[str]:
        """What its folders say, in small letters."""
        end = self.stem.rfind("/")
        return [part.text.casefold() for part in self.parts if part.stop <= end]

    @property
    def session(self) -> str:
        """The day, if it is a date."""
        return self.day if self.day.isdecimal() else ""

    @property
    def number(self) -> str:
        """The number at its end, unless it is said to be that of a trial, or that of a level."""
        last, bare = (self.fields or [""])[-1], _bare((self.fields or [""])[-1])
        level = "." in last or bare in (*READ["words"]["numbered"], *READ["words"]["trial"])
        counts = not level and _counts(self.fields, len(self.fields) - 1)
        return last[len(last.rstrip(DIGITS)) :] if counts else ""

    def read(self, places: Sequence[int]) -> Said:
        """Give the person by the fields at some places, and the condition by the others."""
        person = "-".join(self.fields[place] for place in places)
        others = [field for k, field in enumerate(self.fields) if k not in places]
        return Said(person, condition(others), self.session)

    def patterns(self) -> Iterator[tuple[tuple[int, ...], str]]:
        """Give the patterns of all ways to read it, by the places of what may say whose it is."""
        places = self.candidates or [len(self.fields) - 1]
        for number in range(min(len(places), 3) + 1):
            for chosen in combinations(places[:3], number):
                yield chosen, self._pattern([self.fields[k] for k in chosen])

    def _pattern(self, person: Sequence[str]) -> str:
        """Give its pattern if some of its fields say whose it is."""
        pattern, trials = (
            re.sub(r'["{}$`!\\]', "*", self.stem),
            [*READ["words"]["trial"], *READ["words"]["folder"]],
        )
        for part in reversed(self.parts):
            bare, role = _bare(part.text), "{condition}"
            if part.text in person:
                known = [usual(word) for word in WORD.findall(part.text)]
                role = "{subject}" if not any(known) else "{subject}{condition}{recording}"
                role = "{condition}{subject}" if known and all(known) else role
            elif part.text not in self.fields or (bare in trials and part is not self.parts[-1]):
                role = "*"  # a day, or the word before a number
            elif part is self.parts[-1] and "." not in part.text and part.text[-1] in DIGITS:
                role = "{recording}" if bare in ("", *trials) else "{condition}{recording}"
            placed = re.sub("[^-_ ]+", role, pattern[part.start : part.stop])
            pattern = pattern[: part.start] + placed + pattern[part.stop :]
        return re.sub(r"[*]([-_ ]?[*])+", "*", pattern)

    def names(self, person: str) -> bool:
        """Tell whether fields in a row are this person, whatever marks are between them."""
        letters, fields = _letters(person), [*map(_letters, self.fields)]
        ends = range(1, len(fields) + 1)
        return any("".join(fields[a:b]) == letters for b in ends for a in range(b))

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


def said_by(pattern: str, files: Iterable[str]) -> dict[str, Said]:
    """Read names by a pattern such as ``{subject}_{condition}_{recording}``; of those that fit.

    A place takes letters up to the next mark of the pattern; ``*`` takes any. Places of one kind
    are joined. The recording may be missing at the end. Raises ValueError for another place, and
    where folders that are not in the pattern tell recordings apart.

    Examples
    --------
    >>> said_by("{subject}/{condition}/*", ["P01/slow/Trial01.c3d"])
    {'P01/slow/Trial01.c3d': Said(person='P01', condition='slow', session='')}
    """
    pattern = re.sub(r"(?i)\.c3d$", "", pattern)
    roles = re.findall(r"\{(.*?)\}", pattern)
    if wrong := [role for role in roles if role not in ROLES]:
        raise ValueError(f"--pattern: no place {shown(wrong[0])}; there are {listed(ROLES)}")
    marks = re.escape(re.sub(r"\{.*?\}|[^\W_]|[*/]", "", pattern))
    field, text = f"([^/{marks}]", re.escape(pattern).replace(r"\*", "[^/]*?")
    text = text.replace(r"\}\{recording\}", r"\}(?<!\d)(\d*)")
    text = re.sub(r"(_|\\-|\\ )\\\{recording\\\}$", lambda end: f"(?:{end[1]}{field}+))?", text)
    ways = list[str]()
    for boundary, times in BOUNDARIES.items():
        way = text.replace(r"\}\{", rf"\}}{boundary}\{{")
        ways.append("(?:(.*)/)?" + re.sub(r"\\\{\w+\\\}", lambda _: field + times + ")", way))
    said, above = dict[str, Said](), set[str]()
    for file in files:
        name = RecordingName.of(file)
        fits = filter(None, (re.fullmatch(way, name.stem, re.IGNORECASE) for way in ways))
        if match := next(fits, None):
            folder, *texts = match.groups()
            above.add(folder or "")
            person, what = (
                "-".join(dict.fromkeys(t for r, t in zip(roles, texts, strict=True) if r == role))
                for role in ROLES[:2]
            )
            said[file] = Said(person, what.lower(), name.session)
    if len(above) > 1:
        raise ValueError(
            f"--pattern: the folders {listed(sorted(above))} are not in it; state what they say, "
            f'such as "{{subject}}/{pattern}" or "*/{pattern}"'
        )
    return said


def condition(fields: Sequence[str]) -> str:
    """Give what fields of a name say of the condition; the last number is that of a repetition."""
    nothing = ("", *READ["words"]["trial"], *READ["words"]["folder"])
    words = (w for w in _unnumbered(fields) if TIME.fullmatch(w) or _bare(w) not in nothing)
    return "-".join(words).lower()


def _start(part: Field) -> int:
    return part.start


def _letters(text: str) -> str:
    """Give letters and digits of a text alone, in small letters."""
    return re.sub(r"[\W_]", "", text).casefold()


def _counts(fields: Sequence[str], place: int) -> bool:
    """Tell whether no word before a number says that it is that of a trial or of a level."""
    words = (*READ["words"]["numbered"], *READ["words"]["trial"])
    return not place or fields[place - 1].casefold() not in words


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
