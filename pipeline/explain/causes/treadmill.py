"""What may be wrong with a moving treadmill: its compensation, and the platform's pose."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import scipy

from compensation import InertiaModel, PlatformPose, interpolate_pose
from compensation.inertia.model_error import SLOW_HZ
from compensation.platform import LEFT
from hbm.signals.resampling import delayed
from hbm.signals.samples import mean_rate_hz
from hbm.spatial import WRENCH_COMPONENTS, Array, rotation_about, shift_wrench
from pipeline.explain.cause import Altered, Cause, Prior, change_of, priors
from pipeline.explain.causes.plates import of_plate, with_added
from pipeline.trial.chain import Chain
from pipeline.trial.ground.platform import in_lab

UP: Final = np.array([0.0, 0.0, 1.0])


def compensation_causes(chain: Chain) -> Iterator[Cause]:
    """Give what compensating the plates of a trial may leave.

    Yields
    ------
    Cause
        The principal directions of what the inertia models may leave, each of one standard
        deviation by the calibration; that the accelerometers are later than the calibration found;
        and per plate the size and delay of what was predicted of its belt. Nothing where nothing
        was subtracted.
    """
    prior_of = priors()
    if chain.accelerations:
        for number, (along, added) in enumerate(principal_directions(chain), start=1):
            # the plate and component to which most is added, 1 N·m counting as 10 N
            sizes = [np.sqrt(np.nanmean(w**2, axis=0)) * [1, 1, 1, 10, 10, 10] for w in added]
            plate, component = divmod(int(np.argmax(sizes)), 6)
            where = f"{WRENCH_COMPONENTS[component]} of plate {chain.plates[plate].number}"
            title = f"compensation: direction {number}, mostly {where}"
            change, usual = partial(_subtracted, more=added), prior_of["inertia_model"]
            yield Cause(title, "compensation", usual, change, of_platform=True, along=along)
        late = _sensors_delay(chain)
        yield Cause("accelerometers delayed", "compensation", late, _late_sensors, True)
    belts = chain.lab.laboratory.belts if chain.belts else ()
    for k, model in enumerate(belts):
        name, size = f"plate {chain.plates[k].number}", prior_of["belt_model"]
        # by the calibration: what the model left of the moment that it was fitted to
        remaining = model.rms_compensated / model.rms_measured
        if np.isfinite(remaining):
            size = replace(size, size=float(remaining))
        larger = of_plate(k, partial(with_added, wrench=-chain.belts[k]))
        later = partial(_late_belt, plate=k)
        yield Cause(f"{name}: size of its belt's moment", "compensation", size, larger)
        yield Cause(f"{name}: belt speed delayed", "compensation", prior_of["belt_delay"], later)


def principal_directions(chain: Chain) -> list[tuple[Array, list[Array]]]:
    """Find the few errors of the inertia models that do most to the residual.

    Parameters
    ----------
    chain
        A trial that was compensated.

    Returns
    -------
    list
        Of each direction, the largest first: the part of each of the models' independent errors,
        (D,), the same errors in all trials; and what one standard deviation of it adds to the
        predicted wrench of each plate, in its own axes, (T, 6) [N, N·m]. Together they have 95 %
        of the variance, unless that takes more than 12; axes of the residual count by its own root
        mean square.

    Notes
    -----
    What a model may leave is a sum of two: the uncertainty of its gains, as its fit has it, and
    what a linear model of few accelerometers does not explain of a motion like the trial's
    (`compensation.inertia.model_error`). The latter is taken as what a small, unknown gain and
    delay of each direction and band would leave: the motion there and its Hilbert transform, each
    with half of the variance per energy. Components are correlated as the calibration found them.
    Noise, belts and zeros are no part of it. Without rounding the directions are those of a
    Karhunen-Loève expansion of the residual.
    """
    factor, rate_hz = _root(chain.lab.correlation), mean_rate_hz(chain.time)
    slow = chain.settings.cutoff_hz <= SLOW_HZ
    # 20 frames a second show what passes the 6 Hz of a trial
    step = max(int(rate_hz / 20.0), 1)
    residual = chain.residual
    weight = 1 / np.sqrt(np.nanmean(residual**2, axis=0))
    signals, effects = [], []
    rows = np.split(factor, len(chain.lab.models))
    for k, (model, readings) in enumerate(zip(chain.lab.models, chain.accelerations, strict=True)):
        basis = _basis(model, readings, rate_hz)
        signals.append(_scaled(model, basis, slow))
        # t frames, a axes of the residual, c components, m independent errors, s signals
        passed = _scaled(model, chain.low_pass(basis)[::step], slow)
        to_residual = _to_residual(chain, k)[::step] * weight[:, None]
        effects.append(np.einsum("tac,cm,tsc->msta", to_residual, rows[k], passed, optimize=True))
    # errors that plates share add up; a row for each error and signal
    whole = np.sum(effects, axis=0)
    is_known = np.isfinite(whole).all(axis=(0, 1, 3)) & np.isfinite(residual[::step]).all(axis=1)
    table = whole[:, :, is_known].reshape(whole.shape[0] * whole.shape[1], -1)
    total = float(np.sum(table**2))
    if not total:
        return []
    most = min(12, min(table.shape) - 1)
    vectors, values, _ = scipy.sparse.linalg.svds(table, most, rng=np.random.default_rng(0))
    order = np.argsort(-values)
    explained = np.cumsum(values[order] ** 2) / total
    directions = []
    for n in order[: int(np.searchsorted(explained, 0.95)) + 1]:
        # from independent errors back to the components of the plates
        sizes = factor @ vectors[:, n].reshape(whole.shape[:2])
        of_plates = np.split(sizes, len(signals))
        pairs = zip(signals, of_plates, strict=True)
        added = [np.einsum("tsc,sc->tc", signal, size.T) for signal, size in pairs]
        directions.append((vectors[:, n], added))
    return directions


def _basis(model: InertiaModel, readings: Array, rate_hz: float) -> Array:
    """Give the signals of which a model's errors are made, (T, S)."""
    design = np.column_stack([readings, np.ones(len(readings))])
    if model.model_error is None:
        return design
    motion = model.model_error.motion(readings[:, : len(model.sensor_noise)], rate_hz)
    is_known = np.isfinite(motion).all(axis=1, keepdims=True)
    # a quarter of a period later: with the motion itself it makes any small gain and delay
    quadrature = np.imag(scipy.signal.hilbert(np.where(is_known, motion, 0.0), axis=0))
    return np.hstack([design, motion, np.where(is_known, quadrature, np.nan)])


