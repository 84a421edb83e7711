"""The command line, ``hbm``: arguments in, messages out, no science.

A command imports what it needs when it runs, so that ``--help`` answers at once.
"""

import sys
from collections.abc import Sequence
from typing import Annotated

import typer
from typer.exceptions import TyperException

from pipeline.cli import doctor, results, simulate, study, treadmill, trial
from pipeline.cli.options import USAGE

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


for command in (trial.residuals, trial.export, simulate.demo, study.init, study.check, study.run):
    app.command()(command)
for command in (results.report, results.view, treadmill.plates, simulate.simulate, doctor.doctor):
    app.command()(command)
for command in (treadmill.fit, treadmill.signals, treadmill.rank):
    calibration.command()(command)
app.add_typer(calibration, name="calibration")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; an error is one line, or a traceback with ``--debug``.

    Parameters
    ----------
    arguments
        What follows ``hbm``; by default what was typed.

    Returns
    -------
    int
        0 fine; 1 some trials failed, the rest is done; 2 wrong usage or input; 130 interrupted,
        143 terminated.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    typed = [argument for argument in given if argument != "--debug"]
    try:
        code = app(args=typed or ["--help"], prog_name="hbm", standalone_mode=False)
    except (TyperException, ValueError, OSError, KeyError) as error:
        if "--debug" in given:
            raise
        for line in getattr(error, "faults", None) or [one_line(error)]:
            typer.echo(f"hbm: error: {line}", err=True)
        return USAGE
    return int(code or 0)


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
    elif isinstance(error, KeyError):
        text = str(error.args[0])
    else:
        text = str(error)
    parts = [text, *getattr(error, "__notes__", [])]
    return "; ".join(" ".join(part.split()) for part in parts)
