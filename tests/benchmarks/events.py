"""Gait events by every method against the truth of the virtual laboratory, beside gaitkit's.

gaitkit is optional, and may be installed for another interpreter, ``HBM_GAITKIT_PYTHON``.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hbm.plausibility.labels import without_frozen_frames
from hbm.plausibility.outliers import solve_without_outliers
from hbm.spatial import GRAVITY_MPS2
from pipeline.config.schema import Settings, Subject
from pipeline.config.study import Study, read_study
from pipeline.io.recording import Event, Recording
from pipeline.trial.gait.carried import places_of
from pipeline.trial.gait.contact import feet_of, share_between_feet
from pipeline.trial.gait.detection import (
    detect_events,
    foot_motion,
    foot_motion_events,
    plate_events,
)
from pipeline.trial.gait.events import LABELS, SIDES, event_times
from pipeline.trial.ground.laboratory import Laboratory, bind
from pipeline.trial.ground.wrenches import ground_wrenches, plate_loads
from pipeline.trial.study_files import read_study_file, read_study_laboratory
from pipeline.trial.subject import body_mass, subject_body
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study

SEEDS = (1, 2, 3)
"""Of the studies that are reported; the methods were developed on others (11 to 13)."""
PROTOCOL = Protocol(
    subjects=3, baseline_s=30.0, pitch_s=60.0, waits_s=(12.0, 14.0, 12.0, 13.0), beside_s=0.0
)
TOLERANCE_S = 0.25
"""Of an event that is the true one; the next of its kind and side is a second away."""
ENDS_S = 1.0
"""Left out after the belts have reached their speed, and before the end."""
OURS = ("zeni", "plates", "auto")
MOTION = "auto, without plates"
PEER_PYTHON = "HBM_GAITKIT_PYTHON"
NOBODY, DEFAULTS = Subject(), Settings()
Found = Mapping[str, Sequence[Event]]
Sources = dict[str, Any]
"""What the events of a trial can be found from: arguments of `detect_events`."""


@dataclass(frozen=True)
class Errors:
    """Errors of one kind of event in one trial [ms], and how many are missed and invented."""

    ms: np.ndarray
    missed: int
    invented: int


def race(folder: Path) -> dict[str, list[dict[str, float | str]]]:
    """Simulate the studies, find the events of every trial, and tabulate their errors."""
    trials: list[tuple[str, Found, Sequence[Event]]] = []
    peer = "not run"
    for seed in SEEDS:
        study = read_study(
            simulate_study(folder / str(seed), Setting(seed=seed, protocol=PROTOCOL))
        )
        paths = [study.path(p.trials[c][0].file) for p in study.subjects.values() for c in p.trials]
        others, peer = gaitkit_events(paths)
        for name, condition, sources in _sources(study):
            found = ours(sources) | others.get(name, {})
            trials.append((condition, found, true_events(study.folder, name)))
    print(f"gaitkit: {peer}", file=sys.stderr)
    return {"events": tabulate(trials)}


def ours(sources: Sources) -> dict[str, Sequence[Event]]:
    """Give the events of one trial by our methods."""
    found = {method: detect_events(**sources, method=method)[0] for method in OURS}
    return {f"hbm, {name}": events for name, events in found.items()} | {
        f"hbm, {MOTION}": foot_motion_events(sources["markers"].time, sources["motion"])
    }


def gaitkit_events(paths: Sequence[Path]) -> tuple[dict[str, Found], str]:
    """Give gaitkit's events by name of the recording, and its version or why there are none."""
    program = os.environ.get(PEER_PYTHON, sys.executable)
    command = [program, str(Path(__file__).with_name("gaitkit_peer.py")), *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or ["no message"])[-1]
        return {}, f"left out: {reason} ({program}; {PEER_PYTHON} names another interpreter)"
    result = json.loads(done.stdout)
    found = {
        Path(path).stem: {
            f"gaitkit, {method}": [
                Event(time, *kind.split()) for kind, times in kinds.items() for time in times
            ]
            for method, kinds in methods.items()
        }
        for path, methods in result["trials"].items()
    }
    return found, result["version"]


