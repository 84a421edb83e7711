"""The synthetic person with the markers of other sets, standing with bent elbows.

Joint centres and axes are those of the body that all markers of Human Body Model 2 give, so that
what another set finds can be compared with them.
"""

from functools import cache

import numpy as np

from hbm.calibration_pose.anatomy import MARKER_OFFSET_M, LimbMeasures
from hbm.coordinates import INDEX, MOVING
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers, marker_sets
from hbm.poses import marker_positions, segment_frames
from tests.hbm.people import HBM1_NAMES, HBM1_ONLY_MM
from tests.synthetic import T_POSE_MM, synthetic_body, synthetic_t_pose

BENT_RAD = np.radians(70.0)
OTHER_MM = HBM1_ONLY_MM | {
    "T2": (-85, 4, 1465), "T8": (-104, 1, 1290), "RBAK": (-97, -74, 1350),
    "LFHD": (90, 70, 1690), "RFHD": (95, -65, 1694), "LBHD": (-80, 66, 1660),
    "RBHD": (-76, -72, 1665), "GLAB": (105, 2, 1680), "LMAS": (5, 70, 1620), "RMAS": (9, -70, 1624),
    "LTHAP": (72, 122, 640), "LTHAD": (58, 118, 560), "LTIAP": (49, 122, 400),
    "LTIAD": (38, 120, 260), "LHF": (-14, 160, 450), "LTT": (62, 117, 455),
    "LMT1": (140, 96, 40), "LINSTEP": (76, 128, 66),
    "RTHAP": (75, -124, 655), "RTHAD": (60, -116, 570), "RTIAP": (50, -121, 410),
    "RTIAD": (36, -122, 255), "RHF": (-16, -158, 462), "RTT": (60, -119, 460),
    "RMT1": (137, -92, 42), "RINSTEP": (74, -122, 69),
}  # fmt: skip


def _either_side(labels):
    return {s + label: s + point for s in "LR" for label, point in labels.items()}


def _of_hbm1(name):
    other = {label: point for point, label in HBM1_NAMES.items()}
    return {label: other.get(label, label) for label in marker_sets()[name].segment}


PIG_LOWER = {"LASI": "LASIS", "RASI": "RASIS", "LPSI": "LPSIS", "RPSI": "RPSIS"} | _either_side(
    {"THI": "LTHI", "KNE": "LEK", "TIB": "LSHA", "ANK": "LM", "HEE": "HEE", "TOE": "MT2"}
)
PIG = (
    PIG_LOWER
    | {"C7": "C7", "T10": "T10", "CLAV": "JN", "STRN": "XIPH", "RBAK": "RBAK"}
    | _either_side({"FHD": "FHD", "BHD": "BHD", "SHO": "SHO", "UPA": "DELT", "ELB": "LEE"})
    | _either_side({"FRM": "FRM", "WRA": "MW", "WRB": "LW", "FIN": "FIN"})
)
MEDIAL = _either_side({"KNM": "MEK", "MED": "MM", "MELB": "MEE"})
CGM2_LEGS = _either_side({"THAP": "THAP", "THAD": "THAD", "TIAP": "TIAP", "TIAD": "TIAD"})
CGM2_FEET = _either_side({"FMH": "MT1", "SMH": "MT2", "VMH": "MT5", "TOE": "INSTEP"})
CGM2_HEAD = {"T2": "T2", "GLAB": "GLAB", "LMAS": "LMAS", "RMAS": "RMAS"}
IOR_LOWER = {n: n for n in ("LASIS", "RASIS", "LPSIS", "RPSIS")} | _either_side(
    {"GT": "GTRO", "LE": "LEK", "HF": "HF", "TT": "TT", "LM": "LM", "CA": "HEE", "FM": "MT1"}
    | {"VM": "MT5", "SM": "MT2"}
)
IOR_MEDIAL = _either_side({"ME": "MEK", "MM": "MM"})
IOR_TRUNK = {
    "C7": "C7",
    "T2": "T2",
    "MAI": "T8",
    "IJ": "JN",
    "PX": "XIPH",
    "LA": "LSHO",
    "RA": "RSHO",
}

RAJAGOPAL_LOWER = {n: n + "S" for n in ("LASI", "RASI", "LPSI", "RPSI")} | _either_side(
    {"TH1": "LTHI", "TH2": "THAP", "TH3": "THAD", "LFC": "LEK", "MFC": "MEK", "TB1": "LSHA"}
    | {"TB2": "TIAP", "TB3": "TIAD", "LMAL": "LM", "MMAL": "MM", "CAL": "HEE", "MT5": "MT5"}
    | {"TOE": "TOE"}
)
RAJAGOPAL = (
    RAJAGOPAL_LOWER
    | {"C7": "C7", "CLAV": "JN"}
    | _either_side({"ACR": "SHO", "UA1": "DELT", "LEL": "LEE", "MEL": "MEE", "FAulna": "LW"})
    | _either_side({"FAradius": "MW", "FAsuperior": "FRM"})
)


def _dotted(labels):
    return {f"{s}.{label}": s + point for s in "LR" for label, point in labels.items()}


