"""Hints for misspelt names in messages to people."""

from collections.abc import Iterable
from difflib import get_close_matches

from hbm.coordinates import FIXED_TO


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """Give ``", did you mean 'x'?"`` for the nearest known word, or nothing."""
    close = get_close_matches(str(word), list(known), n=1)
    return f", did you mean {close[0]!r}?" if close else ""


def no_segment(name: object, known: Iterable[str]) -> str:
    """Say that there is no segment of a name, and what to write instead.

    "trunk" is the name of earlier versions for thorax and mid trunk together.
    """
    known = list(known)
    instead = ["thorax", "mid_trunk"] if name == "trunk" else [FIXED_TO.get(str(name), "")]
    instead = [repr(s) for s in instead if s in known]
    hint = f", write {' and '.join(instead)}" if instead else did_you_mean(name, known)
    return f"no segment {name!r}{hint}"
