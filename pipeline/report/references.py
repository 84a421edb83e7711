"""The works that a report cites, as BibTeX."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files


@cache
def references() -> Mapping[str, str]:
    """Give the entries of ``references.bib`` by their keys."""
    text = files("pipeline.report").joinpath("references.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{(\w+),$", text, re.MULTILINE)
    return dict(zip(keys, text.strip().split("\n\n"), strict=True))


def bibtex(keys: Sequence[str], software_version: str) -> str:
    """Give the entries of some works.

    Parameters
    ----------
    keys
        Keys of `references`.
    software_version
        Version for the entry of this software.
    """
    entries = "\n\n".join(references()[key] for key in keys) + "\n"
    return entries.replace("{VERSION}", f"{{{software_version}}}")
