"""Options that commands share, and those that a request for one trial is made of."""

import os
from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

from pipeline.run.request import Help, TrialRequest

USAGE = 2
"""Exit code for wrong usage or input."""

RESULT = ".parquet"
"""Suffix of the file of a processed trial."""

Out = Annotated[Path, typer.Option("--out", help="Folder for the output.")]
Jobs = Annotated[int, typer.Option(min=1, help="How many trials at a time.")]
Seed = Annotated[int, typer.Option(min=0, help="Equal seeds give equal signals and results.")]
Simulate = Annotated[
    bool, typer.Option("--simulate", help="Fill the folder from the virtual laboratory first.")
]
Axes = Annotated[
    str | None,
    typer.Option(help="Where the file's x, y, z point, e.g. left,back,up; default: inferred."),
]
Units = Annotated[
    str | None, typer.Option(help="Unit of the markers, e.g. mm; default: the file's.")
]
PlateUnits = Annotated[
    str | None,
    typer.Option(help="Units of the plates' forces and moments, e.g. N,Nmm; default: the file's."),
]
Accelerometers = Annotated[
    list[str] | None,
    typer.Option(
        "--accelerometer",
        help="SENSOR=X,Y,Z: its channels, such as rear=ch14,ch15,ch16; repeatable; default: by "
        "name, such as Acc1.X.",
    ),
]
PlateCorrectionFile = Annotated[
    Path | None,
    typer.Option(help="Calibration of the plates (hbm plates), if trials are to name it."),
]
StudyFolder = Annotated[Path, typer.Argument(help="Folder with study.toml and subject files.")]
ResultsFolder = Annotated[Path, typer.Argument(help="Folder that hbm run wrote.")]


def takes_trial_request(command: Callable[..., int | None]) -> Callable[..., int | None]:
    """Give a command the options that a `TrialRequest` is made of.

    Parameters
    ----------
    command
        Takes a ``request`` first, then options of its own.

    Returns
    -------
    callable
        The same for typer: the fields of the request in its place, as argument and options.
    """
    _, *own = signature(command).parameters.values()
    parameters = [*_parameters(TrialRequest), *own]

    @wraps(command)
    def typed(**options: Any) -> int | None:
        typed_in = {f.name: options.pop(f.name) for f in fields(TrialRequest)}
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in typed_in.items()
        }
        return command(TrialRequest(**values), **options)

    typed.__annotations__ = {p.name: p.annotation for p in parameters}
    vars(typed)["__signature__"] = signature(command).replace(parameters=parameters)
    return typed


def _parameters(request: type[TrialRequest]) -> list[Parameter]:
    """Give a request's fields for typer: the trial as an argument, the others as options.

    A field of several values is an option that may be repeated, for which typer wants a list.
    """
    hints = get_type_hints(request, include_extras=True)
    parameters = []
    for field in fields(request):
        kind, option = get_args(hints[field.name])
        assert isinstance(option, Help)
        default = (
            typer.Argument(help=option.text)
            if field.default is MISSING
            else typer.Option(field.default, help=option.text, min=option.min, max=option.max)
        )
        if get_origin(kind) is tuple:
            kind = list[get_args(kind)[0]]  # type: ignore[misc]
        keyword = Parameter.POSITIONAL_OR_KEYWORD
        parameters.append(Parameter(field.name, keyword, default=default, annotation=kind))
    return parameters


def require_no_options(request: TrialRequest, what: str) -> None:
    """Refuse options of a trial where they can have no effect."""
    given = [
        f"--{field.name.replace('_', '-')}"
        for field in fields(request)
        if field.default is not MISSING and getattr(request, field.name) != field.default
    ]
    if given:
        raise ValueError(
            f"{request.trial.name} is {what}; leave out {', '.join(given)}, or give the recording "
            "instead"
        )


def require_folder(out: Path) -> None:
    """Refuse a folder that cannot be written to before minutes are spent on what goes into it."""
    nearest = next(path for path in (out, *out.absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise ValueError(f"--out {out}: {nearest} is a file, not a folder")
    if not os.access(nearest, os.W_OK):
        raise ValueError(f"--out {out}: no permission to write into {nearest}")
