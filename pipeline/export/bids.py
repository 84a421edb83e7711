"""A recording as a BIDS data set (Motion-BIDS): what other laboratories and repositories read."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.export.tables import even_rate_hz
from pipeline.io.input_file import naming
from pipeline.io.recording import Recording
from pipeline.io.write import whole_file, write_text

BIDS_VERSION: Final = "1.10.0"
FRAME: Final = "lab"
SPACE: Final = {"SpatialAxes": "ALS", "RotationOrder": "n/a", "RotationRule": "n/a"}
"""x, y and z point to anterior, left and superior."""
FORMULA: Final = ("=", "+", "-", "@")
"""Beginnings of a cell that spreadsheets take for a formula."""
README: Final = """Marker trajectories and ground reactions of people on an instrumented treadmill.

Frame `lab`: right-handed, x forward, y left, z up. Plates (tracksys-plates): force on the subject
and moment about the origin of the lab. Gaps are n/a. Times start at 0 at the first sample.
"""


System = tuple[Array, pd.DataFrame, Array]
"""Times (N,) [s], one row per channel, samples (N, channels)."""


def write_bids(recording: Recording, folder: str | Path, subject: str, task: str) -> list[Path]:
    """Add a recording to a BIDS data set; make the data set where there is none.

    Parameters
    ----------
    recording
        The trial.
    folder
        The data set's folder.
    subject, task
        Labels, of letters and digits only.

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
    for name, label in (("subject", subject), ("task", task)):
        if not re.fullmatch(r"[0-9a-zA-Z]+", label):
            raise ValueError(f"{name} {label!r}: BIDS allows letters and digits only")
    systems = _systems(recording)
    with naming(recording.source):
        rates = {
            name: even_rate_hz(time, f"BIDS ({name})") for name, (time, _, _) in systems.items()
        }
    folder = Path(folder)
    place = folder / f"sub-{subject}" / "motion"
    written = _data_set(folder, subject)
    for name, (_, channels, values) in systems.items():
        stem = f"{place / f'sub-{subject}_task-{task}_tracksys-{name}'}"
        optical = name == "optical"
        description = {
            "TaskName": task,
            "SamplingFrequency": rates[name],
            "TrackedPointsCount": channels["tracked_point"].nunique() if optical else 0,
            "MotionChannelCount": len(channels),
            ("POSChannelCount" if optical else "MISCChannelCount"): len(channels),
            "RecordingDuration": len(values) / rates[name],
            "RecordingType": "continuous",
            "MissingValues": "n/a",
            "TrackingSystemName": name,
        }
        written += [
            _tsv(Path(f"{stem}_motion.tsv"), pd.DataFrame(values), header=False),
            _json(Path(f"{stem}_motion.json"), description),
            _tsv(Path(f"{stem}_channels.tsv"), channels),
            _json(Path(f"{stem}_channels.json"), {"reference_frame": {"Levels": {FRAME: SPACE}}}),
        ]
    if recording.events:
        stem = f"{place / f'sub-{subject}_task-{task}'}"
        kinds = [f"{event.side}_{event.label}" for event in recording.events]
        onsets = [event.time for event in recording.events]
        table = pd.DataFrame({"onset": onsets, "duration": 0, "trial_type": kinds})
        levels = {kind: kind.replace("_", " ") for kind in dict.fromkeys(kinds)}
        meaning = {"trial_type": {"Description": "gait event", "Levels": levels}}
        written += [
            _tsv(Path(f"{stem}_events.tsv"), table),
            _json(Path(f"{stem}_events.json"), meaning),
        ]
    return written


def _systems(recording: Recording) -> dict[str, System]:
    """Give time, channels and samples of each tracking system."""
    markers, plates, analog = recording.markers, recording.plates, recording.analog
    points = [(f"{name}_{a}", a, "POS", name, "m", FRAME) for name in markers.names for a in "xyz"]
    position = markers.position.reshape(len(markers.time), -1)
    found = {"optical": (markers.time, _channels(points), position)}
    if plates:
        if any(not np.array_equal(plate.time, plates[0].time) for plate in plates):
            raise ValueError(f"{recording.source.name}: the plates have different clocks")
        of_plates = [
            (f"plate{plate.number}_{what}_{a}", a, "MISC", f"plate{plate.number}", unit, FRAME)
            for plate in plates
            for what, unit in (("force", "N"), ("moment", "N m"))
            for a in "xyz"
        ]
        wrenches = np.hstack([plate.wrench for plate in plates])
        found["plates"] = (plates[0].time, _channels(of_plates), wrenches)
    if analog is not None:
        named = zip(analog.names, analog.units, strict=True)
        others = [(name, "n/a", "MISC", "n/a", unit or "n/a", "n/a") for name, unit in named]
        found["analog"] = (analog.time, _channels(others), analog.values)
    return found


def _channels(rows: Sequence[tuple[str, ...]]) -> pd.DataFrame:
    columns = ["name", "component", "type", "tracked_point", "units", "reference_frame"]
    return pd.DataFrame(rows, columns=columns)


def _data_set(folder: Path, subject: str) -> list[Path]:
    """Write what a data set needs once, and list the subject."""
    written = []
    description, readme = folder / "dataset_description.json", folder / "README.md"
    if not description.exists():
        name = folder.resolve().name
        data_set = {"Name": name, "BIDSVersion": BIDS_VERSION, "DatasetType": "raw"}
        written.append(_json(description, data_set))
    if not readme.exists() and not (folder / "README").exists():
        write_text(README, readme)
        written.append(readme)
    people = folder / "participants.tsv"
    known = pd.DataFrame({"participant_id": []}, dtype=str)
    if people.exists():
        known = pd.read_csv(people, sep="\t", dtype=str, keep_default_na=False)
    if "participant_id" not in known:
        raise ValueError(f"{people}: no column participant_id")
    if f"sub-{subject}" not in set(known["participant_id"]):
        row = pd.DataFrame({"participant_id": [f"sub-{subject}"]})
        written.append(_tsv(people, pd.concat([known, row])))
    return written


def _tsv(path: Path, table: pd.DataFrame, *, header: bool = True) -> Path:
    texts = table.select_dtypes(exclude="number")
    table = table.assign(**texts.map(_no_formula))
    with whole_file(path) as temporary:
        table.to_csv(
            temporary,
            sep="\t",
            index=False,
            header=header,
            na_rep="n/a",
            float_format="%.9g",
            lineterminator="\n",
            encoding="utf-8",
        )
    return path


def _no_formula(cell: object) -> object:
    """Put a quote before a text that a spreadsheet would compute; a label may be anything."""
    formula = isinstance(cell, str) and len(cell) > 1 and cell.startswith(FORMULA)
    return f"'{cell}" if formula else cell


def _json(path: Path, content: Mapping[str, object]) -> Path:
    write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", path)
    return path
