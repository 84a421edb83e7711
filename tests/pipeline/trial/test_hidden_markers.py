"""A walk in which some markers are never seen is solved from the others."""

import numpy as np

from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from pipeline.config.schema import Settings, Subject
from pipeline.trial.subject import subject_body
from tests.pipeline import lab

SHOULDER = ("LSHO", "LDELT")


def test_an_arm_without_markers_of_its_shoulder_is_solved_in_all_frames(tmp_path):
    """Gone after 0.2 s: shoulder and elbow can be exchanged along a curved valley.

    Steps go to and fro there.
    """
    walk = lab.walk(tmp_path, duration_s=4.0)
    body = subject_body(walk, Subject(sex="male"), Settings(), 74.6)
    names = walk.markers.names
    position = walk.markers.position.copy()
    position[20:, [names.index(name) for name in SHOULDER]] = np.nan
    markers = Markers(walk.markers.time, names, position)
    motion = solve_ik(body, markers)
    assert np.isfinite(motion.marker_error[:, motion.markers.index("LLEE")]).all()
