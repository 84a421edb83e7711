"""What may be wrong with force plates: delay, zeros, gains, cross-talk, places and directions."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from hbm.spatial import WRENCH_COMPONENTS, Array, rotation_about, shift_wrench, transform_wrench
from pipeline.explain.cause import Cause
from pipeline.explain.causes.delay import delayed
from pipeline.explain.causes.known_plates import KnownPlates, usual_plates
from pipeline.explain.processing_chain import ProcessingChain


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
