"""Options that commands share, and those that a request for one trial is made of."""

import os
import shlex
from collections.abc import Callable, Iterator
from functools import wraps
from inspect import Parameter, signature
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, get_origin

import typer
from pydantic.fields import FieldInfo

from pipeline.cli.request import NO_OPTIONS, TrialRequest
from pipeline.config.input_model import InputModel, bounds_of
from pipeline.config.schema import Settings, Subject
from pipeline.config.toml_file import check_options

Command = Callable[..., int | None]
RESULT = ".parquet"
"""Suffix of the file of a processed trial."""

Out = Annotated[
    Path, typer.Option("--out", help="Folder for the output.", rich_help_panel="Output")
]
Jobs = Annotated[int, typer.Option(min=1, help="How many trials at a time.")]
Seed = Annotated[int, typer.Option(min=0, help="Equal seeds give equal signals and results.")]
Simulate = Annotated[bool, typer.Option("--simulate", help="Simulate the recordings first.")]


def _help(kind: type[InputModel], name: str) -> str:
    """Give the description of a setting, and the numbers that it may have."""
    text = " ".join((kind.model_fields[name].description or "").split())
    bounds = bounds_of(kind, name)
    return f"{text} [{bounds}]" if bounds else text


def described(kind: type[InputModel], name: str, *names: str) -> Any:
    """Give the option of a setting, with its description."""
    return typer.Option(*names, help=_help(kind, name))


PlateCorrectionFile = Annotated[Path | None, typer.Option(help="Calibration by hbm plates.")]
StudyFolder = Annotated[Path, typer.Argument(help="Folder with study.toml and subject files.")]
ResultsFolder = Annotated[Path, typer.Argument(help="Folder of hbm run; view: or one result.")]


def takes(kind: type[InputModel]) -> Callable[[Command], Command]:
    """Give a command, which takes a request of some kind first, its options."""

    def decorated(command: Command) -> Command:
        _, *own = signature(command).parameters.values()
        options = {n: f for n, f in kind.model_fields.items() if n not in NO_OPTIONS}
        parameters = [_parameter(kind, name, field) for name, field in options.items()]
        parameters += [each.replace(kind=Parameter.KEYWORD_ONLY) for each in own]

        @wraps(command)
        def typed(**values: Any) -> int | None:
            typed_in = {name: values.pop(name) for name in options}
            stated = {n: tuple(v) if isinstance(v, list) else v for n, v in typed_in.items()}
            stated = {name: value for name, value in stated.items() if value not in (None, ())}
            return command(check_options(kind, stated), **values)

        typed.__annotations__ = {p.name: p.annotation for p in parameters}
        vars(typed)["__signature__"] = signature(command).replace(parameters=parameters)
        return typed

    return decorated


def _parameter(kind_of_request: type[InputModel], name: str, field: FieldInfo) -> Parameter:
    """Give a field of a request for typer: an argument if it is required, else an option."""
    help_text, annotation = _help(kind_of_request, name), str(field.annotation)
    kind: Any = Path if "Path" in annotation else float if "float" in annotation else str
    if get_origin(field.annotation) in (tuple, dict):
        kind = list[str]  # an option that may be repeated
    if field.is_required():
        default = typer.Argument(help=help_text)
    else:
        value = field.default if isinstance(field.default, str | float) else None
        default = typer.Option(value, help=help_text, rich_help_panel=_panel(name))
        kind = kind | None if value is None else kind
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def _panel(name: str) -> str:
    """Say what an option is about, for the help."""
    if name in {"segments", *Subject.model_fields}:
        return "Subject"
    if name in {"calibration", "plate_calibration", "platform_markers", "accelerometer"}:
        return "Treadmill"
    return "Processing" if name in {"span", *Settings.model_fields} else "Recording"


def given_options(request: TrialRequest) -> Iterator[tuple[str, str]]:
    """Give the options of a request that differ from the defaults, with their values as typed."""
    defaults = TrialRequest.model_construct()
    for name, value in request:
        if name in request.model_fields_set - {"trial"} and value != getattr(defaults, name):
            values = [f"{k}={v}" for k, v in value.items()] if isinstance(value, dict) else value
            for each in values if isinstance(values, list | tuple) else [values]:
                yield f"--{name.replace('_', '-')}", str(each)


def explain_command(request: TrialRequest) -> str:
    """Give the command that explains a trial processed as requested."""
    options = chain.from_iterable(given_options(request))
    return shlex.join(["hbm", "explain", str(request.trial), *options])


def require_no_options(request: TrialRequest, what: str) -> None:
    """Refuse options of a trial where they can have no effect."""
    given = list(dict(given_options(request)))
    if given:
        raise ValueError(
            f"{request.trial.name} is {what}; leave out {', '.join(given)}, or give the recording "
            "instead"
        )


def require_folder(out: Path, option: str = "--out") -> None:
    """Refuse a folder that cannot be written to before minutes are spent on what goes into it."""
    nearest = next(path for path in (out, *out.absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise ValueError(f"{option} {out}: {nearest} is a file, not a folder")
    if not os.access(nearest, os.W_OK):
        raise ValueError(f"{option} {out}: no permission to write into {nearest}")
