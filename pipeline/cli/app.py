"""The command line, ``hbm``: arguments in, messages out, no science.

A command is imported when it is called or its own help is asked for, so that ``hbm --help`` answers
at once; what it needs to run is imported when it runs.
"""

import atexit
import gc
import io
import os
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.metadata import version
from inspect import getdoc
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from hbm.spelling import both_ends, did_you_mean, listed, printable, short
from pipeline.cli.output import ADVICE, AGAIN, AGAIN_ADVICE, OUTPUT, print_object, printing
from pipeline.cli.stopping import Stopped, stoppable
from pipeline.io.input_file import RENAME, UNUSABLE, describe_error, expected

GROUP: Final = "calibration"
COMMANDS: Final = {
    "residuals": ("trial", "Process one trial: residuals as tables and figure."),
    "export": ("trial", "Write models for OpenSim or as URDF, tables, BIDS or C3D."),
    "demo": ("study", "Simulate a study and run experiment 3 on it."),
    "init": ("study", "Write a commented study.toml and a subject file."),
    "check": ("study", "List all problems of a study before anything is computed."),
    "run": ("study", "Process a study; finished trials are skipped."),
    "explain": ("trial", "Find the causes of residuals, and what to fix first."),
    "report": ("study", "Write tables, statistics, figures and report.html."),
    "view": ("study", "Open a trial in the Rerun viewer."),
    "plates": ("treadmill", "Check force plates against known weights (experiment 1)."),
    "simulate": ("study", "Simulate experiment 3: recordings, true values."),
    "live": ("live", "Compute residuals while the subject walks."),
    "doctor": ("doctor", "Print versions and the engine, and how kernels run here."),
    GROUP: ("", "Calibrate a moving treadmill, rank calibrations (experiment 2)."),
}
CALIBRATION: Final = {
    "fit": ("treadmill", "Fit a calibration to a recording of the empty treadmill."),
    "check": ("treadmill", "Check a calibration with a recording of another day."),
    "signals": ("treadmill", "Write calibration and validation signals."),
    "checklist": ("treadmill", "Mark which recordings of a laboratory are done."),
    "rank": ("treadmill", "Rank calibration trials by what remains of validation trials."),
}
"""Command -> its module, and what it does; its docstring says what else there is to know."""


class GroupedCommand(TyperCommand):
    """A command whose help lists options by what they are about."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """List the arguments, then each group of options."""
        groups: dict[str, list[tuple[str, str]]] = {"Arguments": []}
        for param in self.get_params(ctx):
            if record := param.get_help_record(ctx):
                panel = getattr(param, "rich_help_panel", None) or "Options"
                argument = param.param_type_name == "argument"
                groups.setdefault("Arguments" if argument else panel, []).append(record)
        for panel, records in groups.items():
            if records:
                with formatter.section(panel):
                    formatter.write_dl(records)


class Group(TyperGroup):
    """All commands; each is imported when it is asked for, none for the help of the group."""

    listed: Mapping[str, tuple[str, str]] = COMMANDS

    def list_commands(self, ctx: Any) -> list[str]:
        """Give the names of the commands."""
        return list(self.listed)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command; one that does not exist ends with the nearest one."""
        if cmd_name not in self.listed:
            ctx.fail(f"no command {short(cmd_name)!r}{did_you_mean(cmd_name, self.listed)}")
        module, sentence = self.listed[cmd_name]
        if not module:
            group = Group(name=cmd_name, help=sentence, rich_markup_mode=None)
            group.listed = CALIBRATION
            return group
        one = typer.Typer(add_completion=False, rich_markup_mode=None)
        command = getattr(import_module(f"pipeline.cli.{module}"), cmd_name)
        with_json = cmd_name in ("residuals", "check", "run", "explain", "plates", "fit", "rank")
        printed = printing(command, with_json=with_json)
        text = f"{sentence}\n\n{getdoc(command)}"
        one.command(cmd_name, cls=GroupedCommand, help=text)(printed)
        return typer.main.get_command(one)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands with a sentence on each."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, sentence) for name, (_, sentence) in self.listed.items()])


app = typer.Typer(cls=Group, pretty_exceptions_enable=False, rich_markup_mode=None)


def _version(asked: bool) -> None:
    """Print the version, and nothing else."""
    if asked:
        print(f"hbm-residuals {version('hbm-residuals')}")
        raise typer.Exit


