"""A walk over plates in a floor, as most laboratories record it: two or three steps on plates.

On a belt of constant speed, walking is walking over a floor, seen from a frame that moves
uniformly. The virtual walker's steady steps are therefore shown from the frame of the belt; the
person who stands before the belts start gives the static recording.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.spatial import Array, shift_wrench
from pipeline.io.recording import Metadata, Plate, Recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    ANALOG_HZ,
    FRAME_HZ,
    make_force_plate,
)
from pipeline.virtual_lab.machine.platform import BeltRamp, stationary_platform
from pipeline.virtual_lab.person.gait import SIDES, schedule
from pipeline.virtual_lab.person.subject import Person, VirtualSubject, make_subject
from pipeline.virtual_lab.person.walk import Walk, foot_wrenches, simulate_walk
from pipeline.virtual_lab.protocol.walking_trial import measure_person

STANDING_S: Final = 4.0
STARTING_S: Final = 3.5
STATIC_S: Final = 1.8
"""Standing before the belts start, the time that they take, and how long the T-pose is recorded."""
FIRST_STEP_S: Final = STANDING_S + STARTING_S + 1.5
"""Steps before it are not shown."""
BESIDE_S: Final = 0.8
"""For which the walk is recorded before the first step on plates, and after the last one."""
PLATE_M: Final = 0.6, 0.4
"""Length along the walkway and width of a plate, typical of plates in floors."""
APART_M: Final = 0.605
"""From the middle of one plate to that of the next: they lie in a row with narrow gaps."""
MAX_MISSED_M: Final = 0.04
"""By which the steps are at most beside where they would be best."""


@dataclass(frozen=True, slots=True)
class OvergroundWalk:
    """A subject's recordings.

    Attributes
    ----------
    subject
        Who.
    static
        Standing in a T-pose on the middle plate.
    walk
        Walking across, every plate under one step.
    """

    subject: VirtualSubject
    static: Recording
    walk: Recording


def simulate_overground(
    person: Person | None = None,
    *,
    speed_mps: float = 1.25,
    plates: int = 3,
    seed: int = 0,
    body_seed: int | None = None,
    faults: Faults | None = None,
) -> OvergroundWalk:
    """Simulate a person who stands on a plate of three in a floor, and then walks across them.

    Parameters
    ----------
    person
        Who; by default a man of 74.6 kg and 1.78 m.
    speed_mps
        Of walking [m/s].
    plates
        How many there are, in a row along the walkway.
    seed
        Equal seeds give equal recordings.
    body_seed
        Of the person's body, for several walks of one person; by default `seed` counts.
    faults
        Of body, cameras and plates, by default those of a well-maintained laboratory. The plates'
        placement counts for all of them together.

    Returns
    -------
    OvergroundWalk
        Markers at 100 Hz, plates at 1000 Hz. A step is on the plate under the foot's middle for its
        whole duration, or on the floor.
    """
    faults = faults or Faults()
    of_subject, of_walk, of_aim, of_plates, of_markers = np.random.default_rng(seed).spawn(5)
    if body_seed is not None:
        of_subject = np.random.default_rng(body_seed).spawn(1)[0]
    subject = make_subject(
        person or Person(), individuality=1.0, faults=faults.body, rng=of_subject
    )
    belt = BeltRamp(speed_mps, STANDING_S, STARTING_S)
    duration_s = FIRST_STEP_S + plates + 3.0
    steps = schedule(subject.step_parameters, speed_mps, STANDING_S, duration_s, of_walk)
    walk = simulate_walk(subject, steps, belt, stationary_platform(), duration_s, of_walk)

    first = int(np.searchsorted(steps.contact, FIRST_STEP_S)) + int(of_aim.integers(2))
    on_plates = range(first, first + plates)
    start_s = steps.contact[first] - BESIDE_S
    stop_s = steps.off[first + plates - 1] + BESIDE_S
    middles = np.array([_middle(walk, number) for number in on_plates])
    centers = np.zeros((plates, 3))
    centers[:, 0] = APART_M * np.arange(plates)
    missed = middles[:, 0] - centers[:, 0]
    aim = of_aim.uniform(-MAX_MISSED_M, MAX_MISSED_M, 2)
    origin = np.array([(missed.max() + missed.min()) / 2, middles[:, 1].mean(), 0.0])
    origin[:2] += aim
    measuring = [make_force_plate(faults.plates, rng) for rng in of_plates.spawn(plates)]

    def recorded(name: str, start_s: float, stop_s: float, shift: Array) -> Recording:
        time = start_s + np.arange(round((stop_s - start_s) * ANALOG_HZ)) / ANALOG_HZ
        moved = belt.travelled(time)[:, None] * [1.0, 0.0, 0.0] - shift
        loads = np.zeros((plates, len(time), 6))
        for side, wrench in foot_wrenches(walk, time).items():
            on_floor = shift_wrench(wrench, -moved)
            under = _under(walk, side, time, shift, centers)
            for number in range(plates):
                loads[number] += np.where((under == number)[:, None], on_floor, 0.0)
        frames = start_s + np.arange(round((stop_s - start_s) * FRAME_HZ)) / FRAME_HZ
        position = measure_person(walk, frames, faults.cameras, of_markers)
        position[..., 0] += belt.travelled(frames)[:, None]
        person = subject.person
        return Recording(
            source=Path(name),
            markers=Markers(frames - start_s, subject.skeleton.markers, position - shift),
            plates=tuple(
                _plate(number + 1, time - start_s, measured, center)
                for number, center in enumerate(centers)
                for measured in [
                    measuring[number].measure(
                        shift_wrench(loads[number], center), ANALOG_HZ, of_plates
                    )
                ]
            ),
            metadata=Metadata(height_m=person.height_m),
        )

    standing = np.mean([subject.soles[side].standing for side in SIDES], axis=0) * [1, 1, 0]
    return OvergroundWalk(
        subject,
        recorded("static.c3d", 0.0, STATIC_S, standing - centers[plates // 2]),
        recorded("walk.c3d", start_s, stop_s, origin),
    )


def _middle(walk: Walk, number: int) -> Array:
    """Give where the middle of a step's foot is on the floor, (2,) [m]."""
    placement = walk.placement
    side = SIDES[number % 2]
    sole = placement.soles[side]
    contact = placement.steps.contact[number]
    ahead = placement.belt.travelled(np.array([contact]))[0] + (sole.heel + sole.toe) / 2
    return np.asarray(placement.place[number] + [ahead, 0.0])


def _under(walk: Walk, side: str, time: Array, shift: Array, centers: Array) -> Array:
    """Give the number of the plate under a foot, (N,); -1 where that is the floor."""
    number = walk.placement.step(side, time)
    middle = np.zeros((len(time), 2))
    for step in np.unique(number):
        standing = step < 2 if side == "left" else step < 0
        place = walk.placement.soles[side].standing[:2] if standing else _middle(walk, int(step))
        middle[number == step] = place
    away = np.abs(middle[:, None] - shift[:2] - centers[:, :2])
    within = np.all(away <= np.array(PLATE_M) / 2, axis=2)
    return np.asarray(np.where(np.any(within, axis=1), np.argmax(within, axis=1), -1))


def _plate(number: int, time: Array, wrench: Array, center: Array) -> Plate:
    x, y = np.array(PLATE_M) / 2
    corners = center + np.array([[x, y, 0], [x, -y, 0], [-x, -y, 0], [-x, y, 0]])
    return Plate(number, time, wrench, np.eye(3), center, corners)
