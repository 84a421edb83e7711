"""The catalogue of notes, the code that makes them and the page that explains them agree."""

import ast
import re
from pathlib import Path

import pytest

from hbm.notes import LEVELS, note_codes
from hbm.notes import _kind as kind_of

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "notes.md").read_text(encoding="utf-8")
ENTRIES = dict(re.findall(r"^### (\w+)\n\n(.+)$", PAGE, re.MULTILINE))
MODULES = [p for top in ("hbm", "compensation", "pipeline") for p in (ROOT / top).rglob("*.py")]


def strings_of(node):
    return {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and type(n.value) is str}


def first_arguments(tree):
    """What stands where a note's code does: `Note.of(CODE, …)`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Note.of":
            yield node.args[0]


def test_the_page_explains_every_code_in_the_order_of_the_catalogue():
    assert re.findall(r"^### (.+)$", PAGE, re.MULTILINE) == list(note_codes())
    assert list(ENTRIES) == list(note_codes())


@pytest.mark.parametrize("code", note_codes())
def test_the_page_marks_warnings_as_the_catalogue_does(code):
    assert kind_of(code).level in LEVELS
    assert ENTRIES[code].startswith("**Warning.** ") == (kind_of(code).level == "warning")
    assert len(ENTRIES[code].split()) >= 10


def test_every_code_is_made_somewhere_and_none_is_made_that_is_not_in_the_catalogue():
    codes, used = set(note_codes()), set()
    for module in MODULES:
        tree = ast.parse(module.read_text(encoding="utf-8"))
        used |= strings_of(tree) & codes
        for argument in first_arguments(tree):
            assert strings_of(argument) <= codes, f"{module.name}: {ast.unparse(argument)}"
    assert used == codes
