"""What is said of real files, as they are and damaged, is what was said of them the first time."""

import hashlib
import random
from functools import cache

import numpy as np
import pytest

from pipeline.io.read import read_recording
from tests.campaign.mutations import mutate
from tests.conftest import SHARED_DATA

FILES = sorted(
    path
    for folder in (SHARED_DATA, SHARED_DATA.with_name("cases"))
    for path in folder.rglob("*")
    if path.suffix.lower() in (".c3d", ".trc", ".xdf")
)
LARGEST = 400_000
"""Of a file that is damaged [bytes]."""
FIRST: dict[str, str] = {}


@cache
def content(path):
    return path.read_bytes()


def said(path, forces):
    """Values, notes and axes of a recording, or why it is not read."""
    try:
        recording = read_recording(path, forces=forces)
    except (ValueError, OSError, KeyError) as error:
        return str(error)
    values = [recording.markers.time, recording.markers.position]
    for plate in recording.plates:
        values += [plate.wrench_in_plate, plate.corners, plate.center, plate.rotation]
    digest = hashlib.sha256()
    for array in values:
        digest.update(np.ascontiguousarray(array).tobytes())
    return f"{digest.hexdigest()} {recording.markers.names} {[*map(str, recording.notes)]}"


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_the_same_is_said(path, seed, tmp_path):
    forces = path.with_name(f"{path.stem}_grf.mot")
    if seed and not 0 < len(content(path)) <= LARGEST:
        pytest.skip("empty or large")
    damaged = tmp_path / path.name
    if seed:
        text = path.suffix == ".trc"
        damaged.write_bytes(mutate(random.Random(seed), content(path), text=text).content)
    text = said(damaged if seed else path, forces if forces.exists() else None)
    assert text == FIRST.setdefault(f"{path} {seed}", text)
