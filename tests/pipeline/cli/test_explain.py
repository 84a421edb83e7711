"""What residuals are made of, on the command line."""

import json
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import pytest

from pipeline.cli.app import main


@dataclass(frozen=True)
class Explained:
    folder: Path
    lines: list[str]


@pytest.fixture(scope="module")
def explained(walker, tmp_path_factory):
    """The walk, explained in a terminal of 80 columns: the files and what is printed."""
    folder = tmp_path_factory.mktemp("explained")
    command = ["explain", str(walker.source), "--sex", "female", "--out", str(folder)]
    printed = StringIO()
    with pytest.MonkeyPatch.context() as patched, redirect_stdout(printed):
        patched.setenv("COLUMNS", "80")
        assert main(command) == 0
    return Explained(folder, printed.getvalue().splitlines())


def test_all_numbers_and_figures_are_written_and_nothing_else(explained):
    assert sorted(path.name for path in explained.folder.iterdir()) == [
        "walk_0_bands.parquet",
        "walk_0_bands.png",
        "walk_0_bands.svg",
        "walk_0_explained.json",
        "walk_0_explained.png",
        "walk_0_explained.svg",
    ]
    stored = json.loads((explained.folder / "walk_0_explained.json").read_text())
    assert stored["key"] == ""
    assert stored["budget"]["found_cycles"] >= 4


def test_eighty_columns_are_enough(explained):
    *said, _ = explained.lines
    assert max(map(len, said)) <= 80
    assert any(line.split() == ["Fx", "Fy", "Fz", "Mx", "My", "Mz"] for line in said)
    assert any(line.startswith("not explained ") for line in said)


def test_the_command_says_what_it_wrote_and_checks_itself(explained):
    text = " ".join(explained.lines)
    assert "Held-out check: the causes found in one half of the cycles" in text
    assert "Most worth mending" in text or "Nothing is clearly worth mending" in text
    assert explained.lines[-1].startswith(f"written to {explained.folder}: walk_0_explained.json")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["gone.c3d"], "gone.c3d"),
        (["result.parquet"], "only the recording shows what its residuals are made of"),
        (["walk.c3d", "--mass-kg", "5"], "mass"),
        (["walk.c3d", "--accelerometer", "a=x,y,z"], "has no effect without --calibration"),
        ([".", "--mass-kg", "70"], "leave out --mass-kg"),
        ([".", "--out", "elsewhere"], "leave out --out"),
        (["."], "no results of trials here"),
    ],
)
def test_what_cannot_be_explained_gives_one_line(
    walker, tmp_path, monkeypatch, capsys, arguments, words
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.c3d").symlink_to(walker.source)
    (tmp_path / "result.parquet").touch()
    assert main(["explain", *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
