"""Why trials failed: one file per trial next to its result, collected into ``failures.json``.

One file per trial, since several runs may work on one results folder at the same time.
"""

import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter, ValidationError

from pipeline.io.write import write_text

FAILURES: Final = "failures.json"
SUFFIX: Final = ".failed.json"
_JSON: Final = TypeAdapter(dict[str, str])


def record_failure(target: Path, name: str, reason: str | None) -> None:
    """Store why a trial failed, or remove what is stored.

    Parameters
    ----------
    target
        File of the trial's result.
    name
        The trial, as "subject condition".
    reason
        Why it failed; None if it did not.

    Raises
    ------
    OSError
        If the folder cannot be written to.
    """
    path = target.with_suffix(SUFFIX)
    if reason is None:
        path.unlink(missing_ok=True)
    else:
        write_text(json.dumps({name: reason}, ensure_ascii=False), path)


def collect_failures(out: Path, known: Iterable[str]) -> dict[str, str]:
    """Write ``failures.json`` from what is stored next to the results.

    Parameters
    ----------
    out
        Results folder.
    known
        Trials that the study has, as "subject condition"; failures of others are removed.

    Returns
    -------
    dict
        "subject condition" -> reason.

    Raises
    ------
    OSError
        If the folder cannot be written to.
    """
    wanted = set(known)
    failures: dict[str, str] = {}
    for path, stored in recorded_failures(out / "trials"):
        if wanted.isdisjoint(stored):
            path.unlink(missing_ok=True)
        else:
            failures |= stored
    write_text(json.dumps(failures, indent=1, ensure_ascii=False), out / FAILURES)
    return failures


def recorded_failures(folder: Path) -> Iterator[tuple[Path, dict[str, str]]]:
    """Give the files of `record_failure` in a folder and what they say; damaged ones left out."""
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        with suppress(OSError, ValueError):
            yield path, _reasons(path)


def read_failures(folder: Path) -> dict[str, str]:
    """Read ``failures.json``: "subject condition" -> reason; empty where there is no such file.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    path = folder / FAILURES
    try:
        return _reasons(path)
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}); run 'hbm run' again") from error


def _reasons(path: Path) -> dict[str, str]:
    """Read reasons by trial; a ValueError says why a file holds anything else."""
    try:
        return _JSON.validate_json(path.read_bytes())
    except ValidationError as error:
        raise ValueError(error.errors()[0]["msg"].lower()) from error
