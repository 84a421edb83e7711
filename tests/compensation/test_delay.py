"""Known delays and a known rotation of a plate are found again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from compensation import Delay, agreed_delay
from compensation.accuracy import fit_plate_alignment
from compensation.delay import STEP_TOLERANCE, estimate_delay, without_step
from compensation.hammer import hammer_delay

# Delays from motion -----------------------------------------------------------------------------


def shifted_pair(laboratory, delay_s, seed, **options):
    """The same motion, seen by accelerometers on time and by the plate `delay_s` late."""
    lab = laboratory()
    early = lab.random_trial(seed, noise=2 * seed, **options)
    late = lab.random_trial(seed, noise=2 * seed + 1, late_s=delay_s, **options)
    return early.accelerations, late.wrench


@pytest.mark.parametrize(
    ("delay_s", "rate_hz", "cutoff_hz"), [(0.0071, 1000, None), (0.0844, 100, 20)]
)
def test_a_known_delay_between_sensors_and_plate_comes_back(
    laboratory, delay_s, rate_hz, cutoff_hz
):
    pair = shifted_pair(laboratory, delay_s, 1, cutoff_hz=cutoff_hz)
    found = estimate_delay(*pair, rate_hz)
    assert found.seconds == pytest.approx(delay_s, abs=5e-5)  # ten times better than asked for
    assert found.standard_error < 5e-5


@pytest.mark.parametrize("delay_s", [-0.02, 0.0844])
def test_the_delay_of_slow_motion_comes_back_too(delay_s):
    """Whole samples of a turn in six seconds correlate alike over several of them."""
    time = np.arange(0, 30, 0.01)

    def seen(at):
        return np.column_stack([np.sin(2 * np.pi * at / 6), np.sin(2 * np.pi * at / 7.3)])

    found = estimate_delay(seen(time), 3 * seen(time - delay_s), 100)
    assert found.seconds == pytest.approx(delay_s, abs=5e-5)


@pytest.mark.campaign
def test_stated_uncertainty_of_a_delay_covers_its_error(laboratory):
    scores = []
    for seed in range(16):
        pair = shifted_pair(laboratory, 0.0123, seed, cutoff_hz=20, duration=15)
        found = estimate_delay(*pair, 100)
        scores.append((found.seconds - 0.0123) / found.standard_error)
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.6  # 16 draws of about 1: ± 18 %


@settings(max_examples=15)
@given(delay_s=st.floats(-0.15, 0.15))
def test_markers_and_plates_of_different_units_are_aligned_without_noise(delay_s):
    time = np.arange(3000) / 100

    def signal(at):
        return np.sin(2 * np.pi * 0.7 * at) + 0.4 * np.sin(2 * np.pi * 2.3 * at + 1)

    found = estimate_delay(signal(time)[:, None], -350 * signal(time - delay_s)[:, None] + 9, 100)
    assert found.seconds == pytest.approx(delay_s, abs=2e-5)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda a, w: (a[:400], w[:400]), "400 samples .* 0.2 s"),
        (
            lambda a, w: (a, np.random.default_rng(0).normal(size=w.shape)),
            "variance only, .*one trial",
        ),
        (lambda a, w: (a[40:], w[:-40]), "lies beyond 0.2 s"),
    ],
)
def test_wrong_motion_gets_one_clear_error(laboratory, spoil, message):
    pair = shifted_pair(laboratory, 0.0, 1, cutoff_hz=20, duration=20)
    with pytest.raises(ValueError, match=message):
        estimate_delay(*spoil(*pair), 100)


# Delays from hammer impacts ---------------------------------------------------------------------


def impacts(seed, delay_s, contact_s=0.004, count=15, height_noise_m=2e-4):
    """A hammer's marker at 100 Hz, a late plate at 1000 Hz; contacts are half sines."""
    rng = np.random.default_rng(seed)
    struck = 2 + np.arange(count) * 1.5 + rng.uniform(0, 0.3, count)
    camera, plate = np.arange(0, struck[-1] + 2, 0.01), np.arange(0, struck[-1] + 2, 0.001)
    height = np.full(len(camera), 0.25)
    force = 1.5 * rng.normal(size=len(plate))
    for hit in struck:
        near = np.abs(camera - hit) < 0.25
        ago, rebound = camera[near] - hit, rng.uniform(0.1, 0.8)
        inside = np.clip(ago, 0, contact_s)
        moved = -2.5 * np.minimum(ago, contact_s) + 2.5 * (1 + rebound) / 2 * (
            inside - contact_s / np.pi * np.sin(np.pi * inside / contact_s)
        )  # integral of the speed, whose change is that of the half sine's impulse
        moved += 2.5 * rebound * np.maximum(ago - contact_s, 0)
        moved += 20 * np.maximum(ago - 0.07, 0) ** 2  # the hand lifts it
        height[near] = np.minimum(0.25, 0.05 + moved)
        phase = np.clip((plate - hit - delay_s) / contact_s, 0, 1)
        force += 1.5 / contact_s * np.sin(np.pi * phase)
    return camera, height + height_noise_m * rng.normal(size=len(camera)), plate, force


@pytest.mark.parametrize(("delay_s", "contact_s"), [(0.0844, 0.001), (-0.004, 0.010)])
def test_a_known_delay_of_the_plate_comes_back_however_long_the_hammer_touches(delay_s, contact_s):
    found = hammer_delay(*impacts(1, delay_s, contact_s))
    assert found.seconds == pytest.approx(delay_s, abs=3e-4)
    assert abs(found.seconds - delay_s) < 3 * found.standard_error
    assert found.standard_error < 2e-4
    assert found.degrees_of_freedom >= 13  # a contact of 1 ms may pass between two samples


