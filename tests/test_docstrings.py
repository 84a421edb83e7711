"""Docstrings describe the parameters, attributes and errors that are there, and no others."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("hbm", "compensation", "pipeline", "hbm_residuals")
MODULES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def described(docstring, section):
    """Names that a section of a NumPy docstring describes."""
    block = re.search(rf"^{section}\n-+\n((?:(?!\n\S[^\n]*\n---).)*)", docstring, re.M | re.S)
    lines = re.findall(r"^(\*{0,2}\w.*)$", block[1], re.MULTILINE) if block else []
    return [
        name.strip().lstrip("*")
        for line in lines
        for name in re.sub(r" ?[:(].*", "", line).split(",")
    ]


def parameters_of(function):
    arguments = function.args
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    every += filter(None, [arguments.vararg, arguments.kwarg])
    return {argument.arg for argument in every} - {"self", "cls"}


def attributes_of(kind):
    """Names that a class has: fields, properties, methods, and what its methods set."""
    for node in ast.walk(kind):
        match node:
            case ast.AnnAssign(target=ast.Name(id=name)):
                yield name
            case ast.Assign(targets=targets):
                for target in (one for t in targets for one in getattr(t, "elts", [t])):
                    yield getattr(target, "attr", getattr(target, "id", ""))
            case ast.AnnAssign(target=ast.Attribute(attr=name)):
                yield name
            case ast.FunctionDef(name=name):
                yield name


def wrong_names(tree):
    """Names that docstrings of a module describe, and that are not there."""
    for node in ast.walk(tree):
        if isinstance(node, FUNCTIONS):
            there, sections = parameters_of(node), ("Parameters",)
        elif isinstance(node, ast.ClassDef):
            made = [one for one in node.body if getattr(one, "name", "") in ("__init__", "__new__")]
            there = {*attributes_of(node)}.union(*map(parameters_of, made))
            sections = ("Parameters", "Attributes")
            if not made and not node.decorator_list and node.bases:
                continue  # made as its base is
        else:
            continue
        docstring = ast.get_docstring(node) or ""
        for section in sections:
            for name in described(docstring, section):
                if name not in there:
                    yield f"{node.name}: {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_described_parameters_and_attributes_exist(path):
    assert [*wrong_names(ast.parse(path.read_text(encoding="utf-8")))] == []


def test_a_parameter_that_is_not_there_is_found():
    lines = ["Do.", "", "    Parameters", "    ----------", "    a, c", "        Two.", "    *b"]
    text = "\n".join((*lines, "        More.", "", "    Returns", "    -------", "    d", "    "))
    assert [*wrong_names(ast.parse(f'def f(a, *b):\n    """{text}"""\n'))] == ["f: c"]
