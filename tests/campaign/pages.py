"""Tables that campaigns measure, within laboratory notebooks that people wrote."""

import re
from pathlib import Path

NOTEBOOKS = Path(__file__).resolve().parents[1] / "validation"


def renew(page: str, name: str, text: str) -> None:
    """Replace what stands between the two comments of a name in a laboratory notebook; print it."""
    path = NOTEBOOKS / page
    start, end = f"<!-- {name} -->\n\n", f"\n\n<!-- end of {name} -->"
    old = path.read_text(encoding="utf-8")
    new, count = re.subn(
        f"{re.escape(start)}.*?{re.escape(end)}", lambda _: start + text + end, old, flags=re.DOTALL
    )
    if count != 1:
        raise ValueError(f"{path}: expected one place for {name!r}, found {count}")
    path.write_text(new, encoding="utf-8")
    print(text, f"written: {path}", sep="\n", flush=True)
