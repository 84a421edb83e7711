"""The page of the warnings, ``notes.md``: made from the catalogue, ``hbm/notes.toml``.

``python docs/notes_page.py`` writes it again.
"""

import re
from importlib.resources import files
from pathlib import Path

from hbm.notes import catalogue

INTRODUCTION = """# Warnings

A **warning** says what makes a result doubtful. Here is what its sentence leaves open, and what to
do, by the code that the console prints in brackets and the pages beside it. How a result was made
is its [provenance](conventions.md#provenance).
"""


def notes_page() -> str:
    """Give the page: every warning with its meaning and advice."""
    source = files("hbm").joinpath("notes.toml").read_text(encoding="utf-8")
    lines = [INTRODUCTION]
    for heading, code in re.findall(
        r"^# ([A-Z].*)$|^\[(\w+)\]$", source.partition("\n\n")[2], re.M
    ):
        entry = catalogue().get(code, {})
        if heading:
            lines.append(f"## {heading}\n")
        elif "item" not in entry:
            advice = entry["advice"].replace(
                "{remedy}", "Set the correction as printed, where one is advised."
            )
            advice = re.sub(r"\{[^}]*\}", "…", advice)
            lines.append(f"### {code}\n\n{entry['meaning']}\n\n{advice}\n")
    return "\n".join(lines)


if __name__ == "__main__":
    Path(__file__).with_name("notes.md").write_text(notes_page(), encoding="utf-8")
