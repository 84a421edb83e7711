"""The primary analysis for a manuscript: its paragraph and tables, for Word and for LaTeX."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final
from zipfile import ZipFile, ZipInfo

import pandas as pd

from pipeline.io.write import whole_file, write_text
from pipeline.report.blocks import Table
from pipeline.report.tables import TABLE_III

IN_LATEX: Final = {
    **{"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "$": r"\$"},
    **{"{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"},
    **{"<": "$<$", ">": "$>$", "−": "$-$", "±": r"$\pm$", "·": r"$\cdot$", "×": r"$\times$"},
    **{"→": r"$\to$", "η": r"$\eta$", "χ": r"$\chi$", "²": "$^2$"},
    **{"✔": "yes", "✖": "no", "–": "--", "\n": " "},
}
"""Characters that LaTeX reads otherwise, or does not know without further packages."""


def write_paper(folder: Path, title: str, paragraph: str, tables: Sequence[Table]) -> None:
    """Write ``results.docx`` and ``results.tex``: a paragraph, and tables whose cells are texts."""
    _write_word(folder / "results.docx", title, paragraph, tables)
    parts = [r"% needs \usepackage{array,booktabs,rotating}", _latex(paragraph)]
    parts += [_latex_table(table, k) for k, table in enumerate(tables, 1)]
    write_text("\n\n".join(parts) + "\n", folder / "results.tex")


def _latex(text: str) -> str:
    """Write a text so that LaTeX typesets it."""
    written = "".join(IN_LATEX.get(letter, letter) for letter in text)
    return written.replace(r"$\eta$p$^2$", r"$\eta_p^2$")


def _latex_table(table: Table, number: int) -> str:
    """Write a table as wide as a page, whose cells break between words, and its legend."""
    column = rf">{{\raggedright\arraybackslash}}p{{{0.9 / len(table.heads):.3f}\linewidth}}"
    rows = [[_latex(str(text)) for text in row] for row in table.rows]
    frame = pd.DataFrame(rows, columns=[_latex(head) for head in table.heads])
    style = frame.style.hide(axis="index").set_table_styles(
        [
            {"selector": "scriptsize", "props": ":"},
            {"selector": r"setlength\tabcolsep", "props": r":{0.004\linewidth}"},
        ]
    )
    # more than seven columns have no room across an upright page
    text: str = style.to_latex(
        column_format=f"*{{{len(table.heads)}}}{{{column}}}",
        environment="table" if len(table.heads) <= 7 else "sidewaystable",
        position="htbp",
        hrules=True,
        caption=_latex(_caption(table)),
        label=f"tab:residuals-{number}",
    )
    return f"{text}\n{_latex(table.legend)}"


def _caption(table: Table) -> str:
    """Give a caption without the number that the table has on the page of the report."""
    return table.caption.removeprefix(TABLE_III)


def _write_word(path: Path, title: str, paragraph: str, tables: Sequence[Table]) -> None:
    """Write a document whose bytes depend on its content alone; tables are on pages turned."""
    from docx import Document  # here: it takes long to load
    from docx.enum.section import WD_ORIENT
    from docx.shared import Mm, Pt

    document = Document()
    document.core_properties.author = document.core_properties.comments = ""
    document.add_heading(title)
    document.add_paragraph(paragraph)
    document.add_section()
    a4_mm = (210, 297)
    for section, size in zip(document.sections, (a4_mm, a4_mm[::-1]), strict=True):
        section.page_width, section.page_height = map(Mm, size)
        section.left_margin = section.right_margin = Mm(20)
    section.orientation = WD_ORIENT.LANDSCAPE
    for number, table in enumerate(tables, 1):
        document.add_paragraph(f"Table {number}. {_caption(table)}", style="Caption")
        grid = document.add_table(0, len(table.heads), style="Light Shading")
        for texts in (table.heads, *table.rows):
            for cell, text in zip(grid.add_row().cells, texts, strict=True):
                cell.width = Mm((a4_mm[1] - 40) / len(table.heads))
                cell.paragraphs[0].add_run(text).font.size = Pt(8)
                cell.paragraphs[0].paragraph_format.space_after = Pt(0)
        document.add_paragraph(table.legend)
    with whole_file(path) as temporary:
        document.save(str(temporary))
        with ZipFile(temporary) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        with ZipFile(temporary, "w") as archive:
            for name, content in members.items():  # without the time of day
                archive.writestr(ZipInfo(name), content)
