"""Checks of a trial's plates: what they read when nobody is on them, and loads that jump."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hbm.notes import Note
from hbm.signals.samples import stretches
from hbm.spatial import GRAVITY_MPS2, Array, shift_wrench
from pipeline.io.recording import Recording
from pipeline.trial.standing import (
    MAX_STILL_EXTENT_M,
    TENTH_S,
    common_tenths,
    median_extent,
    tenths,
)

MAX_REST_SHARE: Final = 0.1
"""Of body weight that a plate without load may read; more is taken as load."""
REST_SPREAD_N: Final = 6.0
"""Means of a tenth of a second of an unloaded plate lie this close together: noise and creep."""
MIN_REST_S: Final = 0.3
"""In all, so that a foot that lands or leaves does not count as rest: one swing of a foot."""
MAX_REST_N: Final = 10.0
"""About 1 kg: plates drift by less between two zeroings."""
MAX_TOTAL_REST_N: Final = 20.0
"""Of all plates together: 3 % of the weight of a light adult."""

COMPONENTS: Final = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
NOTED_REST: Final = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
"""Of an unloaded plate, moments about its centre [N, N·m]: what a reader of residuals should know;
real plates, zeroed before the session, read up to a few times as much."""
MAX_REST: Final = np.array([10.0, 10.0, np.inf, 5.0, 5.0, 5.0])
"""The same that is a fault; the vertical force is judged by itself."""
MAX_HELD_S: Final = 0.005
MIN_BESIDE: Final = 0.05
"""Of a component's largest value, on both sides of samples that are exactly zero for so short a
time: a foot lands and leaves slowly enough for a plate to read what is in between."""

MIN_SHARED_TIME: Final = 0.9
"""Of the markers' time that the plates must cover: recordings end some frames apart."""

MIN_LOAD_JUMP: Final = 0.2
"""Share of body weight by which the load of somebody who stands still cannot change."""
MAX_LOAD_SPREAD: Final = 0.05
"""Share of body weight within which a load is steady before and after it jumps."""
STEADY_TENTHS: Final = 4
"""Tenths of a second on either side of a jump in which load and subject are steady."""


def check_plates(
    recording: Recording, wrenches: Sequence[Array], mass_kg: float
) -> tuple[Note, ...]:
    """Find plates that are not zero when nobody is on them, and loads that jump.

    Parameters
    ----------
    recording
        The trial.
    wrenches
        Per plate, action on the subject in lab axes at the markers' times, without what a moving
        platform adds, (T, 6) [N, N·m].
    mass_kg
        Body mass.

    Returns
    -------
    tuple of Note
        ``plate_samples_zero`` where samples of a loaded plate are exactly zero;
        ``plates_apart`` where the plates cover less than 0.9 of the markers' time;
        ``plates_not_zeroed`` where an unloaded plate reads more than 10 N either way, or all
        together more than 20 N; ``plate_components_not_zeroed`` where another component is more
        than 10 N or 5 N·m from zero then, and ``plate_rest`` where any is more than 1 N or 0.5 N·m;
        ``load_jumps`` where their total changes by a fifth of the body weight while the subject
        stands still.
    """
    time, weight_n = recording.markers.time, mass_kg * GRAVITY_MPS2
    vertical = {
        f"plate {plate.number}": wrench[:, 2]
        for plate, wrench in zip(recording.plates, wrenches, strict=True)
    }
    levels = {plate: rest_level(force, time, weight_n) for plate, force in vertical.items()}
    rest_n = {plate: level for plate, level in levels.items() if level is not None}
    total_n = sum(rest_n.values())
    others = (
        *_zero_samples(recording),
        *_apart(recording),
        *_at_rest(recording, wrenches, rest_n, time),
        *load_jumps(vertical, recording.markers.position, time, weight_n),
    )
    if max(map(abs, rest_n.values()), default=0) <= MAX_REST_N and abs(total_n) <= MAX_TOTAL_REST_N:
        return others
    added_kg = total_n / GRAVITY_MPS2
    rest = Note.of("plates_not_zeroed", rest_n=rest_n, total_n=total_n, mass_kg=added_kg)
    return (rest, *others)


def _at_rest(
    recording: Recording, wrenches: Sequence[Array], rest_n: Mapping[str, float], time: Array
) -> tuple[Note, ...]:
    """Say what plates read when nobody is on them, each about its own centre."""
    notes = []
    for plate, wrench in zip(recording.plates, wrenches, strict=True):
        level = rest_n.get(f"plate {plate.number}")
        if level is None:
            continue
        means = tenths(shift_wrench(wrench, plate.center), time, *common_tenths(time))
        at_rest = np.abs(means[:, 2] - level) <= REST_SPREAD_N / 2
        usual = np.median(means[at_rest], axis=0) if at_rest.any() else np.zeros(6)
        for code, limit in (("plate_components_not_zeroed", MAX_REST), ("plate_rest", NOTED_REST)):
            far = np.abs(usual) > limit
            if far.any():
                components = {COMPONENTS[k]: usual[k] for k in np.flatnonzero(far)}
                notes.append(Note.of(code, plate=plate.number, components=components))
                break
    return tuple(notes)


