"""Total error of a plate at the loads that a walking person puts on it."""

from itertools import product
from typing import Final

import numpy as np

from compensation import PlateCalibration
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.plate_accuracy.response import FX, FY, FZ, MX, MY, MZ, PlateResponse

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


def total_errors(
    response: PlateResponse, loads: Array, calibration: PlateCalibration | None = None
) -> Array:
    """Give root-mean-square errors over loads: what a plate reports less the truth.

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
    Array
        (K, 8) for `QUANTITIES`: force [N], centre of pressure [m], and moment about the person's
        centre of mass, 1 m above the load [N·m]. Systematic error, drift of a minute and scatter
        together; a delay is an error of time and not in it.
    """
    share = (loads[:, FZ, None] / response.full_scale_n) ** 2
    bent = np.nan_to_num(response.curvature)[:, None] * share
    reported = loads @ response.matrix.swapaxes(1, 2) + response.zero[:, None] + bent
    drift = RECORDING_S * response.drift
    variance = response.scatter[:, 0, None] + response.scatter[:, 1, None] * loads[:, FZ, None] ** 2
    if calibration is not None:
        reported = calibration.correct(reported)
        drift = drift @ calibration.matrix.T
        variance = variance @ (calibration.matrix**2).T
    effect = _effects(loads, reported)
    systematic = np.einsum("klqc,klc->klq", effect, reported - loads)
    growing = np.einsum("klqc,kc->klq", effect, drift)
    random = np.einsum("klqc,klc->klq", effect**2, variance)
    return np.asarray(np.sqrt(np.mean(systematic**2 + growing**2 / 3 + random, axis=1)))


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
