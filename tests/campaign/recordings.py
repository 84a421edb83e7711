"""One simulated walk in every format of recordings, and what damage to it may change."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.cli.request import TrialRequest, chain_of, process
from pipeline.io.read import read_recording
from pipeline.io.recording import Recording
from pipeline.trial.result import TrialResult
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.campaign.formats import Format
from tests.campaign.judgement import (
    attempted,
    noted,
    numbers_changed,
    otherwise_equal,
    values_changed,
)
from tests.campaign.mutations import Damage
from tests.campaign.outcome import Outcome
from tests.pipeline.lab import save
from tests.pipeline.other_formats import (
    excerpt,
    write_dflow,
    write_mox,
    write_nexus,
    write_opensim,
)
from tests.pipeline.xdf_file import recorded, write_xdf

BINARY = ("C3D", "XDF")
STANDING = (0, 120)
WALKING = (600, 850)
"""Frames of the simulated trial: the calibration pose; three gait cycles at full speed."""


@dataclass(frozen=True)
class Trial:
    """A recording's format: how a trial of it is requested, and what it says undamaged.

    ``lines`` says that it is text whose length is stated nowhere: cut between two lines it is a
    shorter recording.
    """

    request: Callable[[Path], TrialRequest]
    recording: Recording
    result: TrialResult
    lines: bool = False

    def judge(self, path: Path, damage: Damage) -> Outcome:
        return attempted(lambda: self._accepted(path, damage), _names(self.request(path), path))

    def _accepted(self, path: Path, damage: Damage) -> Outcome:
        request = self.request(path)
        chain = chain_of(request)
        found = chain.inputs.recording
        if outcome := noted(found.notes, self.recording.notes):
            return outcome
        shorter = damage.cut and self.lines and damage.between_lines
        values = values_changed(found, self.recording, gaps=shorter)
        equal = otherwise_equal(found, self.recording)
        lost = _lost(found, self.recording)
        if damage.cut and (values or not equal or (lost and not shorter)):
            return Outcome("silent", f"{values:g} values differ, lost: {lost or 'nothing'}")
        if equal and not lost and values <= damage.data:
            return Outcome("one datum", f"{values:g} values") if values else Outcome("fine")
        result = process(request, chain)
        if outcome := noted(result.notes, self.result.notes):
            return outcome
        outcome = numbers_changed(result, self.result)
        if outcome and 0 < values <= damage.data:  # these may be why, and not what else differs
            return Outcome("one datum", f"{values:g} values")
        return outcome or Outcome("fine", f"{values:g} values")


def _names(request: TrialRequest, path: Path) -> tuple[str, ...]:
    """Give the files of a trial that a refusal may name: they may contradict each other."""
    return (path.name, request.trial.name)


def _lost(found: Recording, known: Recording) -> str:
    """Say of what there are fewer samples."""
    counts = {"frames": len(known.markers.time) - len(found.markers.time)}
    for one, other in zip(found.plates, known.plates, strict=False):
        counts[f"plate {other.number}"] = len(other.time) - len(one.time)
    if known.analog is not None:
        analog = 0 if found.analog is None else len(found.analog.time)
        counts["analog"] = len(known.analog.time) - analog
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count)


def walk_in(folder: Path) -> TrialRequest:
    """Give the request to process the walk's C3D file."""
    return TrialRequest(trial=folder / "walk.c3d", static=folder / "static.c3d", sex="male")


def recordings(folder: Path) -> list[Format]:
    """Write the walk in every format; equal in every run."""
    folder.mkdir(parents=True, exist_ok=True)
    simulate_trial(folder / "whole.c3d", duration_s=9.0)
    whole = read_recording(folder / "whole.c3d")
    save(replace(excerpt(whole, *STANDING), metadata=whole.metadata), folder / "static.c3d")
    walk = replace(excerpt(whole, *WALKING), metadata=whole.metadata)
    save(walk, folder / "walk.c3d")
    write_opensim(walk, folder / "walk.trc", folder / "walk.mot")
    write_dflow(walk, folder / "walk.txt")
    _write_record(walk, folder / "record.txt")
    write_mox(walk, folder / "walk.mox")
    write_nexus(walk, folder / "walk.csv")
    write_xdf(folder / "walk.xdf", recorded(walk))
    known = walk_in(folder)
    trials = {
        "C3D": ("walk.c3d", lambda path: known.model_copy(update=dict(trial=path))),
        "TRC": (
            "walk.trc",
            lambda path: known.model_copy(update=dict(trial=path, forces=folder / "walk.mot")),
        ),
        "MOT": (
            "walk.mot",
            lambda path: known.model_copy(update=dict(trial=folder / "walk.trc", forces=path)),
        ),
        "D-Flow": ("walk.txt", lambda path: known.model_copy(update=dict(trial=path))),
        "D-Flow record": (
            "record.txt",
            lambda path: known.model_copy(update=dict(trial=folder / "walk.txt", record=path)),
        ),
        "MOX": ("walk.mox", lambda path: known.model_copy(update=dict(trial=path))),
        "Nexus": ("walk.csv", lambda path: known.model_copy(update=dict(trial=path))),
        "XDF": ("walk.xdf", lambda path: known.model_copy(update=dict(trial=path))),
    }
    formats = []
    for name, (file, request) in trials.items():
        undamaged = request(folder / file)
        chain = chain_of(undamaged)
        trial = Trial(
            request,
            chain.inputs.recording,
            process(undamaged, chain),
            lines=name.startswith("D-Flow"),
        )
        formats.append(Format(name, folder / file, trial.judge, name not in BINARY, request))
    return formats


def _write_record(walk: Recording, path: Path) -> None:
    time = np.arange(200.0, 200.0 + len(walk.markers.time) / 100, 1 / 60)
    rows = [f"{t:.6f}\t{1.3 + 0.001 * k:.6f}\t1.300000" for k, t in enumerate(time)]
    rows.insert(60, "#\n# EVENT A - COUNT 1\n#")
    rows.append("# EVENT A occured 1 time")
    path.write_text("\n".join(["Time\tLeft.Speed\tRight.Speed", *rows]) + "\n", encoding="utf-8")
