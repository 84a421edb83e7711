"""The notebooks are listed, are scripts of cells, and end with a picture."""

import ast
import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.py"))
HEADER = """\
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---
"""


def cells(path: Path) -> list[tuple[str, str]]:
    """Kind ("markdown" or "code") and text of every cell."""
    body = path.read_text(encoding="utf-8").removeprefix(HEADER)
    parts = re.split(r"^# %%(.*)\n", body, flags=re.MULTILINE)[1:]
    kinds = {"": "code", "[markdown]": "markdown"}
    return [(kinds[a.strip()], b) for a, b in zip(parts[::2], parts[1::2], strict=True)]


def test_there_are_eight_lessons():
    assert [path.name[:3] for path in NOTEBOOKS] == [f"0{n}_" for n in range(1, 9)]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
class TestEveryNotebook:
    def test_is_a_percent_script(self, path):
        text = path.read_text(encoding="utf-8")
        ast.parse(text)
        assert text.startswith(HEADER + "\n# %%")
        for kind, cell in cells(path):
            assert cell.strip()
            if kind == "markdown":
                assert all(line.startswith("#") for line in cell.strip().splitlines())

    def test_starts_with_its_title(self, path):
        kind, text = cells(path)[0]
        assert kind == "markdown"
        assert re.match(r"# # \w+", text)

    def test_ends_with_a_picture_that_is_described(self, path):
        (before, words), (kind, code) = cells(path)[-2:]
        assert (before, kind) == ("markdown", "code")
        assert words.startswith("# ## The picture\n#\n")
        assert code.rstrip().splitlines()[-1].startswith(f'figure.savefig("{path.stem}.png"')

    def test_is_listed_once_in_the_readme(self, path):
        readme = (FOLDER / "README.md").read_text(encoding="utf-8")
        assert readme.count(f"- [{path.name}]({path.name}): ") == 1
