"""Joint centres and axes from anatomical landmarks in a calibration pose.

Every rule names its source. Where a landmark is missing the next documented rule is used, with a
note; where there is none the error says which marker would do. All positions are in lab axes,
whatever direction the subject faces.
"""

from collections.abc import Mapping

from hbm.calibration_pose.anatomy import Anatomy, Measures
from hbm.calibration_pose.arms import locate_arm
from hbm.calibration_pose.axial import locate_head, locate_pelvis, locate_trunk
from hbm.calibration_pose.legs import locate_leg
from hbm.calibration_pose.trunk_levels import locate_trunk_levels, with_spine
from hbm.coordinates import SIDES
from hbm.spatial import Array


def locate_anatomy(landmarks: Mapping[str, Array], measures: Measures) -> Anatomy:
    """Find all joint centres and axes.

    Parameters
    ----------
    landmarks
        Landmark -> position in the calibration pose, (3,) [m], lab axes; absent where missing.
    measures
        Properties of the subject that the markers do not show.

    Returns
    -------
    Anatomy
        In the lab, in the calibration pose; without head and arms if the trunk is not shown.

    Raises
    ------
    ValueError
        If a pelvis or leg landmark is missing that no rule can replace, or sides are swapped.
    """
    anatomy = Anatomy()
    locate_pelvis(anatomy, landmarks, measures)
    for side in SIDES:
        locate_leg(anatomy, landmarks, measures, side)
    landmarks = with_spine(anatomy, landmarks, measures.sex)
    locate_trunk(anatomy, landmarks, measures)
    if "thorax" in anatomy.frames:
        locate_trunk_levels(anatomy, landmarks, measures.sex)
        locate_head(anatomy, landmarks)
        for side in SIDES:
            locate_arm(anatomy, landmarks, measures, side)
    return anatomy
