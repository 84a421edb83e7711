"""Single marker positions that cannot be are left out, and nothing else is."""

import numpy as np
import pytest

from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from hbm.plausibility.outliers import solve_without_outliers
from tests.hbm.motions import exchanged
from tests.synthetic import synthetic_body

BODY = synthetic_body()
FRAMES = slice(10, 16)


def displaced(markers, name, offset_m, frames=FRAMES):
    position = markers.position.copy()
    position[frames, markers.names.index(name)] += offset_m
    return Markers(markers.time, markers.names, position)


def noisy(markers, segments, size_m, frames=FRAMES):
    """The markers of some segments are anywhere."""
    own = zip(BODY.markers, BODY.marker_segment, strict=True)
    columns = [markers.names.index(name) for name, segment in own if segment in segments]
    position = markers.position.copy()
    position[frames, columns] += np.random.default_rng(7).normal(
        scale=size_m, size=position[frames, columns].shape
    )
    return Markers(markers.time, markers.names, position)


def test_of_a_walk_with_noise_no_position_is_left_out(walk):
    solved, motion, notes = solve_without_outliers(BODY, walk, jobs=1)
    assert solved is walk
    assert notes == ()
    np.testing.assert_array_equal(motion.q, solve_ik(BODY, walk).q)


@pytest.mark.parametrize("name", ["LHEE", "RASIS"])
def test_a_jump_of_one_marker_leaves_the_pose_as_the_others_show_it(walk, name):
    """As if the marker had not been seen."""
    gap = displaced(walk, name, np.nan)
    solved, motion, notes = solve_without_outliers(BODY, displaced(walk, name, 0.3), jobs=1)
    np.testing.assert_array_equal(solved.position, gap.position)
    np.testing.assert_array_equal(motion.q, solve_ik(BODY, gap).q)
    (note,) = notes
    assert note.values["samples"] == 6
    assert note.values["of_marker"] == {name: 6}
    assert (note.values["first_s"], note.values["last_s"]) == pytest.approx(walk.time[[10, 15]])


def test_an_arm_of_noise_is_left_out_as_a_whole(walk):
    arm = ("left_upper_arm", "left_forearm", "left_hand")
    _, motion, notes = solve_without_outliers(BODY, noisy(walk, arm, 0.5), jobs=1)
    whole = solve_ik(BODY, walk)
    assert [note.code for note in notes] == ["marker_outliers"]
    assert motion.converged.all()
    others = [i for i, name in enumerate(motion.names) if name[0] == "R" or name[:6] == "Pelvis"]
    np.testing.assert_allclose(motion.q[:, others], whole.q[:, others], atol=0.01)


def test_a_marker_that_is_wrong_throughout_is_not_left_out(walk):
    """It may be the body that is wrong; its error is a warning of its own."""
    everywhere = slice(0, len(walk.time))
    solved, _, notes = solve_without_outliers(BODY, displaced(walk, "C7", 0.15, everywhere), jobs=1)
    assert notes == ()
    assert not np.isnan(solved.position).any()


def test_heels_that_are_exchanged_for_some_frames_are_left_out_there(walk):
    _, motion, notes = solve_without_outliers(
        BODY, exchanged(walk, FRAMES, ("LHEE", "RHEE")), jobs=1
    )
    assert set(notes[0].values["of_marker"]) == {"LHEE", "RHEE"}
    assert motion.marker_error[np.isfinite(motion.marker_error)].max() < 0.03
