"""A study with what its explanation found corrected: settings with their source, no recordings."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from hbm.spelling import Table
from pipeline.budgets.explanation import StudyExplanation
from pipeline.budgets.words import LATE, LIMITS, MASS, size_in_words
from pipeline.config.schema import Correction, TrialName, recording_tables
from pipeline.config.study import Study
from pipeline.config.toml_file import read_table
from pipeline.explain.budget import SharedCause, alike_in_plates
from pipeline.explain.joint import MENDABLE
from pipeline.io.write import write_text
from pipeline.trial.residuals import AXES


def write_corrected(
    study: Study,
    explanation: StudyExplanation,
    mass_kg: Mapping[str, float],
    results: Path,
    out: Path,
) -> tuple[list[Correction], list[str]]:
    """Write a study whose settings carry the corrections that are certain.

    Parameters
    ----------
    study
        The study that was explained.
    explanation
        Its explanation.
    mass_kg
        Subject -> body mass that the results are of [kg].
    results
        Folder of its results.
    out
        Folder for the corrected study; its files name the recordings where they are.

    Returns
    -------
    written
        The corrections: of the delay, of zeros, gains and places of plates, and of masses, each of
        which lowers residuals in which its size was not found.
    left_out
        Other causes that are certain, and why they are not corrected: they do not, they lower no
        residual by 3 %, or all plates have them, as an error of the body model would look.

    Raises
    ------
    ValueError
        If ``out`` holds a study already.
    OSError
        If it cannot be written to.
    """
    if (out / "study.toml").exists():
        raise ValueError(f"{out}: there is a study already; name another folder with --apply")
    tables = {path.name: read_table(path) for path in sorted(study.folder.glob("*.toml"))}
    people = {table["id"]: table for table in tables.values() if "trials" in table}
    for person in people.values():
        trials = person["trials"].items()
        person["trials"] = {key: recording_tables(recordings) for key, recordings in trials}
    file, written, left_out = tables["study.toml"], list[Correction](), list[str]()
    alike = alike_in_plates(shared.cause for shared in explanation.causes)
    for shared in explanation.causes:
        cause = shared.cause
        if not cause.is_certain or cause.group not in MENDABLE:
            continue
        name = f"{shared.name}{cause.directed} {size_in_words(cause)}"
        if cause.name in alike:
            left_out.append(f"{name}: in all plates, as an error of the body model would be")
        elif shared.fall < LIMITS.least_fall:
            left_out.append(f"{name}: it lowers no residual by {100 * LIMITS.least_fall:.0f} %")
        elif not shared.holds:
            left_out.append(f"{name}: it does not lower the residuals of other trials")
        elif setting := _state(shared, study, file, people, mass_kg):
            axis = shared.axis
            correction = Correction(
                setting=setting,
                cause=name,
                trials=len(shared.trials),
                residual=AXES[axis],
                before=round(float(shared.rms[axis]), 2),
                after=round(float(cause.left[axis]), 2),
                held_out_percent=round(100 * float(shared.held_out[axis]), 1),
                source=os.path.relpath(results, out),
            )
            written.append(correction)
    file["corrections"] = [correction.model_dump() for correction in written]
    for name, table in tables.items():
        if table is file or "trials" in table:
            moved = _moved(table, study.folder, out)
            write_text(tomli_w.dumps(moved), out / name)
    return written, left_out


def _state(
    shared: SharedCause,
    study: Study,
    file: Table,
    people: Mapping[str, Table],
    mass_kg: Mapping[str, float],
) -> str:
    """State the correction of a cause in the tables of a study; empty where no setting does it."""
    cause, trial = shared.cause, TrialName(*shared.trials[0].split(" "))
    if cause.name == MASS:
        mass = round(mass_kg[trial.subject] / (1 + cause.size), 2)
        people[trial.subject]["mass_kg"] = mass
        return f"{trial.subject} mass_kg = {mass}"
    if study.file.plates.calibration is not None:  # its own delay, matrix and offset go before
        return ""
    if cause.name == LATE:
        delay_s = round((study.file.settings.plate_delay_s or 0.0) + cause.size, 5)
        file.setdefault("settings", {})["plate_delay_s"] = delay_s
        return f"plate_delay_s = {delay_s}"
    match cause.name.removeprefix("plate ").split():
        case plate, "gain", "of", component:
            mending = f"{plate} gain {component} {1 / (1 + cause.size):.5f}"
        case plate, "zero", "of", component:
            mending = f"{plate} zero {component} {cause.size:.3f}"
        case plate, "place", "along", axis:
            mending = f"{plate} move {axis} {-cause.size:.5f}"
        case _:
            return ""
    if shared.name != cause.name:  # of one trial
        recordings = people[trial.subject]["trials"][trial.condition]
        file = recordings[int(trial.recording or 1) - 1]
    file["mend_plates"] = [*file.get("mend_plates", ()), mending]
    return f'{shared.name.removesuffix(cause.name)}mend_plates "{mending}"'


def _moved(value: Any, folder: Path, out: Path, key: str = "") -> Any:
    """Name the files of a study as seen from another folder."""
    if isinstance(value, dict):
        return {name: _moved(item, folder, out, name) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_moved(item, folder, out, key) for item in value]
    # a name is no file, even where a file happens to be called so
    is_name = key in ("name", "id", "exclude", "rename")
    if isinstance(value, str) and not is_name and (folder / value).is_file():
        return os.path.relpath(folder / value, out)

    return value
