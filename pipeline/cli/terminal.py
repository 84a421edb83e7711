"""What commands print with: a console, tables, and the progress of long work."""

import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from hbm.notes import Note, provenance, warnings_of
from hbm.spelling import counted, listed, printable
from pipeline.cli.output import OUTPUT
from pipeline.cli.stopping import stoppable

if TYPE_CHECKING:
    from pipeline.report.blocks import Table as Block
    from pipeline.run.job import Outcome

MIN_COLUMNS: Final = 40
"""A narrower terminal, or one that says it has no columns, breaks the lines itself."""
ALWAYS: Final = (
    *("Axes", "Body mass", "Corrected", "Delay of plates", "Feet on plates", "Gait cycles"),
    *("Landmarks", "Plate calibration", "Platform pose", "Treadmill calibration"),
)
"""Items of provenance that change numbers; --verbose prints the others too."""
WIDE: Final = 10_000
"""Columns in which any table has room."""


class PlainConsole(Console):
    """A console that prints text as it is: brackets are no markup, escapes do not escape."""

    def __init__(self, **options: Any) -> None:
        silent = OUTPUT.quiet or OUTPUT.json
        super().__init__(highlight=False, markup=False, quiet=silent, **options)
        if self.width < MIN_COLUMNS:
            self.width = MIN_COLUMNS

    def say(self, *parts: RenderableType) -> None:
        """Print in one line, however long; the terminal wraps it."""
        self.print(*parts, soft_wrap=True)

    def say_notes(self, notes: Iterable[Note]) -> None:
        """Print warnings with advice, and provenance as a table: with --verbose all of it."""
        notes = tuple(notes)
        for note in warnings_of(notes):
            self.say(note_line(note))
        rows = [row for row in provenance(notes) if OUTPUT.verbose or row[0] in ALWAYS]
        width = max((len(item) for item, _ in rows), default=0)
        for item, sentence in rows:
            self.say(Text.assemble((f"{item:{width}}  ", "dim"), sentence))

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Lay out text, tables, progress: all that is printed comes by here."""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                lines = map(printable, segment.text.split("\n"))
                yield Segment("\n".join(lines), segment.style)

    def on_broken_pipe(self) -> None:
        """Say that nobody reads the output any more; the command ends."""
        raise BrokenPipeError


def print_table(table: Table, console: Console) -> None:
    """Print a table, or a line for each of its rows where the terminal is too narrow for it."""
    wide = console.options.update(max_width=WIDE)
    if console.measure(table, options=wide).maximum <= console.width:
        console.print(table)
        return
    console.print(table.title or "")
    headers = [str(column.header).replace("\n", " ") for column in table.columns]
    names = sum(column.justify == "left" for column in table.columns[:2])
    for row in zip(*(map(str, column.cells) for column in table.columns), strict=True):
        lines = (cell.replace("\n", " ") for cell in row)
        cells = [f"{header} {cell}" for header, cell in zip(headers, lines, strict=True)]
        text = ", ".join(cells[names:]).replace(",  ", " ")
        console.print(f"{' '.join(row[:names])}: {text}")
    console.print(table.caption or "")


def print_block(block: "Block", console: PlainConsole, *, narrow: bool = False) -> None:
    """Print a table of a page: rated cells with their symbols.

    A ``narrow`` one without the last columns, where the terminal has no room for them.
    """
    numbers = block.css_class == "numbers"
    names = 2 if numbers else len(block.heads)
    symbols = {"pass": "✔ ", "check": "▲ ", "fail": "✖ "}  # as on the page
    table = Table(title=block.caption)
    for k, head in enumerate(block.heads):
        table.add_column(head, justify="left" if k < names else "right")
    for row in block.rows:
        cells = []
        for cell in row:
            rated = [("", cell, "")] if isinstance(cell, str) else cell
            texts = (
                f"{symbols.get(rating, '')}{value}{f', {detail}' if detail else ''}"
                for rating, value, detail in rated
            )
            cells.append("; ".join(texts))
        table.add_row(*cells)
    wide = console.options.update(max_width=WIDE)
    while narrow and numbers and len(table.columns) > names + 1:
        if console.measure(table, options=wide).maximum <= console.width:
            break
        del table.columns[-1]
        table.caption = f"On the page: {', '.join(block.heads[len(table.columns) :])}"
    if numbers:
        print_table(table, console)
    else:
        console.print(table)
    if block.legend:
        console.print(block.legend)


def announcer(console: Console) -> Callable[[str], None]:
    """Give a function that prints a sentence when something takes long."""
    return lambda sentence: console.print(sentence, style="dim")


def note_line(note: Note) -> Text:
    """Lay out a warning with its code and advice, else item and sentence."""
    if note.item:
        return Text(f"- {note.item}: {note}")
    code = (f" [{note.code}]", "dim")
    return Text.assemble((f"- warning: {note}", "bold"), code, f"\n  {note.advice}")


class StepProgress(Progress):
    """Progress of long work: a bar with the time left in a terminal, a line per step elsewhere."""

    def __init__(self, console: Console, work: str, unit: str) -> None:
        super().__init__(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_interactive,
            speed_estimate_period=math.inf,  # steps may take minutes: all of them are used
        )
        self.work, self.unit = work, unit
        self.task = self.add_task(work, total=None)
        self.advance(self.task, 0)  # the time left is estimated from here on

    def show(self, line: str, done: int, steps: int, *, failed: bool = False) -> None:
        """Say that a step is done; one that failed in a terminal too, and with --quiet."""
        if failed and OUTPUT.quiet:
            print(f"hbm: {line}", file=sys.stderr)
        task, count = self.tasks[0], f"{done} of {steps} {self.unit}"
        task.total = steps  # to update it would begin the estimate of the time left anew
        self.update(self.task, completed=done, description=f"{self.work}: {count}")
        if self.console.is_interactive:
            if failed:
                self.console.print(line, soft_wrap=True)
        else:
            left = TimeRemainingColumn().render(task)
            time_left = f", {left} left" if task.time_remaining else ""
            self.console.print(f"{line}; {count}{time_left}", soft_wrap=True)


def follow_trials(
    outcomes: Iterable["Outcome"], total: int, work: str, done: str, console: Console
) -> list["Outcome"]:
    """Show what becomes of trials as they finish; where that is stopped, say how to go on.

    Kept trials have no line, and a reason of failure has one however many trials have it.
    """
    finished: list[Outcome] = []
    kept = 0
    alike: dict[str, list[str]] = {}

    def so_far() -> str:
        count = sum(outcome.failure is None for outcome in finished)
        return f"{done} are {count} of {counted(total, 'trial')}; the same command goes on"

    with stoppable(so_far), StepProgress(console, work, "trials") as progress:
        for outcome in outcomes:
            finished.append(outcome)
            kept += outcome.state == "kept"
            failed = outcome.failure is not None or bool(outcome.failed_variants)
            if outcome.failure in alike:
                alike[outcome.failure].append(str(outcome.job.name))
            elif outcome.state != "kept" or failed:
                progress.show(str(outcome), len(finished) - kept, total - kept, failed=failed)
            if outcome.failure is not None:
                alike.setdefault(outcome.failure, [])
    for reason, names in alike.items():
        if names:
            console.print(f"FAILED {listed(sorted(names))}: {reason}", soft_wrap=True)
    return finished


def counts_of(outcomes: Iterable["Outcome"], done: str) -> str:
    """Count what became of trials."""
    states = Counter(outcome.state for outcome in outcomes)
    return (
        f"{counted(states['done'], 'trial')} {done}, {states['kept']} were there already, "
        f"{states['failed']} failed"
    )


def outcome_record(outcome: "Outcome") -> dict[str, object]:
    """Give what became of a trial, for scripts."""
    failed = dict(outcome.failed_variants)
    what = {"trial": str(outcome.job.name), "state": outcome.state, "failure": outcome.failure}
    return what | ({"failed_variants": failed} if failed else {})
