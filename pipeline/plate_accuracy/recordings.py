"""A recording of experiment 1: the plate under one belt, and the marker on weight or hammer."""

from dataclasses import replace

import numpy as np

from compensation import Delay, hammer_delay
from hbm.spatial import Array, shift_wrench
from hbm.spelling import listed
from pipeline.config.plate_study import BeltSide, HammerRecording, PlatesStudy, Surface
from pipeline.io.read import read_as_stated
from pipeline.io.recording import Plate


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
    if not seen.any():
        raise ValueError(f"{name}: marker {label!r} is never seen")
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


def read_hammer_delay(study: PlatesStudy, impacts: HammerRecording) -> Delay:
    """Estimate the delay of a plate from a recording of impacts.

    Raises
    ------
    ValueError
        As `read_with_marker` and `compensation.hammer_delay`; it names the file.
    """
    try:
        return hammer_delay(*read_hammer(study, impacts))
    except ValueError as error:
        raise ValueError(f"{impacts.file}: {error}") from error


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