def _zero_samples(recording: Recording) -> tuple[Note, ...]:
    """Name plates of which single samples are exactly zero between loaded ones."""
    notes = []
    for plate in recording.plates:
        zero = np.zeros(len(plate.time), bool)
        longest = round(MAX_HELD_S / float(np.median(np.diff(plate.time))))
        for component in plate.wrench_in_plate.T:
            least = MIN_BESIDE * np.nanmax(np.abs(component), initial=0.0)
            starts, stops = stretches(component == 0).T
            inside = (starts > 0) & (stops < len(component)) & (stops - starts <= longest)
            starts, stops = starts[inside], stops[inside]
            beside = np.minimum(np.abs(component[starts - 1]), np.abs(component[stops]))
            for start, stop in zip(starts[beside > least], stops[beside > least], strict=True):
                zero[start:stop] = True
        if zero.any():
            samples, first_s = int(zero.sum()), plate.time[np.argmax(zero)]
            note = Note.of(
                "plate_samples_zero", plate=plate.number, samples=samples, first_s=first_s
            )
            notes.append(note)
    return tuple(notes)


def _apart(recording: Recording) -> tuple[Note, ...]:
    """Say where plates and markers were recorded, if not at the same time."""
    start_s, stop_s = recording.markers.time[[0, -1]]
    first_s = max(plate.time[0] for plate in recording.plates)
    last_s = min(plate.time[-1] for plate in recording.plates)
    if min(last_s, stop_s) - max(first_s, start_s) >= MIN_SHARED_TIME * (stop_s - start_s):
        return ()
    times = {"first_s": first_s, "last_s": last_s, "start_s": start_s, "stop_s": stop_s}
    return (Note.of("plates_apart", **times),)


def rest_level(vertical: Array, time: Array, weight_n: float) -> float | None:
    """Give what a plate reads when nobody is on it.

    Parameters
    ----------
    vertical
        Vertical force, (T,) [N].
    time
        (T,) [s].
    weight_n
        Body weight.

    Returns
    -------
    float or None
        The level, below a tenth of the body weight, at which the plate is most often [N]: the mean
        over those tenths of a second that lie closest together. None where the plate is never
        at rest for 0.3 s in all: somebody stands on it throughout.
    """
    means = tenths(vertical, time, *common_tenths(time))
    low = np.sort(means[means < MAX_REST_SHARE * weight_n])
    within = np.searchsorted(low, low + REST_SPREAD_N, side="right") - np.arange(len(low))
    if TENTH_S * max(within, default=0) < MIN_REST_S:
        return None
    start = int(np.argmax(within))
    return float(low[start : start + within[start]].mean())


def load_jumps(
    vertical: Mapping[str, Array], position: Array, time: Array, weight_n: float
) -> tuple[Note, ...]:
    """Find where the load of somebody who stands still jumps.

    Parameters
    ----------
    vertical
        Plate -> vertical force on the subject, (T,) [N].
    position
        The subject's markers, (T, K, 3) [m].
    time
        (T,) [s].
    weight_n
        Body weight.

    Returns
    -------
    tuple of Note
        ``load_jumps`` for the largest change of the plates' total from one steady load to another
        by more than a fifth of the body weight while half of the markers stay within 2 cm.
    """
    every = common_tenths(time)
    load = np.stack([tenths(force, time, *every) for force in vertical.values()])
    wide = 2 * STEADY_TENTHS + 1
    if load.shape[1] < wide:
        return ()
    windows = sliding_window_view(load, wide, axis=1)
    before, after = windows[..., :STEADY_TENTHS], windows[..., -STEADY_TENTHS:]
    change = after.mean(axis=-1) - before.mean(axis=-1)
    jump_n = np.abs(change.sum(axis=0))
    spread_n = [np.ptp(each.sum(axis=0), axis=-1) for each in (before, after)]
    steady = np.max(spread_n, axis=0) < MAX_LOAD_SPREAD * weight_n
    largest_n = MIN_LOAD_JUMP * weight_n
    found = np.flatnonzero(steady & (jump_n > largest_n))
    place = tenths(position, time, every[0], int(found.max(initial=-wide)) + wide)
    notes: tuple[Note, ...] = ()
    for start in found:
        still = median_extent(place[start : start + wide]) < MAX_STILL_EXTENT_M
        if still and jump_n[start] > largest_n:
            largest_n = jump_n[start]
            by_plate = zip(vertical, change[:, start], strict=True)
            note = Note.of(
                "load_jumps",
                plates=[plate for plate, each in by_plate if 2 * abs(each) > largest_n],
                at_s=time[0] + TENTH_S * (start + wide / 2),
                before_n=before[:, start].sum(axis=0).mean(),
                after_n=after[:, start].sum(axis=0).mean(),
            )
            notes = (note,)
    return notes
