"""A calibration against a recording of another day: still valid, drifted, or a sensor changed."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from compensation.alignment.delay import BLOCKS
from compensation.alignment.sensor_delay import sensor_delays
from compensation.inertia.changes import (
    QUANTILE_95,
    likeliest,
    plate_gains,
    sensor_change,
    sensor_offset,
)
from compensation.inertia.checks import MIN_IMPROVEMENT
from compensation.inertia.fit import fit_inertia
from compensation.inertia.model import SLOW_HZ, InertiaModel
from compensation.inertia.quality import MAX_LEFT, refuse_unusable
from compensation.inputs import read_table
from hbm.notes import Note
from hbm.signals.filtering import low_pass
from hbm.spatial import Array

Verdict = Literal[
    "valid",
    "drifted",
    "offset",
    "late",
    "gain",
    "turned",
    "moved",
    "plates",
    "outdated",
    "faulty",
]
MAX_ZERO_CHANGE: Final = np.repeat([3.0, 0.6], 3)
"""By which the zero of a plate may have changed [N, N·m]; in children, errors of 3 N do not change
joint moments beyond their spread (doi 10.1016/j.jbiomech.2024.112351). 0.6 N·m, a millimetre under
75 kg, are our choice."""
CONTROL_LIMIT: Final = 3.0
"""Standard deviations of a zero from recording to recording that are no drift (Shewhart 1931)."""
MIN_DELAY_S: Final = 0.0003
"""Of an accelerometer; less leaves a fraction of a newton of a sway."""
MIN_LEFT: Final = 1e-9
"""Of an exact calibration [N, N·m]."""
MIN_ONE_SENSOR: Final = 0.5
"""Share of what a new fit would explain that the change of one sensor must explain."""
MIN_PLATES: Final = 0.8
"""The same of gains of plates, which have more numbers; another assembly looks like 0.7 of it."""
MIN_AS_GOOD: Final = 0.99
"""Share of what gains of plates explain from which on one gain or turn of a sensor is likelier: it
needs one number or three, the plates one for each component."""
MAX_UNEXPLAINED: Final = 2.0
"""Factor by which what a new fit leaves may exceed what is expected and still count as of rollers;
what rattles or leans on a plate leaves more."""


@dataclass(frozen=True, slots=True)
class ZeroChange:
    """Change of the zero of one plate since the calibration.

    Attributes
    ----------
    plate
        Its name.
    change, error
        With the standard error of the mean, (6,) [N, N·m].
    usual
        Standard deviation by which the calibration expects it to change, (6,) [N, N·m].
    """

    plate: str
    change: Array
    error: Array
    usual: Array

    @property
    def significant(self) -> bool:
        """Whether it matters and is more than zeros usually change, in any component."""
        usual = CONTROL_LIMIT * np.hypot(self.error, self.usual)
        return bool(np.any(np.abs(self.change) > np.maximum(MAX_ZERO_CHANGE, usual)))


@dataclass(frozen=True, slots=True)
class DayCheck:
    """What a recording of another day says about a calibration.

    Attributes
    ----------
    verdict
        "valid"; "drifted", the zero of a plate has changed; "offset", "late", "gain", "turned",
        "moved", an accelerometer has; "plates", their gain has; "outdated", something else;
        "faulty", accelerometers or plates cannot be compared: then there are no zeros.
    notes
        The verdict in words, with 95 % intervals and what to do.
    zeros
        Change of the zero of every plate.
    left
        Plate -> RMS below 6 Hz that the calibration leaves of this recording about its mean, (6,)
        [N, N·m].
    """

    verdict: Verdict
    notes: tuple[Note, ...]
    zeros: tuple[ZeroChange, ...]
    left: Mapping[str, Array]


def check_another_day(
    plates: Mapping[str, InertiaModel],
    accelerations: ArrayLike,
    wrenches: Mapping[str, Array],
    recording: str,
    without_delay: Collection[str] = (),
    belts_mps: ArrayLike | None = None,
) -> DayCheck:
    """Compare a calibration with an empty recording of another day.

    Parameters
    ----------
    plates
        Plate -> its model, each with a setup.
    accelerations
        Of the recording, with the calibration's delays and gains undone, through the setup's
        low-pass, (N, k) [m/s²].
    wrenches
        Plate -> wrench at the same instants, equally filtered, (N, 6) [N, N·m].
    recording
        Its name, for the notes.
    without_delay
        Sensors of which the calibration did not estimate the delay: it was stated, or the file is
        of an earlier version. That they are late now shows no change.
    belts_mps
        Speed of the belts at the same instants, (N,) [m/s]; None where it is unknown.

    Returns
    -------
    DayCheck
        Verdict, and what it rests on.

    Raises
    ------
    ValueError
        Wrong shapes or gaps; or a recording that cannot show it: a platform that hardly moves,
        somebody on the boards.

    Notes
    -----
    All signals pass 6 Hz, as residuals do. In order: the delays of the sensors against the plates
    are estimated as in a calibration. Then for each sensor a linear transformation ``T`` (3, 3) of
    its readings about their mean is fitted, with the gains as they are, that explains the plates
    best; a multiple of one is a gain, a rotation a turn, anything else another place on the
    platform. The sensor is the one whose transformation explains most. What is left in the mean is
    the change of the zero, or of a sensor's offset where that sensor's mean reading has changed by
    what explains it. Errors are of a jackknife over 40 blocks.

    What is left is judged by what the calibration expects to leave in this motion, at this belt
    speed, and by what a fit to the recording itself leaves, up to twice what is expected: rollers
    out of balance leave more in one recording than in another, and no new calibration would change
    that. Where such a fit leaves more than is allowed, no change of a sensor is looked for.
    """
    a = read_table(accelerations, "accelerations")
    names, rate = list(plates), _rate_hz(plates)
    stacked = np.hstack([read_table(wrenches[name], name, 6) for name in names])
    fitted = {name: fit_inertia(a, wrenches[name], plates[name].setup) for name in names}
    refuse_unusable(fitted)
    slow, slow_w = (low_pass(x, rate, SLOW_HZ, "zero_phase") for x in (a, stacked))
    sensors = next(iter(plates.values())).sensors
    gain = np.hstack([plates[name].gain for name in names])
    size = np.hstack([_expected(plates[name], a, belts_mps) for name in names])
    error = slow_w - slow @ gain[:-1] - gain[-1]
    left = np.sqrt(np.mean((error - error.mean(axis=0)) ** 2, axis=0))
    by_plate = {name: left[6 * k : 6 * k + 6] for k, name in enumerate(names)}
    if swapped := _swapped(names, slow_w, slow @ gain[:-1] + gain[-1], size):
        note = Note.of("calibration_plates_swapped", recording=recording, plates=swapped)
        return DayCheck("faulty", (note,), (), {})
    late = [
        Note.of(
            "calibration_delay_uncorrected"
            if sensor in without_delay
            else "calibration_sensor_late",
            sensor=sensor,
            change_s=d.seconds,
            interval_s=QUANTILE_95 * d.standard_error,
            recording=recording,
        )
        for sensor, d in zip(sensors, sensor_delays(a, stacked, rate), strict=True)
        if abs(d.seconds) > QUANTILE_95 * d.standard_error + MIN_DELAY_S
    ]
    zeros = _zero_changes(plates, error)
    if late:
        return DayCheck("late", tuple(late), zeros, by_plate)
    own = slow_w - slow @ np.hstack([fitted[n].gain[:-1] for n in names])
    own -= own.mean(axis=0)
    limits = np.tile(MAX_LEFT, len(names))
    unexplained = np.minimum(own.std(axis=0), MAX_UNEXPLAINED * size)
    allowed = np.maximum(limits, 2 * np.maximum(size, unexplained))
    note = Note.of("calibration_outdated", recording=recording)
    outdated = DayCheck("outdated", (note,), zeros, by_plate)
    if np.any(own.std(axis=0) > allowed):
        return outdated
    own_misfit = float(np.sum((own / size) ** 2))
    relative, weighted = error / size, gain[:-1] / size
    scaled, by_plates = plate_gains(names, slow @ weighted, relative)
    changes = [
        sensor_change(sensor, part, weighted[3 * k : 3 * k + 3], relative)
        for k, (sensor, part) in enumerate(
            zip(sensors, np.split(slow, len(sensors), axis=1), strict=True)
        )
    ]
    likely = max(changes, key=lambda change: change.explained)
    found = likeliest(changes)
    excess = float(np.sum((relative - relative.mean(axis=0)) ** 2)) - own_misfit
    simpler = found is not None and found[0] != "moved"
    if MIN_AS_GOOD * by_plates > likely.explained or (by_plates > likely.explained and not simpler):
        if by_plates < MIN_PLATES * excess:
            return outdated
        notes = tuple(plate.note(recording) for plate in scaled)
        return DayCheck("plates", notes, zeros, by_plate)
    if found is not None:
        if likely.explained < MIN_ONE_SENSOR * excess:
            return outdated
        kind, note = found[0], found[1].note(found[0], recording)
        return DayCheck(kind, (note,), zeros, by_plate)
    if np.any(left > allowed):
        return outdated
    drifted = [zero for zero in zeros if zero.significant]
    if drifted:
        change = a.mean(axis=0) - next(iter(plates.values())).acceleration_mean
        of_sensors = np.split(gain[:-1] / limits, len(sensors))
        found_offset = sensor_offset(change, of_sensors, error.mean(axis=0) / limits)
        if found_offset is not None:
            sensor, offset = found_offset
            axes = dict(zip("xyz", offset, strict=True))
            note = Note.of(
                "calibration_sensor_offset",
                sensor=sensors[sensor],
                change_mps2=axes,
                recording=recording,
            )
            return DayCheck("offset", (note,), zeros, by_plate)
        notes = tuple(_drift_note(zero, recording) for zero in drifted)
        return DayCheck("drifted", notes, zeros, by_plate)
    valid = Note.of(
        "calibration_still_valid",
        recording=recording,
        force_n=max(np.linalg.norm(z.change[:3]) for z in zeros),
        moment_nm=max(np.linalg.norm(z.change[3:]) for z in zeros),
        gain=likely.gain - 1,
        interval=QUANTILE_95 * likely.gain_error,
    )
    return DayCheck("valid", (valid,), zeros, by_plate)


def _swapped(names: list[str], measured: Array, predicted: Array, size: Array) -> tuple[str, ...]:
    """Give two plates that fit a calibration much better in each other's place; else none."""

    def misfit(first: int, second: int) -> float:
        order = list(range(len(names)))
        order[first], order[second] = second, first
        columns = np.concatenate([np.arange(6 * k, 6 * k + 6) for k in order])
        return float(np.sum(np.var((measured[:, columns] - predicted) / size, axis=0)))

    pairs = list(combinations(range(len(names)), 2))
    best = min(pairs, key=lambda pair: misfit(*pair), default=(0, 0))
    better = misfit(*best) < misfit(0, 0) / MIN_IMPROVEMENT
    return tuple(names[k] for k in best) if better else ()


