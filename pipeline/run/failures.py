"""Why trials failed, kept beside the results: one file per trial, gathered into failures.json.

One file per trial, for several runs may work on one folder at once, each on its own trials.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from pipeline.io.write import whole_file

FAILURES: Final = "failures.json"


def note_failure(target: Path, name: str, reason: str | None) -> None:
    """Keep the reason why a trial failed, or forget it.

    Parameters
    ----------
    target
        Where the trial's result goes.
    name
        The trial, as "subject condition".
    reason
        Why it failed; None if it did not.

    Raises
    ------
    OSError
        If the folder cannot be written to.
    """
    path = target.with_suffix(".failed.json")
    if reason is None:
        path.unlink(missing_ok=True)
        return
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps({name: reason}, ensure_ascii=False), encoding="utf-8")


def gather_failures(out: Path, known: Iterable[str]) -> dict[str, str]:
    """Write ``failures.json`` from what was kept.

    Parameters
    ----------
    out
        Results folder.
    known
        Trials that the study has, as "subject condition"; what was kept of others is forgotten.

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
    for path in sorted((out / "trials").glob("*.failed.json")):
        try:
            kept = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if wanted.isdisjoint(kept):
            path.unlink(missing_ok=True)
        else:
            failures |= kept
    with whole_file(out / FAILURES) as temporary:
        text = json.dumps(failures, indent=1, ensure_ascii=False)
        temporary.write_text(text, encoding="utf-8")
    return failures
