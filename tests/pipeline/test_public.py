"""Public names: type checkers see the same as programs, and each has an example."""

import ast
from pathlib import Path

import pipeline


def test_type_checkers_see_the_same_names():
    tree = ast.parse(Path(pipeline.__file__).read_text(encoding="utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    imported = {(node.module, alias.name) for node in guarded.body for alias in node.names}
    assert imported == {(f"pipeline.{home}", name) for name, home in pipeline._HOME.items()}
    assert sorted(pipeline._HOME) == sorted(pipeline.__all__)
