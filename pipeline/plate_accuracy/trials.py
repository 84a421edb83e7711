"""The recordings of experiment 1: a weight's true wrench beside the plate's, filtered alike."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from compensation import (
    PlateAlignment,
    center_of_pressure,
    fit_plate_alignment,
    wrench_of_weight,
)
from hbm.signals.filtering import LowPassMethod, low_pass
from hbm.signals.resampling import interpolate
from hbm.spatial import Array, shift_wrench, transform_wrench
from pipeline.config.plate_study import BeltSide, PlatesFile, PlatesStudy, WeightRecording
from pipeline.io.c3d.read import read_c3d
from pipeline.io.recording import Plate, Recording

RATE_HZ: Final = 100.0
SHORTEST_S: Final = 3.0
EDGE_S: Final = 0.3
STILL_MPS: Final = 0.01
STILL_S: Final = 0.3
STILL_HZ: Final = 8.0
SLOW_HZ: Final = 2.4
"""Cut-off for what is estimated over whole recordings: the marker's noise grows with its square."""
THESIS_FILTER: Final[LowPassMethod] = "double_pass"
"""Of what is compared with the thesis' errors (van de Loosdrecht 2018, II.A.4): its 20 Hz are the
cut-off of each of MATLAB's two passes."""
OWN_FILTER: Final[LowPassMethod] = "zero_phase"
"""Of what the thesis does not estimate: places, cross-talk, delay in motion, vibration."""


@dataclass(frozen=True, slots=True)
class WeightTrial:
    """A weight on a plate, at about 100 Hz, in the cameras' frame about the lab origin.

    Attributes
    ----------
    weight
        What was stated.
    time
        (T,) [s].
    marker
        (T, 3) [m], low-passed.
    measured, truth
        Wrenches, (T, 6) [N, N·m], low-passed at the study's cut-off.
    slow_marker, slow_measured, slow_truth
        The same, wrenches about the middle of the plate, low-passed at 2.4 Hz.
    used
        Samples that count, (T,): the middle half of the belt at constant speed, else all.
    noise
        SD of the plate above the cut-off, (6,) [N, N·m].
    reach
        Ends of the belt along x [m].
    """

    weight: WeightRecording
    time: Array
    marker: Array
    measured: Array
    truth: Array
    slow_marker: Array
    slow_measured: Array
    slow_truth: Array
    used: Array
    noise: Array
    reach: tuple[float, float]


def read_weight(
    study: PlatesStudy, weight: WeightRecording, alignment: PlateAlignment
) -> WeightTrial:
    """Read a recording of a known weight.

    Parameters
    ----------
    study
        The study.
    weight
        Which recording.
    alignment
        Of its plate with the cameras.

    Returns
    -------
    WeightTrial
        The plate's wrench is brought to the cameras' frame; its delay is left as it is.

    Raises
    ------
    ValueError
        If marker or plate are missing, the marker is lost for a moment, or it is too short.
    """
    file = study.file
    _, plate, time, marker = _read(study, weight.file, weight.belt, file.marker)
    clock, rate = plate.time, plate.rate_hz
    held = (clock >= time[0]) & (clock <= time[-1])
    clock, raw = clock[held], _to_cameras(plate.wrench[held], alignment)
    if len(clock) < SHORTEST_S * rate:
        raise ValueError(
            f"{weight.file}: {len(clock) / rate:.1f} s are too short, give 3 s or more"
        )
    fine = interpolate(time, marker, clock)
    thin = slice(None, None, max(round(rate / RATE_HZ), 1))

    def known(marker: Array) -> Array:
        return wrench_of_weight(weight.mass_kg, marker, rate, file.center_height_m)[thin]

    smoothed, place = (low_pass(x, rate, file.cutoff_hz, THESIS_FILTER) for x in (raw, fine))
    slow, slow_place = (low_pass(x, rate, SLOW_HZ, OWN_FILTER) for x in (raw, fine))
    reach = float(plate.corners[:, 0].min()), float(plate.corners[:, 0].max())
    since, until = clock[thin] - clock[0], clock[-1] - clock[thin]
    used = (since > EDGE_S) & (until > EDGE_S)
    if weight.profile != "sine":
        used &= np.abs(place[thin, 0] - sum(reach) / 2) <= (reach[1] - reach[0]) / 4
    if np.count_nonzero(used) < RATE_HZ / 2:
        raise ValueError(f"{weight.file}: the weight was hardly in the middle half of the belt")
    return WeightTrial(
        weight=weight,
        time=clock[thin],
        marker=place[thin],
        measured=smoothed[thin],
        truth=known(place),
        slow_marker=slow_place[thin],
        slow_measured=shift_wrench(slow[thin], plate.center),
        slow_truth=shift_wrench(
            _not_pushed_across(known(slow_place), slow_place[thin], file), plate.center
        ),
        used=used,
        noise=np.std(raw - smoothed, axis=0),
        reach=reach,
    )


