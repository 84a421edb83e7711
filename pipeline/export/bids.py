"""A recording as a BIDS data set (Motion-BIDS): what other laboratories and repositories read."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import pandas as pd

from hbm.spatial import Array
from hbm.spelling import printable
from pipeline.config.schema import Subject, TrialName
from pipeline.config.study import Study
from pipeline.export.tables import even_rate_hz
from pipeline.io.input_file import describe_error, naming
from pipeline.io.recording import Recording
from pipeline.io.write import uncomputed, whole_file, write_text
from pipeline.trial.process import process_trial
from pipeline.trial.result import TrialResult
from pipeline.trial.study_files import read_study_file, read_study_laboratory

TEMPLATES: Final = files("pipeline.export") / "bids_files"
System = tuple[float, pd.DataFrame, Array]
"""Rate [Hz], one row per channel, samples (N, channels)."""


def write_bids(
    recording: Recording,
    folder: str | Path,
    subject: str,
    task: str,
    *,
    result: TrialResult | None = None,
    group: str | None = None,
) -> list[Path]:
    """Add a recording to a BIDS data set; make the data set where there is none.

    Parameters
    ----------
    recording
        The trial.
    folder
        The data set's folder.
    subject, task
        Labels, of letters and digits only.
    result
        The processed trial: the subject's sex, age, stature and body mass, gait events, session
        and number of the recording. Without one, mass and stature are the file's, and so are
        events.
    group
        Of the subject.

    Returns
    -------
    list[Path]
        The files written: one tracking system for markers, one for plates, one for other
        channels, each on its own clock; and events.

    Raises
    ------
    ValueError
        A label is not letters and digits, or a clock has fewer than two samples or is uneven.
    OSError
        The folder cannot be written.
    """
    session, number = (result.session, result.recording) if result else ("", "")
    labels = {"sub": subject, **({"ses": session} if session else {}), "task": task}
    for name, label in labels.items():
        if label != bare_label(label) or not label:
            raise ValueError(f"{name} {label!r}: BIDS allows letters and digits only")
    with naming(recording.source):
        systems = _systems(recording)
    folder = Path(folder)
    entities = [f"{name}-{label}" for name, label in labels.items()]
    start = folder.joinpath(*entities[:-1], "motion", "_".join(entities))
    run = f"_run-{number}" if number else ""
    written = _data_set(folder, f"sub-{subject}", _person(recording, result, group))
    for name, (rate_hz, channels, values) in systems.items():
        stem = f"{start}_tracksys-{name}{run}"
        numbers = {
            "TaskName": task,
            "TrackingSystemName": name,
            "SamplingFrequency": rate_hz,
            "RecordingDuration": len(values) / rate_hz,
            "MotionChannelCount": len(channels),
            f"{channels['type'].iloc[0]}ChannelCount": len(channels),
        }
        if name == "optical":
            numbers["TrackedPointsCount"] = len(recording.markers.names)
        written += [
            _tsv(Path(f"{stem}_motion.tsv"), pd.DataFrame(values), header=False),
            _json(Path(f"{stem}_motion.json"), numbers),
            _tsv(Path(f"{stem}_channels.tsv"), channels.map(_cell)),
            _json(Path(f"{stem}_channels.json")),
        ]
    if events := result.events if result else recording.events:
        onsets = [event.time - recording.markers.time[0] for event in events]
        kinds = [f"{event.side}_{event.label}" for event in events]
        table = pd.DataFrame({"onset": onsets, "duration": 0, "trial_type": kinds})
        written.append(_tsv(Path(f"{start}{run}_events.tsv"), table.sort_values("onset")))
        written.append(_json(Path(f"{start}{run}_events.json")))
    return written


def write_bids_study(study: Study, out: Path) -> Iterator[tuple[TrialName, list[Path] | str]]:
    """Add every trial of a study to a BIDS data set, processed for its gait events.

    Yields the name of each trial and its files, or the reason why there are none. Conditions are
    tasks. A ValueError where two subjects or conditions have one label, or the laboratory cannot
    be read.
    """
    for kind, names in (("subject", study.subjects), ("condition", study.file.conditions)):
        labels = [bare_label(text).casefold() for text in names]
        for text, label in zip(names, labels, strict=True):
            if labels.count(label) > 1:
                raise ValueError(f"{kind} {text}: another one has the same letters; rename one")
    laboratory = read_study_laboratory(study)
    for name, trial in study.trials.items():
        if trial.file is None or trial.exclude is not None:
            continue
        person = study.subject(name.subject)
        subject, task = bare_label(name.subject), bare_label(name.condition)
        try:
            recording = read_study_file(study, trial.file, trial, person.static)
            result = process_trial(study, *name, laboratory=laboratory)
            result = replace(result, session=bare_label(result.session))
            yield name, write_bids(recording, out, subject, task, result=result, group=person.group)
        except Exception as error:
            yield name, describe_error(error)


def bare_label(name: str) -> str:
    """Give the letters and digits of a name, of which BIDS makes labels."""
    return "".join(letter for letter in name if letter.isascii() and letter.isalnum())


def _systems(recording: Recording) -> dict[str, System]:
    """Give rate, channels and samples of each tracking system."""
    markers, plates, analog = recording.markers, recording.plates, recording.analog
    points = [(f"{name}_{a}", a, "POS", name, "m", "lab") for name in markers.names for a in "xyz"]
    position = markers.position.reshape(len(markers.time), -1)
    systems_read = {"optical": (markers.time, points, position)}
    if plates:
        if any(not np.array_equal(plate.time, plates[0].time) for plate in plates):
            raise ValueError("the plates have different clocks")
        of_plates = [
            (f"plate{plate.number}_{what}_{a}", a, "MISC", f"plate{plate.number}", unit, "lab")
            for plate in plates
            for what, unit in (("force", "N"), ("moment", "N m"))
            for a in "xyz"
        ]
        wrenches = np.hstack([plate.wrench for plate in plates])
        systems_read["plates"] = (plates[0].time, of_plates, wrenches)
    if analog is not None:
        named = zip(analog.names, analog.units, strict=True)
        others = [(name, "n/a", "MISC", "n/a", unit or "n/a", "n/a") for name, unit in named]
        systems_read["analog"] = (analog.time, others, analog.values)
    systems = {}
    columns = ("name", "component", "type", "tracked_point", "units", "reference_frame")
    for name, (time, rows, values) in systems_read.items():
        channels = pd.DataFrame(rows, columns=columns)
        systems[name] = even_rate_hz(time, f"BIDS ({name})"), channels, values
    return systems


def _person(recording: Recording, result: TrialResult | None, group: str | None) -> dict[str, Any]:
    """Give what is known of the subject by the columns of participants.tsv; None for the rest."""
    subject, of_file = result.subject if result else Subject(), recording.metadata
    height_m = result.body.height_m if result else of_file.height_m
    mass_kg = result.body.mass if result else of_file.mass_kg
    return {
        # BIDS asks for 89 in place of higher ages, so that old people are not recognised
        "age": subject.age_years and min(subject.age_years, 89),
        "sex": None if subject.sex == "unspecified" else subject.sex,
        "height": height_m and round(height_m, 3),
        "weight": mass_kg and round(mass_kg, 1),
        "group": group,
    }


def _data_set(folder: Path, subject: str, person: Mapping[str, Any]) -> list[Path]:
    """Write what a data set needs once, and list the subject; what is listed already stays."""
    needed = [folder / name for name in ("dataset_description.json", "participants.json")]
    written = [_json(path) for path in needed if not path.exists()]
    if not [*folder.glob("README*")]:
        written.append(folder / "README.md")
        write_text((TEMPLATES / "README.md").read_text(encoding="utf-8"), written[-1])
    people = folder / "participants.tsv"
    participants = pd.DataFrame({"participant_id": []}, dtype=str)
    if people.exists():
        participants = pd.read_csv(people, sep="\t", dtype=str, keep_default_na=False)
    if "participant_id" not in participants:
        raise ValueError(f"{people}: no column participant_id")
    table = participants
    if subject not in set(participants["participant_id"]):
        table = pd.concat([participants, pd.DataFrame({"participant_id": [subject]})])
    columns = dict.fromkeys([*participants, *person])
    table = table.reindex(columns=[*columns]).astype(object).fillna("n/a")
    for name, value in person.items():
        unknown = (table["participant_id"] == subject) & (table[name] == "n/a")
        table.loc[unknown, name] = _cell(value)
    return written if table.equals(participants) else [*written, _tsv(people, table)]


def _cell(value: Any) -> str:
    """Give a cell of text: in one line, computed by no spreadsheet, n/a for what is unknown."""
    return "n/a" if value is None else uncomputed(printable(str(value))) or "n/a"


def _tsv(path: Path, table: pd.DataFrame, *, header: bool = True) -> Path:
    form: Any = {"sep": "\t", "na_rep": "n/a", "float_format": "%.9g", "lineterminator": "\n"}
    with whole_file(path) as temporary:
        table.to_csv(temporary, index=False, header=header, encoding="utf-8", **form)
    return path


def _json(path: Path, more: Mapping[str, object] = MappingProxyType({})) -> Path:
    """Write what every data set says in files with such an end of their name, and more."""
    template = (TEMPLATES / path.name.rpartition("_")[2]).read_text(encoding="utf-8")
    write_text(json.dumps(json.loads(template) | more, indent=2) + "\n", path)
    return path
