"""What may be wrong with force plates: delay, zeros, gains, cross-talk, places and directions.

How large each may be is narrowed by what calibrations and the trial itself say of its plates,
before its residual is looked at.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np

from hbm.numbers import read_numbers
from hbm.signals.resampling import delayed
from hbm.signals.samples import mean_rate_hz, stretches
from hbm.spatial import WRENCH_COMPONENTS, Array, rotation_about, shift_wrench, transform_wrench
from pipeline.explain.cause import Altered, Cause, Change, Prior, change_of, priors
from pipeline.io.recording import Plate
from pipeline.trial.chain import Chain
from pipeline.trial.ground.platform import plate_marker_delay

LIMITS: Final = read_numbers("pipeline.explain", "thresholds.toml", "plates")
UNKNOWN: Final = 1e12
"""Variance of a response that no calibration examined."""


def plate_causes(chain: Chain, delay: tuple[float, float] = (np.nan, np.nan)) -> Iterator[Cause]:
    """Give what may be wrong with the plates of a trial.

    Parameters
    ----------
    chain
        The trial.
    delay
        How much later than the markers the whole body's motion shows the plates to be, and one
        standard deviation [s]; NaN where it does not show it, so that the delay keeps its usual
        size. A measurement of the plates or the platform goes before it; with that, or None, the
        residuals show the delay.

    Yields
    ------
    Cause
        That all plates delayed, and per plate: its zeros and gains by component, cross-talk of the
        vertical force into the horizontal ones, and its place and direction. All are faults of the
        plate in its own axes, which move with the platform.
    """
    late, shown = _measured_delay(chain), None
    if late is None:
        is_stated = chain.settings.plate_delay_s is not None
        late = priors()["stated_delay" if is_stated else "delay"]
        shown = delay if np.isfinite(delay[0]) else (late.mean, late.size)
    yield Cause("plates delayed", "delay", late, _late, found=shown)
    for k, plate in enumerate(chain.plates):
        name, error = f"plate {plate.number}", response_error(chain, plate)
        in_lab, zero_priors = components_in_lab(plate), zeros(chain, k)
        for i, component in enumerate(WRENCH_COMPONENTS):
            shifted = of_plate(k, partial(with_added, wrench=np.eye(6)[i]))
            title = f"{name}: zero of {component}"
            yield Cause(title, "zero", zero_priors[i], shifted, in_lab=in_lab.get(i, ""))
        for title, group, kind, bounds, altered, i in _responses():
            prior = priors()[kind].calibrated(float(min(error[bound] for bound in bounds)))
            change, direction = of_plate(k, altered), in_lab.get(i, "")
            yield Cause(f"{name}: {title}", group, prior, change, in_lab=direction)


def components_in_lab(plate: Plate) -> dict[int, str]:
    """Give what components of a plate's wrench are in the lab, where it is parallel to the lab."""
    names = (
        *("forward force", "sideways force", "vertical force"),
        *("roll moment", "pitch moment", "yaw moment"),
    )
    cosines = np.abs(plate.rotation)
    along = {int(i): int(axis) for axis, i in np.argwhere(cosines > LIMITS.parallel_cosine)}
    return {3 * kind + i: names[3 * kind + axis] for kind in (0, 1) for i, axis in along.items()}


def of_plate(plate: int, altered: Altered) -> Change:
    """Give the change by a fault of one plate."""

    def of_all(wrenches: Sequence[Array], size: float) -> tuple[Array, ...]:
        return (*wrenches[:plate], altered(wrenches[plate], size), *wrenches[plate + 1 :])

    return change_of("wrenches", of_all)


def _responses() -> Iterator[tuple[str, str, str, Sequence[tuple[int, int]], Altered, int]]:
    """Give faults of a plate's response to load: name, group, kind, bounds, fault, component.

    The bounds are entries of the response's error, (6, 6), none of which the fault can exceed.
    """
    axes = np.eye(6)
    for i, component in enumerate(WRENCH_COMPONENTS):
        # (i, j) of a gain matrix is what component j of the load adds to component i
        gain = partial(_with_gain, gain=np.diag(axes[i]))
        yield f"gain of {component}", "gain", "gain", [(i, i)], gain, i
    for i, component in enumerate(WRENCH_COMPONENTS[:2]):
        talk = partial(_with_gain, gain=np.outer(axes[i], axes[2]))
        yield f"Fz in {component}", "gain", "cross_talk", [(i, 2)], talk, i
    for i, letter in enumerate("xyz"):
        # a step along i changes moments j and k by forces k and j; a turn about i mixes j and k
        j, k = (i + 1) % 3, (i + 2) % 3
        moved, turned = partial(_moved, by=axes[i, :3]), partial(_turned, about=axes[i, :3])
        yield f"place along {letter}", "place", "place", [(3 + j, k), (3 + k, j)], moved, -1
        yield f"direction about {letter}", "place", "direction", [(j, k), (k, j)], turned, -1