def _scaled(model: InertiaModel, basis: Array, slow: bool) -> Array:
    """Give what one standard deviation of each of a model's errors adds, (T, S, 6)."""
    # correlated errors of the gains of each component become independent ones
    gains = basis[:, : len(model.gain)]
    parts = [np.stack([gains @ _root(covariance) for covariance in model.covariance], axis=2)]
    if model.model_error is not None:
        # half of the variance for the motion, half for its quadrature
        size = np.sqrt(np.tile(model.model_error.per_energy[int(slow)], (2, 1)) / 2)
        parts.append(basis[:, len(model.gain) :, None] * size)
    return np.concatenate(parts, axis=1)


def _root(covariance: Array) -> Array:
    """Give a square root of a covariance, which may be singular."""
    # by eigenvalues: Cholesky's factor needs all of them above zero
    variance, directions = np.linalg.eigh(covariance)
    return np.asarray(directions * np.sqrt(np.maximum(variance, 0)))


def _to_residual(chain: Chain, plate: int) -> Array:
    """Give what a wrench of a plate, in its own axes, is in the residual, (T, 6, 6)."""
    units = [np.tile(unit, (len(chain.time), 1)) for unit in np.eye(6)]
    moved = [in_lab([unit], [chain.plates[plate]], chain.platform)[0] for unit in units]
    # about the pelvis origin, where the residual is
    return np.stack([shift_wrench(unit, chain.filtered.value[:, :3]) for unit in moved], axis=2)


def _sensors_delay(chain: Chain) -> Prior:
    """Give how much later the accelerometers may be than the calibration found."""
    sensors, between = chain.lab.sensors, priors()["accelerometer_delay_between_days"]
    errors = [s.delay_error_s for s in sensors if s.delay_error_s is not None]
    if not errors or len(errors) < len(sensors):
        return priors()["accelerometer_delay"]
    size = np.linalg.norm([max(errors), chain.lab.sensors_apart_s, between.size])
    return replace(between, size=float(size))


def _subtracted(chain: Chain, size: float, *, more: Sequence[Array]) -> Chain:
    """Subtract more than was subtracted, by a wrench per plate times a size."""
    rest = [wrench - size * added for wrench, added in zip(chain.wrenches, more, strict=True)]
    return chain.changed(wrenches=tuple(rest))


def _late_sensors(chain: Chain, delay_s: float) -> Chain:
    """Make the accelerometers later [s]."""
    later = tuple(delayed(chain.time, readings, delay_s) for readings in chain.accelerations)
    # the zeros, last in the gain, are the same before and after
    added = [
        (after - before) @ model.gain[:-1]
        for model, before, after in zip(chain.lab.models, chain.accelerations, later, strict=True)
    ]
    return _subtracted(chain, 1.0, more=added).changed(accelerations=later)


def _late_belt(chain: Chain, delay_s: float, *, plate: int) -> Chain:
    """Make the channel of a belt's speed later [s]."""
    later = list(chain.belts)
    later[plate] = delayed(chain.time, later[plate], delay_s)
    # what was predicted of the belt has been subtracted: the change of it is subtracted too
    less = with_added(chain.wrenches[plate], -1.0, wrench=later[plate] - chain.belts[plate])
    wrenches = [less if k == plate else wrench for k, wrench in enumerate(chain.wrenches)]
    return chain.changed(wrenches=tuple(wrenches), belts=tuple(later))


