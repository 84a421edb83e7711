"""The live chain gives, frame by frame, what ``filter = "realtime"`` gives of the recording."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import BeltModel
from hbm.coordinates import LIMBS
from pipeline.config.schema import Belt, Platform, Settings, Subject, Treadmill
from pipeline.io.c3d.read import read_c3d
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import reported
from pipeline.trial.study_files import read_study_file
from tests.hbm import motions
from tests.pipeline import lab
from tests.pipeline.live.playing import arrivals, body_of, chain_of, play
from tests.pipeline.wrong_plates import correction_of, wrongly_measured

PERSON = Subject(sex="male", mass_kg=74.6)
REALTIME = Settings(filter="realtime")
MARKED = Treadmill(
    accelerometers=lab.CHANNELS, platform=Platform(markers=tuple(lab.PLATFORM_MARKERS_M))
)
FRAMES = 600
MAX_ANGLE_RAD = 1e-9
MAX_FORCE_N = 1e-4


def assert_same(recording, laboratory, settings=REALTIME, start_s=0.0, static=None):
    """Process a recording both ways and compare every frame that was not late."""
    whole = process_recording(recording, PERSON, settings, laboratory=laboratory, static=static)
    chain = chain_of(whole.body, laboratory, settings, recording)
    frames = play(chain, arrivals(recording, start_s=start_s))
    assert len(frames) == len(whole.motion.time) == chain.received
    in_time = np.array([not frame.quality & Quality.LATE for frame in frames])
    assert np.count_nonzero(~in_time) <= round(chain.wait_s * 100) + 1

    def compare(found, expected, largest):
        found = np.array(found)[in_time]
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected[in_time]))
        assert np.nanmax(np.abs(found - expected[in_time])) < largest

    np.testing.assert_array_equal([f.markers for f in frames], recording.markers.position)
    if whole.platform is None:
        assert all(frame.platform is None for frame in frames)
    else:
        here = np.array([frame.platform[1] for frame in frames])
        known = np.isfinite(here[:, 0]) & in_time
        assert known.mean() > 0.8
        np.testing.assert_allclose(here[known], whole.platform.position[known], atol=1e-9)
    compare([frame.q for frame in frames], whole.motion.q, MAX_ANGLE_RAD)
    errors = [frame.marker_error for frame in frames]
    compare(errors, whole.motion.marker_error, MAX_ANGLE_RAD)
    variants = {"measured": whole.measured, "compensated": whole.compensated}
    for name, dynamics in variants.items():
        if dynamics is None:
            assert name not in frames[0].residual
            continue
        residual = [frame.residual[name] for frame in frames]
        compare(residual, reported(dynamics.residual), MAX_FORCE_N)
        for k, foot in enumerate(("left_foot", "right_foot")):
            by_foot = [frame.by_foot[name][k] for frame in frames]
            compare(by_foot, whole.ground[name][foot], MAX_FORCE_N)
        tau = np.array([frame.tau[name] for frame in frames])
        known = np.isfinite(dynamics.tau) & in_time[:, None]
        assert np.count_nonzero(known) > 0.5 * known.size
        assert np.abs(tau - dynamics.tau)[known].max() < MAX_FORCE_N
    counts = np.array([frame.quality.counts for frame in frames])
    np.testing.assert_array_equal(counts[in_time], whole.counts[in_time])
    assert counts.any()
    return whole, frames


@pytest.fixture(scope="module")
def pitch(study):
    return lab.cropped(read_study_file(study, "sub01_pitch.c3d"), 0, FRAMES + 100)


@pytest.fixture(scope="module")
def walk(walker):
    return lab.cropped(walker, 0, FRAMES)


def without(recording, names, start_s, stop_s):
    time = recording.markers.time
    rows = (time >= start_s) & (time < stop_s)
    return replace(recording, markers=motions.without(recording.markers, names, rows))


@pytest.mark.parametrize(("condition", "first"), [("sway", 450), ("pitch", 0)])
def test_on_a_moving_platform_with_compensation(study, laboratory, condition, first):
    recording = read_study_file(study, f"sub01_{condition}.c3d")
    some = lab.cropped(recording, first, first + FRAMES)
    whole, _ = assert_same(some, laboratory, static=recording)
    added = whole.measured.residual - whole.compensated.residual
    assert np.nanmax(np.abs(added)) > 50


def test_on_a_treadmill_that_stands_still(walk):
    assert_same(walk, Laboratory(Treadmill()), Settings(filter="realtime", cutoff_hz=10.0))


def test_with_single_markers_missing_whatever_the_streams_clock_shows(pitch, laboratory):
    gaps = without(pitch, ("LHEE", "RASIS"), 3.0, 4.0)
    assert_same(without(gaps, ("C7", "LLEK"), 3.5, 3.6), laboratory, start_s=123456.789)


def test_with_limbs_unseen_for_a_second_each(pitch, laboratory):
    segment_of = body_of(pitch, PERSON, laboratory=laboratory).segment_of
    gaps, starts_s = pitch, {"left leg": 2.5, "right arm": 4.5}
    for limb, start_s in starts_s.items():
        names = [name for name, segment in segment_of.items() if segment in LIMBS[limb]]
        gaps = without(gaps, names, start_s, start_s + 1.0)
    _, frames = assert_same(gaps, laboratory)
    for limb, start_s in starts_s.items():
        during = frames[round(100 * start_s) :][:100]
        unseen = [bool(frame.quality & Quality.LIMB_UNSEEN) for frame in during]
        assert all(unseen) == any(unseen) == (limb == "left leg")


def test_without_markers_for_a_while_and_with_one_that_jumps(pitch, laboratory):
    gone = without(pitch, pitch.markers.names, 4.0, 4.3)
    jumped = motions.displaced(gone.markers, "RHEE", 0.4, slice(540, 560))
    _, frames = assert_same(replace(gone, markers=jumped), laboratory)
    left_out = [k for k, f in enumerate(frames) if f.quality & Quality.MARKERS_LEFT_OUT]
    assert left_out == list(range(540, 560))
    assert all(frame.quality & Quality.POSE_UNKNOWN for frame in frames[400:430])


def test_with_belts_that_accelerate(walk):
    """Models that read ahead, and a speed with noise."""
    moved = lab.on_platform(walk, lab.pitching(FRAMES / 100))
    time, random = moved.analog.time, np.random.default_rng(5)
    speed = 1.3 + 0.3 * np.sin(2 * np.pi * 0.9 * time) + random.normal(0, 0.001, len(time))
    analog = replace(
        moved.analog,
        names=(*moved.analog.names, "Left", "Right"),
        units=(*moved.analog.units, "m/s", "mm/s"),
        values=np.column_stack([moved.analog.values, speed, 1000 * np.flip(speed)]),
    )
    belt = Belt(calibration="belts.c3d", speed_channels=("Left", "Right"))
    treadmill = MARKED.model_copy(update={"belt": belt})
    models = tuple(BeltModel([-1.2, 0.5, 2.0, -1.0, 0.5], advance=s) for s in (0, 2))
    whole, _ = assert_same(replace(moved, analog=analog), Laboratory(treadmill, belts=models))
    added = whole.measured.residual - whole.compensated.residual
    assert np.nanmax(np.abs(added[:, 4])) > 1


def with_differences(calibration, lags_s=(0.01, 0.02, 0.04)):
    """The same calibration with dynamic models, whose differences have gains of their own."""
    random, models = np.random.default_rng(0), {}
    for name, model in calibration.plates.items():
        more = random.normal(0, 5, (len(lags_s) * (len(model.gain) - 1), 6))
        gain = np.vstack([model.gain[:-1], more, model.gain[-1:]])
        covariance = np.tile(1e-6 * np.eye(len(gain)), (6, 1, 1))
        models[name] = replace(model, gain=gain, covariance=covariance, lags_s=lags_s)
    return replace(calibration, dynamic=models)


def test_with_accelerometers_and_plates_that_are_late(walk):
    late = {"plate_delay_s": 0.012, "accelerometer_delay_s": 0.019}
    empty = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0), **late)
    static = MARKED.model_copy(update={"inertia_model": "static"})
    calibration = fit_calibration(empty, static)
    laboratory = Laboratory(static, with_differences(calibration))
    settings = Settings(filter="realtime", plate_delay_s=0.012)
    assert_same(lab.on_platform(walk, lab.pitching(FRAMES / 100), **late), laboratory, settings)


def test_with_plates_that_their_calibration_corrects(walk):
    correction = correction_of(walk, delays=(0.004, 0.011))
    assert_same(wrongly_measured(walk), Laboratory(Treadmill(), plates=correction))


def test_with_a_platform_as_commanded(walk):
    platform = Platform(
        sway_channel="Sway", pitch_channel="Pitch", pivot_m=tuple(lab.PIVOT_M), delay_s=0.03
    )
    moved = lab.on_platform(walk, lab.pitching(FRAMES / 100), command_delay_s=0.03)
    assert_same(moved, Laboratory(MARKED.model_copy(update={"platform": platform})))


def test_on_a_real_recording(shared_data):
    recording = read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")
    assert_same(recording, Laboratory(Treadmill()))
