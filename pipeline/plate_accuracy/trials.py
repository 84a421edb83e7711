"""The recordings of experiment 1: a weight's true wrench and the plate's, equally filtered."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from compensation import Delay, center_of_pressure, hammer_delay
from compensation.accuracy import PlateAlignment, fit_plate_alignment, wrench_of_weight
from hbm.numbers import read_numbers
from hbm.signals.filtering import LowPassMethod, low_pass
from hbm.signals.resampling import interpolate
from hbm.spatial import GRAVITY_MPS2, Array, Mask, shift_wrench, transform_wrench
from hbm.spelling import listed
from pipeline.config.plate_study import BeltSide, HammerRecording, PlatesStudy, WeightRecording
from pipeline.io.read import read_recording
from pipeline.io.recording import Plate

LIMITS: Final = read_numbers("pipeline.plate_accuracy", "thresholds.toml", "recordings")
PLACES: Final = read_numbers("pipeline.plate_accuracy", "thresholds.toml", "places")


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
    recording = read_recording(study.folder / name, study.file.options)
    if label not in recording.markers.names:
        present = listed(recording.markers.names)
        raise ValueError(f"{name}: no marker {label!r}; markers there: {present}")
    marker = recording.markers.position[:, recording.markers.names.index(label)]
    is_known = np.asarray(np.isfinite(marker).all(axis=1))
    if np.count_nonzero(is_known) < 2:
        raise ValueError(f"{name}: marker {label!r} is never seen, or in one frame only")
    first, last = np.flatnonzero(is_known)[[0, -1]]
    if not is_known[first : last + 1].all():
        raise ValueError(f"{name}: marker {label!r} has a gap; fill the gap or cut it off first")
    rows = slice(first, last + 1)
    number = study.file.plate_numbers.get(belt)
    plate = next((p for p in recording.plates if p.number == number), None)
    if plate is None:
        raise ValueError(f"{name}: no plate {number} for the {belt} belt (plate_numbers)")
    if belt in study.file.surface:  # about the centre of the stated surface, in lab axes
        surface = study.file.surface[belt]
        center, corners = surface.center, surface.corners
        wrench = shift_wrench(plate.wrench, center)
        plate = replace(
            plate, wrench_in_plate=wrench, rotation=np.eye(3), center=center, corners=corners
        )
    if not np.isfinite(plate.corners).all():
        raise ValueError(
            f"{name}: does not say where plate {number} is; give the edges of the {belt} belt in "
            f"plates.toml: [surface.{belt}], x_m = [rear, front], y_m = [right, left]"
        )
    if not np.isfinite(plate.wrench_in_plate).all():
        raise ValueError(f"{name}: plate {number} has gaps; cut them off, or record it again")
    return plate, recording.markers.time[rows], marker[rows]


def read_hammer_delay(study: PlatesStudy, impacts: HammerRecording) -> Delay:
    """Estimate the delay of a plate from a recording of impacts; an error names the file."""
    label = study.file.hammer_marker
    plate, time, marker = read_with_marker(study, impacts.file, impacts.belt, label)
    try:
        return hammer_delay(time, marker[:, 2], plate.time, plate.wrench[:, 2])
    except ValueError as error:
        raise ValueError(f"{impacts.file}: {error}") from error


RATE_HZ: Final = 100.0
"""At which errors are compared: five times the cut-off."""
THESIS_FILTER: Final[LowPassMethod] = "double_pass"
"""Of what is compared with the thesis' errors (van de Loosdrecht 2018, II.A.4): its 20 Hz are the
cut-off of each of MATLAB's two passes."""
OWN_FILTER: Final[LowPassMethod] = "zero_phase"
"""Of what the thesis does not estimate: places, cross-talk, delay in motion, vibration."""
SLOW_CUTOFF_HZ: Final = 2.4
"""For estimates over whole recordings: the marker's noise grows with the square of the cut-off."""
UNALIGNED: Final = PlateAlignment(0.0, np.zeros(2), np.zeros((3, 3)))
"""Of a plate without static recordings: its position is taken from the file."""


