"""The human body model: markers and wrenches in, coordinates and pelvis residuals out."""

from typing import TYPE_CHECKING

from hbm.public_names import on_first_use

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
    from hbm.markers import Markers as Markers
    from hbm.markers import MarkerSet as MarkerSet
    from hbm.markers import marker_sets as marker_sets
    from hbm.markers import read_marker_set as read_marker_set
    from hbm.motion import Motion as Motion
    from hbm.segments import SegmentOverride as SegmentOverride
    from hbm.segments import read_overrides as read_overrides
else:
    __getattr__, __dir__, __all__ = on_first_use(__name__, __file__)
