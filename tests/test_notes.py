"""Every note has a code in the catalogue, a meaning and advice, and code that makes it."""

import ast
import runpy
from pathlib import Path

from hbm.notes import catalogue

ROOT = Path(__file__).resolve().parents[1]
MODULES = [p for top in ("hbm", "compensation", "pipeline") for p in (ROOT / top).rglob("*.py")]


def strings_of(node):
    return {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and type(n.value) is str}


def first_arguments(tree):
    """What stands where a note's code does: `Note.of(CODE, …)`."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(ast.Attribute(ast.Name("Note"), "of"), [code, *_]):
                yield code


def test_every_code_is_made_somewhere_and_none_is_made_that_is_not_in_the_catalogue():
    codes, texts = set(catalogue()), [module.read_text(encoding="utf-8") for module in MODULES]
    for text in texts:
        if "Note.of(" in text:
            for argument in first_arguments(ast.parse(text)):
                assert strings_of(argument) <= codes, ast.unparse(argument)
    whole = "\n".join(texts)
    assert {code for code in codes if f'"{code}"' not in whole} == set()


def test_every_warning_has_a_meaning_and_advice_and_the_page_of_the_notes_is_made_of_them():
    for code, entry in catalogue().items():
        assert ("item" in entry) != ({"meaning", "advice"} <= set(entry)), code
    path = ROOT / "docs" / "notes_page.py"
    page = runpy.run_path(str(path))["notes_page"]()
    assert (ROOT / "docs" / "notes.md").read_text(encoding="utf-8") == page, f"run {path}"