def response_error(chain: Chain, plate: Plate) -> Array:
    """Give the standard error of a plate's response by its calibration, in its own axes, (6, 6).

    Responses to components that its recordings did not excite are unknown; without a calibration
    all are.
    """
    plates = chain.lab.laboratory.plates
    calibration = None if plates is None else plates.calibrations.of(plate.number)
    if calibration is None:
        return np.full((6, 6), np.sqrt(UNKNOWN))
    unknown = [name not in calibration.examined for name in WRENCH_COMPONENTS]
    variance = np.where(unknown, UNKNOWN, np.minimum(calibration.standard_error**2, UNKNOWN))
    # from the calibration's axes to the plate's: variances turn by squared direction cosines
    square = np.kron(np.eye(2), plate.rotation**2)
    return np.asarray(np.sqrt(square.T @ variance @ square))


def zeros(chain: Chain, k: int) -> Sequence[Prior]:
    """Give how wrong the zeros of a plate's components may be, 6.

    Usual sizes, but where the plate's readings of this trial while nobody is on it say more, and
    only without these the treadmill's calibration: zeros drift, and may be set anew, from one
    recording to the next.
    """
    usual = [priors()["zero_force"]] * 3 + [priors()["zero_moment"]] * 3
    threshold_n = chain.settings.contact_threshold_n
    swing = swing_zero(chain.time, chain.wrenches[k], chain.plates[k], threshold_n)
    if swing is not None:
        # a measurement that tells less than what is usual says nothing
        return [
            prior.narrowed(float(error), float(mean)) if error < prior.size else prior
            for prior, mean, error in zip(usual, *swing, strict=True)
        ]
    left = chain.lab.models[k].model_error if chain.lab.models else None
    if left is None:
        return usual
    return [prior.calibrated(float(zero)) for prior, zero in zip(usual, left.zero, strict=True)]


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
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
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
    # at the ends of an unloaded stretch the filter of a calibration smears the load
    edge, shortest = round(LIMITS.edge / step_s), round(LIMITS.shortest_swing / step_s)
    means = [
        wrench[start + edge : stop - edge].mean(axis=0)
        for start, stop in stretches(free)
        if stop - start >= shortest
    ]
    if len(means) < LIMITS.fewest_swings:
        return None
    # what all swings have alike without being a zero does not show in their spread
    common = [priors()[f"swing_zero_{kind}"].size for kind in ("force", "moment")]
    same = np.repeat(common, 3)
    error = np.std(means, axis=0, ddof=1) / np.sqrt(len(means))
    return np.mean(means, axis=0), np.hypot(error, same)


def _measured_delay(chain: Chain) -> Prior | None:
    """Give the delay of the plates by their calibration or the platform's motion, if possible."""
    prior_of, laboratory = priors(), chain.lab.laboratory
    if laboratory.plates is not None:
        calibrations = [laboratory.plates.calibrations.of(p.number) for p in chain.plates]
        if all(one is not None and one.delay_s is not None for one in calibrations):
            return prior_of["calibrated_delay"]
    platform = laboratory.treadmill.platform
    if platform is not None and platform.markers and chain.accelerations:
        assert chain.platform is not None
        readings = chain.accelerations[0][:, : len(chain.lab.models[0].acceleration_mean)]
        late = plate_marker_delay(chain.platform, readings, mean_rate_hz(chain.time))
        if late is not None:
            # the estimate's error, what sensors differ by, and what a calibrated delay may be wrong
            least = prior_of["calibrated_delay"].size
            size = np.linalg.norm([late.standard_error, chain.lab.sensors_apart_s, least])
            return prior_of["delay"].narrowed(float(size), late.seconds)
    return None


def _late(chain: Chain, delay_s: float) -> Chain:
    """Make the plates later [s] than markers and platform; the ends are held."""
    later = [delayed(chain.time, wrench, delay_s) for wrench in chain.wrenches]
    return chain.changed(wrenches=tuple(later))


def with_added(measured: Array, size: float, *, wrench: Array) -> Array:
    """Add a wrench times a size."""
    return measured + size * wrench


def _with_gain(wrench: Array, share: float, *, gain: Array) -> Array:
    """Add a share of the wrench, by a matrix."""
    return wrench + share * (wrench @ gain.T)


def _moved(wrench: Array, size: float, *, by: Array) -> Array:
    """Take the plate to be where it is not, by a vector in its own axes times a size [m]."""
    return shift_wrench(wrench, -size * by)


def _turned(wrench: Array, angle: float, *, about: Array) -> Array:
    """Take the plate to be turned about an axis of its own through its centre [rad]."""
    return transform_wrench(wrench, rotation_about(about, angle), np.zeros(3))
