"""Public names: all are there, none is imported before it is used, and each has an example."""

import ast
import doctest
import subprocess
import sys
from pathlib import Path

import pytest

import compensation


def test_every_public_name_is_where_the_package_says():
    assert {"fit_inertia", "fit_belt", "to_lab", "PlatformPose"} <= set(compensation.__all__)
    assert set(compensation.__all__) == set(compensation._HOME)
    for name in compensation.__all__:
        assert getattr(compensation, name).__name__ == name


def test_type_checkers_see_the_same_names():
    tree = ast.parse(Path(compensation.__file__).read_text(encoding="utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    imported = {(node.module, alias.name) for node in guarded.body for alias in node.names}
    assert imported == {(home, name) for name, home in compensation._HOME.items()}


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'fit_everything'"):
        compensation.fit_everything  # noqa: B018


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, compensation; print(sorted({'numpy', 'scipy', 'hbm'} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(compensation.__file__).parents[1],
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", compensation.__all__)
def test_every_public_name_has_an_example_that_runs(name):
    """pytest --doctest-modules runs them; here each has to be there."""
    documented = getattr(compensation, name)
    assert doctest.DocTestParser().get_examples(documented.__doc__)
