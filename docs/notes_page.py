"""The page of the notes, ``notes.md``: made from the catalogue, ``hbm/notes.toml``.

``python docs/notes_page.py`` writes it again.
"""

import re
from importlib.resources import files
from pathlib import Path

from hbm.notes import catalogue

INTRODUCTION = """# What the notes mean

A note is a **warning**, with something to do, or **provenance**: how a result was made. Warnings
are listed here by the codes that the console prints in brackets. Provenance is a table in the
report, in the viewer, in results files and, with `--verbose`, on the console.
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
            advice = re.sub(r"\{remedy\}", "the correction as printed", entry["advice"])
            advice = re.sub(r"\{[^}]*\}", "…", advice)
            lines.append(f"### {code}\n\n{entry['meaning']}\n\n**To do.** {advice}\n")
    return "\n".join(lines)


if __name__ == "__main__":
    Path(__file__).with_name("notes.md").write_text(notes_page(), encoding="utf-8")
