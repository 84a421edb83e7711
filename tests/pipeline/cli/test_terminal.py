"""What is printed fits a terminal of any width, loses no number, and shows how far work is."""

import pytest
from rich.table import Table
from rich.text import Text

from hbm.notes import Note
from pipeline.cli.terminal import PlainConsole, StepProgress, note_line, print_table

HOSTILE = "a\x1b]0;title\x07b\x1b[31mc\x9b2Jd\u202ee\udcfff\rg\x00h"
MARKUP = "[red]x[/red] [/] [bold [link=x]"


def printed(monkeypatch, print_it, **environment):
    """What a terminal gets, its own control codes for styles left out."""
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    screen = PlainConsole()
    with screen.capture() as capture:
        print_it(screen)
    return capture.get()


def table(*cells):
    made = Table("name", "axis", title=cells[0], caption=cells[1])
    for name in ("RMS\nN", "", "peak"):
        made.add_column(name, justify="right")
    made.add_row(*cells)
    return made


@pytest.mark.parametrize(
    "print_it",
    [
        lambda screen: screen.print(HOSTILE),
        lambda screen: screen.print(Text(HOSTILE)),
        lambda screen: screen.print(note_line(Note.of("platform_pose", source=HOSTILE))),
        lambda screen: print_table(table(*[HOSTILE] * 5), screen),
    ],
)
@pytest.mark.parametrize("columns", ["40", "300"])
def test_what_would_command_a_terminal_is_printed_as_question_marks(monkeypatch, print_it, columns):
    text = printed(monkeypatch, print_it, COLUMNS=columns, NO_COLOR="1")
    assert "title" in text.replace("\n", "")
    assert all(line.isprintable() for line in text.split("\n")), repr(text)


@pytest.mark.parametrize(
    "print_it",
    [
        lambda screen: screen.print(MARKUP),
        lambda screen: print_table(table(*[MARKUP] * 5), screen),
        lambda screen: StepProgress(screen, MARKUP, MARKUP).show(MARKUP, 1, 2),
    ],
)
def test_brackets_neither_style_nor_fail(monkeypatch, print_it):
    assert MARKUP in printed(monkeypatch, print_it, COLUMNS="300")


ROW = ("measured", "Fx", "1234567.8 ± 1234.5", "N·m", "-87654.3")


@pytest.mark.parametrize("columns", ["0", "20", "50"])
def test_in_a_narrow_terminal_a_table_is_a_line_for_each_row_and_loses_no_number(
    monkeypatch, columns
):
    made = table(*ROW)
    text = printed(monkeypatch, lambda screen: print_table(made, screen), COLUMNS=columns)
    assert "…" not in text
    one_line = " ".join(text.split())
    assert all(number in one_line for number in ("1234567.8 ± 1234.5", "-87654.3"))
    assert max(map(len, text.splitlines())) <= max(40, int(columns))
