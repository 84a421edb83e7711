"""The human body model: markers and wrenches in, coordinates and pelvis residuals out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hbm.body import Body, build_body
    from hbm.calibration_pose.anatomy import LimbMeasures
    from hbm.calibration_pose.functional import functional_hips
    from hbm.coordinates import COORDINATES, HBM_ORDER
    from hbm.description import describe
    from hbm.dynamics import Dynamics, filter_motion, inverse_dynamics, inverse_dynamics_variants
    from hbm.kinematics import solve_ik
    from hbm.markers.marker_set import MarkerSet
    from hbm.markers.table import marker_sets, read_marker_set
    from hbm.markers.trajectories import Markers
    from hbm.motion import Motion
    from hbm.overrides import SegmentOverride, read_overrides
    from hbm.plausibility.labels import changed_distances
    from hbm.plausibility.motion import implausible

_HOME = {
    "Body": "body",
    "build_body": "body",
    "COORDINATES": "coordinates",
    "HBM_ORDER": "coordinates",
    "changed_distances": "plausibility.labels",
    "describe": "description",
    "implausible": "plausibility.motion",
    "Dynamics": "dynamics",
    "filter_motion": "dynamics",
    "functional_hips": "calibration_pose.functional",
    "inverse_dynamics": "dynamics",
    "inverse_dynamics_variants": "dynamics",
    "solve_ik": "kinematics",
    "LimbMeasures": "calibration_pose.anatomy",
    "Markers": "markers.trajectories",
    "MarkerSet": "markers.marker_set",
    "marker_sets": "markers.table",
    "read_marker_set": "markers.table",
    "Motion": "motion",
    "SegmentOverride": "overrides",
    "read_overrides": "overrides",
}

__all__ = [
    "COORDINATES",
    "HBM_ORDER",
    "Body",
    "Dynamics",
    "LimbMeasures",
    "MarkerSet",
    "Markers",
    "Motion",
    "SegmentOverride",
    "build_body",
    "changed_distances",
    "describe",
    "filter_motion",
    "functional_hips",
    "implausible",
    "inverse_dynamics",
    "inverse_dynamics_variants",
    "marker_sets",
    "read_marker_set",
    "read_overrides",
    "solve_ik",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package costs nothing."""
    if name not in _HOME:
        raise AttributeError(f"module 'hbm' has no attribute {name!r}")
    return getattr(import_module(f"hbm.{_HOME[name]}"), name)
