"""Soft tissue artefact: the skin carries the markers away from the bones."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.signal import lfilter

from hbm.coordinates import INDEX
from hbm.numbers import read_numbers
from hbm.spatial import Array
from pipeline.virtual_lab.faults import CameraFaults

SKIN: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "skin")

ARTEFACTS: Final[dict[str, tuple[float, tuple[str, ...]]]] = {
    "pelvis": (0.004, ("RHipFlexion", "LHipFlexion")),
    "thorax": (0.004, ("TrunkRightBend", "TrunkLeftTwist", "RShoulderFlexion", "LShoulderFlexion")),
    "head": (0.001, ("HeadFlexion", "HeadLeftTwist")),
    "shoulder": (0.005, ("ShoulderFlexion",)),
    "upper_arm": (0.006, ("ShoulderFlexion", "ElbowFlexion")),
    "forearm": (0.004, ("ElbowFlexion", "ForeArmPronation")),
    "hand": (0.002, ("WristFlexion", "ForeArmPronation")),
    "thigh": (0.009, ("HipFlexion", "HipAbduction", "HipInternalRotation", "KneeFlexion")),
    "shank": (0.005, ("KneeFlexion", "AnklePlantarFlexion")),
    "foot": (0.002, ("AnklePlantarFlexion", "FootPronation")),
    "toes": (0.002, ("AnklePlantarFlexion", "ToeFlexion")),
}
"""RMS displacement of a segment's skin markers in walking [m], and what drives it.

Thigh the most, then shank (Leardini et al. 2005, Gait Posture 21:212; Peters et al. 2010, Gait
Posture 31:1); head, hands and feet, for which no review has a value, are assumed small. The
artefact is a linear function of the coordinates of the joints at both ends of the segment (Bonci et
al. 2014, J Biomech 47:2354); on the limbs they stand without the side."""


def displace_markers(
    position: Array,
    segment: tuple[str, ...],
    rotation: Mapping[str, Array],
    q: Array,
    walking: Array,
    faults: CameraFaults,
    rng: np.random.Generator,
    rate_hz: float,
) -> Array:
    """Displace markers with the skin under them, those of a segment partly together.

    Parameters
    ----------
    position
        Positions of the markers if they were fixed to the bones, (T, M, 3) [m].
    segment
        Segment of each marker, (M,).
    rotation
        Segment -> its orientation, (T, 3, 3).
    q
        Coordinates, (C, T): those of the Human Body Model are the first 46.
    walking
        From standing (0) to walking (1), (T,). In the calibration pose the skin is at rest.
    faults
        ``skin_scale`` multiplies the published magnitudes.
    rng
        Source of chance; what is drawn does not depend on the scale.
    rate_hz
        Frame rate [Hz].

    Returns
    -------
    Array
        Positions of the markers on the skin, (T, M, 3) [m].
    """
    displaced = position.copy()
    for carrier in dict.fromkeys(segment):
        part = carrier.removeprefix("left_").removeprefix("right_")
        letter = "" if part == carrier else carrier[0].upper()
        rms_m, coordinates = ARTEFACTS[part]
        # a random linear function of the joints' coordinates, partly the same for all its markers
        drivers = _unit_variance(q[[INDEX[letter + name] for name in coordinates]], walking)
        size = faults.skin_scale * rms_m / np.sqrt(3)
        common = rng.normal(size=(3, len(drivers)))
        turn = np.moveaxis(rotation[carrier], 0, 2)
        for k in (k for k, s in enumerate(segment) if s == carrier):
            alone = rng.normal(size=(3, len(drivers)))
            mixed = np.sqrt(SKIN.common) * common + np.sqrt(1 - SKIN.common) * alone
            driven = _unit_variance(mixed @ drivers, walking)
            irregular = _irregular(len(position), rng, rate_hz)
            shift = np.sqrt(SKIN.driven) * driven + np.sqrt(1 - SKIN.driven) * irregular
            # along the segment's axes, from rest in the calibration pose
            shift *= size * walking
            displaced[:, k] += (turn * shift).sum(axis=1).T
    return displaced


def _unit_variance(values: Array, walking: Array) -> Array:
    """Shift and scale signals (S, T) to mean 0 and variance 1 in walking."""
    least = 1e-12  # of what is not zero: a coordinate that does not move drives nothing
    weight = walking / max(float(walking.sum()), least)
    away = values - (values @ weight)[:, None]
    sd = np.sqrt(away**2 @ weight)[:, None]
    return np.asarray(away / np.maximum(sd, least))


def _irregular(frames: int, rng: np.random.Generator, rate_hz: float) -> Array:
    """Draw low-passed white noise of unit variance per axis, (3, T)."""
    keep = np.exp(-1 / (SKIN.correlation * rate_hz))
    noise = rng.normal(size=(3, frames))
    filtered = lfilter([(1 - keep) ** 2], [1, -2 * keep, keep**2], noise, axis=1)
    # variance of the output of two low-passes of first order in a row
    variance = (1 - keep) ** 4 * (1 + keep**2) / (1 - keep**2) ** 3
    return np.asarray(filtered / np.sqrt(variance))
