"""Every number of judgement has a unit, a meaning and an origin, and code that reads it."""

import re
import shlex
import tomllib
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from hbm.numbers import read_numbers

ROOT = Path(__file__).resolve().parents[2]


def sections():
    """Every section of every file: its path, its package, its name and its entries."""
    for room in ("hbm", "compensation", "pipeline"):
        for name in ("thresholds.toml", "parameters.toml"):
            for path in sorted((ROOT / room).rglob(name)):
                package = ".".join(path.parent.relative_to(ROOT).parts)
                for section, entries in tomllib.loads(path.read_text(encoding="utf-8")).items():
                    yield path, package, section, entries


def entries():
    for path, _, section, named in sections():
        for name, entry in named.items():
            yield f"{path}: {section}.{name}", entry


def test_a_number_has_a_unit_a_meaning_and_an_origin():
    for name, entry in entries():
        origin = set(entry) - {"value", "unit", "meaning"}
        assert origin in ({"data", "command"}, {"source"}), name
        assert all(str(text).strip() for text in entry.values()), name


def test_code_reads_each_number():
    for path, package, section, named in sections():
        arguments = r",\s*".join(f'"{re.escape(word)}"' for word in (package, path.name, section))
        reading = re.compile(rf"read_numbers\(\s*{arguments}")
        codes = [code.read_text(encoding="utf-8") for code in path.parent.rglob("*.py")]
        readers = [code for code in codes if reading.search(code)]
        for name in named:
            assert any(re.search(rf"\.{name}\b", code) for code in readers), f"{section}.{name}"


def test_the_command_of_a_number_can_be_typed():
    for name, entry in entries():
        if "command" not in entry:
            continue
        python, option, module, *arguments = shlex.split(entry["command"])
        assert (python, option) == ("python", "-m"), name
        assert find_spec(module), name
        if module == "pytest":
            files = [word.partition("::")[0] for word in arguments if word.startswith("tests/")]
            assert files, name
            assert all((ROOT / file).exists() for file in files), name


def test_values_are_read_as_they_stand():
    for path, package, section, named in sections():
        values = read_numbers(package, path.name, section)
        for name, entry in named.items():
            np.testing.assert_array_equal(getattr(values, name), entry["value"])