@pytest.mark.campaign
def test_the_95_percent_interval_of_a_delay_by_a_hammer_holds_it_19_times_in_20():
    rng = np.random.default_rng(7)
    holds = []
    for seed in range(40):
        delay_s, contact_s = rng.uniform(-0.005, 0.02), rng.uniform(0.001, 0.01)
        found = hammer_delay(*impacts(seed, delay_s, contact_s))
        half = stats.t.isf(0.025, found.degrees_of_freedom) * found.standard_error
        holds.append(abs(found.seconds - delay_s) < half)
    assert 35 <= sum(holds) < 40


def test_a_bounce_is_no_impact_of_its_own_and_spoils_none():
    camera, height, plate, force = impacts(4, 0.004)
    again = np.interp(plate, plate + 0.08, force, left=0.0) * 0.3
    found = hammer_delay(camera, height, plate, force + np.where(again > 20, again, 0))
    assert found.degrees_of_freedom == 14
    assert found.seconds == pytest.approx(0.004, abs=3e-4)


def test_a_plate_that_rings_after_every_impact_shows_no_delay():
    camera, height, plate, force = impacts(5, 0.004)
    ringing = np.exp(-np.arange(0, 0.4, 0.001) * 9) * np.sin(
        2 * np.pi * 50 * np.arange(0, 0.4, 0.001)
    )
    rung = np.convolve(force, 0.3 * ringing)[: len(force)]
    with pytest.raises(ValueError, match="impacts in both"):
        hammer_delay(camera, height, plate, rung)


# Plate to cameras -------------------------------------------------------------------------------

ANGLE, OFFSET = np.radians(0.19), np.array([0.0015, -0.0018])


def places(seed, error_m=0.001, angle=ANGLE, offset=OFFSET, count=110):
    """The thesis' 55 places per belt: (plate points, camera points)."""
    rng = np.random.default_rng(seed)
    camera = np.column_stack([rng.uniform(-0.8, 0.8, count), rng.uniform(-0.5, 0.5, count)])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return camera @ turn.T + offset + error_m * rng.normal(size=(count, 2)), camera


def test_rotation_and_offset_of_the_thesis_are_found_within_their_stated_uncertainty():
    scores = []
    for seed in range(40):
        found = fit_plate_alignment(*places(seed))
        error = np.array([found.angle - ANGLE, *(found.offset - OFFSET)])
        scores.append(error / found.standard_error)
    assert np.mean(np.abs(scores) < 1.98) == pytest.approx(0.95, abs=0.045)  # 120 draws
    assert np.degrees(found.standard_error[0]) < 0.02
    assert np.all(found.standard_error[1:] < 2e-4)


@settings(max_examples=20)
@given(angle=st.floats(-3.1, 3.1), x=st.floats(-1, 1), y=st.floats(-1, 1))
def test_any_rotation_and_offset_is_undone(angle, x, y):
    plate, camera = places(2, error_m=0, angle=angle, offset=np.array([x, y]))
    found = fit_plate_alignment(plate, camera)
    np.testing.assert_allclose((plate - found.offset) @ found.rotation, camera, atol=1e-12)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda p, c: (p[:2], c[:2]), "2 places"),
        (lambda p, c: (p, 1000 * c), "both in metres"),
        (lambda p, c: (p, c * [1, -1]), "when mirrored"),
    ],
)
def test_wrong_places_get_one_clear_error(spoil, message):
    with pytest.raises(ValueError, match=message):
        fit_plate_alignment(*spoil(*places(4)))


@pytest.mark.parametrize("share", [0.3, 1.6])
def test_steps_that_are_too_short_or_too_long_by_a_factor_lead_to_the_same_delay(share):
    """A plain repetition would need some sixty of the shortest ones."""
    best, tried = np.array([0.4, -1.7]), []

    def step_of(shifts):
        tried.append(shifts)
        return share * np.sin(best - shifts), np.eye(2)

    shifts, _ = without_step(step_of, np.zeros(2))
    np.testing.assert_allclose(shifts, best, atol=STEP_TOLERANCE / share)
    assert len(tried) <= 12


VAGUE = Delay(0.0042, 0.002)


@pytest.mark.parametrize(
    ("hammer", "motion", "method", "disagree"),
    [
        (Delay(0.0040, 0.00001), Delay(0.0042, 0.0004), "motion", False),  # precise enough
        (Delay(0.0040, 0.0001), VAGUE, "hammer", False),
        (Delay(0.0040, 0.003), VAGUE, "motion", False),
        (VAGUE, None, "hammer", False),
        (None, VAGUE, "motion", False),
        (Delay(0.00438, 0.0001), Delay(0.004, 0.0001), "motion", False),  # ± 0.196 ms each
        (Delay(0.00440, 0.0001), Delay(0.004, 0.0001), "motion", True),
    ],
)
def test_the_delay_in_motion_is_used_where_it_is_precise_and_a_contradiction_is_seen(
    hammer, motion, method, disagree
):
    assert agreed_delay(hammer, motion)[1:] == (method, disagree)


def test_few_impacts_widen_the_interval():
    """Student's t of two degrees of freedom is 4.30."""
    assert Delay(0.0, 0.001, degrees_of_freedom=2).uncertainty == pytest.approx(0.0043027, rel=1e-4)
