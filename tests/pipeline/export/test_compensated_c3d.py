"""A compensated file gives every program the plates that this one computes."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import to_lab
from hbm.signals.filtering import low_pass
from hbm.spatial import rotation_about
from pipeline.export.compensated_c3d import write_compensated, write_compensated_study
from pipeline.io.c3d.read import read_c3d
from pipeline.io.input_file import file_digest
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory, bind, with_corrected_plates
from pipeline.trial.ground.platform import platform_pose, pose_at
from pipeline.trial.ground.wrenches import plate_artefacts
from pipeline.trial.process import process_recording, process_trial
from pipeline.trial.study_files import read_study_file, read_study_laboratory
from tests.pipeline import lab
from tests.pipeline.wrong_plates import correction_of, wrongly_measured

FRAMES = (None, "plate", "lab")
RANGE_SHARE = 1e-6
CUTOFF_HZ = 20.0


@pytest.fixture(scope="module")
def original(study):
    return read_study_file(study, "sub01_pitch.c3d")


@pytest.fixture(scope="module")
def calibration(study):
    return study.path("empty.c3d")


@pytest.fixture(scope="module")
def written(original, laboratory, calibration, tmp_path_factory):
    """The trial that pitches by 10°, written in every frame."""
    folder = tmp_path_factory.mktemp("compensated")
    return {
        frame: write_compensated(
            *(original, laboratory, folder / f"{frame}.c3d"), calibration=calibration, frame=frame
        )
        for frame in FRAMES
    }


@pytest.fixture(scope="module")
def recordings(written):
    return {frame: read_c3d(file.path) for frame, file in written.items()}


def compensated(recording, laboratory):
    """Plates after the calibration's low-pass, minus the prediction after the same one."""
    columns = [recording.analog.channel(name) for names in lab.CHANNELS.values() for name in names]
    readings, time = np.column_stack(columns) * 9.80665, recording.analog.time
    for plate in recording.plates:
        model = laboratory.calibration.plates[f"plate {plate.number}"]
        low = model.setup.low_pass
        yield model.compensate(low(readings, time), low(plate.wrench_in_plate, plate.time))


def through_low_pass(recording):
    plates = tuple(
        replace(p, wrench_in_plate=low_pass(p.wrench_in_plate, p.time, CUTOFF_HZ, "zero_phase"))
        for p in recording.plates
    )
    return replace(recording, plates=plates)


def test_read_back_and_low_passed_the_plates_are_our_compensated_ones(
    original, recordings, laboratory
):
    for plate, expected in zip(
        through_low_pass(recordings[None]).plates, compensated(original, laboratory), strict=True
    ):
        error = np.abs(plate.wrench_in_plate - expected)
        assert (error < RANGE_SHARE * np.ptp(expected, axis=0)).all()


def test_only_what_the_treadmill_adds_is_subtracted(original, recordings, laboratory):
    """Without any filter: what the subject did to the plates is there up to their noise."""
    artefacts, _ = plate_artefacts(bind(original, laboratory))
    for before, after, artefact in zip(
        original.plates, recordings[None].plates, artefacts, strict=True
    ):
        error = np.abs(after.wrench_in_plate - (before.wrench_in_plate - artefact))
        assert (error < RANGE_SHARE * np.ptp(before.wrench_in_plate, axis=0)).all()
        assert np.abs(artefact).max() > 100


def test_the_file_says_what_was_done(recordings, study, written):
    for frame, recording in recordings.items():
        done = recording.compensation
        assert done.plates == (1, 2)
        assert done.calibration_sha256 == file_digest(study.path("empty.c3d"))
        assert done.cutoff_hz == CUTOFF_HZ
        assert done.frame == (frame or "recorded")
        assert written[frame].verification.disagreements == ()


def test_a_copy_of_wrong_plates_holds_corrected_ones(original, study, tmp_path):
    """Corrected first, then compensated by a calibration of plates corrected alike."""
    wrong = lab.save(wrongly_measured(original), tmp_path / "wrong.c3d")
    empty = read_c3d(study.path("empty.c3d"), "left,back,up")
    treadmill, correction = study.file.treadmill, correction_of(original)
    of_right = fit_calibration(empty, treadmill)
    of_wrong = fit_calibration(wrongly_measured(empty), treadmill, correction)
    artefacts, _ = plate_artefacts(bind(original, Laboratory(treadmill, of_right)))
    laboratory = Laboratory(treadmill, of_wrong, plates=correction)
    written = write_compensated(read_c3d(wrong), laboratory, tmp_path / "copy.c3d")
    copy = read_c3d(written.path)
    for plate, before, artefact in zip(copy.plates, original.plates, artefacts, strict=True):
        error = np.abs(plate.wrench_in_plate - (before.wrench_in_plate - artefact))
        assert (error < RANGE_SHARE * np.ptp(before.wrench_in_plate, axis=0)).all()
    assert copy.compensation.plate_calibration_sha256 == correction.sha256
    with pytest.raises(ValueError, match=r"copy\.c3d: .*corrected already"):
        with_corrected_plates(copy, correction)


def residual_of(recording, study, *, platform):
    laboratory = read_study_laboratory(study)
    left_out = {"calibration": None} | ({} if platform else {"platform": None})
    treadmill = laboratory.treadmill.model_copy(update=left_out)
    result = process_recording(
        recording,
        study.subject("sub01").person,
        study.file.settings,
        laboratory=replace(laboratory, treadmill=treadmill, calibration=None),
        condition=study.condition("pitch"),
    )
    return result.measured.residual


