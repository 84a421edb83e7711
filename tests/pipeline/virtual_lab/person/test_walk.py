"""The simulated gait is within published norms and obeys the equations of motion."""

import numpy as np
import pytest

from hbm.coordinates import INDEX
from hbm.spatial import GRAVITY_MPS2
from pipeline.virtual_lab.person.balance import balanced
from pipeline.virtual_lab.person.body import COLUMN, center_of_mass, ground_wrench, segment_poses
from pipeline.virtual_lab.person.gait import posture, rolled
from pipeline.virtual_lab.person.subject import Person, make_subject
from pipeline.virtual_lab.person.walk import foot_wrenches, left_wrench, plate_wrenches
from tests.virtual_gait import fit_gait, gait_optimum
from tests.virtual_gait.realism import (
    ANGLES,
    angle_curves,
    force_peaks,
    lean_change,
    pressure_inside_foot,
    read_norms,
    share_within_band,
    steady,
    trunk_lean,
)

SUBJECTS = range(9)
WALKS = [
    *((subject, "baseline") for subject in SUBJECTS),
    (0, "sway"),
    (0, "pitch"),
]


@pytest.fixture(scope="module")
def norms(shared_data):
    """Published bands of eight joint angles: adults at self-selected speed."""
    return read_norms(shared_data / "normative_gait" / "pinzone_2014.csv")


@pytest.fixture(scope="module")
def angles(walked):
    """Mean joint angles of nine subjects over the gait cycle: title -> (9, 101) [deg]."""
    curves = [angle_curves(walked(subject)[0]) for subject in SUBJECTS]
    return {title: np.stack([c[title] for c in curves]) for title in curves[0]}


@pytest.mark.parametrize("title", ANGLES)
def test_joint_angles_are_as_often_within_two_standard_deviations_as_those_of_healthy_people(
    norms, angles, title
):
    """Who are so at 95 % of all instants. Knees are bent more than the norms' at contact."""
    shares = share_within_band(angles[title], norms[title])
    assert shares.mean() > 0.95
    assert (shares > (0.8 if title == "knee flexion" else 0.95)).all()


@pytest.mark.parametrize("title", ANGLES)
def test_mean_joint_angles_of_nine_subjects_are_within_the_published_band(norms, angles, title):
    band = norms[title]
    within_band = np.abs(angles[title].mean(axis=0) - band.mean) < band.sd
    assert within_band.mean() > 0.8


@pytest.mark.slow
def test_the_gait_pattern_is_what_its_script_fits_to_the_norms(shared_data):
    """For level ground: fitted again from the published table, against the data file."""
    path = shared_data / "normative_gait" / "pinzone_2014.csv"
    reference = make_subject(Person())
    target, _ = fit_gait.target_of(reference, *fit_gait.read_norms(path))
    found = gait_optimum.optimise(reference, target, fit_gait.HARMONICS)
    phase = np.arange(50) / 50
    walk = posture(phase, np.ones(50), np.zeros(50), reference.standing)
    for name in ("RHipFlexion", "RKneeFlexion", "RAnklePlantarFlexion", "PelvisZ", "TrunkFlexion"):
        expected = fit_gait.evaluate(found[name], phase)
        np.testing.assert_allclose(walk[:, INDEX[name]], expected, atol=0.002)


@pytest.mark.parametrize("subject", SUBJECTS)
def test_vertical_force_has_two_peaks(walked, subject):
    first, second, valley, *_ = force_peaks(walked(subject)[0]).values()
    assert 1.0 <= first <= 1.3
    assert 1.0 <= second <= 1.3
    assert valley < min(first, second) - 0.15


def test_the_leading_foot_brakes_and_the_trailing_foot_pushes(walked):
    """By about a quarter of body weight on average, and nobody pushes by more than a third."""
    peaks = [force_peaks(walked(subject)[0]) for subject in SUBJECTS]
    for name, most in (("braking", 0.3), ("propulsion", 1 / 3)):
        peak = np.array([own[name] for own in peaks])
        assert 0.15 <= peak.mean() <= 0.3
        assert ((peak > 0.1) & (peak < most)).all()


@pytest.mark.parametrize(("subject", "condition"), WALKS)
def test_the_centre_of_pressure_is_under_the_stance_foot_in_single_support(
    walked, subject, condition
):
    assert pressure_inside_foot(walked(subject, condition)[0]) > 0.95


@pytest.mark.parametrize("condition", ["baseline", "sway", "pitch"])
def test_both_feet_together_carry_what_the_equations_of_motion_require(walked, condition):
    walk, _ = walked(0, condition)
    time = steady(walk)[::7]
    feet = foot_wrenches(walk, time)
    needed = walk.ground.at(time)
    np.testing.assert_allclose(feet["left"] + feet["right"], needed, atol=1e-9)
    np.testing.assert_allclose(
        sum(plate_wrenches(walk, time))[:, :3],
        np.einsum("tji,tj->ti", walk.platform.pose(time).rotation, needed[:, :3]),
        atol=1e-9,
    )


@pytest.mark.parametrize(("subject", "condition"), WALKS)
def test_in_the_t_pose_the_ground_carries_the_weight_alone(walked, subject, condition):
    """For a second, from which the mass is determined."""
    walk, _ = walked(subject, condition)
    time = np.arange(100) / 100
    wrench = walk.ground.at(time)
    weight = walk.subject.person.mass_kg * GRAVITY_MPS2
    np.testing.assert_allclose(wrench[:, 2], weight, rtol=1e-5)
    np.testing.assert_allclose(wrench[:, :2], 0, atol=0.01)


