"""Both belts: their drives, how they run in a trial, and what the plates have to carry of them."""

from dataclasses import replace
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.faults import BeltFaults
from pipeline.virtual_lab.machine.belt_drive import BeltMotion, run_belt
from pipeline.virtual_lab.machine.belt_parameters import BeltDrive, scattered_drive
from pipeline.virtual_lab.machine.linear_belt import run_linear_belt
from pipeline.virtual_lab.machine.treadmill import Machine
from pipeline.virtual_lab.machine.vibration import Pair

Drives = tuple[BeltDrive, BeltDrive]
BELT_LEFT_M: Final = (0.25, -0.25)
"""Where the middle of the left and the right belt is [m]."""


def make_drives(faults: BeltFaults, rng: np.random.Generator) -> Drives | None:
    """Draw the motors of a laboratory's two belts; None for belts that answer linearly."""
    if faults.drive == "linear":
        return None
    left, right = (_with_faults(scattered_drive(own), faults) for own in rng.spawn(2))
    return left, right


def run_belts(
    machine: Machine,
    drives: Drives | None,
    unbalance_kg_per_m: float,
    command: Array,
    rate_hz: float,
    rng: np.random.Generator,
    people: Pair | None = None,
) -> tuple[BeltMotion, BeltMotion]:
    """Let both belts follow a commanded speed under what people do to them.

    Parameters
    ----------
    machine
        The treadmill.
    drives
        Of the left and the right belt; None for belts that answer linearly.
    unbalance_kg_per_m
        Of a roller of those, as of `BeltFaults`.
    command
        (N,) [m/s].
    rate_hz
        Sampling rate [Hz].
    rng
        Source of the rollers' angles and of the rumble.
    people
        Ground reaction of the left and the right plate on people, (N, 6) each [N, N·m].

    Returns
    -------
    tuple of BeltMotion
        Left and right.
    """
    motions = []
    for k, own in enumerate(rng.spawn(2)):
        if drives is None:
            motions.append(run_linear_belt(machine, command, rate_hz, unbalance_kg_per_m, own))
        elif people is None or not people[k].any():
            motions.append(run_belt(drives[k], command, rate_hz, own))
        else:
            push, weight = -people[k][:, 0], np.maximum(people[k][:, 2], 0.0)
            motions.append(run_belt(drives[k], command, rate_hz, own, weight, push))
    return motions[0], motions[1]


def carried_of_belts(belts: tuple[BeltMotion, BeltMotion]) -> Pair:
    """Give what the plates have to carry of their belts, about the platform's origin.

    The forces act in the middle of the belt; (N, 6) each [N, N·m], with the sign of an action on a
    person standing there.
    """
    wrenches = []
    for belt, y in zip(belts, BELT_LEFT_M, strict=True):
        zero = np.zeros(len(belt.speed))
        columns = [belt.forward_force, zero, belt.upward_force]
        columns += [y * belt.upward_force, belt.pitch_moment, -y * belt.forward_force]
        wrenches.append(np.column_stack(columns))
    return wrenches[0], wrenches[1]


def _with_faults(drive: BeltDrive, faults: BeltFaults) -> BeltDrive:
    return replace(
        drive,
        unbalance_kg_per_m=faults.unbalance_kg_per_m,
        rumble_nm_per_sqrt_hz=faults.roughness * drive.rumble_nm_per_sqrt_hz,
        report_jitter_s=faults.roughness * drive.report_jitter_s,
        lines=tuple(
            line._replace(moment_kg=faults.roughness * line.moment_kg) for line in drive.lines
        ),
    )