@dataclass(frozen=True, slots=True)
class WeightTrial:
    """A weight on a plate, at about 100 Hz, in the cameras' frame about the lab origin.

    Attributes
    ----------
    weight
        As stated in ``plates.toml``.
    time
        (T,) [s].
    marker
        (T, 3) [m], low-passed at the study's cut-off.
    measured, truth
        Wrenches of plate and weight, (T, 6) [N, N·m], low-passed at the study's cut-off.
    slow_marker, slow_measured, slow_truth
        The same, wrenches about the centre of the plate, low-passed at 2.4 Hz.
    slow_noise
        Standard deviation of what is noise of the slow marker in that truth, (6,) [N, N·m]: a force
        along the belt like the vertical one that the marker seems to show, and its moment.
    used
        Samples that are compared, (T,): the middle half of the belt at constant speed, else all.
    belt_ends
        Ends of the belt along x [m].
    center
        Centre of the plate's surface in its file, (3,) [m].
    constant
        Components in the plate's own axes that are the same in every sample, (6,).
    """

    weight: WeightRecording
    time: Array
    marker: Array
    measured: Array
    truth: Array
    slow_marker: Array
    slow_measured: Array
    slow_truth: Array
    slow_noise: Array
    used: Mask
    belt_ends: tuple[float, float]
    center: Array
    constant: Mask


def read_weight(
    study: PlatesStudy, weight: WeightRecording, alignment: PlateAlignment
) -> WeightTrial:
    """Read a recording of a known weight.

    Parameters
    ----------
    study
        The study.
    weight
        The recording.
    alignment
        Of its plate with the cameras.

    Returns
    -------
    WeightTrial
        The plate's wrench is brought to the cameras' frame; its delay is not corrected.

    Raises
    ------
    ValueError
        If marker or plate are missing, the marker has a gap, or the recording is too short.
    """
    file = study.file
    plate, time, marker = read_with_marker(study, weight.file, weight.belt, file.marker)
    clock, rate = plate.time, plate.rate_hz
    with_marker = (clock >= time[0]) & (clock <= time[-1])
    clock, raw = clock[with_marker], to_cameras(plate.wrench[with_marker], alignment)
    if len(clock) < LIMITS.shortest * rate:
        raise ValueError(
            f"{weight.file}: {len(clock) / rate:.1f} s are too short, give "
            f"{LIMITS.shortest:g} s or more"
        )
    position = interpolate(time, marker, clock)
    thinned = slice(None, None, max(round(rate / RATE_HZ), 1))

    def true_wrench(low_passed: Array) -> Array:
        truth = wrench_of_weight(weight.mass_kg, low_passed, rate, file.center_height_m)
        return truth[thinned]

    # plate and marker through the same filter, so that neither is late against the other
    filtered, place = (low_pass(x, rate, file.cutoff_hz, THESIS_FILTER) for x in (raw, position))
    slow, slow_place = (low_pass(x, rate, SLOW_CUTOFF_HZ, OWN_FILTER) for x in (raw, position))
    rear, front = float(plate.corners[:, 0].min()), float(plate.corners[:, 0].max())
    since, until = clock[thinned] - clock[0], clock[-1] - clock[thinned]
    # at the ends low-pass and differentiation of the marker are inaccurate
    used = (since > LIMITS.edge) & (until > LIMITS.edge)
    if weight.profile != "sine":
        # where the belt's speed is constant, as the thesis compares (II.A.4)
        from_middle = np.abs(place[thinned, 0] - (rear + front) / 2)
        used &= from_middle <= LIMITS.middle_of_belt * (front - rear) / 2
    if np.count_nonzero(used) < LIMITS.shortest_used * RATE_HZ:
        raise ValueError(f"{weight.file}: the weight was hardly in the middle half of the belt")
    slow_truth = true_wrench(slow_place)
    in_plate = plate.wrench_in_plate[with_marker]
    weight_n = weight.mass_kg * GRAVITY_MPS2
    slow_clean = _without_noise(slow_truth, slow_place[thinned], weight_n, file.center_height_m)
    return WeightTrial(
        weight=weight,
        time=clock[thinned],
        marker=place[thinned],
        measured=filtered[thinned],
        truth=true_wrench(place),
        slow_marker=slow_place[thinned],
        slow_measured=shift_wrench(slow[thinned], plate.center),
        slow_truth=shift_wrench(slow_clean, plate.center),
        slow_noise=np.std(slow_truth[used, 2]) * np.array([1, 0, 0, 0, file.center_height_m, 0]),
        used=used,
        belt_ends=(rear, front),
        center=plate.center,
        # a change of axes leaves rounding in a component that never changed
        constant=np.ptp(in_plate, axis=0) <= 1e-12 * np.abs(in_plate).max(),
    )


