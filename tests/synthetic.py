"""A synthetic subject: 46 markers in a T-pose, for tests that need every coordinate to move.

The positions are plausible for an adult man of 1.78 m and are asymmetric on purpose: no two limbs
are alike, the axes of elbow and ankle are oblique to those that follow them, and the pelvis is a
little rotated and tilted, as in a real subject.
"""

from functools import cache

import numpy as np

from hbm.body import Body, build_body
from hbm.markers import Markers

MASS_KG = 74.6
STATURE_M = 1.78
RATE_HZ = 100.0
T_POSE_MM = {
    "LASIS": (112, 128, 1002), "RASIS": (103, -131, 1009),
    "LPSIS": (-83, 46, 1021), "RPSIS": (-90, -42, 1025),
    "C7": (-72, 5, 1508), "T10": (-98, -3, 1216), "JN": (58, -2, 1447), "XIPH": (104, 4, 1243),
    "LLEK": (12, 165, 512), "LMEK": (-3, 59, 506), "LLTHI": (34, 178, 716),
    "LLM": (-31, 158, 82), "LMM": (-14, 84, 97), "LLSHA": (2, 171, 318),
    "LHEE": (-88, 110, 34), "LMT2": (124, 142, 48), "LMT5": (88, 186, 29),
    "RLEK": (5, -171, 520), "RMEK": (4, -61, 511), "RLTHI": (41, -174, 741),
    "RLM": (-38, -149, 79), "RMM": (-9, -78, 92), "RLSHA": (-4, -168, 297),
    "RHEE": (-92, -96, 36), "RMT2": (121, -138, 51), "RMT5": (79, -177, 27),
    "LHEAD": (24, 81, 1678), "RHEAD": (29, -78, 1671), "THEAD": (13, 6, 1779),
    "FHEAD": (112, 9, 1702),
    "LSHO": (-21, 189, 1476), "LDELT": (-6, 297, 1487), "LLEE": (6, 462, 1462),
    "LMEE": (-42, 455, 1399), "LFRM": (9, 588, 1451), "LLW": (-35, 714, 1434),
    "LMW": (22, 721, 1438), "LFIN": (1, 803, 1443),
    "RSHO": (-27, -193, 1469), "RDELT": (-19, -304, 1478), "RLEE": (2, -469, 1449),
    "RMEE": (-51, -457, 1391), "RFRM": (-2, -601, 1446), "RLW": (-37, -717, 1421),
    "RMW": (16, -729, 1432), "RFIN": (-8, -811, 1424),
}  # fmt: skip


def synthetic_t_pose() -> Markers:
    """One second of standing still, facing forward, arms held out sideways, palms down."""
    time = np.arange(100) / RATE_HZ
    pose = np.array(list(T_POSE_MM.values())) / 1000
    return Markers(time, tuple(T_POSE_MM), np.tile(pose, (len(time), 1, 1)))


@cache
def synthetic_body() -> Body:
    """The body of that subject: 46 coordinates, all observed by markers except the toes."""
    return build_body(
        synthetic_t_pose(), mass=MASS_KG, sex="male", marker_set="hbm2", height_m=STATURE_M
    )