def _expected(model: InertiaModel, accelerations: Array, belts_mps: ArrayLike | None) -> Array:
    """Give the RMS below 6 Hz that a calibration expects to leave of a recording, (6,)."""
    sd = model.uncertainty(accelerations, slow=True, zero=False, belts_mps=belts_mps)
    return np.asarray(np.maximum(np.sqrt(np.mean(sd**2, axis=0)), MIN_LEFT))


def _zero_changes(plates: Mapping[str, InertiaModel], error: Array) -> tuple[ZeroChange, ...]:
    means = np.array([block.mean(axis=0) for block in np.array_split(error, BLOCKS)])
    change, sd = error.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(BLOCKS)
    found = []
    for k, (name, model) in enumerate(plates.items()):
        own = slice(6 * k, 6 * k + 6)
        usual = np.zeros(6) if model.model_error is None else model.model_error.zero
        found.append(ZeroChange(name, change[own], sd[own], usual))
    return tuple(found)


def _drift_note(zero: ZeroChange, recording: str) -> Note:
    force, moment = np.argmax(np.abs(zero.change[:3])), 3 + np.argmax(np.abs(zero.change[3:]))
    return Note.of(
        "calibration_drifted",
        plate=zero.plate,
        recording=recording,
        force_n=zero.change[force],
        force_interval_n=QUANTILE_95 * zero.error[force],
        moment_nm=zero.change[moment],
        moment_interval_nm=QUANTILE_95 * zero.error[moment],
    )


def _rate_hz(plates: Mapping[str, InertiaModel]) -> float:
    setup = next(iter(plates.values())).setup
    if setup is None:
        raise ValueError("the model does not state how it was recorded; fit it with a setup")
    return setup.rate_hz
