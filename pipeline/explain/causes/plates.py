"""What may be wrong with force plates: delay, zeros, gains, cross-talk, places and directions.

How large each may be is narrowed by what calibrations and the trial itself say of its plates,
before its residual is looked at.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from compensation import PlateCalibration
from hbm.signals.resampling import interpolate
from hbm.signals.samples import stretches
from hbm.spatial import WRENCH_COMPONENTS, Array, rotation_about, shift_wrench, transform_wrench
from pipeline.explain.cause import Cause, Prior, priors
from pipeline.explain.processing_chain import ProcessingChain
from pipeline.io.recording import Plate
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.ground.platform import plate_marker_delay

MIN_SWING_S: Final = 0.2
EDGE_S: Final = 0.05
"""Of an unloaded stretch at either end, in which the filter of a calibration smears the load."""
MIN_SWINGS: Final = 3
"""Below them nothing shows how much one differs from another."""
MIN_NARROWED: Final = 0.1
"""Of a usual size that is left even by a calibration without error: days differ."""


@dataclass(frozen=True, slots=True)
class PlatePriors:
    """How wrong one plate may be, in its own axes.

    Attributes
    ----------
    zero, gain
        Of each component, 6.
    cross_talk
        Of the vertical force in the two horizontal ones.
    place, direction
        Along and about each axis, 3.
    """

    zero: tuple[Prior, ...]
    gain: tuple[Prior, ...]
    cross_talk: tuple[Prior, ...]
    place: tuple[Prior, ...]
    direction: tuple[Prior, ...]


@dataclass(frozen=True, slots=True)
class KnownPlates:
    """How wrong the plates of a trial may be.

    Attributes
    ----------
    delay
        Of all plates.
    plates
        Each plate, in their order.
    delay_is_measured
        Whether the delay is from a measurement of the plates or of the platform.
    """

    delay: Prior
    plates: tuple[PlatePriors, ...]
    delay_is_measured: bool = False


def usual_plates(plates: int) -> KnownPlates:
    """Give how wrong a number of plates may be of which nothing is known."""
    known = priors()
    force, moment = known["zero_force"], known["zero_moment"]
    one = PlatePriors(
        zero=(force,) * 3 + (moment,) * 3,
        gain=(known["gain"],) * 6,
        cross_talk=(known["cross_talk"],) * 2,
        place=(known["place"],) * 3,
        direction=(known["direction"],) * 3,
    )
    return KnownPlates(known["delay"], (one,) * plates)


def known_plates(chain: ProcessingChain, laboratory: Laboratory) -> KnownPlates:
    """Narrow what may be wrong with the plates of a trial by what is known of them.

    Parameters
    ----------
    chain
        The trial.
    laboratory
        The treadmill and its calibrations.

    Returns
    -------
    KnownPlates
        Usual sizes, but where one of these says more: of the delay, a calibration of the plates, a
        statement, or the platform's own motion in markers and accelerometers; of gain, cross-talk,
        place and direction, a calibration of the plates; of zeros, what the plates read in this
        trial while nobody is on them, and only without that the treadmill's calibration: zeros
        drift, and may be set anew, from one recording to the next.
    """
    usual = usual_plates(len(chain.plates))
    models = () if chain.subtracted is None else chain.subtracted.models
    plates = []
    for k, (plate, one) in enumerate(zip(chain.plates, usual.plates, strict=True)):
        if laboratory.plates is not None:
            calibration = laboratory.plates.calibrations.of(plate.number)
            if calibration is not None:
                one = calibrated(one, calibration, plate)
        threshold_n = chain.settings.contact_threshold_n
        swing = swing_zero(chain.time, chain.wrenches[k], plate, threshold_n)
        error = models[k].model_error if models else None
        if swing is not None:
            one = replace(one, zero=narrowed(one.zero, *swing))
        elif error is not None:
            source = "the treadmill's calibration: zeros of its recordings"
            spread = np.minimum([z.size for z in one.zero], error.zero)
            zero = tuple(
                replace(z, size=max(float(size), MIN_NARROWED * z.size), source=source)
                for z, size in zip(one.zero, spread, strict=True)
            )
            one = replace(one, zero=zero)
        plates.append(one)
    measured = _measured_delay(chain, laboratory, usual.delay)
    stated = chain.settings.plate_delay_s is not None
    delay = measured or (priors()["stated_delay"] if stated else usual.delay)
    return KnownPlates(delay, tuple(plates), delay_is_measured=measured is not None)


def swing_zero(
    time: Array, wrench: Array, plate: Plate, threshold_n: float
) -> tuple[Array, Array] | None:
    """Find what a plate reads while nobody is on it.

    Parameters
    ----------
    time
        Frame times, (T,) [s].
    wrench
        In the plate's own axes, (T, 6) [N, N·m].
    plate
        The plate.
    threshold_n
        Vertical force below which it counts as unloaded [N].

    Returns
    -------
    mean, standard_error
        Of the means of at least three stretches of 0.2 s or longer, without 0.05 s at either end,
        (6,) each [N, N·m]; None where there are fewer.

    Notes
    -----
    The standard error is that of the mean over stretches, which differ by noise, vibration and
    drift, and what is the same in all of them without being a zero (``swing_zero_force`` and
    ``swing_zero_moment`` of `priors`).

    Examples
    --------
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> import pipeline
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0, plate_noise_n=0)
    >>> plate = pipeline.read_c3d("walk.c3d").plates[0]
    >>> wrong = plate.wrench_in_plate + [2.0, 0, 0, 0, 0, 0]
    >>> mean, error = swing_zero(plate.time, wrong, plate, 20.0)
    >>> bool(abs(mean[0] - 2.0) < 1e-6)
    True
    """
    vertical = wrench[:, :3] @ plate.rotation[2]
    free = np.abs(vertical) < threshold_n
    step_s = float(np.median(np.diff(time)))
    edge, shortest = round(EDGE_S / step_s), round(MIN_SWING_S / step_s)
    means = [
        wrench[start + edge : stop - edge].mean(axis=0)
        for start, stop in stretches(free)
        if stop - start >= shortest
    ]
    if len(means) < MIN_SWINGS:
        return None
    known = priors()
    same = np.repeat([known["swing_zero_force"].size, known["swing_zero_moment"].size], 3)
    error = np.std(means, axis=0, ddof=1) / np.sqrt(len(means))
    return np.mean(means, axis=0), np.hypot(error, same)


def narrowed(prior: Sequence[Prior], mean: Array, error: Array) -> tuple[Prior, ...]:
    """Combine what is expected of zeros with what was measured of them, (6,) each [N, N·m]."""
    result = []
    for before, value, sd in zip(prior, mean, error, strict=True):
        precision = before.size**-2 + sd**-2
        both = (before.mean * before.size**-2 + value * sd**-2) / precision
        source = "what the plate reads in this trial while nobody is on it"
        result.append(
            replace(before, size=float(precision**-0.5), mean=float(both), source=source, advice="")
        )
    return tuple(result)


def calibrated(usual: PlatePriors, calibration: PlateCalibration, plate: Plate) -> PlatePriors:
    """Narrow what may be wrong with a plate by the errors of its calibration.

    Parameters
    ----------
    usual
        Without the calibration.
    calibration
        Of the plate. Its response to components that its recordings did not excite stays as
        unknown as it was.
    plate
        The plate: errors are brought from the lab's axes to its own.

    Returns
    -------
    PlatePriors
        Never larger than usual, nor smaller than a tenth of that.
    """
    unknown = [name not in calibration.examined for name in WRENCH_COMPONENTS]
    variance = np.where(unknown, np.inf, calibration.standard_error**2)
    square = np.kron(np.eye(2), plate.rotation**2)
    # 0 · inf: an unknown component that has no part in another
    used = np.where(np.isinf(variance), 1e12, variance)
    error = np.sqrt(square.T @ used @ square)

    def narrow(prior: Prior, *errors: float) -> Prior:
        size = max(min(errors), MIN_NARROWED * prior.size)
        if size >= prior.size:
            return prior
        return replace(prior, size=float(size), source="the calibration of the plates", advice="")

    lever = error[3:, :3]
    return replace(
        usual,
        gain=tuple(narrow(p, error[i, i]) for i, p in enumerate(usual.gain)),
        cross_talk=tuple(narrow(p, error[i, 2]) for i, p in enumerate(usual.cross_talk)),
        place=(
            narrow(usual.place[0], lever[1, 2], lever[2, 1]),
            narrow(usual.place[1], lever[0, 2], lever[2, 0]),
            narrow(usual.place[2], lever[0, 1], lever[1, 0]),
        ),
        direction=(
            narrow(usual.direction[0], error[1, 2], error[2, 1]),
            narrow(usual.direction[1], error[0, 2], error[2, 0]),
            narrow(usual.direction[2], error[0, 1], error[1, 0]),
        ),
    )


def _measured_delay(chain: ProcessingChain, laboratory: Laboratory, usual: Prior) -> Prior | None:
    """Narrow the delay of the plates by their calibration or the platform's motion, if possible."""
    known = priors()
    plates = laboratory.plates
    measured = [
        one is not None and one.delay_s is not None
        for one in (plates.calibrations.of(p.number) if plates else None for p in chain.plates)
    ]
    if all(measured):
        return known["calibrated_delay"]
    platform, done = laboratory.treadmill.platform, chain.subtracted
    if platform is not None and platform.markers and done is not None and done.felt:
        assert chain.pose is not None
        rate_hz = (len(chain.time) - 1) / float(chain.time[-1] - chain.time[0])
        readings = done.felt[0][:, : len(done.models[0].acceleration_mean)]
        late = plate_marker_delay(chain.pose, readings, rate_hz)
        if late is not None:
            error, least = late.standard_error, known["calibrated_delay"].size
            size = float(np.linalg.norm([error, done.sensors_apart_s, least]))
            source = "the platform's motion in its markers and accelerometers"
            return replace(usual, size=size, mean=late.seconds, source=source, advice="")
    return None