def platform_causes(chain: Chain) -> Iterator[Cause]:
    """Give what may be wrong with the platform's pose in a trial.

    Yields
    ------
    Cause
        Of markers: zero of sway and pitch. Of channels: these, delay, size of sway and pitch, and
        direction of the axis about the vertical; where there is pitch, the place of its axis too.
        Nothing where the platform stands still.
    """
    platform = chain.lab.laboratory.treadmill.platform
    if chain.platform is None or platform is None:
        return
    kind = "marker" if platform.markers else "channel"
    under = np.mean([plate.center for plate in chain.plates], axis=0)
    pitch = partial(_pitch, center=under)
    yield _of_pose("zero of sway", f"{kind}_sway_zero", _sway, moving=False)
    yield _of_pose("zero of pitch", f"{kind}_pitch_zero", pitch, moving=False)
    if platform.markers:
        return
    yield _of_pose("late", "pose_delay", partial(_late, time=chain.time))
    if platform.sway_channel:
        yield _of_pose("size of sway", "pose_size", _larger_sway)
    if platform.pitch_channel:
        yield _of_pose("size of pitch", "pose_size", _larger_pitch)
        yield _of_pose("pivot along x", "pivot", partial(_pivot, along=np.eye(3)[0]))
        yield _of_pose("pivot along z", "pivot", partial(_pivot, along=UP))
    yield _of_pose("direction about z", "pose_direction", _turned)


def _of_pose(title: str, kind: str, altered: Altered, *, moving: bool = True) -> Cause:
    """Give a cause that alters the pose by its size."""
    change = change_of("platform", altered)
    return Cause(f"platform: {title}", "platform", priors()[kind], change, of_platform=moving)


def _late(pose: PlatformPose, delay_s: float, *, time: Array) -> PlatformPose:
    """Make the pose later [s]; the ends are held, gaps stay where they are."""
    known_s = time[np.flatnonzero(np.isfinite(pose.position).all(axis=1))]
    later = interpolate_pose(pose, time, np.clip(time - delay_s, known_s[0], known_s[-1]))
    # frames that are unknown before or after the delay stay as they were
    gap = np.asarray(np.isnan(later.position + pose.position).any(axis=1, keepdims=True))
    return PlatformPose(
        np.where(gap[:, None], pose.rotation, later.rotation),
        np.where(gap, pose.position, later.position),
    )


def _sway(pose: PlatformPose, size: float) -> PlatformPose:
    """Take the platform to be farther to the left [m]."""
    return PlatformPose(pose.rotation, pose.position + size * LEFT)


def _pitch(pose: PlatformPose, size: float, *, center: Array) -> PlatformPose:
    """Take the platform to be pitched farther [rad], about a lateral axis through a point."""
    turn = rotation_about(LEFT, size)
    # a turn about a point c moves the origin by c - R c
    moved = pose.position + pose.rotation @ (center - turn @ center)
    return PlatformPose(pose.rotation @ turn, moved)


def _larger_sway(pose: PlatformPose, share: float) -> PlatformPose:
    """Take the platform to sway by a share farther."""
    return PlatformPose(pose.rotation, pose.position + share * pose.position * LEFT)


def _larger_pitch(pose: PlatformPose, share: float) -> PlatformPose:
    """Take the platform to pitch by a share farther, about the axis that its pose shows.

    In the plane of pitch the position is ``p - R p``: the point ``p`` of the axis is found from all
    frames.
    """
    plane = [0, 2]
    is_known = np.isfinite(pose.position).all(axis=1)
    # (I - R) p = position, two rows for each frame
    still = np.eye(3) - pose.rotation
    rows = still[is_known][:, plane][:, :, plane].reshape(-1, 2)
    point = np.zeros(3)
    point[plane] = np.linalg.lstsq(rows, pose.position[is_known][:, plane].ravel())[0]
    turn = rotation_about(LEFT, share * pose.pitch)
    in_plane = point - pose.rotation @ turn @ point
    return PlatformPose(pose.rotation @ turn, pose.position * LEFT + in_plane)


def _turned(pose: PlatformPose, angle: float) -> PlatformPose:
    """Take the platform's axes of motion to be turned about the vertical [rad]."""
    # the same motion seen in turned axes: T R T' and T p
    turn = rotation_about(UP, angle)
    return PlatformPose(turn @ pose.rotation @ turn.T, pose.position @ turn.T)


def _pivot(pose: PlatformPose, size: float, *, along: Array) -> PlatformPose:
    """Take the axis of pitch to be where it is not, by a size [m] along a direction."""
    return PlatformPose(pose.rotation, pose.position + size * (along - pose.rotation @ along))