def tabulate(trials: Sequence[tuple[str, Found, Sequence[Event]]]) -> list[dict[str, float | str]]:
    """Give mean, SD, missed and invented per method, event and condition."""
    errors: dict[tuple[str, str, str], list[Errors]] = {}
    for condition, found, true in trials:
        for method, events in found.items():
            for label in LABELS:
                of_trial = [errors_of(events, true, label, side) for side in SIDES]
                errors.setdefault((method, label, condition), []).extend(of_trial)
    return [
        {
            "name": method,
            "event": label.replace("_", " "),
            "condition": condition,
            "mean_ms": float(np.mean(ms)) if ms.size else np.nan,
            "sd_ms": float(np.std(ms, ddof=1)) if ms.size > 1 else np.nan,
            "found": ms.size,
            "missed": sum(each.missed for each in of_kind),
            "invented": sum(each.invented for each in of_kind),
        }
        for (method, label, condition), of_kind in errors.items()
        for ms in [np.concatenate([each.ms for each in of_kind])]
    ]


def errors_of(events: Sequence[Event], true: Sequence[Event], label: str, side: str) -> Errors:
    """Compare the events of a kind and side, in steady walking, with the true ones."""
    every, own = event_times(true, label, side), event_times(events, label, side)
    first, last = PROTOCOL.steady_s + ENDS_S, max(event.time for event in true) - ENDS_S
    wanted = every[(every > first) & (every < last)]
    nearest = np.array([int(np.argmin(np.abs(every - time))) for time in own], int)
    best: dict[int, float] = {}
    for time, k in zip(own, nearest, strict=True):
        error = float(time - every[k])
        if abs(error) <= TOLERANCE_S and abs(error) < abs(best.get(int(k), np.inf)):
            best[int(k)] = error
    inside = (own > first) & (own < last)
    matched = [error for k, error in best.items() if first < every[k] < last]
    true_inside = sum(first < every[k] + error < last for k, error in best.items())
    return Errors(
        1000 * np.array(matched), len(wanted) - len(matched), int(inside.sum() - true_inside)
    )


def write_table(rows: Sequence[Mapping[str, float | str]], path: Path) -> None:
    """Write the table of the documentation: per method and event what every condition shows."""
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for row in rows:
        text = "none" if np.isnan(row["mean_ms"]) else f"{row['mean_ms']:+.0f} ± {row['sd_ms']:.0f}"
        of_kind = cells.setdefault((row["name"], row["event"]), {})
        of_kind[f"{row['condition']}, ms"] = text.replace("-", "−")
        of_kind[f"{row['condition']}, missed + invented"] = f"{row['missed']} + {row['invented']}"
    table = pd.DataFrame(
        [{"method": name, "event": event} | more for (name, event), more in cells.items()]
    )
    table.to_csv(path, index=False)


def true_events(folder: Path, name: str) -> list[Event]:
    """Read the true events of a simulated trial."""
    table = pd.read_csv(folder / "truth" / f"{name}_events.csv")
    return [Event(row.time_s, row.event, row.side) for row in table.itertuples()]


def event_sources(
    recording: Recording,
    laboratory: Laboratory,
    person: Subject = NOBODY,
    rules: Settings = DEFAULTS,
) -> Sources:
    """Process a recording as far as its events need it."""
    mass_kg = body_mass(person, recording, recording).mass_kg
    body = subject_body(recording, person, rules, mass_kg)
    markers, motion, _ = solve_without_outliers(
        body, without_frozen_frames(recording.markers, body.markers), 1
    )
    lab = bind(recording, laboratory, rules.plate_delay_s)
    ground = ground_wrenches(lab, motion.time)
    contacts = share_between_feet(
        motion.time,
        ground.variants[ground.best],
        feet_of(places_of(body, motion.q)),
        rules.contact_threshold_n,
    ).contacts
    weight_n = body.mass * GRAVITY_MPS2
    return {
        "of_file": recording.events,
        "of_plates": plate_events(contacts, plate_loads(lab), motion.time, weight_n),
        "motion": foot_motion(places_of(body, motion.q), ground.pose),
        "markers": markers,
        "marker_set": body.marker_set,
    }


def _sources(study: Study) -> Iterator[tuple[str, str, Sources]]:
    laboratory, rules = read_study_laboratory(study), study.file.settings
    for person in study.subjects.values():
        for condition, trial in person.trials.items():
            recording = read_study_file(study, trial.file, trial)
            sources = event_sources(recording, laboratory, person.person, rules)
            yield recording.source.stem, condition, sources