def plate_causes(
    chain: ProcessingChain,
    known: KnownPlates | None = None,
    delay: tuple[float, float] | None = None,
) -> Iterator[Cause]:
    """Give what may be wrong with the plates of a trial.

    Parameters
    ----------
    chain
        The trial.
    known
        What is known of its plates, as `known_plates` finds it; by default nothing.
    delay
        Their delay as the whole body's motion shows it, and one standard deviation [s]; by default
        the residuals show it.

    Yields
    ------
    Cause
        That all plates are late, and per plate: its zeros and gains by component, cross-talk of the
        vertical force into the horizontal ones, and its place and direction. All are faults of the
        plate in its own axes, which move with the platform.
    """
    known = known or usual_plates(len(chain.plates))
    yield Cause("plates are late", "delay", known.delay, late, found=delay)
    for k, (plate, prior) in enumerate(zip(chain.plates, known.plates, strict=True)):
        name = f"plate {plate.number}"
        for i, component in enumerate(WRENCH_COMPONENTS):
            change = partial(_with_load, plate=k, gain=np.zeros((6, 6)), zero=np.eye(6)[i])
            yield Cause(f"{name}: zero of {component}", "zero", prior.zero[i], change)
        for i, component in enumerate(WRENCH_COMPONENTS):
            gain = np.diag(np.eye(6)[i])
            change = partial(_with_load, plate=k, gain=gain, zero=np.zeros(6))
            yield Cause(f"{name}: gain of {component}", "gain", prior.gain[i], change)
        for i, component in enumerate(WRENCH_COMPONENTS[:2]):
            gain = np.zeros((6, 6))
            gain[i, 2] = 1.0
            change = partial(_with_load, plate=k, gain=gain, zero=np.zeros(6))
            title = f"{name}: Fz in {component}"
            yield Cause(title, "gain", prior.cross_talk[i], change)
        for i, (axis, letter) in enumerate(zip(np.eye(3), "xyz", strict=True)):
            moved, turned = partial(_moved, plate=k, by=axis), partial(_turned, plate=k, about=axis)
            yield Cause(f"{name}: place along {letter}", "place", prior.place[i], moved)
            title = f"{name}: direction about {letter}"
            yield Cause(title, "place", prior.direction[i], turned)


