"""The primary analysis for a manuscript: its paragraph and tables, for Word and for LaTeX."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final
from zipfile import ZipFile, ZipInfo

import pandas as pd

from pipeline.io.write import whole_file, write_text
from pipeline.report.blocks import Table

IN_LATEX: Final = {"−": "$-$", "±": r"$\pm$", "·": r"$\cdot$", "×": r"$\times$", "²": "$^2$"} | {
    **{"→": r"$\to$", "η": r"$\eta$", "✔": "yes", "✖": "no", "–": "--"}
}
"""Characters that LaTeX does not know without further packages."""


def write_paper(folder: Path, title: str, paragraph: str, tables: Sequence[Table]) -> None:
    """Write ``results.docx`` and ``results.tex``: a paragraph, and tables whose cells are texts."""
    _write_word(folder / "results.docx", title, paragraph, tables)
    parts = [r"% needs \usepackage{booktabs}", _latex(paragraph)]
    for table in tables:
        frame = pd.DataFrame(table.rows, columns=[*table.heads])
        text = frame.to_latex(index=False, escape=True, caption=table.caption, position="htbp")
        parts += [_latex(text, escape=False), _latex(table.legend)]
    write_text("\n\n".join(parts) + "\n", folder / "results.tex")


def _latex(text: str, *, escape: bool = True) -> str:
    """Write a text so that LaTeX typesets it."""
    if escape:
        for special in "&%_#$":
            text = text.replace(special, rf"\{special}")
    for character, command in IN_LATEX.items():
        text = text.replace(character, command)
    return text


def _write_word(path: Path, title: str, paragraph: str, tables: Sequence[Table]) -> None:
    """Write a document whose bytes depend on its content alone."""
    from docx import Document  # here: it takes long to load

    document = Document()
    document.add_heading(title)
    document.add_paragraph(paragraph)
    for table in tables:
        document.add_paragraph(table.caption, style="Caption")
        grid = document.add_table(0, len(table.heads), style="Light Shading")
        for texts in (table.heads, *table.rows):
            for cell, text in zip(grid.add_row().cells, texts, strict=True):
                cell.text = text
        document.add_paragraph(table.legend)
    with whole_file(path) as temporary:
        document.save(str(temporary))
        with ZipFile(temporary) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        with ZipFile(temporary, "w") as archive:
            for name, content in members.items():  # without the time of day
                archive.writestr(ZipInfo(name), content)
