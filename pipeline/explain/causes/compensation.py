"""What compensating the plates may leave: of the inertia model, of the accelerometers, of belts."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from scipy.signal import hilbert
from scipy.sparse.linalg import svds

from compensation import InertiaModel
from compensation.inertia.model_error import SLOW_HZ
from hbm.spatial import WRENCH_COMPONENTS, Array, shift_wrench
from pipeline.explain.cause import Cause
from pipeline.explain.causes.delay import delayed
from pipeline.explain.priors import Prior, priors
from pipeline.explain.processing_chain import ProcessingChain, wrenches_in_lab
from pipeline.explain.subtracted import Subtracted

SHARE: Final = 0.95
MOST: Final = 12
"""Of the variance that the models may leave, and directions that are given for it at most."""
THINNED_HZ: Final = 20.0
"""Rate that shows what passes the 6 Hz of a trial."""


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
        (in_lab,) = wrenches_in_lab([alone], [chain.plates[plate]], chain.pose)
        columns.append(shift_wrench(in_lab, chain.motion.value[:, :3]))
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