GAIT2354 = {"V.Sacral": "SACR", "Sternum": "JN", "Top.Head": "THEAD"} | _dotted(
    {"ASIS": "ASIS", "Thigh.Upper": "LTHI", "Thigh.Front": "THAP", "Thigh.Rear": "THAD"}
    | {"Knee.Lat": "LEK", "Knee.Med": "MEK", "Shank.Upper": "LSHA", "Shank.Front": "TIAP"}
    | {"Shank.Rear": "TIAD", "Ankle.Lat": "LM", "Ankle.Med": "MM", "Heel": "HEE"}
    | {"Midfoot.Sup": "INSTEP", "Toe.Lat": "MT5", "Toe.Med": "MT1", "Toe.Tip": "TOE"}
    | {"Acromium": "SHO", "Bicep": "DELT", "Elbow": "LEE", "Wrist.Lat": "LW", "Wrist.Med": "MW"}
)
OPENCAP = {"C7_study": "C7"} | {
    f"{side}{label}_study": s + point
    for side, s in (("L", "L"), ("r", "R"))
    for label, point in (
        {".ASIS": "ASIS", ".PSIS": "PSIS", "_thigh1": "LTHI", "_thigh2": "THAP", "_thigh3": "THAD"}
        | {"_knee": "LEK", "_mknee": "MEK", "_sh1": "LSHA", "_sh2": "TIAP", "_sh3": "TIAD"}
        | {"_ankle": "LM", "_mankle": "MM", "_calc": "HEE", "_toe": "MT2", "_5meta": "MT5"}
        | {"_shoulder": "SHO", "_lelbow": "LEE", "_melbow": "MEE", "_lwrist": "MW"}
        | {"_mwrist": "LW"}
    ).items()
}
HELEN_HAYES_LOWER = {"VSAC": "SACR", "LASI": "LASIS", "RASI": "RASIS"} | _either_side(
    {"THI": "LTHI", "KNE": "LEK", "KNE_2": "MEK", "SHA": "LSHA", "ANK": "LM", "ANK_2": "MM"}
    | {"HEE": "HEE", "TOE": "MT2", "FOO": "MT1", "FOO_2": "MT5"}
)
HELEN_HAYES = (
    HELEN_HAYES_LOWER
    | {"C7": "C7", "IJ": "JN", "PX": "XIPH", "ROFF": "RBAK"}
    | _either_side({"SHO": "SHO", "ELB": "LEE", "WRI": "MW"})
)
CODA = _dotted(
    {"ASIS": "ASIS", "PSIS": "PSIS", "Ant.Fem.": "THAP", "Post.Fem.": "THAD", "Knee": "LEK"}
    | {"Ant.Tib.": "TIAP", "Post.Tib.": "TIAD", "Ankle": "LM", "Heel": "HEE", "Toe": "MT5"}
)

SETS = {
    "hbm2": {name: name for name in T_POSE_MM},
    "hbm1_lower": _of_hbm1("hbm1_lower"),
    "hbm1": _of_hbm1("hbm1"),
    "pig_lower": PIG_LOWER,
    "pig": PIG,
    "cgm2_lower": PIG_LOWER | CGM2_LEGS,
    "cgm2": {n: p for n, p in PIG.items() if n != "C7" and not n.endswith("HD")}
    | CGM2_LEGS
    | CGM2_FEET
    | CGM2_HEAD,
    "ior_lower": IOR_LOWER | IOR_MEDIAL,
    "ior": IOR_LOWER | IOR_MEDIAL | IOR_TRUNK,
    "rajagopal_lower": RAJAGOPAL_LOWER,
    "rajagopal": RAJAGOPAL,
    "gait2354": GAIT2354,
    "opencap": OPENCAP,
    "helen_hayes_lower": HELEN_HAYES_LOWER,
    "helen_hayes": HELEN_HAYES,
    "coda": CODA,
}
"""Marker set -> label -> the point of the person that carries the marker."""


@cache
def bent():
    """Coordinates of the person with elbows bent, (46,)."""
    q = solve_ik(synthetic_body(), synthetic_t_pose()).q[0].copy()
    for s in "RL":
        q[INDEX[f"{s}ElbowFlexion"]] = BENT_RAD
    return q


@cache
def points():
    """All points of the person in that pose, by name [m]."""
    body = synthetic_body()
    at = dict(zip(body.markers, marker_positions(body, bent()[None])[0], strict=True))
    return at | {name: np.array(point) / 1000 for name, point in OTHER_MM.items()}


@cache
def joints():
    """Segment -> its proximal joint in that pose, (3,) [m]."""
    return dict(zip(MOVING, segment_frames(synthetic_body(), bent()[None])[1][0], strict=True))


def wearing(labels, frames=20):
    """Markers of the person who stands still: label -> the point that it is on."""
    position = np.array([points()[point] for point in labels.values()])
    return Markers(np.arange(frames) / 100, tuple(labels), np.tile(position, (frames, 1, 1)))


def measured():
    """Widths of the person's joints, between the epicondyles and malleoli under the markers."""
    at = points()

    def width(a, b):
        return float(np.linalg.norm(at[a] - at[b])) - 2 * MARKER_OFFSET_M

    return {
        side: LimbMeasures(
            knee_width_m=width(f"{s}LEK", f"{s}MEK"),
            ankle_width_m=width(f"{s}LM", f"{s}MM"),
            elbow_width_m=width(f"{s}LEE", f"{s}MEE"),
        )
        for side, s in (("left", "L"), ("right", "R"))
    }
