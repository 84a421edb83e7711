"""Every function and test that the page from the thesis to the code names exists."""

import ast
import re
import shlex
from pathlib import Path

import typer

from pipeline.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
CODE = re.findall(r"`([^`]+)`", (ROOT / "docs" / "thesis.md").read_text(encoding="utf-8"))


def names_in(path):
    """Functions, methods and classes that a file defines."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    definitions = ast.FunctionDef | ast.ClassDef
    return {node.name for node in ast.walk(tree) if isinstance(node, definitions)}


def test_functions_and_tests_are_where_the_page_says():
    places = [re.fullmatch(r"([\w/]+\.py)(?:: |::)(\w+)", code) for code in CODE]
    named = [place.groups() for place in places if place]
    assert sum(path.startswith("tests/") for path, _ in named) > 20
    assert sum(not path.startswith("tests/") for path, _ in named) > 20
    assert [(path, name) for path, name in named if name not in names_in(path)] == []
    assert {code for code in CODE if ".py" in code} == {place[0] for place in places if place}


def test_commands_are_there():
    """Each command with its options, and each module that `python -m` runs."""
    lines = [code.removeprefix("hbm ") for code in CODE if code.startswith("hbm ")]
    assert len(lines) > 5
    for line in lines:
        command, words = typer.main.get_command(app), shlex.split(line)
        while hasattr(command, "list_commands"):
            assert words[0] in command.list_commands(None), line
            command = command.get_command(None, words.pop(0))
        options = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= options, line
    for module in re.findall(r"python -m (tests[\w.]*)", "\n".join(CODE)):
        path = ROOT / module.replace(".", "/")
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), module