@pytest.mark.slow
def test_the_residual_of_the_written_file_is_the_compensated_one(study, recordings):
    """Plates of both have passed the calibration's low-pass, in newtons and newton metres."""
    expected = process_trial(study, "sub01", "pitch").compensated.residual
    moving = residual_of(through_low_pass(recordings[None]), study, platform=True)
    np.testing.assert_allclose(moving, expected, atol=0.02)
    in_lab = residual_of(through_low_pass(recordings["lab"]), study, platform=False)
    np.testing.assert_allclose(in_lab, expected, atol=1.0)
    assert np.sqrt(np.mean((in_lab - expected) ** 2)) < 0.02


def test_wrenches_in_the_lab_are_those_of_the_moving_plates(original, recordings, laboratory):
    """A program that knows no platform reads the wrench that acted, in the lab, from the file."""
    platform = laboratory.treadmill.platform
    pose, _ = platform_pose(original, platform, original.markers.time)
    at_samples = pose_at(original, pose, original.plates[0].time)
    for moving, at_rest in zip(recordings[None].plates, recordings["lab"].plates, strict=True):
        wrench = to_lab(moving.wrench, at_samples)
        error = np.abs(at_rest.wrench - wrench)
        assert (error < 1e-6 * np.ptp(wrench, axis=0).max()).all()


def test_with_the_plates_frame_the_corners_are_in_the_mean_pose(original, recordings, laboratory):
    """As a rigid plate: moved to the mean of its centre, tilted by the mean pitch."""
    platform = laboratory.treadmill.platform
    pose, _ = platform_pose(original, platform, original.markers.time)
    mean_pitch = pose.pitch.mean()
    assert abs(np.degrees(mean_pitch)) > 1
    for moved, plate in zip(recordings["plate"].plates, original.plates, strict=True):
        np.testing.assert_allclose(moved.center, pose.to_lab(plate.center).mean(axis=0), atol=1e-4)
        expected = rotation_about([0, 1, 0], mean_pitch) @ plate.rotation
        np.testing.assert_allclose(moved.rotation, expected, atol=1e-3)
        sides = [np.diff(p.corners, axis=0) for p in (moved, plate)]
        np.testing.assert_allclose(*(np.linalg.norm(side, axis=1) for side in sides), atol=1e-6)
    for one, other in zip(recordings["plate"].plates, recordings[None].plates, strict=True):
        np.testing.assert_array_equal(one.wrench_in_plate, other.wrench_in_plate)


def test_a_frame_without_a_pose_is_refused(original, laboratory, tmp_path):
    treadmill = laboratory.treadmill.model_copy(update={"platform": None})
    level = replace(laboratory, treadmill=treadmill)
    with pytest.raises(ValueError, match=r"sub01_pitch\.c3d: --frame lab .*pose"):
        write_compensated(original, level, tmp_path / "x.c3d", frame="lab")


def test_the_original_is_never_written_over(original, laboratory, tmp_path):
    """Nor by another name of the same file."""
    link = tmp_path / "link.c3d"
    link.symlink_to(original.source)
    before = file_digest(original.source)
    for target in (original.source, link):
        with pytest.raises(ValueError, match="over the original"):
            write_compensated(original, laboratory, target)
    assert file_digest(original.source) == before


def test_samples_that_a_plate_missed_stay_missing(original, laboratory, tmp_path):
    wrench = original.plates[0].wrench_in_plate.copy()
    wrench[5000:5100, 2] = np.nan
    first = replace(original.plates[0], wrench_in_plate=wrench)
    path = lab.save(replace(original, plates=(first, original.plates[1])), tmp_path / "gap.c3d")
    recording = read_c3d(path)
    unknown = np.isnan(recording.plates[0].wrench_in_plate).any(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(unknown), np.arange(5000, 5100))
    target = tmp_path / "out" / "gap.c3d"
    written = read_c3d(write_compensated(recording, laboratory, target, frame="lab").path)
    after = np.isnan(written.plates[0].wrench_in_plate).any(axis=1)
    np.testing.assert_array_equal(after, unknown)
    assert np.isfinite(written.plates[1].wrench_in_plate).all()


def test_a_study_is_written_whole_and_what_fails_is_listed(study, tmp_path):
    """One recording is damaged."""
    (tmp_path / "study").mkdir()
    for path in study.folder.glob("sub01_*.c3d"):
        (tmp_path / "study" / path.name).symlink_to(path)
    (tmp_path / "study" / "empty.c3d").symlink_to(study.path("empty.c3d"))
    (tmp_path / "study" / "damaged.c3d").write_bytes(b"\2\x50" + bytes(5000))
    first = study.subjects["sub01"]
    damaged = first.trials["sway"][0].model_copy(update={"file": "damaged.c3d"})
    subject = first.model_copy(update={"trials": first.trials | {"sway": (damaged,)}})
    other = replace(study, folder=tmp_path / "study", subjects={"sub01": subject})
    outcomes = dict(write_compensated_study(other, tmp_path / "out", None))
    assert len(list((tmp_path / "out").iterdir())) == 2
    assert "not a C3D" in outcomes["damaged.c3d"]
    assert all(outcomes[f"sub01_{c}.c3d"].path for c in ("baseline", "pitch"))


def test_a_study_without_a_calibration_is_refused_in_one_line(study, tmp_path):
    treadmill = study.file.treadmill.model_copy(update={"calibration": None})
    without = replace(study, file=study.file.model_copy(update={"treadmill": treadmill}))
    with pytest.raises(ValueError, match=r"study\.toml .*no calibration .*treadmill"):
        next(write_compensated_study(without, tmp_path, None))
