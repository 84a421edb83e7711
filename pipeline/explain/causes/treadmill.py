"""What may be wrong with a moving treadmill: its compensation, and the platform's pose."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from scipy.signal import hilbert
from scipy.sparse.linalg import svds

from compensation import InertiaModel, PlatformPose, interpolate_pose
from compensation.inertia.model_error import SLOW_HZ
from compensation.platform import LEFT
from hbm.spatial import WRENCH_COMPONENTS, Array, rotation_about, shift_wrench
from pipeline.config.schema import Platform
from pipeline.explain.cause import Cause, Change, Prior, priors
from pipeline.explain.causes.plates import delayed
from pipeline.explain.processing_chain import ProcessingChain
from pipeline.explain.subtracted import Subtracted
from pipeline.trial.ground.platform import in_lab

SHARE: Final = 0.95
MOST: Final = 12
"""Of the variance that the models may leave, and directions that are given for it at most."""
THINNED_HZ: Final = 20.0
"""Rate that shows what passes the 6 Hz of a trial."""
UP: Final = np.array([0.0, 0.0, 1.0])


def compensation_causes(chain: ProcessingChain) -> Iterator[Cause]:
    """Give what compensating the plates of a trial may leave.

    Yields
    ------
    Cause
        The principal directions of what the inertia models may leave, each of one standard
        deviation by the calibration; that the accelerometers are later than the calibration found;
        and per plate the size and delay of what was predicted of its belt. Nothing where nothing
        was subtracted.
    """
    done = chain.subtracted
    if done is None:
        return
    known = priors()
    if done.models:
        for number, (along, added) in enumerate(principal_directions(chain), start=1):
            plate, component = _largest(added)
            where = f"{WRENCH_COMPONENTS[component]} of plate {chain.plates[plate].number}"
            title = f"compensation: direction {number}, mostly {where}"
            subtract = partial(_without, added=added)
            usual = known["inertia_model"]
            yield Cause(title, "compensation", usual, subtract, of_platform=True, along=along)
        late = _sensors_prior(done, known)
        yield Cause("accelerometers are late", "compensation", late, _late_sensors, True)
    for k, (model, belt) in enumerate(zip(done.belt_models, done.belts, strict=True)):
        name = f"plate {chain.plates[k].number}"
        left = model.rms_compensated / model.rms_measured
        share = known["belt_model"]
        if np.isfinite(left):
            share = replace(share, size=float(left), source="what the belts' calibration left")
        added = [np.zeros_like(w) for w in chain.wrenches]
        added[k] = belt
        larger = partial(_without, added=added)
        yield Cause(f"{name}: size of its belt's moment", "compensation", share, larger)
        later = partial(_late_belt, plate=k)
        yield Cause(f"{name}: belt's speed is late", "compensation", known["belt_delay"], later)


def principal_directions(chain: ProcessingChain) -> list[tuple[Array, list[Array]]]:
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
    done = chain.subtracted
    assert done is not None
    factor = _root(done.correlation)
    rate_hz = (len(chain.time) - 1) / float(chain.time[-1] - chain.time[0])
    bases = [
        _basis(model, felt, rate_hz) for model, felt in zip(done.models, done.felt, strict=True)
    ]
    slow = chain.settings.cutoff_hz <= SLOW_HZ
    step = max(int(rate_hz / THINNED_HZ), 1)
    residual = chain.residual
    weight = 1 / np.sqrt(np.nanmean(residual**2, axis=0))
    effects = []
    for k, (model, basis) in enumerate(zip(done.models, bases, strict=True)):
        passed = _scaled(model, chain.low_pass(basis)[::step], slow)
        to_residual = _to_residual(chain, k)[::step] * weight[:, None]
        own = factor[6 * k : 6 * k + 6]
        effects.append(np.einsum("tac,cm,tsc->msta", to_residual, own, passed, optimize=True))
    whole = np.sum(effects, axis=0)
    known = np.isfinite(whole).all(axis=(0, 1, 3)) & np.isfinite(residual[::step]).all(axis=1)
    table = whole[:, :, known].reshape(whole.shape[0] * whole.shape[1], -1)
    total = float(np.sum(table**2))
    if not total:
        return []
    most = min(MOST, min(table.shape) - 1)
    vectors, values, _ = svds(table, most, rng=np.random.default_rng(0))
    order = np.argsort(-values)
    explained = np.cumsum(values[order] ** 2) / total
    count = int(np.searchsorted(explained, SHARE)) + 1
    signals = [_scaled(model, basis, slow) for model, basis in zip(done.models, bases, strict=True)]
    return [
        (
            vectors[:, n],
            [
                np.einsum("tsc,sc->tc", signal, (factor[6 * k : 6 * k + 6] @ sizes).T)
                for k, signal in enumerate(signals)
            ],
        )
        for n, sizes in ((n, vectors[:, n].reshape(whole.shape[:2])) for n in order[:count])
    ]


def _basis(model: InertiaModel, felt: Array, rate_hz: float) -> Array:
    """Give the signals of which a model's errors are made, (T, S)."""
    design = np.column_stack([felt, np.ones(len(felt))])
    if model.model_error is None:
        return design
    motion = model.model_error.motion(felt[:, : len(model.sensor_noise)], rate_hz)
    known = np.isfinite(motion).all(axis=1, keepdims=True)
    quadrature = np.imag(hilbert(np.where(known, motion, 0.0), axis=0))
    return np.hstack([design, motion, np.where(known, quadrature, np.nan)])


