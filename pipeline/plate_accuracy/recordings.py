"""A recording of experiment 1: the plate under one belt, and the marker on weight or hammer."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from compensation import Delay, HammerImpact, hammer_delay, hammer_impacts
from hbm.spatial import Array, shift_wrench
from hbm.spelling import listed
from pipeline.config.plate_study import BeltSide, HammerRecording, PlatesStudy, Surface
from pipeline.io.read import read_as_stated
from pipeline.io.recording import Plate

AROUND_S: Final = 0.06
"""Of the instant of an impact, either way: what its paths are fitted to."""


def read_with_marker(
    study: PlatesStudy, name: str, belt: BeltSide, label: str
) -> tuple[Plate, Array, Array]:
    """Read a recording of any format.

    Parameters
    ----------
    study
        The study.
    name
        The recording's file.
    belt
        Whose plate is wanted.
    label
        Of the marker.

    Returns
    -------
    plate
        The plate under the belt, its surface as stated in ``plates.toml`` or else in the file.
    time, marker
        Times and positions of the marker while it is seen, (T,) [s] and (T, 3) [m].

    Raises
    ------
    ValueError
        Marker or plate are missing or have a gap, or it is unknown where the plate is.
    """
    recording = read_as_stated(study.folder / name, study.file.stated)
    if label not in recording.markers.names:
        present = listed(recording.markers.names)
        raise ValueError(f"{name}: no marker {label!r}; markers there: {present}")
    marker = recording.markers.position[:, recording.markers.names.index(label)]
    seen = np.asarray(np.isfinite(marker).all(axis=1))
    if np.count_nonzero(seen) < 2:
        raise ValueError(f"{name}: marker {label!r} is never seen, or in one frame only")
    first, last = np.flatnonzero(seen)[[0, -1]]
    if not seen[first : last + 1].all():
        raise ValueError(f"{name}: marker {label!r} has a gap; fill the gap or cut it off first")
    rows = slice(first, last + 1)
    number = study.file.plate_numbers.get(belt)
    plate = next((p for p in recording.plates if p.number == number), None)
    if plate is None:
        raise ValueError(f"{name}: no plate {number} for the {belt} belt (plate_numbers)")
    if belt in study.file.surface:
        plate = _at_surface(plate, study.file.surface[belt])
    if not np.isfinite(plate.corners).all():
        raise ValueError(
            f"{name}: does not say where plate {number} is; state the edges of the {belt} belt in "
            f"plates.toml: [surface.{belt}], x_m = [rear, front], y_m = [right, left]"
        )
    if not np.isfinite(plate.wrench_in_plate).all():
        raise ValueError(f"{name}: plate {number} has gaps; cut them off, or record it again")
    return plate, recording.markers.time[rows], marker[rows]


@dataclass(frozen=True, slots=True)
class HammerTrace:
    """One impact of a recording and what is around it.

    Attributes
    ----------
    impact
        The one whose delay is nearest the mean.
    time, height
        Of the marker, (N,) [s], (N,) [m].
    force_time, force
        Of the plate, vertical, (P,) [s], (P,) [N].
    """

    impact: HammerImpact
    time: Array
    height: Array
    force_time: Array
    force: Array


def read_hammer_delay(study: PlatesStudy, impacts: HammerRecording) -> tuple[Delay, HammerTrace]:
    """Estimate the delay of a plate from a recording of impacts, and cut one of these out.

    Raises
    ------
    ValueError
        As `read_with_marker` and `compensation.hammer_delay`; it names the file.
    """
    time, height, force_time, force = recorded = read_hammer(study, impacts)
    try:
        delay, found = hammer_delay(*recorded), hammer_impacts(*recorded)
    except ValueError as error:
        raise ValueError(f"{impacts.file}: {error}") from error
    typical = min(found, key=lambda impact: abs(impact.delay_s - delay.seconds))
    near, near_force = (np.abs(t - typical.marker_s) <= AROUND_S for t in (time, force_time))
    return delay, HammerTrace(
        typical, time[near], height[near], force_time[near_force], force[near_force]
    )


def read_hammer(study: PlatesStudy, impacts: HammerRecording) -> tuple[Array, Array, Array, Array]:
    """Give marker times, marker height, plate times and unfiltered vertical force of impacts."""
    label = study.file.hammer_marker
    plate, time, marker = read_with_marker(study, impacts.file, impacts.belt, label)
    return time, marker[:, 2], plate.time, plate.wrench[:, 2]


def _at_surface(plate: Plate, surface: Surface) -> Plate:
    """Give a plate about the centre of a stated surface, in lab axes."""
    center, corners = surface.center, surface.corners
    wrench = shift_wrench(plate.wrench, center)
    return replace(
        plate, wrench_in_plate=wrench, rotation=np.eye(3), center=center, corners=corners
    )
