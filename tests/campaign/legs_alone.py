"""What residuals lose without markers on trunk, head and arms.

    python -m tests.campaign.legs_alone [--data ../shared/data] [--virtual 24]

Every recording is processed with all its markers and with those of pelvis and legs alone; mass and
stature are the same. Prints the RMS of both, in % of body weight and of body weight × stature, the
SD of their difference, and the SD that the trial's table expects.
"""

import argparse
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from hbm.markers import Markers
from hbm.model import Body
from hbm.plausibility.unseen import unseen_covariance
from hbm.spatial import GRAVITY_MPS2
from pipeline.config.schema import Settings, Subject
from pipeline.io.read import read_recording
from pipeline.io.recording import Recording
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import counted
from pipeline.trial.result import TrialResult

UPPER = re.compile("thorax|head|trunk|shoulder|arm|hand")


def with_legs_alone(recording: Recording, body: Body) -> Recording:
    """Leave out the markers of trunk, head and arms."""
    markers, segment_of = recording.markers, body.segment_of
    legs = [name for name in markers.names if not UPPER.search(segment_of.get(name, ""))]
    columns = [markers.names.index(name) for name in legs]
    fewer = Markers(markers.time, tuple(legs), markers.position[:, columns])
    return replace(recording, markers=fewer)


def known_with_legs_alone(known: dict, body: Body) -> dict:
    """What is known of a subject, with the calibration pose of the legs alone, mass and stature."""
    sizes = {"mass_kg": body.mass, "height_m": body.height_m}
    changed = {"subject": known["subject"].model_copy(update=sizes)}
    if known.get("static") is not None:
        changed["static"] = with_legs_alone(known["static"], body)
    return {**known, **changed}


def opencap(data: Path) -> tuple[str, Recording, dict]:
    """A healthy walk in a table of markers without plates' corners."""
    folder = data / "opencap_subject4"
    walk = read_recording(folder / "walking1.trc", forces=folder / "walking1_grf.mot")
    known = {"subject": Subject(sex="male"), "static": read_recording(folder / "static1.trc")}
    return folder.name, walk, known


def percent(result: TrialResult, values: np.ndarray) -> np.ndarray:
    """Give values by body weight and, of moments, stature [%]."""
    weight_n = result.body.mass * GRAVITY_MPS2
    return 100 * values / (weight_n * np.repeat([1.0, result.body.height_m], 3))


def compared(recording: Recording, known: dict) -> np.ndarray:
    """RMS with all markers and with the legs alone, SD of the difference, SD expected, (4, 6)."""
    full = process_recording(recording, settings=Settings(), **known)
    legs = process_recording(
        with_legs_alone(recording, full.body),
        settings=Settings(),
        **known_with_legs_alone(known, full.body),
    )
    frames = counted(full) & counted(legs)
    every, fewer = (r.measured.residual[frames] for r in (full, legs))
    expected = unseen_covariance(legs.body, legs.motion, counted(legs))
    sizes = [np.sqrt(np.mean(x**2, axis=0)) for x in (every, fewer, fewer - every)]
    return np.array([percent(full, x) for x in (*sizes, np.sqrt(np.diag(expected)))])


def main() -> None:
    from tests.campaign.plate_doubts import real, virtual

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, help="folder of real recordings")
    parser.add_argument("--virtual", type=int, default=24)
    chosen = parser.parse_args()
    kinds = {"virtual": [(b.name, b.recording, b.known) for b in virtual(chosen.virtual)]}
    if chosen.data:
        bases = [(b.name, b.recording, b.known) for b in real(chosen.data)]
        kinds["real"] = [*bases, opencap(chosen.data)]
    for kind, recordings in kinds.items():
        found = []
        for name, recording, known in recordings:
            try:
                found.append(compared(recording, known))
                print(f"{name}: {np.round(found[-1], 2).tolist()}", flush=True)
            except ValueError as refused:
                print(f"{name}: {refused}", flush=True)
        means = np.sqrt(np.nanmean(np.square(found), axis=0))
        for what, row in zip(("all", "legs alone", "difference", "expected"), means, strict=True):
            print(f"{kind} | {what} | {' | '.join(f'{value:.2f}' for value in row)}")


if __name__ == "__main__":
    main()
