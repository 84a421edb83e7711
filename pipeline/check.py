"""A study looked over before any computing: what a run will use, lock, fill or refuse."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hbm.coordinates import COORDINATES, LAST, support
from hbm.markers import MarkerSet, did_you_mean, marker_sets, recognise_marker_set
from pipeline.c3d import read_c3d
from pipeline.laboratory import accelerations, read_calibration
from pipeline.recording import Recording
from pipeline.study import Study

SHORTEST_S = 5.0
OFTEN_MISSING = 0.2


@dataclass(frozen=True, slots=True)
class Findings:
    """What was found: ``faults`` stop a trial, ``remarks`` do not; one sentence each."""

    faults: tuple[str, ...]
    remarks: tuple[str, ...]


def check_study(study: Study) -> Findings:
    """Open every recording of a study and say what a run will make of it.

    Parameters
    ----------
    study
        The study; its TOML files are already checked.

    Returns
    -------
    Findings
        All faults of all files, not only the first.
    """
    faults: list[str] = []
    remarks: list[str] = []
    treadmill = study.file.treadmill
    if treadmill.calibration:
        try:
            path = study.path(treadmill.calibration)
            calibration = read_calibration(path, treadmill, study.file.axes)
            for name, model in calibration.plates.items():
                remarks += [f"{path.name}: {name}: {warning}" for warning in model.warnings]
            remarks.append(f"{path.name}: models for {', '.join(calibration.plates)}")
        except (ValueError, OSError) as error:
            faults.append(str(error))
    else:
        remarks.append("study.toml: no treadmill.calibration, so nothing will be compensated")
    for subject, person in study.subjects.items():
        for condition, trial in person.trials.items():
            if trial.exclude is not None:
                remarks.append(f"{subject} {condition}: excluded: {trial.exclude}")
            elif trial.file is not None:
                _check_trial(study, condition, study.path(trial.file), faults, remarks)
        missing = [name for name in study.file.conditions if name not in person.trials]
        if missing:
            remarks.append(f"{subject}: no trial for {', '.join(missing)}")
    return Findings(tuple(faults), tuple(remarks))


def _check_trial(
    study: Study, condition: str, path: Path, faults: list[str], remarks: list[str]
) -> None:
    try:
        recording = read_c3d(path, study.file.axes, rename=study.file.rename)
        chosen = _marker_set(study, recording)
    except (ValueError, OSError) as error:
        text = str(error)
        faults.append(text if path.name in text else f"{path.name}: {text}")
        return
    name, markers = path.name, recording.markers
    duration = float(markers.time[-1] - markers.time[0])
    remarks.append(
        f"{name}: {duration:.1f} s, {len(markers.names)} markers at {markers.rate_hz:g} Hz "
        f"({chosen.name}), {len(recording.plates)} plates, {len(recording.events)} events"
    )
    if not recording.plates:
        faults.append(f"{name}: no force plates")
    if duration < SHORTEST_S:
        faults.append(f"{name}: lasts {duration:.1f} s; a trial needs {SHORTEST_S:g} s at least")
    _check_markers(name, recording, chosen, remarks)
    _check_channels(study, condition, recording, faults)


def _marker_set(study: Study, recording: Recording) -> MarkerSet:
    if study.marker_set is not None:
        return study.marker_set
    stated = study.file.settings.marker_set
    return marker_sets()[stated] if stated else recognise_marker_set(recording.markers.names)


def _check_markers(name: str, recording: Recording, chosen: MarkerSet, remarks: list[str]) -> None:
    markers = recording.markers
    absent = [marker for marker in chosen.segment if marker not in markers.names]
    if absent:
        remarks.append(f"{name}: markers missing from the set: {', '.join(absent)}")
    shown = {i for m, s in chosen.segment.items() if m not in absent for i in support(LAST[s])}
    locked = [coordinate for i, coordinate in enumerate(COORDINATES) if i not in shown]
    if locked:
        remarks.append(f"{name}: will be locked at neutral: {', '.join(locked)}")
    gaps = np.isnan(markers.position[..., 0]).mean(axis=0)
    for marker, share in zip(markers.names, gaps, strict=True):
        if share > OFTEN_MISSING and marker in chosen.segment:
            remarks.append(f"{name}: {marker} is missing {100 * share:.0f} % of the time")


def _check_channels(study: Study, condition: str, recording: Recording, faults: list[str]) -> None:
    treadmill, rule = study.file.treadmill, study.file.conditions[condition]
    name = recording.source.name
    if treadmill.calibration:
        try:
            accelerations(recording, treadmill)
        except ValueError as error:
            faults.append(str(error))
    known = recording.analog.names if recording.analog is not None else ()
    platform = treadmill.platform
    wanted = [rule.pulse_channel] if rule.perturbed else []
    wanted += [platform.sway_channel, platform.pitch_channel] if platform else []
    for channel in filter(None, wanted):
        if channel not in known:
            faults.append(f"{name}: no analog channel {channel!r}{did_you_mean(channel, known)}")
    for marker in platform.markers if platform else ():
        if marker not in recording.markers.names:
            hint = did_you_mean(marker, recording.markers.names)
            faults.append(f"{name}: no platform marker {marker!r}{hint}")
