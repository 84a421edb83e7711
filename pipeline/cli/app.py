"""The command line, ``hbm``: arguments in, messages out, no science.

A command imports what it needs when it runs, so that ``--help`` answers at once.
"""

import atexit
import gc
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final

import typer
from typer.exceptions import TyperException

from pipeline.cli import doctor, explain, export, live, simulate, study, treadmill, trial
from pipeline.cli.options import USAGE
from pipeline.cli.output import accept_any_letter, drop_output, print_error
from pipeline.cli.stopping import Stopped

INTERRUPTED: Final = 130
MAX_REASON: Final = 200
"""Characters of Python's own message about a fault."""
UNREAD: Final = 141
"""As in a shell: ended by the signal of a pipe that nobody reads (128 + 13)."""

app = typer.Typer(
    help="Pelvis residuals of a full-body gait model on instrumented treadmills that move.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
calibration = typer.Typer(rich_markup_mode=None)


@app.callback()
def common(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Take the options that every command has."""
    del debug  # taken from the arguments by main


@calibration.callback(invoke_without_command=True)
def show_help(context: typer.Context) -> None:
    """Calibrate a moving treadmill: what its empty plates measure."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


for command in (
    *(trial.residuals, export.export, simulate.demo, study.init, study.check, study.run),
    *(explain.explain, study.report, study.view, treadmill.plates, simulate.simulate),
    *(live.live, doctor.doctor),
):
    app.command()(command)
for command in (treadmill.fit, treadmill.check, treadmill.signals, treadmill.rank):
    calibration.command()(command)
app.add_typer(calibration, name="calibration")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; an error is one line, or a traceback with ``--debug``.

    What no command expects is said to be a fault of this program. Where the output is a pipe that
    is no longer read, the command ends without a word.

    Parameters
    ----------
    arguments
        What follows ``hbm``; by default what was typed.

    Returns
    -------
    int
        0 fine; 1 some trials failed, the rest is done; 2 wrong usage or input, or a fault of this
        program; 130 interrupted; 141 the output is not read; 143 terminated.
    """
    accept_any_letter()
    atexit.register(gc.freeze)  # to look for garbage among all that is imported takes 0.3 s
    given = list(sys.argv[1:] if arguments is None else arguments)
    typed = [argument for argument in given if argument != "--debug"]
    try:
        code = int(app(args=typed or ["--help"], prog_name="hbm", standalone_mode=False) or 0)
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        drop_output()
        return UNREAD
    except Stopped as stopped:
        print_error(str(stopped))
        return stopped.exit_code
    except Exception as error:
        if "--debug" in given:
            raise
        for line in getattr(error, "faults", None) or [one_line(error)]:
            print_error(f"error: {line}")
        return USAGE
    if code == INTERRUPTED:
        print_error("interrupted")
    return code


def one_line(error: BaseException) -> str:
    """Put an error into one line, with the notes that were added on its way up."""
    if isinstance(error, TyperException):
        context: typer.Context | None = getattr(error, "ctx", None)
        command = context.command_path if context is not None else "hbm"
        text = f"{error.format_message().rstrip('.')}; see '{command} --help'"
    elif isinstance(error, FileExistsError | NotADirectoryError) and error.filename:
        text = f"{error.filename}: a file stands where a folder should be"
    elif isinstance(error, OSError) and error.strerror and error.filename:
        text = f"{error.filename}: {error.strerror.lower()}"
    elif isinstance(error, OSError) and error.strerror:
        text = error.strerror.lower()
    elif _is_sentence(error):
        text = str(error.args[0] if isinstance(error, KeyError) else error)
    else:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = (
            f"a fault of this program: {type(error).__name__}: {str(error)[:MAX_REASON]} "
            f"({Path(place.filename).name}, line {place.lineno}); please report it with what "
            "--debug shows"
        )
    parts = [text, *getattr(error, "__notes__", [])]
    return "; ".join(" ".join(part.split()) for part in parts)


def _is_sentence(error: BaseException) -> bool:
    """Whether an error was raised for people to read."""
    if isinstance(error, KeyError):
        return bool(error.args) and isinstance(error.args[0], str) and " " in error.args[0]
    return isinstance(error, ValueError | OSError) and bool(str(error))
