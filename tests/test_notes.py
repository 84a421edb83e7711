"""The catalogue of notes, the code that makes them and the page that explains warnings agree."""

import ast
import re
from pathlib import Path

from hbm.notes import catalogue

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "notes.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^### (\w+)$(.+?)(?=^#|\Z)", PAGE, re.MULTILINE | re.DOTALL))
MODULES = [p for top in ("hbm", "compensation", "pipeline") for p in (ROOT / top).rglob("*.py")]


def strings_of(node):
    return {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and type(n.value) is str}


def first_arguments(tree):
    """What stands where a note's code does: `Note.of(CODE, …)`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Note.of":
            yield node.args[0]


def test_the_page_says_of_every_warning_and_of_nothing_else_what_to_do():
    warnings = {code for code, entry in catalogue().items() if "item" not in entry}
    told = {code for code, text in SECTIONS.items() if re.search(r"\*\*To do\.\*\* \w+", text)}
    assert told == warnings


def test_the_page_explains_every_item_of_provenance():
    rows = PAGE.partition("## Provenance")[2].partition("###")[0]
    for entry in catalogue().values():
        assert re.search(rf"^\|[^|]*\b{entry.get('item', 'item')}\b", rows, re.MULTILINE)


def test_every_code_is_made_somewhere_and_none_is_made_that_is_not_in_the_catalogue():
    codes, used = set(catalogue()), set()
    for module in MODULES:
        tree = ast.parse(module.read_text(encoding="utf-8"))
        used |= strings_of(tree) & codes
        for argument in first_arguments(tree):
            assert strings_of(argument) <= codes, f"{module.name}: {ast.unparse(argument)}"
    assert used == codes
