"""Say which texts are longer than they may be, and which notebooks are made unlike the others."""

import re
import sys
from pathlib import Path
from string import Formatter

from hbm.notes import catalogue

ROOT = Path(__file__).resolve().parents[1]
TASKS = ("recording", "treadmill", "study", "why", "live", "python")
FIGURE = re.compile(r"^(?!def ).*(plt\.subplots|\.plot\.bar|hr\.figure|\bshow)\(", re.MULTILINE)
faults = []


def demand(holds: bool, fault: str) -> None:
    """Note a fault unless what is demanded holds."""
    if not holds:
        faults.append(fault)


# pages of a task are read while one works; notes and reference are looked up
pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
words = {  # the bars of tables are none
    page.stem: sum(map(bool, map(re.compile(r"\w").search, page.read_text("utf-8").split())))
    for page in pages
}
for name, most in ({"README": 900} | dict.fromkeys(TASKS, 700)).items():
    demand(words[name] <= most, f"{name}.md: {words[name]} words, at most {most}")
total = sum(words.values())
demand(total <= 22000, f"all pages together: {total} words, at most 22000")

# a notebook has one question, three imports and two to four figures, made in a cell
contents = (ROOT / "notebooks" / "README.md").read_text(encoding="utf-8")
for path in sorted((ROOT / "notebooks").glob("*.py")):
    text = path.read_text(encoding="utf-8")
    titles = re.findall(r"^# # (.+)", text, re.MULTILINE)
    demand([title[-1] for title in titles] == ["?"], f"{path.name}: one title, a question")
    imports = re.findall(r"^(?:import|from) ", text, re.MULTILINE)
    demand(len(imports) <= 3, f"{path.name}: at most three imports")
    demand(f"): {titles[0]}" in contents, f"{path.name}: its title is in notebooks/README.md")
    cells = re.sub(r"^def show\(.*?(?=^\S)", "", text, flags=re.DOTALL | re.MULTILINE)
    demand(2 <= len(FIGURE.findall(cells)) <= 4, f"{path.name}: two to four figures")

# a warning has at most 20 words, with its values, and asks nothing
for code, entry in catalogue().items():
    parts = Formatter().parse(entry["text"])
    said = " ".join(before + ("x" if field else "") for before, field, *_ in parts).split()
    if "advice" in entry:
        demand(len(said) <= 20 and "?" not in entry["text"], f"{code}: {entry['text']}")

sys.exit("\n".join(faults) or None)
