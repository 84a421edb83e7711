"""The human body model: markers and wrenches in, coordinates and pelvis residuals out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from hbm.body import Body as Body
    from hbm.body import build_body as build_body
    from hbm.calibration_pose.anatomy import LimbMeasures as LimbMeasures
    from hbm.calibration_pose.functional import functional_hips as functional_hips
    from hbm.coordinates import COORDINATES as COORDINATES
    from hbm.coordinates import HBM_ORDER as HBM_ORDER
    from hbm.dynamics import Dynamics as Dynamics
    from hbm.dynamics import filter_motion as filter_motion
    from hbm.dynamics import inverse_dynamics as inverse_dynamics
    from hbm.ik.tracking import solve_ik as solve_ik
    from hbm.markers.marker_set import MarkerSet as MarkerSet
    from hbm.markers.marker_set import marker_sets as marker_sets
    from hbm.markers.marker_set import read_marker_set as read_marker_set
    from hbm.markers.trajectories import Markers as Markers
    from hbm.motion import Motion as Motion
    from hbm.segments import SegmentOverride as SegmentOverride
    from hbm.segments import read_overrides as read_overrides

_NAMES: Final = {
    "body": ("Body", "build_body"),
    "calibration_pose.anatomy": ("LimbMeasures",),
    "calibration_pose.functional": ("functional_hips",),
    "coordinates": ("COORDINATES", "HBM_ORDER"),
    "dynamics": ("Dynamics", "filter_motion", "inverse_dynamics"),
    "ik.tracking": ("solve_ik",),
    "markers.marker_set": ("MarkerSet", "marker_sets", "read_marker_set"),
    "markers.trajectories": ("Markers",),
    "motion": ("Motion",),
    "segments": ("SegmentOverride", "read_overrides"),
}
"""Module -> its public names."""
_HOME: Final = {name: module for module, names in _NAMES.items() for name in names}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package costs nothing."""
    if name not in _HOME:
        raise AttributeError(f"module 'hbm' has no attribute {name!r}")
    return getattr(import_module(f"hbm.{_HOME[name]}"), name)
