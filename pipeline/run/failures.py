"""Why trials failed: one file per trial next to its result, collected into ``failures.json``.

One file per trial, since several runs may work on one results folder at the same time.
"""

import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from pipeline.io.write import write_text

FAILURES: Final = "failures.json"
SUFFIX: Final = ".failed.json"
_JSON: Final = TypeAdapter(dict[str, str])


def record_failure(target: Path, name: str, reason: str | None) -> None:
    """Store beside a result why the trial failed, or, without a reason, remove what is stored."""
    path = target.with_suffix(SUFFIX)
    if reason is None:
        path.unlink(missing_ok=True)
    else:
        write_text(json.dumps({name: reason}, ensure_ascii=False), path)


def collect_failures(out: Path, known: Iterable[str]) -> dict[str, str]:
    """Write ``failures.json`` from what is stored next to the results: trial -> reason.

    Trials are "subject condition"; failures of those that the study does not have are removed.
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
    """Read ``failures.json``; empty where there is none, a ValueError says that it is damaged."""
    path = folder / FAILURES
    try:
        return _reasons(path)
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise ValueError(f"{path} is damaged; run 'hbm run' again") from error


def _reasons(path: Path) -> dict[str, str]:
    """Read reasons by trial; a ValueError where a file holds anything else."""
    return _JSON.validate_json(path.read_bytes())
