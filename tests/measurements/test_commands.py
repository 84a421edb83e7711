"""Every command that measures says with ``--help`` what it does, and runs nothing."""

import importlib
import re
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("benchmarks", "campaign", "validation", "virtual_gait", "virtual_machine")
OF_OTHERS = {
    "tests.benchmarks.gaitkit_peer",
    "tests.benchmarks.live_loopback",
    "tests.benchmarks.worker",
}
"""Processes that a command starts; nobody types them."""


def programs():
    """Every module of these folders that is run, as it is typed."""
    for folder in FOLDERS:
        for path in sorted((ROOT / "tests" / folder).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            name = module.removesuffix(".__main__")
            if "__name__ ==" in path.read_text(encoding="utf-8") and name not in OF_OTHERS:
                yield name


def helped(name, monkeypatch, capsys):
    """What ``python -m NAME --help`` prints."""
    package = find_spec(name).submodule_search_locations
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        importlib.import_module(f"{name}.__main__" if package else name).main()
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("name", [*programs()])
def test_a_command_says_how_it_is_typed_and_what_it_does(name, monkeypatch, capsys):
    pytest.importorskip("resource", reason="forks and limits")
    text = helped(name, monkeypatch, capsys)
    assert re.match(rf"usage: (python -m )?{re.escape(name)} ", text)
    assert len(text.split("\n\n")) >= 3  # usage, what it does, options


@pytest.mark.parametrize("name", ["tests.benchmarks", "tests.campaign", "tests.validation"])
def test_a_command_of_several_parts_lists_them_with_how_long_they_take(name, monkeypatch, capsys):
    pytest.importorskip("resource", reason="forks and limits")
    lines = re.findall(
        r"^  \S.*\((?:\d+ (?:s|min|h))\b.*\)$", helped(name, monkeypatch, capsys), re.M
    )
    assert len(lines) >= 4


def test_measurements_that_contributing_names_are_commands():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text[text.index("## Measurements") : text.index("## Conventions")]
    named = {name.rstrip(".") for name in re.findall(r"tests\.[a-z_.]+", table)}
    assert len(named) > 10
    assert named <= set(programs())


def test_nothing_that_measures_is_collected():
    """Short forms of measurements are tests beside this one."""
    tests = [path for folder in FOLDERS for path in (ROOT / "tests" / folder).rglob("test_*.py")]
    assert tests == []
