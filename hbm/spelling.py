"""Hints for misspelt names in messages to people."""

from collections.abc import Iterable
from difflib import get_close_matches

from hbm.coordinates import FIXED_TO


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """Give ``", did you mean 'x'?"`` for the nearest known word, or nothing."""
    close = get_close_matches(str(word), list(known), n=1)
    return f", did you mean {close[0]!r}?" if close else ""


def differing_case(names: Iterable[str], known: Iterable[str]) -> str:
    """Say how many names differ from known ones only in upper and lower case, or nothing."""
    by_letters = {name.casefold(): name for name in known}
    pairs = [(name, by_letters.get(name.casefold(), name)) for name in names]
    differ = [f"{name!r} for {other}" for name, other in pairs if name != other]
    verb = "differs" if len(differ) == 1 else "differ"
    return f"; {len(differ)} {verb} in case only, such as {differ[0]}" if differ else ""


def no_segment(name: object, known: Iterable[str]) -> str:
    """Say that a segment is none of those known here, and what to write instead.

    "trunk" is the name of earlier versions for thorax and mid trunk together.
    """
    known = list(known)
    if name in FIXED_TO:
        return f"{name!r} has no coordinates; write {FIXED_TO[str(name)]!r}, to which it is fixed"
    if name == "trunk":
        parts = " and ".join(repr(s) for s in ("thorax", "mid_trunk") if s in known)
        return f"no segment 'trunk', write {parts}"
    return f"no segment {name!r}{did_you_mean(name, known)}"