def _not_pushed_across(wrench: Array, marker: Array, file: PlatesFile) -> Array:
    """Take off what the marker's noise across the belt makes of a weight that rides along it.

    Times the distance along the belt it would be most of the moment about the vertical, and noise
    in what explains an error makes the error look smaller.
    """
    across = wrench[:, 1].copy()
    wrench[:, 1] = 0
    wrench[:, 3] += file.center_height_m * across
    wrench[:, 5] -= marker[:, 0] * across
    return wrench


def static_places(study: PlatesStudy, belt: BeltSide) -> tuple[Array, Array] | None:
    """Find where a weight stood still in the static recordings of a plate.

    Returns
    -------
    tuple or None
        Centres of pressure by the plate and places of the marker, (n, 2) [m] each; None where
        there are no static recordings.

    Raises
    ------
    ValueError
        If fewer than three places are found.
    """
    plate_points, camera_points = [], []
    names = [s.file for s in study.file.static if s.belt == belt]
    for name in names:
        recording, plate, time, marker = _read(study, name, belt, study.file.marker)
        slow = low_pass(plate.wrench, plate.rate_hz, STILL_HZ, OWN_FILTER)
        wrench = interpolate(plate.time, slow, time)
        threshold = 0.5 * float(np.nanpercentile(wrench[:, 2], 90))
        wrench = _without_drift(time, wrench, wrench[:, 2] < 0.2 * threshold)
        place = low_pass(marker, recording.markers.rate_hz, STILL_HZ, OWN_FILTER)
        speed = np.linalg.norm(np.gradient(place, time, axis=0), axis=1)
        still = (speed < STILL_MPS) & (wrench[:, 2] > threshold)
        edges = np.flatnonzero(np.diff(still.astype(int), prepend=0, append=0))
        shortest = STILL_S * recording.markers.rate_hz
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if stop - start < shortest:
                continue
            rows = slice(start + int(shortest / 3), stop - int(shortest / 3))
            mean = wrench[rows].mean(axis=0)[None]
            plate_points.append(center_of_pressure(mean, threshold)[0, :2])
            camera_points.append(marker[rows, :2].mean(axis=0))
    if not names:
        return None
    if len(plate_points) < 3:
        raise ValueError(
            f"{', '.join(names)}: {len(plate_points)} places found where the weight stood still "
            "on the plate, expected at least 3"
        )
    return np.array(plate_points), np.array(camera_points)


def align(plate: Array, camera: Array) -> PlateAlignment:
    """Align `static_places`; covariance by leaving out each: along and across are not alike."""
    whole, count = fit_plate_alignment(plate, camera), len(plate)
    if count == 3:
        return whole
    parts = (
        fit_plate_alignment(np.delete(plate, k, 0), np.delete(camera, k, 0)) for k in range(count)
    )
    off = np.array([[p.angle - whole.angle, *(p.offset - whole.offset)] for p in parts])
    return replace(whole, covariance=off.T @ off * (count - 1) / count)


def read_hammer(study: PlatesStudy, name: str, belt: BeltSide) -> tuple[Array, Array, Array, Array]:
    """Give marker times, marker height, plate times and raw vertical force of hammer blows."""
    _, plate, time, marker = _read(study, name, belt, study.file.hammer_marker)
    return time, marker[:, 2], plate.time, plate.wrench[:, 2]


UNALIGNED = PlateAlignment(0.0, np.zeros(2), np.zeros((3, 3)), np.nan, np.nan)
"""A plate that was not aligned with the cameras: taken as the file says."""


def _read(
    study: PlatesStudy, name: str, belt: BeltSide, label: str
) -> tuple[Recording, Plate, Array, Array]:
    file: PlatesFile = study.file
    recording = read_c3d(study.folder / name, file.axes)
    if label not in recording.markers.names:
        there = ", ".join(recording.markers.names) or "none"
        raise ValueError(f"{name}: no marker {label!r}; there: {there}")
    number = file.plate_numbers.get(belt)
    plate = next((p for p in recording.plates if p.number == number), None)
    if plate is None:
        raise ValueError(f"{name}: no plate {number} for the {belt} belt (plate_numbers)")
    marker = recording.markers.position[:, recording.markers.names.index(label)]
    seen = np.asarray(np.isfinite(marker).all(axis=1))
    if not seen.any():
        raise ValueError(f"{name}: marker {label!r} is never seen")
    first, last = np.flatnonzero(seen)[[0, -1]]
    if not seen[first : last + 1].all():
        raise ValueError(f"{name}: marker {label!r} is lost for a while; fill or cut the gap first")
    rows = slice(first, last + 1)
    return recording, plate, recording.markers.time[rows], marker[rows]


def _without_drift(time: Array, wrench: Array, empty: NDArray[np.bool_]) -> Array:
    """Take off the straight line through what the plate measured while it was empty."""
    if np.count_nonzero(empty) < 0.1 * len(empty):
        return wrench
    basis = np.column_stack([np.ones(len(time)), time])
    return np.asarray(wrench - basis @ np.linalg.lstsq(basis[empty], wrench[empty])[0])


def _to_cameras(wrench: Array, alignment: PlateAlignment) -> Array:
    turn = np.eye(3)
    turn[:2, :2] = alignment.rotation.T
    return transform_wrench(wrench, turn, -turn @ np.append(alignment.offset, 0.0))
