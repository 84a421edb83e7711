"""The progress of long work: what it counts, and how long it says the rest takes."""

from io import StringIO

import pytest
from rich.console import Console

from pipeline.cli.terminal import StepProgress


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


def test_the_time_left_goes_by_the_size_of_the_steps(clock):
    screen = console(clock, terminal=False)
    with StepProgress(screen, "processing", "trials") as progress:
        clock[0] = 10.0
        progress.show("a long trial", 1, 3, size_done=80, size=100)
    assert screen.file.getvalue() == "a long trial; 1 of 3 trials, 0:00:03 left\n"


def test_steps_that_need_no_work_do_not_count_for_the_time_left(clock):
    screen = console(clock, terminal=False)
    with StepProgress(screen, "processing", "trials") as progress:
        progress.show("kept", 1, 3, size_done=0, size=200)
        clock[0] = 10.0
        progress.show("done", 2, 3, size_done=100, size=200)
    assert screen.file.getvalue().splitlines() == [
        "kept; 1 of 3 trials",
        "done; 2 of 3 trials, 0:00:10 left",
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
