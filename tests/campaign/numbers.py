"""What do tests and files say at half and at twice each number of judgement of a room?

    python -m tests.campaign.numbers ROOM [SECTION | SECTION.NAME …] [--tests FILE …]

Of `thresholds.toml` in `pipeline/ROOM`, `hbm` or `compensation`, by default of all. Tests plant
faults, and state what is said of them and where there is none. Those that read a number run again
with half and with twice of it, up to the first that fails; where none does, with a thousandth and
the thousandfold, which are as if there were no rule. Of `io`, real files are read too, as they are
and damaged. Prints a line for each number.
"""

import tomllib
from argparse import ArgumentParser
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from _pytest.runner import runtestprotocol

import hbm.numbers

ROOT = Path(__file__).resolve().parents[2]
FILES = ROOT / "tests" / "campaign" / "said_of_files.py"
FACTORS = {"half": 0.5, "twice": 2.0}
EXTREMES = {"a thousandth": 1e-3, "the thousandfold": 1e3}
Key = tuple[int, str]
"""A section's identity, and the name of a number in it."""
READ: set[Key] = set()


class Numbers(SimpleNamespace):
    """A section of numbers that remembers which were read."""

    def __getattribute__(self, name: str) -> Any:
        READ.add((id(self), name))
        return super().__getattribute__(name)


def scaled(value: Any, factor: float) -> Any:
    """The number, or each of several, times a factor; whole numbers stay whole."""
    if isinstance(value, dict):
        return {key: scaled(one, factor) for key, one in value.items()}
    if isinstance(value, list):
        return np.array([scaled(one, factor) for one in value])
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


class Again:
    """Runs tests as they are, and again with each number that they read changed."""

    def __init__(self, room: str, names: list[str]) -> None:
        self.room, self.names = room, names
        self.fixtures: dict[Any, set[Key]] = defaultdict(set)
        self.reads: dict[pytest.Item, set[Key]] = {}
        self.seconds: dict[pytest.Item, float] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef, request):
        before = set(READ)
        READ.clear()
        try:
            return (yield)
        finally:
            if fixturedef.scope != "function":
                self.fixtures[fixturedef] |= READ
            READ.update(before)

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        for item, following in zip(session.items, [*session.items[1:], None], strict=True):
            READ.clear()
            reports = runtestprotocol(item, log=False, nextitem=following)
            used = item._fixtureinfo.name2fixturedefs.values()
            shared = set().union(*(self.fixtures[one[-1]] for one in used))
            passed = all(report.passed for report in reports)
            if not passed:
                print(f"{item.nodeid} is left out, for it does not pass as it is", flush=True)
            self.reads[item] = READ | shared if passed else set()
            self.seconds[item] = sum(report.duration for report in reports)
        for section, name, value in numbers(package(self.room), self.names):
            values = hbm.numbers.read_numbers(package(self.room), "thresholds.toml", section)
            items = [item for item in session.items if (id(values), name) in self.reads[item]]
            tests = sum(item.path != FILES for item in items)
            said: list[str] = []
            for words, factor in (FACTORS | EXTREMES).items():
                if words in EXTREMES and any(said[:2]):
                    break
                of = [item for item in items if words in FACTORS or item.path != FILES]
                said.append(self.failing(of, values, name, scaled(value, factor)))
            parts = [
                f"{words}: {one or 'all the same'}"
                for words, one in zip(FACTORS | EXTREMES, said, strict=False)
            ]
            counts = f"{tests} tests, {len(items) - tests} files"
            print(f"{section}.{name}\t{counts}\t" + "\t".join(parts), flush=True)
        return True

    def failing(self, items: list[pytest.Item], values: Any, name: str, changed: Any) -> str:
        """Say which test fails first, the shortest first, and of how many files more is said."""
        by_file = defaultdict(list)
        for item in sorted(items, key=self.seconds.__getitem__):
            by_file[item.path].append(item)
        shared = any((id(values), name) in read for read in self.fixtures.values())
        files, failed = 0, ""
        for item in (item for path in sorted(by_file) for item in by_file[path]):
            if failed and item.path != FILES:
                continue
            fails = self.fails_by(item, shared, values, name, changed)
            if fails and item.path == FILES:
                files += 1
            elif fails:
                failed = f"{item.path.stem}::{item.name}"
        return ", ".join([failed] * bool(failed) + [f"{files} files"] * bool(files))

    def fails_by(
        self, item: pytest.Item, shared: bool, values: Any, name: str, changed: Any
    ) -> bool:
        """Whether a test fails with the changed number, and not as it is."""
        usual = getattr(values, name)
        # with all that it shares made anew where it fails again for what it left there
        for anew in (True,) if shared else (False, True):
            setattr(values, name, changed)
            fails = self.fails(item, anew)
            setattr(values, name, usual)
            if not fails or not self.fails(item, anew):
                return fails
        return False

    def fails(self, item: pytest.Item, anew: bool) -> bool:
        """Whether a test fails now, with all that it shares made anew or as it is."""
        setup = item.session._setupstate
        setup.teardown_exact(None if anew else item.parent)
        reports = runtestprotocol(item, log=False, nextitem=None if anew else item.parent)
        return any(report.failed for report in reports)


def package(room: str) -> str:
    """Give the name of a room's package."""
    return room if room in ("hbm", "compensation") else f"pipeline.{room}"


def numbers(of_package: str, names: list[str]) -> Iterator[tuple[str, str, Any]]:
    """Sections, names and values of a package's numbers, of those that are asked for."""
    file = ROOT / of_package.replace(".", "/") / "thresholds.toml"
    for section, entries in tomllib.loads(file.read_text(encoding="utf-8")).items():
        for name, entry in entries.items():
            if not names or {section, f"{section}.{name}"} & {*names}:
                yield section, name, entry["value"]


def main() -> None:
    parser = ArgumentParser(prog="python -m tests.campaign.numbers", description=__doc__)
    parser.add_argument("room", help="such as io")
    parser.add_argument("names", nargs="*", metavar="NUMBER", help="SECTION or SECTION.NAME")
    parser.add_argument("--tests", nargs="+", help="files or folders; by default the room's")
    given = parser.parse_args()
    hbm.numbers.SimpleNamespace = Numbers  # before any package reads its numbers
    of_room = "tests/" + package(given.room).replace(".", "/")
    tests = given.tests or [of_room, *[str(FILES)] * (given.room == "io")]
    options = ("-o", "addopts=", "--import-mode=importlib", "-m", "not slow and not campaign")
    quiet = ("-p", "no:cacheprovider", "-p", "no:terminal")
    pytest.main([*options, *quiet, *tests], plugins=[Again(given.room, given.names)])


if __name__ == "__main__":
    main()