def static_places(study: PlatesStudy, belt: BeltSide) -> tuple[Array, Array] | None:
    """Find where a weight stood still in the static recordings of a plate.

    Returns
    -------
    tuple or None
        Centres of pressure and positions of the marker, (n, 2) [m] each; None without static
        recordings.

    Raises
    ------
    ValueError
        If fewer than three places are found.
    """
    plate_points, camera_points = [], []
    names = [recording.file for recording in study.file.static if recording.belt == belt]
    for name in names:
        plate, time, marker = read_with_marker(study, name, belt, study.file.marker)
        rate = (len(time) - 1) / float(time[-1] - time[0])
        # 8 Hz are fast enough to see when a weight is put down
        slow = low_pass(plate.wrench, plate.rate_hz, 8.0, OWN_FILTER)
        wrench = interpolate(plate.time, slow, time)
        # the 90th percentile is the weight, in a recording that it stands through for the most part
        threshold = PLACES.placed * float(np.nanpercentile(wrench[:, 2], 90))
        wrench = _without_drift(time, wrench, wrench[:, 2] < PLACES.empty * threshold)
        place = low_pass(marker, rate, 8.0, OWN_FILTER)
        speed = np.linalg.norm(np.gradient(place, time, axis=0), axis=1)
        at_rest = (speed < PLACES.rest_speed) & (wrench[:, 2] > threshold)
        edges = np.flatnonzero(np.diff(at_rest.astype(int), prepend=0, append=0))
        shortest = PLACES.shortest_rest * rate
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if stop - start < shortest:
                continue
            # without the ends, where the weight is put down and taken up
            rows = slice(start + int(shortest / 3), stop - int(shortest / 3))
            mean = wrench[rows].mean(axis=0)[None]
            plate_points.append(center_of_pressure(mean, threshold)[0, :2])
            camera_points.append(marker[rows, :2].mean(axis=0))
    if not names:
        return None
    if len(plate_points) < PLACES.fewest:
        raise ValueError(
            f"{', '.join(names)}: {len(plate_points)} places where the weight stood still "
            f"on the plate, expected at least {PLACES.fewest}"
        )
    return np.array(plate_points), np.array(camera_points)


def align(plate_points: Array, camera_points: Array) -> PlateAlignment:
    """Align a plate on `static_places`, with the covariance of a jackknife over the places.

    Along and across the belt, errors of a centre of pressure differ, which the covariance of least
    squares does not allow for.
    """
    alignment, count = fit_plate_alignment(plate_points, camera_points), len(plate_points)
    # without one of the fewest places nothing is left that tells how uncertain the fit is
    if count == PLACES.fewest:
        return alignment
    without_one = (
        fit_plate_alignment(np.delete(plate_points, k, 0), np.delete(camera_points, k, 0))
        for k in range(count)
    )
    off = np.array(
        [
            [other.angle - alignment.angle, *(other.offset - alignment.offset)]
            for other in without_one
        ]
    )
    # jackknife: the sum of squares of n fits times (n - 1) / n
    return replace(alignment, covariance=off.T @ off * (count - 1) / count)


def _without_noise(wrench: Array, marker: Array, weight_n: float, height_m: float) -> Array:
    """Remove the lateral and the varying vertical force of a true wrench: noise of the marker.

    The weight moves along the belt only, and does not leave it. Multiplied by the distance along
    the belt, this noise would be most of the moments about the lateral and the vertical axis, and
    noise in a regressor biases its coefficient towards zero.
    """
    # what remains of lateral and vertical force beyond the weight; along the belt it is true
    noise = wrench[:, :3] - [0.0, 0.0, weight_n]
    noise[:, 0] = 0
    place = np.column_stack([marker[:, :2], np.full(len(marker), height_m)])
    return np.asarray(wrench - np.hstack([noise, np.cross(place, noise)]))


def _without_drift(time: Array, wrench: Array, empty: Mask) -> Array:
    """Subtract the straight line through the wrench of the empty plate."""
    if np.count_nonzero(empty) < PLACES.least_empty * len(empty):
        return wrench
    basis = np.column_stack([np.ones(len(time)), time])
    return np.asarray(wrench - basis @ np.linalg.lstsq(basis[empty], wrench[empty])[0])


def to_cameras(wrench: Array, alignment: PlateAlignment) -> Array:
    """Bring a plate's wrenches about the lab origin to the cameras' frame, (T, 6) both."""
    # the alignment is from cameras to plate, R p + o; this is its inverse
    rotation = np.eye(3)
    rotation[:2, :2] = alignment.rotation.T
    return transform_wrench(wrench, rotation, -rotation @ np.append(alignment.offset, 0.0))
