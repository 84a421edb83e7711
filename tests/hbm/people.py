"""The synthetic person with other markers, mirrored, and elsewhere."""

import numpy as np

from hbm.markers import Markers
from tests.synthetic import T_POSE_MM

HBM1_NAMES = {"XIPH": "XYPH", "JN": "STRN"}
HBM1_ONLY_MM = {
    "SACR": (-87, 2, 1023), "NAVE": (98, 1, 1090), "BBAC": (-96, -70, 1350),
    "LGTRO": (15, 176, 930), "FLTHI": (72, 120, 720), "LATI": (28, 150, 300),
    "LTOE": (198, 152, 45),
    "RGTRO": (11, -181, 937), "FRTHI": (69, -124, 712), "RATI": (24, -147, 310),
    "RTOE": (193, -149, 47),
}  # fmt: skip


def standing(points_mm, frames=20, rate_hz=100.0):
    """Markers that stand still, from positions in mm."""
    pose = np.array(list(points_mm.values()), float) / 1000
    return Markers(np.arange(frames) / rate_hz, tuple(points_mm), np.tile(pose, (frames, 1, 1)))


def person(*missing, **moved_mm):
    """The person in the T-pose, some markers missing, others moved."""
    points = {name: p for name, p in T_POSE_MM.items() if name not in missing}
    return standing(points | moved_mm)


def hbm1_person(names):
    """The person with the markers of Human Body Model 1."""
    points = {HBM1_NAMES.get(name, name): p for name, p in T_POSE_MM.items()} | HBM1_ONLY_MM
    return standing({name: points[name] for name in names})


def mirrored(markers):
    """The person's mirror image, left and right exchanged."""
    own = {name.casefold(): name for name in markers.names}
    other = {"l": "r", "r": "l"}
    names = tuple(
        own.get(other.get(n[0].casefold(), "") + n[1:].casefold(), n) for n in markers.names
    )
    return Markers(markers.time, names, markers.position * [1, -1, 1])


def moved(markers, yaw, shift=(0.0, 0.0, 0.0)):
    """The person facing another direction, elsewhere."""
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return Markers(markers.time, markers.names, markers.position @ R.T + np.array(shift))
