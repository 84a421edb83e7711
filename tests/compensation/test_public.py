"""The package's face: every public name is there, and none costs anything before it is used."""

import ast
import pkgutil
import subprocess
import sys
import tomllib
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
    imported = {
        (node.module.removeprefix("compensation."), alias.name)
        for node in guarded.body
        for alias in node.names
    }
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


def test_of_hbm_only_spatial_algebra_signals_and_notes_may_be_imported():
    """The contract names what is forbidden; a new module of hbm has to be added there."""
    root = Path(compensation.__file__).parents[1]
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    forbidden = next(c for c in contracts if c.get("source_modules") == ["compensation"])
    modules = {f"hbm.{found.name}" for found in pkgutil.iter_modules([str(root / "hbm")])}
    allowed = modules - set(forbidden["forbidden_modules"])
    assert allowed == {"hbm.spatial", "hbm.signals", "hbm.notes"}
