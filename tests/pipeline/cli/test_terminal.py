"""What is printed: printable text, tables of any width, the progress of long work."""

from io import StringIO

import pytest
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hbm.notes import Note
from pipeline.cli.terminal import PlainConsole, StepProgress, note_line, print_table

HOSTILE = "a\x1b]0;title\x07b\x1b[31mc\x9b2Jd\u202ee\udcfff\rg\x00h"
MARKUP = "[red]x[/red] [/] [bold [link=x]"


@pytest.fixture
def clock():
    return [0.0]


def console(clock, *, terminal):
    return Console(
        file=StringIO(), force_terminal=terminal, width=80, get_time=lambda: clock[0], markup=False
    )


def test_without_a_terminal_each_step_is_a_line_with_the_time_left(clock):
    screen = console(clock, terminal=False)
    with StepProgress(screen, "simulating", "recordings") as progress:
        for done in (1, 2, 3):
            clock[0] += 60.0
            progress.show(f"sub0{done}.c3d", done, 3)
    assert screen.file.getvalue().splitlines() == [
        "sub01.c3d; 1 of 3 recordings, 0:02:00 left",
        "sub02.c3d; 2 of 3 recordings, 0:01:00 left",
        "sub03.c3d; 3 of 3 recordings",
    ]


def test_in_a_terminal_a_bar_shows_the_count_and_only_failures_stay(clock):
    screen = console(clock, terminal=True)
    with StepProgress(screen, "simulating", "recordings") as progress:
        clock[0] = 60.0
        progress.show("sub01.c3d", 1, 3)
        progress.show("FAILED sub02.c3d", 2, 3, always=True)
    assert "simulating: 2 of 3 recordings" in screen.file.getvalue()
    assert "0:00:30" in screen.file.getvalue()
    assert "sub01.c3d" not in screen.file.getvalue()
    assert "FAILED sub02.c3d" in screen.file.getvalue()


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
        lambda screen: screen.print(HOSTILE, soft_wrap=True),
        lambda screen: screen.print(Text(HOSTILE)),
        lambda screen: screen.print(note_line(Note.of("platform_pose", source=HOSTILE))),
        lambda screen: print_table(table(*[HOSTILE] * 5), screen),
        lambda screen: screen.print(Table(HOSTILE)),
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


@pytest.mark.parametrize("columns", ["0", "1", "20", "40", "50"])
def test_in_a_narrow_terminal_a_table_is_a_line_for_each_row_and_loses_no_number(
    monkeypatch, columns
):
    made = table(*ROW)
    text = printed(monkeypatch, lambda screen: print_table(made, screen), COLUMNS=columns)
    assert "…" not in text
    one_line = " ".join(text.split())
    assert "measured Fx: RMS N 1234567.8 ± 1234.5 N·m, peak -87654.3" in one_line
    assert max(map(len, text.splitlines())) <= max(40, int(columns))


def test_in_a_wide_terminal_a_table_is_a_table(monkeypatch):
    made = table(*ROW)
    text = printed(monkeypatch, lambda screen: print_table(made, screen), COLUMNS="80")
    assert any(all(cell in line for cell in ROW) for line in text.splitlines())
