"""The catalogue of notes and the code that makes them agree."""

import ast
from pathlib import Path

from hbm.notes import catalogue

ROOT = Path(__file__).resolve().parents[1]
MODULES = [p for top in ("hbm", "compensation", "pipeline") for p in (ROOT / top).rglob("*.py")]


def strings_of(node):
    return {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and type(n.value) is str}


def first_arguments(tree):
    """What stands where a note's code does: `Note.of(CODE, …)`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Note.of":
            yield node.args[0]


def test_every_code_is_made_somewhere_and_none_is_made_that_is_not_in_the_catalogue():
    codes, used = set(catalogue()), set()
    for module in MODULES:
        tree = ast.parse(module.read_text(encoding="utf-8"))
        used |= strings_of(tree) & codes
        for argument in first_arguments(tree):
            assert strings_of(argument) <= codes, f"{module.name}: {ast.unparse(argument)}"
    assert used == codes
