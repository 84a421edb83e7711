"""What names of recordings say: whose they are, of what, on which day, and whether of a pose.

Patterns and words are in ``recording_names.toml``; a pattern that somebody states decides instead.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from itertools import combinations
from pathlib import PurePosixPath
from typing import Final, NamedTuple
from unicodedata import normalize

from hbm.spelling import listed, packaged_toml, shown, without_accents

READ: Final = packaged_toml("pipeline.config", "recording_names.toml")
PATTERNS: Final = {name: re.compile(text, re.VERBOSE) for name, text in READ["pattern"].items()}
USUAL: Final = {word for words in READ["words"].values() for word in words}
TRIAL: Final = (*READ["words"]["trial"], *READ["words"]["folder"])
DIGITS: Final = "0123456789"
ROLES: Final = ("subject", "condition", "recording")
"""What ``{…}`` in a pattern may stand for."""
BOUNDARIES: Final = {
    r"(?:(?<=\d)(?=\D)|(?<=\D)(?=\d))": "+",
    r"(?-i:(?<=[a-z])(?=[A-Z])|(?<=[A-Z]{2})(?=[a-z]))": "+?",
}
"""Between two places without a mark: the last of digits and letters, else the first capital."""
WITHOUT: Final = "'hbm init' without --pattern shows the ways in which names can be read"


class Said(NamedTuple):
    """What a name says: of whom, of what, and on which day."""

    person: str
    condition: str
    session: str = ""


class Field(NamedTuple):
    """Where a part of a name between marks begins and ends, and what it says."""

    start: int
    stop: int
    text: str


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
    @cache
    def of(cls, file: str) -> "RecordingName":
        """Read the name of a file, relative to a folder."""
        text = stem = normalize("NFC", str(PurePosixPath(file).with_suffix("")))
        fields_of = dict[str, list[Field]]()
        # in this order: what one has taken is no other's
        for name in ("day", "functional", "pose", "person", "occasion"):
            matches = [*PATTERNS[name].finditer(text)]
            fields_of[name] = [Field(*m.span(), re.sub("[-_. ]", "", m[0])) for m in matches]
            text = PATTERNS[name].sub(lambda match: "_" * len(match[0]), text)
        ends = [end for mark in PATTERNS["between"].finditer(text) for end in mark.span()]
        spans = zip([0, *ends[1::2]], [*ends[::2], len(text)], strict=True)
        words = [Field(a, b, text[a:b]) for a, b in spans if text[a:b].strip(".'’")]
        kind = next((name for name in ("functional", "pose") if fields_of[name]), "")
        days, people, occasions = (fields_of[name] for name in ("day", "person", "occasion"))
        # the number of a person may have one digit, but then it may be that of a session too
        parts, free = sorted([*people, *occasions, *words]), all(len(p.text) == 2 for p in people)
        sure = bool(people)
        if days and not kind and all(usual(part.text) for part in parts):
            parts, people = sorted([*days, *parts]), days  # it may be what a person is called
        fields = [part.text for part in parts]
        fields = [f for k, f in enumerate(fields) if f.isdecimal() or f not in fields[:k]]
        numbered = [k for k, field in enumerate(fields) if field in {one.text for one in people}]
        # a number at the beginning, or before others, may be a person's
        first = {0} if fields and fields[0][0].isdecimal() and not kind else set[int]()
        inner = range(len(fields) - 1 if free and not kind else 0)
        first |= {k for k in inner if fields[k].isdecimal() and _counts(fields, k)}
        initials = (k for k, f in enumerate(fields) if free and re.fullmatch("[A-Z]{2}", f))
        unusual = {*initials, *(k for k, field in enumerate(fields) if not usual(field))}
        candidates = sorted(first | unusual | {*numbered})
        day = "".join(one.text for one in days[:1] or occasions).casefold()
        sure = sure and numbered == candidates[:1]
        return cls(stem, kind, day, sorted({*days, *parts}), fields, candidates, sure)

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
        last = (self.fields or [""])[-1]
        counts = _counts([*self.fields, _bare(last), ""], len(self.fields) + 1)
        counts = counts and "." not in last and _counts(self.fields, len(self.fields) - 1)
        return last[len(last.rstrip(DIGITS)) :] if counts else ""

    def read(self, places: Sequence[int]) -> Said:
        """Give the person by the fields at some places, and the condition by the others."""
        person = "-".join(self.fields[place] for place in places)
        others = [field for k, field in enumerate(self.fields) if k not in places]
        return Said(person, condition(others), self.session)

    def patterns(self) -> Iterator[tuple[tuple[int, ...], str]]:
        """Give the patterns of all ways to read it, by the places of what may say whose it is."""
        places, last = self.candidates, len(self.fields) - 1
        words = [k for k in places if not self.fields[k].isdecimal()]
        after = words[-1:] == [last - 1] and self.fields[last].isdecimal()
        if last not in places and self.number and (not words or after):
            places = [*places, last]
        if not places:
            places = [last]
        for number in range(min(len(places), 3) + 1):
            for chosen in combinations(places[:3], number):
                if last not in chosen[1:] or last - 1 in chosen:  # a number follows its name
                    yield chosen, self._pattern(chosen)

    def _pattern(self, person: Sequence[int]) -> str:
        """Give its pattern if the fields at some places say whose it is."""
        stem, pattern, end, next_place = re.sub(r'["{}$`!\\]', "*", self.stem), "", 0, 0
        for part in self.parts:
            place = next_place if [part.text] == self.fields[next_place : next_place + 1] else None
            next_place += place is not None
            if place is None and part.text in self.fields:
                place = self.fields.index(part.text)  # a folder said it before
            bare, role, last = _bare(part.text), "{condition}", part is self.parts[-1]
            if place in person:
                # a single letter in JdV is no word
                words = re.findall(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+", part.text)
                are_usual = [usual(word) for word in words if len(word) > 1 or not words[1:]]
                role = "{subject}" if not any(are_usual) else "{subject}{condition}{recording}"
                if are_usual and all(are_usual) and not part.text[0].isdecimal():
                    role = "{condition}{subject}" if part.text[-1] in DIGITS else "{subject}"
            elif place is None or (bare in TRIAL and not last):
                role = "*"  # a day, or the word before a number
            elif last and "." not in part.text and part.text[-1] in DIGITS:
                role = "{recording}" if bare in ("", *TRIAL) else "{condition}{recording}"
            placed = re.sub("[^-_ ]+", role, stem[part.start : part.stop])
            if role == "{condition}{recording}":  # of a word and its number with a mark between
                placed = re.sub(r"\{recording\}([-_ ])\{condition\}", r"\1", placed)
            pattern, end = pattern + stem[end : part.start] + placed, part.stop
        return re.sub(r"[*]([-_ ]?[*])+", "*", pattern + stem[end:])

    def names(self, person: str) -> bool:
        """Tell whether fields in a row are this person, whatever marks are between them."""
        letters, fields = _letters(person), [*map(_letters, self.fields)]
        ends = range(1, len(fields) + 1)
        return any("".join(fields[a:b]) == letters for b in ends for a in range(b))

    def words(self, person: str) -> set[str]:
        """Give what its fields say beside the person; of a trial, without a repetition's number."""
        fields = [f for f in self.fields if f.casefold() not in person.casefold().split("-")]
        return {word.casefold() for word in (fields if self.kind else _unnumbered(fields)) if word}

    def apart(self, trials: Sequence["RecordingName"], person: str) -> set[str]:
        """Give words of a pose by which it may not be of all these trials of a person.

        Some trials have the word and others do not; or none has, and one has another such word.
        """
        pose_words, others = self.words(person), [trial for trial in trials if trial is not self]
        words = [trial.words(person) for trial in others]
        apart = {w for w in pose_words if 0 < sum(w in of_trial for of_trial in words) < len(words)}
        if self.kind and any(trial.telling(trial.words(person) - pose_words) for trial in others):
            apart |= self.telling(pose_words.difference(*words))
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
    ways = [
        f"{field}{times})".join(
            re.split(r"\\\{\w+\\\}", text.replace(r"\}\{", rf"\}}{boundary}\{{"))
        )
        for boundary, times in BOUNDARIES.items()
    ]
    by_file, above = dict[str, Said](), set[str]()
    for file in files:
        name = RecordingName.of(file)
        fits = (re.fullmatch(f"(?:(.*)/)?{way}", name.stem, re.IGNORECASE) for way in ways)
        if match := next(filter(None, fits), None):
            above.add(match[1] or "")
            pairs = [*zip(roles, match.groups()[1:], strict=True)]
            said_of = {role: dict.fromkeys(t for r, t in pairs if r == role) for role in ROLES}
            person, what = "-".join(said_of["subject"]), "-".join(said_of["condition"])
            by_file[file] = Said(person, what.lower(), name.session)
    if len(above) > 1:
        raise ValueError(f"--pattern: the folders {listed(sorted(above))} are not in it; {WITHOUT}")
    return by_file


def condition(fields: Sequence[str]) -> str:
    """Give what fields of a name say of the condition; the last number is that of a repetition."""
    # a time of measurement, such as T1, may stand before further fields
    kept = (
        word
        for word in _unnumbered(fields)
        if re.fullmatch("[Tt][0-9]", word) or _bare(word) not in ("", *TRIAL)
    )
    return "-".join(kept).lower()


def _letters(text: str) -> str:
    """Give letters and digits of a text alone, in small letters."""
    return re.sub(r"[\W_]", "", text).casefold()


def _counts(fields: Sequence[str], place: int) -> bool:
    """Tell whether no word before a number says that it is that of a trial or of a level."""
    words = (*READ["words"]["numbered"], *READ["words"]["trial"])
    return place < 1 or fields[place - 1].casefold() not in words


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
    return field.casefold() in TRIAL or USUAL.issuperset(word.casefold() for word in words)