def test_the_force_is_mass_times_acceleration_of_the_centre_of_mass(walked):
    """With the acceleration from positions alone."""
    walk, _ = walked(0, varied_body=False)
    step = 1e-3
    time = np.arange(15.0, 16.0, step)
    center = center_of_mass(walk.subject.skeleton, walk.motion.at(time).T)
    acceleration = np.gradient(np.gradient(center, step, axis=0), step, axis=0)[5:-5]
    mass = walk.subject.skeleton.mass
    weight = np.array([0, 0, GRAVITY_MPS2])
    force = walk.ground.at(time)[5:-5, :3]
    np.testing.assert_allclose(force, mass * (acceleration + weight), atol=0.5)


def test_a_stance_foot_stays_on_the_belt(walked):
    walk, _ = walked(0)
    k = 20  # a left step
    contact, off = walk.placement.steps.contact[k], walk.placement.steps.off[k]
    flat = np.linspace(contact + 0.25 * (off - contact), contact + 0.45 * (off - contact), 20)
    sole = walk.placement.soles["left"]
    rotation, ankle = segment_poses(walk.subject.skeleton, walk.motion.at(flat).T, [sole.segment])[
        0
    ]
    _, origin = sole.from_foot(rotation, ankle)
    on_belt = origin[:, 0] + walk.placement.belt.travelled(flat)
    assert np.ptp(on_belt) < 0.005
    assert np.abs(origin[:, 2]).max() < 0.005


def test_a_contralateral_sway_makes_the_next_step_narrow(walked):
    walk, motion = walked(0, "sway")
    steps, place = walk.placement.steps, walk.placement.place[:, 1]
    baseline = np.abs(np.diff(place[12:22])).mean()
    for onset in motion.onsets:
        next_step = int(np.searchsorted(steps.contact, onset))
        width = (place[next_step] - place[next_step - 1]) * (-1 if next_step % 2 else 1)
        assert width < baseline - 0.03
        assert steps.contact[next_step] - onset > 0.2


def test_a_perturbed_person_neither_drifts_nor_falls(walked):
    walk, _ = walked(0, "sway")
    q = walk.motion.at(steady(walk))
    assert np.abs(q[:, INDEX["PelvisY"]]).max() < 0.25
    bent = sum(q[:, COLUMN[name]] for name in ("TrunkRightBend", "MidTrunkRightBend"))
    trunk = q[:, INDEX["PelvisRightRoll"]] + bent
    assert np.degrees(np.abs(trunk)).max() < 12


def test_the_trunk_stays_upright_on_a_slope_and_the_feet_follow_it(walked):
    walk, _ = walked(0, "pitch")
    time = steady(walk)
    slope = walk.platform.slope(time)
    q = walk.motion.at(time)
    assert np.degrees(np.ptp(slope)) > 15
    assert np.ptp(trunk_lean(walk, time)) < 15
    assert lean_change(walk) < 5
    foot = segment_poses(walk.subject.skeleton, q.T, ["left_foot"])[0][0]
    share = walk.placement.left_share(time)
    flat = (share == 1) & (np.abs(walk.placement.phase("left", time) % 1 - 0.25) < 0.03)
    tilt = np.arctan2(foot[flat][:, 2, 0], np.hypot(foot[flat][:, 0, 0], foot[flat][:, 1, 0]))
    assert np.corrcoef(tilt, slope[flat])[0, 1] > 0.98


def test_a_mass_above_an_oscillating_centre_of_pressure_oscillates_less():
    time = np.arange(2000) / 100
    wave = np.sin(2 * np.pi * time)[:, None] * [1.0, 0.0]
    moved = balanced(wave, 0.95)[500:1500, 0]
    expected = 1 / (1 + 0.95 / GRAVITY_MPS2 * (2 * np.pi) ** 2)
    assert np.ptp(moved) / 2 == pytest.approx(expected, rel=1e-2)


def test_a_rolling_sole_rotates_about_its_contact_with_the_floor(walked):
    """Rolling without slip: the instantaneous centre of rotation is on the floor."""
    sole = walked(0)[0].placement.soles["right"]
    pitch = np.radians(np.linspace(-20, 70, 4001))
    origin = rolled(sole, pitch, np.zeros_like(pitch))
    turning = np.gradient(origin, pitch, axis=0)
    center_height = origin[:, 2] - turning[:, 0]
    assert np.abs(center_height[1:-1]).max() < 5e-4


def test_between_its_samples_the_ground_wrench_is_that_of_the_motion(walked):
    """Interpolated from 200 Hz to 1000 Hz: far below the noise of a plate, 1.5 N."""
    walk, _ = walked(0, varied_body=False)
    time = np.arange(12000, 14000) / 1000
    motion = tuple(np.ascontiguousarray(walk.motion.at(time, k).T) for k in range(3))
    error = walk.ground.at(time) - ground_wrench(walk.subject.skeleton, motion)
    assert np.abs(error).max() < 0.05
    feet = foot_wrenches(walk, time)["left"]
    exact = left_wrench(
        walk.ground.at(time),
        walk.placement,
        walk.platform.pose(time),
        time,
        float(walk.subject.standing[INDEX["PelvisZ"]]),
    )
    loaded = walk.placement.left_share(time) > 0
    assert np.abs(feet - exact)[loaded].max() < 0.1


@pytest.mark.parametrize("condition", ["baseline", "sway", "pitch"])
def test_the_end_of_a_trial_is_like_the_rest_of_it(walked, condition):
    """What follows a trial is unknown, but must not show in it."""
    walk, motion = walked(0, condition)
    end = float(motion.time[-1])
    last, before = np.linspace(end - 0.5, end, 200), np.linspace(end - 4, end - 0.5, 1400)
    peak, usual = (np.abs(walk.ground.at(time)[:, :3]).max(axis=0) for time in (last, before))
    assert (peak < 1.2 * usual).all()
