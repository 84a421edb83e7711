"""The treadmill with its instruments, and what these undergo when it moves."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.belts import Drives, carried_of_belts, make_drives, run_belts
from pipeline.virtual_lab.machine.instruments.accelerometer import (
    SENSOR_NAMES,
    Accelerometer,
    make_accelerometers,
)
from pipeline.virtual_lab.machine.instruments.force_plate import ForcePlate, make_force_plate
from pipeline.virtual_lab.machine.instruments.sampling import FRAME_HZ, Clock
from pipeline.virtual_lab.machine.structure import Structure, make_structure
from pipeline.virtual_lab.machine.treadmill import Machine, TreadmillMotion, make_machine
from pipeline.virtual_lab.machine.vibration import Loads, Pair, Response, respond

INSTRUMENT_STREAM: Final = 7
"""Number of the random numbers of the instruments, which are not those of a subject."""


@dataclass(frozen=True, slots=True)
class InstrumentedTreadmill:
    """A treadmill and its instruments with their errors.

    Attributes
    ----------
    machine
        Mechanical properties of the treadmill.
    structure
        How it yields; None for a rigid one.
    drives
        Motors of the left and the right belt; None for belts that answer linearly.
    faults
        Sizes of all errors.
    plates
        Left and right plate; their errors are about the platform's origin.
    sensors
        Accelerometers.
    """

    machine: Machine
    structure: Structure | None
    drives: Drives | None
    faults: Faults
    plates: tuple[ForcePlate, ForcePlate]
    sensors: tuple[Accelerometer, ...]


def make_treadmill(
    faults: Faults, seed: int, machine: Machine | None = None
) -> InstrumentedTreadmill:
    """Draw the instruments of a laboratory.

    Parameters
    ----------
    faults
        Sizes of their errors.
    seed
        Seed of the errors.
    machine
        The treadmill; by default that of ``faults.machine``.

    Returns
    -------
    InstrumentedTreadmill
        Equal seeds give equal instruments; each has its own random numbers.
    """
    of_left, of_right, of_sensors, of_clocks, of_drives = np.random.default_rng(
        (seed, INSTRUMENT_STREAM)
    ).spawn(5)
    machine = machine or make_machine(faults.machine)
    flexibility = faults.machine.flexibility
    structure = make_structure(machine.assemblies, flexibility=flexibility) if flexibility else None
    left, right, *of_each = _clocks(faults, of_clocks)
    plates = (
        make_force_plate(faults.plates, of_left, left),
        make_force_plate(faults.plates, of_right, right),
    )
    sensors = make_accelerometers(faults.accelerometers, of_sensors, of_each)
    drives = make_drives(faults.belts, of_drives)
    return InstrumentedTreadmill(machine, structure, drives, faults, plates, sensors)


def undergo(
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    rng: np.random.Generator,
    people: Pair | None = None,
    on_frame: Array | None = None,
) -> Response:
    """Give what plates, accelerometers and platform markers undergo in a trial.

    Parameters
    ----------
    treadmill
        The treadmill with its instruments.
    motion
        How the treadmill moves, N samples.
    rng
        Source of the rollers' angles and of the belts' rumble.
    people
        Ground reaction of the left and the right plate on people, in the platform frame about its
        origin, (N, 6) each [N, N·m]; None for an empty treadmill.
    on_frame
        Action of people on the frame beside the belts, likewise, (N, 6); None for nobody.

    Returns
    -------
    Response
        At the motion's samples.
    """
    faults, rate_hz = treadmill.faults, motion.rate_hz
    belts = run_belts(
        treadmill.machine,
        treadmill.drives,
        faults.belts.unbalance_kg_per_m,
        motion.belt,
        rate_hz,
        rng,
        people,
    )
    loads = Loads(carried_of_belts(belts), people, on_frame, faults.machine.people_shake)
    response = respond(
        treadmill.structure,
        treadmill.machine.assemblies,
        motion.platform,
        loads,
        tuple(sensor.place for sensor in treadmill.sensors),
        rate_hz,
        round(rate_hz / FRAME_HZ),
    )
    return replace(response, belts=belts)


def _clocks(faults: Faults, rng: np.random.Generator) -> list[Clock]:
    """Draw the clocks of both plates and of every accelerometer that there can be."""
    delays = [*faults.plates.delays_s, *[faults.accelerometers.delay_s] * len(SENSOR_NAMES)]
    errors = 1e-6 * faults.clocks.rate_ppm * rng.standard_normal(len(delays))
    return [
        Clock(delay_s, rate, faults.clocks.jitter_s)
        for delay_s, rate in zip(delays, errors.tolist(), strict=True)
    ]