def _scaled(model: InertiaModel, basis: Array, slow: bool) -> Array:
    """Give what one standard deviation of each of a model's errors adds, (T, S, 6)."""
    gains = basis[:, : len(model.gain)]
    parts = [np.stack([gains @ _root(each) for each in model.covariance], axis=2)]
    if model.model_error is not None:
        size = np.sqrt(np.tile(model.model_error.per_energy[int(slow)], (2, 1)) / 2)
        parts.append(basis[:, len(model.gain) :, None] * size)
    return np.concatenate(parts, axis=1)


def _root(covariance: Array) -> Array:
    """Give a square root of a covariance, which may be singular."""
    variance, directions = np.linalg.eigh(covariance)
    return np.asarray(directions * np.sqrt(np.maximum(variance, 0)))


def _to_residual(chain: ProcessingChain, plate: int) -> Array:
    """Give what a wrench of a plate, in its own axes, is in the residual, (T, 6, 6)."""
    frames = len(chain.time)
    columns = []
    for unit in np.eye(6):
        alone = np.tile(unit, (frames, 1))
        (moved,) = in_lab([alone], [chain.plates[plate]], chain.pose)
        columns.append(shift_wrench(moved, chain.motion.value[:, :3]))
    return np.stack(columns, axis=2)


def _largest(added: list[Array]) -> tuple[int, int]:
    """Give plate and component to which most is added, a newton metre counting as ten newtons."""
    sizes = [np.sqrt(np.nanmean(each**2, axis=0)) * [1, 1, 1, 10, 10, 10] for each in added]
    plate, component = np.unravel_index(np.argmax(sizes), (len(sizes), 6))
    return int(plate), int(component)


def _sensors_prior(done: Subtracted, known: dict[str, Prior]) -> Prior:
    """Give how much later the accelerometers may be than the calibration found."""
    errors = [sensor.delay_error_s for sensor in done.sensors]
    stated = [error for error in errors if error is not None]
    if not stated or len(stated) < len(errors):
        return known["accelerometer_delay"]
    between = known["accelerometer_delay_between_days"]
    size = float(np.linalg.norm([max(stated), done.sensors_apart_s, between.size]))
    source = f"the calibration's own error, how sensors differ, and {between.source}"
    return replace(between, size=size, source=source)


def _without(chain: ProcessingChain, size: float, *, added: list[Array]) -> ProcessingChain:
    """Subtract more than was subtracted, by a wrench per plate times a size."""
    return chain.with_wrenches(
        [wrench - size * more for wrench, more in zip(chain.wrenches, added, strict=True)]
    )


def _late_sensors(chain: ProcessingChain, delay_s: float) -> ProcessingChain:
    """Make the accelerometers later [s]."""
    done = chain.subtracted
    assert done is not None
    later = tuple(delayed(chain.time, felt, delay_s) for felt in done.felt)
    added = [
        (after - before) @ model.gain[:-1]
        for model, before, after in zip(done.models, done.felt, later, strict=True)
    ]
    shown = replace(done, felt=later)
    return _without(chain, 1.0, added=added).changed(subtracted=shown)


def _late_belt(chain: ProcessingChain, delay_s: float, *, plate: int) -> ProcessingChain:
    """Make the channel of a belt's speed later [s]."""
    done = chain.subtracted
    assert done is not None
    later = list(done.belts)
    later[plate] = delayed(chain.time, done.belts[plate], delay_s)
    added = [after - before for before, after in zip(done.belts, later, strict=True)]
    shown = replace(done, belts=tuple(later))
    return _without(chain, 1.0, added=added).changed(subtracted=shown)


