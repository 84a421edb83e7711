"""How much commands print: --quiet, --verbose, and --json, one object for scripts."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import wraps
from inspect import Parameter, signature
from math import isfinite
from pathlib import Path
from typing import Any, Final

from typer import Option

from hbm.notes import Note
from pipeline.cli.stopping import stoppable

PRINTING: Final = {
    "quiet": "Print only errors.",
    "verbose": "Print also how results were made.",
    "json": "Print one object: numbers, warnings, or the error.",
}
"""Options of commands, the last of those that can -> what they do."""
AGAIN: Final = "no file is half-written; the same command begins again"
"""What a command says that is stopped, where it does not know how much is done."""


@dataclass(slots=True)
class Output:
    """What the command that runs may print.

    Attributes
    ----------
    quiet, verbose, json
        As typed.
    result
        Of --json: the object, which is printed when the command ends.
    """

    quiet: bool = False
    verbose: bool = False
    json: bool = False
    result: dict[str, Any] = field(default_factory=dict)

    def reset(self, *, json: bool = False) -> None:
        """Begin or end a command."""
        self.quiet = self.verbose = False
        self.json, self.result = json, {}


OUTPUT: Final = Output()


def printing(command: Callable[..., Any], *, with_json: bool) -> Callable[..., Any]:
    """Give a command the options --quiet and --verbose, and --json where it can."""
    names = [name for name in PRINTING if name != "json" or with_json]
    added = []
    for name in names:
        option = Option(False, f"--{name}", help=PRINTING[name], rich_help_panel="Output")
        added.append(Parameter(name, Parameter.KEYWORD_ONLY, default=option, annotation=bool))

    @wraps(command)
    def typed(**values: Any) -> Any:
        chosen = {name: values.pop(name) for name in names}
        if sum(chosen.values()) > 1:
            raise ValueError(f"{' and '.join(f'--{n}' for n, v in chosen.items() if v)}: give one")
        for name, value in chosen.items():
            setattr(OUTPUT, name, value)
        with stoppable(lambda: AGAIN):
            return command(**values)

    of_command = [
        p.replace(kind=Parameter.KEYWORD_ONLY) for p in signature(command).parameters.values()
    ]
    typed.__annotations__ = {p.name: p.annotation for p in (*of_command, *added)}
    vars(typed)["__signature__"] = signature(command).replace(parameters=[*of_command, *added])
    return typed


AGAIN_ADVICE: Final = "run the same command again"
ADVICE: Final = {
    "usage": "read the command's --help",
    "input": f"correct what the text names, then {AGAIN_ADVICE}",
    "program": "report it, with what --debug shows",
}
"""Kind of an error -> what to do, where it is not to run it again."""


def print_object() -> None:
    """Print the result of the command as one JSON object, in ASCII, if --json asks for it."""
    if OUTPUT.json and OUTPUT.result:
        print(json.dumps(_finite(OUTPUT.result), allow_nan=False))


def _finite(value: Any) -> Any:
    """Give null for numbers that JSON does not have."""
    if hasattr(value, "_asdict"):  # a row with names
        value = value._asdict()
    if isinstance(value, dict):
        return {name: _finite(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [*map(_finite, value)]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    return None if isinstance(value, float) and not isfinite(value) else value


def tables_in(folder: Path) -> dict[str, Any]:
    """Give the CSV tables of a folder for JSON, by their names, if --json asks for them."""
    if not OUTPUT.json:
        return {}
    from pipeline.io.write import read_csv

    return {path.stem: read_csv(path).to_dict("records") for path in sorted(folder.glob("*.csv"))}


def plain_notes(notes: Iterable[Note]) -> list[dict[str, Any]]:
    """Give notes for JSON: code, level, item, text, advice; infinite values are in the text."""
    return [{n: v for n, v in note.to_dict().items() if n != "values"} for note in notes]