def late(chain: ProcessingChain, delay_s: float) -> ProcessingChain:
    """Make the plates later [s] than markers and platform; the ends are held."""
    return chain.with_wrenches([delayed(chain.time, each, delay_s) for each in chain.wrenches])


def _with_load(
    chain: ProcessingChain, size: float, *, plate: int, gain: Array, zero: Array
) -> ProcessingChain:
    """Add a share of a plate's wrench, as a matrix, and a constant wrench, each times a size."""
    wrench = chain.wrenches[plate]
    return _with_plate(chain, plate, wrench + size * (wrench @ gain.T + zero))


def _moved(chain: ProcessingChain, size: float, *, plate: int, by: Array) -> ProcessingChain:
    """Take a plate to be where it is not, by a vector in its own axes times a size [m]."""
    return _with_plate(chain, plate, shift_wrench(chain.wrenches[plate], -size * by))


def _turned(chain: ProcessingChain, size: float, *, plate: int, about: Array) -> ProcessingChain:
    """Take a plate to be turned about an axis of its own through its centre [rad]."""
    turn = rotation_about(about, size)
    return _with_plate(chain, plate, transform_wrench(chain.wrenches[plate], turn, np.zeros(3)))


def _with_plate(chain: ProcessingChain, plate: int, wrench: Array) -> ProcessingChain:
    wrenches = list(chain.wrenches)
    wrenches[plate] = wrench
    return chain.with_wrenches(wrenches)


def delayed(time: Array, values: Array, delay_s: float) -> Array:
    """Give a signal that comes later.

    Parameters
    ----------
    time
        Frame times, (T,) [s].
    values
        (T, ...); gaps are NaN.
    delay_s
        By how much [s]; negative for earlier.

    Returns
    -------
    Array
        (T, ...). Before the first and after the last known value these are held; gaps stay where
        they are.

    Examples
    --------
    >>> time = np.arange(6.0)
    >>> delayed(time, time**2, 0.5).round(2).tolist()
    [0.0, 0.25, 2.25, 6.25, 12.25, 20.25]
    """
    at = np.clip(time - delay_s, time[0], time[-1])
    later = interpolate(time, values, at)
    return np.asarray(np.where(np.isnan(later), values, later))
