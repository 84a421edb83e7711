"""A recording for the viewer, read back from its file, holds the trial."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from hbm.coordinates import INDEX, MOVING
from hbm.poses import marker_positions, segment_frames
from hbm.spatial import shift_wrench
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import AXES, CYCLE_COLUMNS, cycle_rows, reported
from pipeline.trial.result import CyclePart
from pipeline.viewer.scene import pressure_point
from pipeline.viewer.serve import viewer_binary
from pipeline.viewer.trial import _clock, opening, write_recording
from tests.benchmarks.walker import STRIDE_HZ
from tests.pipeline.stored_recording import Stored
from tests.pipeline.viewer_trial import FIRST_FRAME, LIFT_M, ONSETS_S, sway_and_pitch, viewer_trial

FRAMES = 500
STEP = 2
LOST = slice(100, 130)
LONG_FRAMES = 18000
MEGABYTE = 1e6


@pytest.fixture(scope="module")
def trial():
    return viewer_trial(FRAMES)


@pytest.fixture(scope="module")
def written(trial, tmp_path_factory):
    path = tmp_path_factory.mktemp("viewer") / "trial.rrd"
    write_recording(trial, path)
    return path


@pytest.fixture(scope="module")
def stored(written):
    return Stored(written)


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """A trial without compensation, on a floor that stands still, with frames without solution."""
    result = viewer_trial(FRAMES, compensated=False, moving=False, lost=LOST)
    path = tmp_path_factory.mktemp("viewer") / "broken.rrd"
    write_recording(result, path)
    return result, path


def single(values):
    return np.asarray(values, np.float32)


def test_measured_markers_come_back_at_their_frames_and_times(stored, trial):
    entity = "lab/markers/measured"
    expected = single(trial.markers.position[::STEP])
    np.testing.assert_array_equal(np.array(stored.rows(entity, "positions")), expected)
    np.testing.assert_allclose(stored.times(entity), trial.markers.time[::STEP], atol=1e-9)
    np.testing.assert_array_equal(
        stored.times(entity, "frame"), FIRST_FRAME + np.arange(0, FRAMES, STEP)
    )
    names = stored.rows(entity, "labels", static=True)[0]
    assert tuple(names) == trial.markers.names


def test_segments_are_drawn_at_their_poses_in_the_model(stored, trial):
    rotation, origin = segment_frames(trial.body, trial.motion.q[::STEP])
    for k, segment in enumerate(MOVING):
        entity = f"lab/body/{segment}"
        at = np.array(stored.rows(entity, "translation"))[:, 0]
        turned = Rotation.from_quat(np.array(stored.rows(entity, "quaternion"))[:, 0])
        np.testing.assert_array_equal(at, single(origin[:, k]))
        np.testing.assert_allclose(turned.as_matrix(), rotation[:, k], atol=1e-6)


def test_modelled_markers_are_attached_to_their_segments(stored, trial):
    body = trial.body
    for segment in set(body.marker_segment):
        mine = [k for k, name in enumerate(body.marker_segment) if name == segment]
        entity = f"lab/body/{segment}/markers"
        places = stored.rows(entity, "positions", static=True)[0]
        np.testing.assert_array_equal(places, single(body.marker_position[mine]))
        labels = stored.rows(entity, "labels", static=True)[0]
        assert [label.removesuffix(", modelled") for label in labels] == [
            body.markers[k] for k in mine
        ]


def test_lines_join_only_markers_that_are_far_from_the_model(trial, tmp_path):
    position = trial.markers.position.copy()
    position[200:300, [3, 7]] = position[200:300, [7, 3]]
    swapped = replace(trial, markers=replace(trial.markers, position=position))
    write_recording(swapped, tmp_path / "swapped.rrd")
    lines = Stored(tmp_path / "swapped.rrd").rows("lab/markers/error", "strips")
    assert [len(row) for row in lines] == [0] * 100 + [2] * 50 + [0] * 100
    modelled = marker_positions(trial.body, trial.motion.q)[:, [3, 7]]
    expected = np.stack([position[:, [3, 7]], modelled], axis=2)[200:300:STEP]
    np.testing.assert_allclose(np.array(lines[100:150]), single(expected), atol=1e-6)


@pytest.mark.parametrize("variant", ["measured", "compensated"])
def test_ground_reaction_is_a_metre_per_thousand_newtons_and_absent_where_unloaded(
    stored, trial, variant
):
    feet = [wrench[::STEP] for wrench in trial.ground[variant].values()]
    pose = sway_and_pitch(trial.motion.time[::STEP])
    at = [pressure_point(w, LIFT_M, pose, trial.settings.contact_threshold_n) for w in feet]
    entity = f"lab/ground_reaction/{variant}"
    arrows = stored.rows(entity, "vectors")
    starts = stored.rows(entity, "origins")
    assert {len(row) for row in arrows} == {1, 2}
    for row, (vectors, origins) in enumerate(zip(arrows, starts, strict=True)):
        loaded = [k for k in (0, 1) if np.isfinite(at[k][row]).all()]
        np.testing.assert_array_equal(vectors, single([feet[k][row, :3] / 1000 for k in loaded]))
        np.testing.assert_array_equal(origins, single([at[k][row] for k in loaded]))


def test_centre_of_pressure_lies_on_the_moving_surface_and_leaves_only_a_moment_about_its_normal():
    rng = np.random.default_rng(0)
    pose = sway_and_pitch(np.linspace(0, 5, 200))
    force = rng.normal([0, 0, 700], [80, 40, 100], (200, 3))
    wrench = np.hstack([force, rng.normal(scale=100, size=(200, 3))])
    point = pressure_point(wrench, LIFT_M, pose, 30.0)
    normal = pose.rotation[:, :, 2]
    height = np.sum((point - pose.position) * normal, axis=1)
    np.testing.assert_allclose(height, LIFT_M, atol=1e-12)
    left = shift_wrench(wrench, point)[:, 3:]
    np.testing.assert_allclose(np.cross(left, normal), 0, atol=1e-9)


@pytest.mark.parametrize("variant", ["measured", "compensated"])
def test_residual_wrench_is_drawn_at_the_pelvis_in_lab_axes(stored, trial, variant):
    residual = getattr(trial, variant).residual[::STEP]
    pelvis = segment_frames(trial.body, trial.motion.q[::STEP])[1][:, MOVING.index("pelvis")]
    entity = f"lab/residual/{variant}"
    vectors = np.array(stored.rows(entity, "vectors"))
    np.testing.assert_array_equal(vectors[:, 0], single(residual[:, :3] / 500))
    np.testing.assert_array_equal(vectors[:, 1], single(residual[:, 3:] / 250))
    origins = np.array(stored.rows(entity, "origins"))
    np.testing.assert_array_equal(origins, single(np.repeat(pelvis[:, None], 2, axis=1)))


def test_residual_curves_are_the_reported_residuals_to_the_last_bit(stored, trial):
    for k, axis in enumerate(AXES):
        entity = f"residual/{axis}"
        curves = np.array(stored.rows(entity, "scalars"))
        for column, dynamics in enumerate((trial.measured, trial.compensated)):
            np.testing.assert_array_equal(curves[:, column], reported(dynamics.residual)[:, k])
        assert list(stored.rows(entity, "names", static=True)[0]) == ["measured", "compensated"]
        np.testing.assert_allclose(stored.times(entity), trial.motion.time, atol=1e-9)


def test_joint_moments_of_both_legs_are_shown_by_body_mass(stored, trial):
    curves = np.array(stored.rows("joints/knee_flexion", "scalars"))
    for column, name in enumerate(("RKneeFlexion", "LKneeFlexion")):
        expected = trial.compensated.force(name) / trial.body.mass
        np.testing.assert_allclose(curves[:, column], expected, rtol=1e-12)
    assert list(stored.rows("joints/knee_flexion", "names", static=True)[0]) == ["right", "left"]


def test_marker_errors_are_in_millimetres_with_the_largest_first(stored, trial):
    motion = trial.motion
    names = list(stored.rows("marker_error_mm", "names", static=True)[0])
    columns = [motion.markers.index(name) for name in names]
    errors = np.array(stored.rows("marker_error_mm", "scalars"))
    np.testing.assert_array_equal(errors, motion.marker_error[::STEP, columns] * 1000)
    assert (np.diff(np.sum(errors**2, axis=0)) <= 0).all()


def test_platform_moves_with_its_pose_and_carries_the_plates(stored, trial):
    at = np.array(stored.rows("lab/platform", "translation"))[:, 0]
    turned = Rotation.from_quat(np.array(stored.rows("lab/platform", "quaternion"))[:, 0])
    np.testing.assert_array_equal(at, single(trial.platform.position[::STEP]))
    np.testing.assert_allclose(turned.as_matrix(), trial.platform.rotation[::STEP], atol=1e-6)
    for plate in trial.plates:
        entity = f"lab/platform/plate_{plate.number}/surface"
        corners = stored.rows(entity, "vertex_positions", static=True)[0]
        np.testing.assert_array_equal(corners, single(plate.corners))


def test_phases_change_at_the_events_and_perturbations_begin_at_their_onsets(stored, trial):
    for side in ("left", "right"):
        mine = [event for event in trial.events if event.side == side]
        entity = f"{side}_foot"
        states = [row[0] for row in stored.rows(entity, "state")]
        phase = {"foot_strike": "stance", "foot_off": "swing"}
        assert states == [phase[event.label] for event in mine]
        np.testing.assert_allclose(stored.times(entity), [event.time for event in mine], atol=1e-9)
    states = [list(row) for row in stored.rows("perturbation", "state")]
    assert states == [["perturbation"], [], ["perturbation"], []]
    assert ONSETS_S.tolist() == [1.0, 3.0]
    np.testing.assert_allclose(stored.times("perturbation"), [1.0, 2.0, 3.0, 4.0])


def test_one_recording_and_its_layout_are_in_the_file_and_verify_passes(written):
    reader = RrdReader(written)
    assert (len(reader.recordings()), len(reader.blueprints())) == (1, 1)
    subprocess.run([viewer_binary(), "rrd", "verify", str(written)], check=True, timeout=60)


def test_identifier_is_a_pseudonym_and_differs_between_files_of_the_same_trial(tmp_path):
    identifiers, trial = set(), viewer_trial(60)
    for folder in ("one", "other"):
        path = tmp_path / folder / "trial.rrd"
        write_recording(trial, path)
        identifiers.add(RrdReader(path).recordings()[0].recording_id)
    assert len(identifiers) == 2
    assert not any("sub07" in identifier or "walk" in identifier for identifier in identifiers)


def test_frames_without_solution_hide_the_body_and_break_the_curves(broken):
    result, path = broken
    stored = Stored(path)
    gone = np.zeros(FRAMES, bool)
    gone[LOST] = True
    origin = np.array(stored.rows("lab/body/pelvis", "translation"))[:, 0]
    np.testing.assert_array_equal(np.isnan(origin).all(axis=1), gone[::STEP])
    turn = np.array(stored.rows("lab/body/pelvis", "quaternion"))[:, 0]
    np.testing.assert_allclose(np.linalg.norm(turn, axis=1), 1, atol=1e-6)
    arrows = [len(row) for row in stored.rows("lab/residual/measured", "vectors")]
    np.testing.assert_array_equal(np.array(arrows) == 0, gone[::STEP])
    curve = np.array(stored.rows("residual/Fx", "scalars"))[:, 0]
    np.testing.assert_array_equal(np.isnan(curve), gone)
    np.testing.assert_array_equal(curve, reported(result.measured.residual)[:, 0])
    markers = np.array(stored.rows("lab/markers/measured", "positions"))
    np.testing.assert_array_equal(markers, single(result.markers.position[::STEP]))
    subprocess.run([viewer_binary(), "rrd", "verify", str(path)], check=True, timeout=60)


def pushed(trial, frame):
    """The trial with 400 N to the left on the pelvis in one frame that compensation leaves."""
    residual = trial.compensated.residual.copy()
    residual[frame, 1] += 400
    variants = trial.variants | {"compensated": replace(trial.compensated, residual=residual)}
    return replace(trial, variants=variants)


@pytest.mark.parametrize("frame", [180, 310, 377])
def test_a_trial_opens_at_the_largest_residual_of_its_worst_gait_cycle(trial, frame):
    assert opening(pushed(trial, frame))[1] == round(trial.motion.time[frame] * 1e9)


def test_a_trial_without_gait_cycles_opens_at_the_largest_residual_that_counts(trial):
    span = replace(pushed(trial, 310), span=(2.0, 4.0))
    assert opening(span)[1] == round(trial.motion.time[310] * 1e9)
    assert opening(replace(span, span=(0.0, 2.0)))[1] < 2e9


def test_a_trial_opens_where_it_is_told_to_and_only_within_its_recording(trial):
    assert opening(trial, 2.5) == ("time", 2_500_000_000)
    with pytest.raises(ValueError, match=r"^--at 9: .* 0\.00 to 4\.99 s$"):
        opening(trial, 9.0)


def test_gait_cycles_have_a_timeline_of_their_own_with_their_worst_instants_and_rms(
    trial, tmp_path
):
    frame = 310
    write_recording(pushed(trial, frame), tmp_path / "pushed.rrd")
    stored = Stored(tmp_path / "pushed.rrd")
    table = pd.DataFrame(cycle_rows(pushed(trial, frame), "walk"), columns=CYCLE_COLUMNS)
    table = table[table.compensated & (table.axis == "Fy")]
    worst = table.loc[table.rms.idxmax()]
    strikes = [e.time for e in trial.events if (e.side, e.label) == (worst.side, "foot_strike")]
    numbers = stored.times("residual/Fy", "gait cycle")
    curves = np.array(stored.rows("residual/Fy", "scalars", timeline="gait cycle"))
    mine = table[table.side == worst.side]
    assert [strikes[number - 1] for number in numbers] == mine.start_s.tolist()
    np.testing.assert_allclose(curves[:, 1], mine.rms, rtol=1e-12)
    markers = stored.rows("lab/markers/measured", "positions", timeline="gait cycle")
    expected = single(trial.markers.position[frame])
    np.testing.assert_array_equal(markers[mine.start_s.tolist().index(worst.start_s)], expected)


def test_the_timeline_in_percent_goes_on_by_a_hundred_from_foot_strike_to_foot_strike(trial):
    strikes = [e.time for e in trial.events if (e.side, e.label) == ("left", "foot_strike")]
    middle = (strikes[2] + strikes[3]) / 2
    clock = _clock(trial, "left")(np.array([0.0, strikes[0], middle, strikes[3]]))
    assert clock["gait cycle, %"].tolist() == [100, 100, 350, 400]


def later(trial, delay_s):
    """The trial as if the same gait cycles were walked some time later."""
    events = tuple(replace(event, time=event.time + delay_s) for event in trial.events)
    cycles = {side: spans + delay_s for side, spans in trial.cycles.items()}
    return replace(trial, source=Path("later.c3d"), events=events, cycles=cycles)


def test_trials_side_by_side_are_at_the_same_percentage_of_the_same_gait_cycle(trial, tmp_path):
    path, delay_s = tmp_path / "both.rrd", 0.3
    write_recording(trial, path, beside=later(trial, delay_s))
    stored, reached = Stored(path), []
    for k in (0, 1):
        entity = f"trial_{k}/lab/markers/measured"
        percent = stored.times(entity, "gait cycle, %")
        reached.append(stored.times(entity)[np.searchsorted(percent, 350)])
        assert percent[0] == 100, "segments without a pose would be drawn in a heap"
        assert stored.rows(f"trial_{k}/residual/Fx", "scalars")
    strides = (reached[1] - reached[0] - delay_s) * STRIDE_HZ
    assert strides == pytest.approx(round(strides), abs=0.021 * STRIDE_HZ)
    assert opening(trial, 2.5, beside=True)[0] == "gait cycle, %"
    subprocess.run([viewer_binary(), "rrd", "verify", str(path)], check=True, timeout=60)


def test_the_worst_gait_cycles_of_trials_side_by_side_have_one_number(trial, tmp_path):
    early, late = 180, 377
    for k, frames in enumerate([(early, late), (late, early)]):
        write_recording(
            pushed(trial, frames[0]), tmp_path / f"{k}.rrd", beside=pushed(trial, frames[1])
        )
        stored, numbers = Stored(tmp_path / f"{k}.rrd"), []
        for n, frame in enumerate(frames):
            entity = f"trial_{n}/residual/Fy"
            percent, seconds = stored.times(entity, "gait cycle, %"), stored.times(entity)
            numbers.append(percent[np.searchsorted(seconds, trial.motion.time[frame])] // 100)
            assert percent[0] == 100
        assert numbers[0] == numbers[1]


def test_where_a_part_of_gait_cycles_counts_trials_are_still_aligned_at_foot_strikes(
    trial, tmp_path
):
    parts = {side: spans[:, :1] + [0.3, 0.6] for side, spans in trial.cycles.items()}
    partly = replace(trial, part=CyclePart("0.3 to 0.6 s", parts))
    write_recording(trial, tmp_path / "both.rrd", beside=partly)
    stored = Stored(tmp_path / "both.rrd")
    percent = [stored.times(f"trial_{k}/residual/Fx", "gait cycle, %") for k in (0, 1)]
    walking = (trial.motion.time > 1.5) & (percent[1] > 100)  # after the first foot strikes
    apart = (percent[1] - percent[0])[walking]
    assert np.median(apart) % 100 == 0
    np.testing.assert_allclose(apart, np.median(apart), atol=1, err_msg="beyond rounding")


def test_trials_without_gait_cycles_are_not_shown_side_by_side(trial, tmp_path):
    standing = replace(trial, span=(1.0, 4.0))
    with pytest.raises(ValueError, match=r"^both: .*gait cycles"):
        write_recording(trial, tmp_path / "both.rrd", beside=standing)
    assert opening(standing, beside=True)[0] == "time"


VIDEO = Path(__file__).with_name("five_frames.mp4")
"""At 10 Hz."""


def test_each_frame_of_a_video_is_at_its_time_in_the_trial(trial, tmp_path):
    path = tmp_path / "trial.rrd"
    write_recording(trial, path, video=(VIDEO, 1.25))
    stored = Stored(path)
    np.testing.assert_allclose(stored.times("video"), 1.25 + np.arange(5) / 10)
    shown_ns = np.ravel(stored.rows("video", "timestamp"))
    np.testing.assert_array_equal(shown_ns, np.arange(5) * 10**8)


def test_of_a_video_that_begins_early_only_what_is_of_the_trial_is_shown(trial, tmp_path):
    write_recording(trial, tmp_path / "trial.rrd", video=(VIDEO, -0.25))
    times = Stored(tmp_path / "trial.rrd").times("video")
    np.testing.assert_allclose(times, [0.05, 0.15])


def test_a_file_that_is_no_video_is_refused_by_its_name(trial, tmp_path):
    path = tmp_path / "no.mp4"
    path.write_bytes(b"no video")
    with pytest.raises(ValueError, match=r"no\.mp4: no MP4"):
        write_recording(trial, tmp_path / "trial.rrd", video=(path, 0.0))


def test_a_body_of_which_a_joint_is_unknown_is_hidden_whole(trial, tmp_path):
    q = trial.motion.q.copy()
    q[200:300, INDEX["LKneeFlexion"]] = np.nan
    partly = replace(trial, motion=replace(trial.motion, q=q))
    write_recording(partly, tmp_path / "partly.rrd")
    stored = Stored(tmp_path / "partly.rrd")
    hidden = np.zeros(FRAMES // STEP, bool)
    hidden[100:150] = True
    for segment in MOVING:
        place = np.array(stored.rows(f"lab/body/{segment}", "translation"))[:, 0]
        np.testing.assert_array_equal(np.isnan(place).all(axis=1), hidden, segment)


def test_the_head_is_joined_to_the_trunk(stored, trial):
    """By a bone from the neck, where the head begins, to the centre of its ellipsoid."""
    (length,) = stored.rows("lab/body/head/bones", "lengths", static=True)[0]
    assert length == single(np.linalg.norm(trial.body.segments["head"].center))


def test_no_residual_is_shown_where_filters_have_not_settled(trial, tmp_path):
    settled = np.ones(FRAMES, bool)
    settled[:18] = settled[-18:] = False
    result = replace(trial, quality=np.where(settled, 0, int(Quality.SETTLING)))
    write_recording(result, tmp_path / "ends.rrd")
    stored = Stored(tmp_path / "ends.rrd")
    curve = np.array(stored.rows("residual/Fx", "scalars"))
    np.testing.assert_array_equal(np.isfinite(curve).all(axis=1), settled)
    arrows = np.array([len(row) for row in stored.rows("lab/residual/measured", "vectors")])
    np.testing.assert_array_equal(arrows > 0, settled[::STEP])


@pytest.mark.slow
def test_twelve_minutes_stay_under_150_megabytes(tmp_path):
    """Of which three are written."""
    path = tmp_path / "long.rrd"
    write_recording(viewer_trial(LONG_FRAMES), path)
    assert 4 * path.stat().st_size < 150 * MEGABYTE


@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not limit the size of a file")
def test_a_full_disk_is_one_line_that_names_the_file(tmp_path):
    """A limit on the size of a file stops its writing in the middle, as a full disk does."""
    program = (
        "import resource, signal, sys; from pathlib import Path\n"
        "from pipeline.cli import study\n"
        "from pipeline.cli.app import main\n"
        "from pipeline.run import store\n"
        "from tests.pipeline.viewer_trial import viewer_trial\n"
        "store.read_trial = lambda path, frames=True: viewer_trial(200)\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        "sys.exit(main(['view', 'any.parquet', '--save', sys.argv[1]]))\n"
    )
    path = tmp_path / "new" / "trial.rrd"
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).resolve().parents[3],
        timeout=120,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(rf"hbm: error: {re.escape(str(path))}: .*\n", done.stderr)
    assert list(path.parent.iterdir()) == []


def test_a_trial_without_gait_cycles_is_shown(trial, tmp_path):
    result = replace(trial, cycles={"right": np.empty((0, 2))}, events=())
    write_recording(result, tmp_path / "trial.rrd")
    text = str(Stored(tmp_path / "trial.rrd").rows("summary", "text", static=True)[0][0])
    assert "no residuals" in text
