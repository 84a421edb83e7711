"""Options that commands share, and those that a request for one trial is made of."""

import os
import shlex
from collections.abc import Callable, Iterator
from functools import wraps
from inspect import Parameter, signature
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Final, get_args, get_origin

import typer

from pipeline.cli.request import NO_OPTIONS, TrialRequest
from pipeline.config.input_model import InputModel, bounds_of
from pipeline.config.schema import Settings, Subject
from pipeline.config.toml_file import check_options

Command = Callable[..., int | None]
RESULT = ".parquet"
"""Suffix of the file of a processed trial."""
ALIASES: Final = {"inertia_model": ("--model",)}
"""Further names of options."""

Out = Annotated[
    Path, typer.Option("--out", help="Folder for the output.", rich_help_panel="Output")
]
Jobs = Annotated[
    int | None, typer.Option(min=1, help="Processes; default: one per 5 trials, up to all cores.")
]
Seed = Annotated[int, typer.Option(min=0, help="Equal seeds give equal signals and results.")]
Simulate = Annotated[bool, typer.Option("--simulate", help="Simulate the recordings first.")]


PlateCorrectionFile = Annotated[Path | None, typer.Option(help="Calibration by hbm plates.")]
StudyFolder = Annotated[Path, typer.Argument(help="Folder with study.toml and subject files.")]
ResultsFolder = Annotated[Path, typer.Argument(help="Folder of hbm run; view: or one result.")]


def takes(kind: type[InputModel]) -> Callable[[Command], Command]:
    """Give a command, which takes a request of some kind first, its options."""

    def decorated(command: Command) -> Command:
        _, *others = signature(command).parameters.values()
        options = [name for name in kind.model_fields if name not in NO_OPTIONS]
        parameters = [_parameter(kind, name) for name in options]
        parameters += [other.replace(kind=Parameter.KEYWORD_ONLY) for other in others]

        @wraps(command)
        def typed(**values: Any) -> int | None:
            typed_in = {name: values.pop(name) for name in options}
            given = {n: tuple(v) if isinstance(v, list) else v for n, v in typed_in.items()}
            given = {name: value for name, value in given.items() if value not in (None, ())}
            return command(check_options(kind, given), **values)

        typed.__annotations__ = {p.name: p.annotation for p in parameters}
        vars(typed)["__signature__"] = signature(command).replace(parameters=parameters)
        return typed

    return decorated


def _parameter(kind: type[InputModel], name: str) -> Parameter:
    """Give a field of a request for typer: an argument if it is required, else an option."""
    field, bounds, default = kind.model_fields[name], bounds_of(kind, name), None
    text = " ".join((field.description or "").split())
    shown, annotation = f"{text} [{bounds}]" if bounds else text, _type_of(field.annotation)
    if field.is_required():
        option = typer.Argument(help=shown)
    else:
        if isinstance(field.default, str | float | int | Path):
            default = field.default
        names = f"--{name.replace('_', '-')}", *ALIASES.get(name, ())
        option = typer.Option(default, *names, help=shown, rich_help_panel=_panel(name))
        annotation = annotation | None if default is None else annotation
    return Parameter(name, Parameter.KEYWORD_ONLY, default=option, annotation=annotation)


def _type_of(annotation: Any) -> Any:
    """Find what is typed for a field: of several values, or pairs, an option that is repeated."""
    if get_origin(annotation) in (tuple, dict):
        return list[_type_of(get_args(annotation)[0])]  # type: ignore[misc]
    if annotation in (bool, int, float, Path):
        return annotation
    return next((kind for a in get_args(annotation) if (kind := _type_of(a)) is not str), str)


def _panel(name: str) -> str:
    """Say what an option is about, for the help."""
    if name in {"segments", *Subject.model_fields}:
        return "Subject"
    if name in {"calibration", "plate_calibration", "platform_markers", "accelerometer"}:
        return "Treadmill"
    if name in {"span", *Settings.model_fields}:
        return "Processing"
    return "Recording" if name in TrialRequest.model_fields else "Options"


def given_options(request: TrialRequest) -> Iterator[tuple[str, str]]:
    """Give the options of a request that differ from the defaults, with their values as typed."""
    defaults = TrialRequest.model_construct()
    typed = request.model_fields_set & TrialRequest.model_fields.keys() - {"trial"}
    for name, value in request:
        if name in typed and value != getattr(defaults, name):
            values = [f"{k}={v}" for k, v in value.items()] if isinstance(value, dict) else value
            for part in values if isinstance(values, list | tuple) else [values]:
                yield f"--{name.replace('_', '-')}", str(part)


def explain_command(request: TrialRequest, out: Path) -> str:
    """Give the command that explains a trial processed as requested, into the same folder."""
    options = chain.from_iterable(given_options(request))
    return shlex.join(["hbm", "explain", str(request.trial), *options, "--out", str(out)])


def require_no_options(request: TrialRequest, what: str) -> None:
    """Refuse options of a trial where they can have no effect."""
    names = list(dict(given_options(request)))
    if names:
        raise ValueError(
            f"{request.trial.name} is {what}; leave out {', '.join(names)}, or give the recording "
            "instead"
        )


def require_folder(out: Path) -> None:
    """Refuse a folder that cannot be written to before minutes are spent on what goes into it."""
    nearest = next(path for path in (out, *out.absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise ValueError(f"--out {out}: {nearest} is a file, not a folder")
    if not os.access(nearest, os.W_OK):
        raise ValueError(f"--out {out}: no permission to write into {nearest}")
