"""Notes: what was found while processing, each with a code and a sentence.

Warnings are for a person to act on, with advice; all others are provenance: how a result was made,
a row of a table. Texts, meanings and advice are in one catalogue, ``notes.toml``, of which
``docs/notes.md`` is made.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import isnan
from numbers import Integral, Real
from string import Formatter
from typing import Any, Final, Literal, SupportsFloat

from hbm.spelling import packaged_toml, printable, wrapped, written

Level = Literal["warning", "provenance"]
NoteValue = str | int | float | tuple[str, ...] | Mapping[str, float]
GivenValue = str | SupportsFloat | Sequence[str] | Mapping[str, SupportsFloat]


@dataclass(frozen=True, slots=True, repr=False)
class Note:
    """One finding about a body, a recording or a trial.

    Attributes
    ----------
    code
        Its kind, as in the catalogue and in ``docs/notes.md``.
    values
        Name -> number, text, names, or numbers by name; exactly those of the code's sentences and
        advice, in the unit that the name ends in.

    Raises
    ------
    ValueError
        If the code is not in the catalogue, or the values are not those of its sentence and advice.

    Examples
    --------
    >>> note = Note.of("legs_differ", difference_m=0.041, left_m=0.843, right_m=0.802)
    >>> note.level
    'warning'
    >>> print(note)
    leg lengths differ by 41 mm (hip to ankle: left 0.843 m, right 0.802 m)
    >>> print(note.advice)
    Look at the calibration pose in the viewer, and check the markers of pelvis, knees and ankles.
    """

    code: str
    values: Mapping[str, NoteValue]

    def __post_init__(self) -> None:
        if self.code not in catalogue():
            raise ValueError(f"no note has the code {self.code!r}; hbm/notes.toml lists them")
        if self.values.keys() != (fields := _fields(self.code)):
            wanted, given = (", ".join(sorted(v)) or "none" for v in (fields, self.values))
            raise ValueError(f"note {self.code!r}: its values are {wanted}, got {given}")
        try:
            _ = self.text, self.advice, "light" in catalogue()[self.code] and self.light
        except (TypeError, ValueError) as error:
            raise ValueError(f"note {self.code!r}: {error}; got {dict(self.values)}") from error

    def __hash__(self) -> int:
        return hash((self.code, self.text))

    def __repr__(self) -> str:
        return wrapped(f"Note({self.code!r}: {self.text})")

    def __str__(self) -> str:
        return self.text

    @classmethod
    def of(cls, code: str, /, **values: GivenValue) -> "Note":
        """Make a note from its code and its values by name, in Python's own types or NumPy's."""
        return cls(code, {name: _plain(value) for name, value in values.items()})

    @property
    def item(self) -> str:
        """Give the row of provenance that it belongs to; empty for a warning."""
        return catalogue()[self.code].get("item", "")

    @property
    def level(self) -> Level:
        """Give "warning" for what a person has to act on, "provenance" for all others."""
        return "provenance" if self.item else "warning"

    @property
    def text(self) -> str:
        """Give its sentence."""
        return _SENTENCE.vformat(catalogue()[self.code]["text"], (), self.values)

    @property
    def advice(self) -> str:
        """Give what to do about a warning, without marks of code; empty for provenance."""
        advice = catalogue()[self.code].get("advice", "").replace("`", "")
        return _SENTENCE.vformat(advice, (), self.values)

    @property
    def light(self) -> str:
        """Give what the light of a live session says of it: its own sentence there, or its text."""
        entry = catalogue()[self.code]
        return _SENTENCE.vformat(entry.get("light", entry["text"]), (), self.values)

    def to_dict(self) -> dict[str, str | dict[str, NoteValue]]:
        """Give code, level, item, text, advice and values, ready for JSON."""
        names = ("level", "item", "text", "advice")
        shown: dict[str, str] = {name: getattr(self, name) for name in names}
        return {"code": self.code, **shown, "values": dict(self.values)}

    @classmethod
    def from_dict(cls, plain: object) -> "Note":
        """Make the note that `to_dict` wrote; all but code and values is the catalogue's of today.

        A ValueError where that is no note, or of a code or with values that are unknown today.
        """
        if not isinstance(plain, Mapping) or not isinstance(plain.get("values"), Mapping):
            raise ValueError(f"a note is an object with code and values, got {plain!r}")
        return cls.of(str(plain.get("code")), **plain["values"])


def warnings_of(notes: Iterable[Note]) -> tuple[Note, ...]:
    """Give the notes that a person has to act on."""
    return tuple(note for note in notes if note.level == "warning")


def provenance(notes: Iterable[Note]) -> tuple[tuple[str, str], ...]:
    """Give the rows of provenance: an item and its sentences."""
    rows: dict[str, dict[str, None]] = {}
    for note in notes:
        if note.item:
            rows.setdefault(note.item, {})[note.text] = None
    return tuple((item, "; ".join(sentences)) for item, sentences in rows.items())


@cache
def catalogue() -> Mapping[str, Mapping[str, str]]:
    """Give code -> "text", "item" or the "meaning" and "advice" of a warning, maybe "light"."""
    return packaged_toml("hbm", "notes.toml")


@cache
def _fields(code: str) -> frozenset[str]:
    """Give the names of the values in the sentences and the advice of a note."""
    sentences = (catalogue()[code].get(part, "") for part in ("text", "advice", "light"))
    return frozenset(name for _, name, *_ in Formatter().parse(" ".join(sentences)) if name)


def _plain(value: object) -> NoteValue:
    """Give a value in Python's own types; text from files in one line that can be printed."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    if isinstance(value, Mapping):
        return {printable(str(name)): float(number) for name, number in value.items()}
    if isinstance(value, Sequence):
        return tuple(printable(str(name)) for name in value)
    raise ValueError(f"a note's value is a number, text, names or numbers by name, got {value!r}")


class _Sentence(Formatter):
    """Format of the catalogue's sentences.

    Python's format of numbers, with a factor before it and a unit behind it, both optional:
    ``{difference_m:1000*.0f mm}``. Names are joined by commas, and so are numbers by name.
    ``{frames:frame|frames}`` is singular or plural. Numbers that people type, after ``=`` as in
    ``{delay_s:=.4f}``, have a hyphen and no minus sign. ``{sensors:names}`` are names alone,
    ``{markers:3 markers}`` three names at most, else how many; ``{markers:is|are}`` goes with them.
    """

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec == "names":
            return ", ".join(value)
        if isinstance(value, Mapping):
            numbers = (f"{k} {self.format_field(v, format_spec)}" for k, v in value.items())
            return ", ".join(numbers)
        singular, plural, several = format_spec.partition("|")
        if isinstance(value, tuple):
            most, _, noun = format_spec.partition(" ")
            if plural:
                return singular if len(value) == 1 else several
            return f"{len(value)} {noun}" if noun and len(value) > int(most) else ", ".join(value)
        if isinstance(value, float) and isnan(value):
            return "unknown"
        if plural:
            return f"{value} {singular if value == 1 else several}"
        number, space, unit = format_spec.partition(" ")
        factor, _, number = number.rpartition("*")
        write = format if number.startswith("=") or not isinstance(value, Real) else written
        return write(value * float(factor) if factor else value, number) + (
            unit if unit == "°" else space + unit
        )


_SENTENCE: Final = _Sentence()