def platform_causes(chain: ProcessingChain, platform: Platform | None) -> Iterator[Cause]:
    """Give what may be wrong with the platform's pose in a trial.

    Parameters
    ----------
    chain
        The trial.
    platform
        How the pose is known, as the study states it; None for a treadmill that stands still.

    Yields
    ------
    Cause
        Of markers: zero of sway and pitch. Of channels: these, delay, size of sway and pitch, and
        direction of the axis about the vertical; where there is pitch, the place of its axis too.
        Nothing where the platform stands still.
    """
    if chain.pose is None or platform is None:
        return
    known, kind = priors(), "marker" if platform.markers else "channel"
    zeros: tuple[tuple[str, Change], ...] = (("sway", _sway), ("pitch", _pitch))
    for name, change in zeros:
        prior = known[f"{kind}_{name}_zero"]
        yield Cause(f"platform: zero of {name}", "platform", prior, change)
    if platform.markers:
        return
    moving: list[tuple[str, str, Change]] = [("late", "pose_delay", _late)]
    if platform.sway_channel:
        moving.append(("size of sway", "pose_size", _larger_sway))
    if platform.pitch_channel:
        moving.append(("size of pitch", "pose_size", _larger_pitch))
        moving += [
            (f"pivot along {letter}", "pivot", partial(_pivot, along=axis))
            for letter, axis in (("x", np.eye(3)[0]), ("z", UP))
        ]
    moving.append(("direction about z", "pose_direction", _turned))
    for title, kind, change in moving:
        yield Cause(f"platform: {title}", "platform", known[kind], change, of_platform=True)


def _late(chain: ProcessingChain, delay_s: float) -> ProcessingChain:
    """Make the pose later [s]; the ends are held, gaps stay where they are."""
    pose = _pose(chain)
    known = chain.time[np.flatnonzero(np.isfinite(pose.position).all(axis=1))]
    later = interpolate_pose(pose, chain.time, np.clip(chain.time - delay_s, known[0], known[-1]))
    gap = np.asarray(np.isnan(later.position + pose.position).any(axis=1, keepdims=True))
    return _with_pose(
        chain,
        np.where(gap[:, None], pose.rotation, later.rotation),
        np.where(gap, pose.position, later.position),
    )


def _sway(chain: ProcessingChain, size: float) -> ProcessingChain:
    """Take the platform to be farther to the left [m]."""
    pose = _pose(chain)
    return _with_pose(chain, pose.rotation, pose.position + size * LEFT)


def _pitch(chain: ProcessingChain, size: float) -> ProcessingChain:
    """Take the platform to be pitched farther [rad], about a lateral axis under the person."""
    pose = _pose(chain)
    center = np.mean([plate.center for plate in chain.plates], axis=0)
    turn = rotation_about(LEFT, size)
    return _with_pose(
        chain, pose.rotation @ turn, pose.position + pose.rotation @ (center - turn @ center)
    )


def _larger_sway(chain: ProcessingChain, share: float) -> ProcessingChain:
    """Take the platform to sway by a share farther."""
    pose = _pose(chain)
    return _with_pose(chain, pose.rotation, pose.position + share * pose.position * LEFT)


def _larger_pitch(chain: ProcessingChain, share: float) -> ProcessingChain:
    """Take the platform to pitch by a share farther, about the axis that its pose shows."""
    pose = _pose(chain)
    turn = rotation_about(LEFT, share * pose.pitch)
    sway = pose.position * LEFT
    return _with_pose(chain, pose.rotation @ turn, sway + _along(pose, turn))


def _along(pose: PlatformPose, turn: Array) -> Array:
    """Give the positions in the plane of pitch with a further turn about the axis, (T, 3) [m].

    The position there is ``p - R p``: the point ``p`` of the axis is found from all frames.
    """
    plane = [0, 2]
    known = np.isfinite(pose.position).all(axis=1)
    still = np.eye(3) - pose.rotation
    rows = still[known][:, plane][:, :, plane].reshape(-1, 2)
    point = np.zeros(3)
    point[plane] = np.linalg.lstsq(rows, pose.position[known][:, plane].ravel())[0]
    return point - pose.rotation @ turn @ point


def _turned(chain: ProcessingChain, angle: float) -> ProcessingChain:
    """Take the platform's axes of motion to be turned about the vertical [rad]."""
    pose, turn = _pose(chain), rotation_about(UP, angle)
    return _with_pose(chain, turn @ pose.rotation @ turn.T, pose.position @ turn.T)


def _pivot(chain: ProcessingChain, size: float, *, along: Array) -> ProcessingChain:
    """Take the axis of pitch to be where it is not, by a size [m] along a direction."""
    pose = _pose(chain)
    moved = pose.position + size * (along - pose.rotation @ along)
    return _with_pose(chain, pose.rotation, moved)


def _pose(chain: ProcessingChain) -> PlatformPose:
    assert chain.pose is not None  # there are no causes else
    return chain.pose


def _with_pose(chain: ProcessingChain, rotation: Array, position: Array) -> ProcessingChain:
    return chain.with_wrenches(chain.wrenches, PlatformPose(rotation, position))
