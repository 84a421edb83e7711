"""People beside a plate that stays empty, as a calibration is advised to have them."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from compensation.protocol import RUNNING_MPS
from hbm.spatial import Array
from pipeline.io.recording import Recording
from pipeline.virtual_lab.machine.actuators import move_platform
from pipeline.virtual_lab.machine.instrumented_treadmill import InstrumentedTreadmill, undergo
from pipeline.virtual_lab.machine.instruments.sampling import ANALOG_HZ, FRAME_HZ, SAMPLES_PER_FRAME
from pipeline.virtual_lab.machine.readings import BELT_CHANNELS
from pipeline.virtual_lab.machine.treadmill import TreadmillMotion
from pipeline.virtual_lab.person import bystander
from pipeline.virtual_lab.protocol.calibration_trial import record_without_markers
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, Setting


@dataclass(frozen=True, slots=True)
class Beside:
    """What a person does on a treadmill that stays level, and where.

    Attributes
    ----------
    load
        Of the person, on the right belt or on the boards.
    place
        On which belt, or on the boards, where both plates stay empty.
    belts_mps
        Speed of the belts; None for that of the trials.
    """

    load: bystander.LoadPattern
    place: Literal["right", "left", "boards"]
    belts_mps: float | None = None


BESIDE: Final = {
    "walking_right.c3d": Beside(bystander.walking, "right"),
    "walking_left.c3d": Beside(bystander.walking, "left"),
    "running_right.c3d": Beside(bystander.running, "right", RUNNING_MPS),
    "running_left.c3d": Beside(bystander.running, "left", RUNNING_MPS),
    "boards.c3d": Beside(bystander.stepping_on_boards, "boards", 0.0),
}
"""Recording -> what is recorded."""
MIRRORED: Final = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""A load on the right belt by the same one on the left."""


def beside_names(setting: Setting) -> tuple[str, ...]:
    """Name the recordings of people beside an empty plate; none where the protocol has none."""
    return tuple(BESIDE) if setting.protocol.beside_s > 0 else ()


def run_beside(setting: Setting, treadmill: InstrumentedTreadmill, name: str) -> Recording:
    """Record plates, accelerometers and belts while somebody is beside a plate that stays empty.

    Parameters
    ----------
    setting
        Protocol, faults and seed.
    treadmill
        The instruments, from `make_treadmill` with the setting's faults.
    name
        A key of `BESIDE`.

    Returns
    -------
    Recording
        Without markers. Equal seeds give equal recordings.
    """
    protocol, planned = setting.protocol, BESIDE[name]
    seed = (setting.seed, len(PERSONS), 1 + list(BESIDE).index(name))
    of_load, of_motion, of_plates, of_sensors, of_belts = np.random.default_rng(seed).spawn(5)
    frames = round(protocol.beside_s * FRAME_HZ)
    time = np.arange(frames * SAMPLES_PER_FRAME) / ANALOG_HZ
    level = np.zeros(len(time))
    speed = protocol.speed_mps if planned.belts_mps is None else planned.belts_mps
    motion = TreadmillMotion(
        time,
        move_platform(treadmill.machine, level, level, ANALOG_HZ),
        level + speed,
        np.empty(0),
    )
    load = planned.load(time, of_load)
    nobody = np.zeros_like(load)
    people: tuple[Array, Array] | None = {
        "right": (nobody, -load),
        "left": (-load * MIRRORED, nobody),
        "boards": None,
    }[planned.place]
    on_frame = load if people is None else None
    response = undergo(treadmill, motion, of_motion, people, on_frame)
    streams = of_plates, of_sensors, of_belts
    return record_without_markers(name, treadmill, motion, response, BELT_CHANNELS, streams)
