"""A study of a virtual laboratory with plates in its floor, and one with faults of its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.io.recording import Recording
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS
from tests.campaign.plants import amplified, moved
from tests.campaign.walks import virtual

FIRST_SEED = 30
GAIN, SHIFT_M = 1.05, np.array([0.02, 0.0, 0.0])


def write_overground_study(folder: Path, people: int, *, faulty: bool) -> None:
    """Write one walk per person; with faults, the weighing of the calibration pose has them too."""
    folder.mkdir()
    (folder / "study.toml").write_text('[settings]\nmarker_set = "hbm2"\n[conditions.walk]\n')
    for k, base in enumerate(virtual(people, first=FIRST_SEED)):
        walk, static = base.recording, base.known["static"]
        if faulty:
            walk, static = (amplified(each, 1, 2, GAIN) for each in (walk, static))
            walk = moved(walk, 0, SHIFT_M)
        write_recording(walk, folder / f"s{k}_walk.c3d")
        write_recording(static, folder / f"s{k}_static.c3d")
        mass_kg = PERSONS[(FIRST_SEED + k) % len(PERSONS)].mass_kg
        person = f'id = "s{k}"\nsex = "{base.known["subject"].sex}"\nmass_kg = {mass_kg:.2f}\n'
        trial = f'static = "s{k}_static.c3d"\n[trials.walk]\nfile = "s{k}_walk.c3d"\n'
        (folder / f"s{k}.toml").write_text(person + trial)


def write_recording(recording: Recording, path: Path) -> None:
    """Write a recording whose plates measure ten times as often as its cameras."""
    markers = recording.markers
    frames = min(len(markers.time), len(recording.plates[0].time) // 10)
    plates = [
        replace(
            plate,
            time=plate.time[: 10 * frames],
            wrench_in_plate=plate.wrench_in_plate[: 10 * frames],
        )
        for plate in recording.plates
    ]
    cut = type(markers)(markers.time[:frames], markers.names, markers.position[:frames])
    write_c3d(path, cut, plates, metadata=recording.metadata)