@app.callback()
def common(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_version, help="Print the version.")
    ] = False,
) -> None:
    """Pelvis residuals of a full-body gait model on instrumented treadmills that move.

    'hbm FILE' says what a file or folder is and what can be done with it; 'hbm
    FILE --header' prints the head of a file without names of people.
    """
    del debug, version  # taken from the arguments by main, printed by the callback


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
    # to look for garbage among all that is imported takes a tenth of a short command
    gc.set_threshold(50_000)
    atexit.register(gc.freeze)
    typed_words = list(sys.argv[1:] if arguments is None else arguments)
    typed = [argument for argument in typed_words if argument != "--debug"]
    if typed in ([], [GROUP]):
        typed.append("--help")
    OUTPUT.reset(json="--json" in typed)
    try:
        code = _run(typed, debug="--debug" in typed_words)
        print_object()
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        # nothing more is written, because nobody reads it: else Python complains when it ends
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
        return 141  # as in a shell: ended by the signal of a pipe that nobody reads (128 + 13)
    except OSError as error:
        if "--debug" in typed_words:
            raise
        return _fail(error, typed)  # the output cannot be written
    finally:
        OUTPUT.reset()
    return code


def _run(typed: list[str], *, debug: bool) -> int:
    """Run what was typed, and say what ends it; give the exit code."""
    try:
        with stoppable(lambda: AGAIN):
            for argument in filter(UNUSABLE.search, typed):
                raise ValueError(f"{argument}: {RENAME}")
            full = _with_command(typed)
            if full is None:
                return 0
            code = int(app(args=full, prog_name="hbm", standalone_mode=False) or 0)
            if code == 130:  # interrupted before the command began
                raise KeyboardInterrupt
            return code
    except Exception as error:
        if isinstance(error, BrokenPipeError) or (debug and not isinstance(error, Stopped)):
            raise
        return _fail(error, typed)


def _fail(error: Exception, typed: Sequence[str]) -> int:
    """Say what ends the command, put it into the object of --json, and give the exit code."""
    if isinstance(error, Stopped):
        lines, code = [str(error)], error.code
    else:
        lines = [*getattr(error, "faults", [one_line(error)])]
        code = "input" if expected(error) else "program"
        code = "usage" if isinstance(error, TyperException) else code
    for line in lines:
        print_error(line if isinstance(error, Stopped) else f"error: {line}")
    named = lines[0].partition(": ")[0]
    paths = (Path(word) for word in typed if not word.startswith("-"))
    named_paths = (path for path in paths if named in (str(path), path.name))
    file = next(named_paths, None) or getattr(error, "filename", None)
    OUTPUT.result["error"] = {
        "code": code,
        "text": "; ".join(lines),
        "file": str(file) if file else None,
        "advice": ADVICE.get(code, AGAIN_ADVICE),
    }
    if hasattr(error, "faults"):
        OUTPUT.result["faults"] = lines
    return error.exit_code if isinstance(error, Stopped) else 2  # wrong usage or input


def _with_command(typed: list[str]) -> list[str] | None:
    """Put a command before a file that is given alone: residuals of a trial.

    What else a file or folder is, is printed, with what can be done with it; None is returned.
    """
    if typed[0] in COMMANDS or typed[0].startswith("-"):
        return typed
    path = Path(typed[0])
    if not os.path.lexists(path):
        if path.name == typed[0] and not path.suffix:
            return typed
        near = did_you_mean(path.name, [file.name for file in path.parent.glob("*")])
        raise ValueError(f"{path}: no such file{near}")
    if "--header" in typed:
        from pipeline.io.header import describe_header

        print("\n".join(map(printable, describe_header(path))))
        return None
    from pipeline.cli.recognise import recognise

    recognised = recognise(path)
    others = [word for word in typed[1:] if word.startswith("-")]
    if (without := {*others} - {"--json", "--quiet"}) and not recognised.walking:
        raise ValueError(f"{listed(sorted(without))} has no effect: {typed[0]} is {recognised}")
    if not OUTPUT.json and "--quiet" not in typed:
        print(f"{typed[0]}: {recognised.what}")
    if recognised.walking:
        return ["residuals", *typed]
    if OUTPUT.json:
        OUTPUT.result.update(file=typed[0], what=recognised.what, commands=recognised.commands)
    else:
        print("\n".join(f"  {command}" for command in recognised.commands))
    return None


def one_line(error: BaseException) -> str:
    """Put an error into one line, with the notes that were added on its way up."""
    if not isinstance(error, TyperException):
        return describe_error(error)
    context: typer.Context | None = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "hbm"
    return f"{' '.join(error.format_message().split()).rstrip('.')}; see '{command} --help'"


def accept_any_letter() -> None:
    """Write a question mark for a letter that the encoding of the output lacks, such as ASCII."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # None where it is closed
            stream.reconfigure(errors="replace")


def print_error(line: str) -> None:
    """Print one line to standard error, as far as that exists."""
    # some lines of a terminal: names and texts out of files may have any length
    shown = both_ends(printable(" ".join(line.split())), 690)
    if sys.stderr is not None:
        print(f"hbm: {shown}", file=sys.stderr)
