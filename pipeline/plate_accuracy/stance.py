"""Total error of a plate at the loads that a walking person puts on it."""

from collections.abc import Collection
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from compensation import PlateCalibration
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.plate_accuracy.response import FX, FY, FZ, MX, MY, MZ, PlateResponse, standard_error

PHASES: Final = ((-0.25, 1.2), (0.0, 0.75), (0.25, 1.2))
"""Forward and vertical force of one foot in body weights: braking, midstance, push-off. Vertical
peaks are 1.2 body weights in walking at 1.5 m/s (Keller et al. 1996, Clin Biomech 11:253); the
others are those of the virtual laboratory's subjects at 1.3 m/s (docs/realism.md)."""
LATERAL: Final = (-0.05, 0.05)
"""Lateral force of one foot in body weights: assumed."""
ALONG_M: Final = (-0.4, 0.0, 0.4)
ACROSS_M: Final = (-0.1, 0.0, 0.1)
"""Centres of pressure from the middle of the plate: where feet are on a treadmill's belt; assumed,
and within what the thesis' weights cover."""
BODY_CENTER_M: Final = 1.0
"""Height of a person's centre of mass, about which the error of the moment is judged."""
RECORDING_S: Final = 60.0
"""Time over which a drift acts: a minute of walking after the plate was zeroed."""
NODES_S: Final = RECORDING_S / 2 * (1 + np.array([-1.0, 1.0]) / np.sqrt(3.0))
QUANTITIES: Final = ("Fx", "Fy", "Fz", "COPx", "COPy", "Mx", "My", "Mz")


def stance_loads(body_mass_kg: float) -> Array:
    """Give wrenches of one foot about the centre of a plate's surface, (L, 6) [N, N·m].

    Examples
    --------
    >>> stance_loads(75.0).shape
    (54, 6)
    """
    weight = body_mass_kg * GRAVITY_MPS2
    cases = list(product(PHASES, LATERAL, ALONG_M, ACROSS_M))
    force = weight * np.array([(forward, lateral, up) for (forward, up), lateral, _, _ in cases])
    place = np.array([(x, y, 0.0) for _, _, x, y in cases])
    return np.hstack([force, np.cross(place, force)])


def quantities_of(components: Collection[int]) -> tuple[str, ...]:
    """Give the quantities on which an error of these components of a wrench acts.

    Examples
    --------
    >>> quantities_of([FY])
    ('Fy', 'Mx', 'Mz')
    """
    loads = stance_loads(1.0)
    effect = _effects(loads, loads[None])[..., list(components)]
    return tuple(name for k, name in enumerate(QUANTITIES) if effect[:, :, k].any())


@dataclass(frozen=True, slots=True)
class TotalErrors:
    """Root-mean-square errors over loads, with 95 % confidence intervals; (8,) for `QUANTITIES`.

    Forces [N], centres of pressure [m], moments about the person's centre of mass, 1 m above the
    load [N·m].
    """

    size: Array
    low: Array
    high: Array


def total_errors(
    response: PlateResponse, loads: Array, calibration: PlateCalibration | None = None
) -> TotalErrors:
    """Find the errors of a plate under given loads: what it reports less the truth.

    Parameters
    ----------
    response
        Of the plate.
    loads
        True wrenches about the centre of its surface, (L, 6) [N, N·m].
    calibration
        Applied to what it reports; without, as reported.

    Returns
    -------
    TotalErrors
        Systematic error, drift of a minute and scatter together. A delay is an error of time and
        not in it.

    Notes
    -----
    The interval of the systematic part is its RMS ± Student's t times the RMS of its standard
    error, over the loads: by the triangle inequality the RMS cannot be off by more than the RMS of
    what it is estimated wrongly by, which holds where the error is near zero too. The mean square
    over a minute is exact at the two nodes of Gauss and Legendre, as the drift is linear.
    """
    loads = np.repeat(loads, len(NODES_S), axis=0)
    times = np.resize(NODES_S, len(loads))
    share = (loads[:, FZ, None] / response.full_scale_n) ** 2
    reported = loads @ response.matrix.swapaxes(1, 2) + response.zero[:, None]
    reported += np.nan_to_num(response.curvature)[:, None] * share
    reported += times[:, None] * response.drift[:, None]
    variance = response.scatter[:, 0, None] + response.scatter[:, 1, None] * loads[:, FZ, None] ** 2
    if calibration is not None:
        reported = calibration.correct(reported)
        variance = variance @ (calibration.matrix**2).T
    variance = np.maximum(variance, 0)
    effect = _effects(loads, reported)
    error = np.einsum("klqc,klc->klq", effect, reported - loads)
    random = np.einsum("klqc,klc->klq", effect**2, variance).mean(axis=1)
    systematic, unsure = _rms(error[0]), response.quantile * _rms(standard_error(error))
    wide = response.quantile * standard_error(random)
    return TotalErrors(
        size=np.sqrt(systematic**2 + random[0]),
        low=np.sqrt(np.maximum(systematic - unsure, 0) ** 2 + np.maximum(random[0] - wide, 0)),
        high=np.sqrt((systematic + unsure) ** 2 + random[0] + wide),
    )


def _rms(errors: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


def _effects(loads: Array, reported: Array) -> Array:
    """Give what an error of each component does to each quantity, (K, L, 8, 6)."""
    x, y = -loads[:, MY] / loads[:, FZ], loads[:, MX] / loads[:, FZ]
    effect = np.zeros((*reported.shape[:2], len(QUANTITIES), 6))
    effect[..., range(3), range(3)] = 1
    effect[..., 3, MY], effect[..., 3, FZ] = -1 / reported[..., FZ], -x / reported[..., FZ]
    effect[..., 4, MX], effect[..., 4, FZ] = 1 / reported[..., FZ], -y / reported[..., FZ]
    effect[..., 5, MX], effect[..., 5, FZ], effect[..., 5, FY] = 1, -y, BODY_CENTER_M
    effect[..., 6, MY], effect[..., 6, FZ], effect[..., 6, FX] = 1, x, -BODY_CENTER_M
    effect[..., 7, MZ], effect[..., 7, FX], effect[..., 7, FY] = 1, y, -x
    return effect
