"""What narrows the plates' priors: calibrations, statements, and phases without load."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import PlateCalibration, PlateCalibrations
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Settings, Treadmill
from pipeline.explain.cause import priors
from pipeline.explain.causes.plates import (
    calibrated,
    known_plates,
    narrowed,
    plate_causes,
    swing_zero,
    usual_plates,
)
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline.explain.moving_trial import (
    MARKERS,
    chain_of,
    laboratory,
    moved,
    moving_chain,
    with_platform,
)

STILL = Laboratory(Treadmill())
ALL = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


@pytest.fixture(name="chain", scope="module")
def moving():
    return moving_chain()


def steps(time):
    """Load of 700 N on a plate, a second of stance and 0.5 s of swing."""
    return np.where(time % 1.5 < 1.0, 700.0, 0.0)


def loaded(plate, zero, noise=0.0):
    """A plate that is walked on, in its own axes."""
    time = np.arange(0, 30, 0.01)
    wrench = np.zeros((len(time), 6))
    wrench[:, :3] = np.outer(steps(time), plate.rotation[2])
    return time, wrench + zero + np.random.default_rng(1).normal(0, noise, wrench.shape)


def correction(plates, error, examined=ALL, delay_s=None):
    return PlateCorrection(
        "plates.json",
        "",
        PlateCalibrations(
            tuple(
                PlateCalibration(
                    plate.number, np.eye(6), np.zeros(6), error, plate.center, examined, delay_s
                )
                for plate in plates
            )
        ),
    )


def test_the_zero_of_a_plate_that_is_unloaded_in_swing_is_found(chain):
    zero = np.array([2.0, -3.0, 5.0, 0.5, -1.0, 0.3])
    time, wrench = loaded(chain.plates[0], zero)
    mean, error = swing_zero(time, wrench, chain.plates[0], 30.0)
    np.testing.assert_allclose(mean, zero, atol=1e-9)
    np.testing.assert_allclose(error, [0.3, 0.3, 0.3, 0.2, 0.2, 0.2])


def test_a_zero_seen_through_noise_lies_within_its_errors(chain):
    zero = np.array([2.0, -3.0, 5.0, 0.5, -1.0, 0.3])
    time, wrench = loaded(chain.plates[0], zero, noise=5.0)
    mean, error = swing_zero(time, wrench, chain.plates[0], 30.0)
    assert np.all(np.abs(mean - zero) < 3 * error)
    assert np.all(error > [0.3, 0.3, 0.3, 0.2, 0.2, 0.2])


def test_a_plate_that_is_always_loaded_shows_no_zero(chain):
    plate = chain.plates[0]
    time, wrench = loaded(plate, np.concatenate([100.0 * plate.rotation[2], np.zeros(3)]))
    assert swing_zero(time, wrench, plate, 30.0) is None


def test_what_was_measured_well_replaces_what_was_expected(chain):
    usual = usual_plates(1).plates[0].zero
    found = narrowed(usual, np.full(6, 2.0), np.full(6, 1e-6))
    assert [each.mean for each in found] == pytest.approx([2.0] * 6)
    assert all(each.size < 1e-5 for each in found)


def test_two_equally_good_sources_meet_in_the_middle():
    usual = usual_plates(1).plates[0].zero
    found = narrowed(usual, np.full(6, 2.0), np.array([each.size for each in usual]))
    assert [each.mean for each in found] == pytest.approx([1.0] * 6)
    sizes = [each.size / before.size for each, before in zip(found, usual, strict=True)]
    assert sizes == pytest.approx([0.5**0.5] * 6)


def test_errors_of_a_calibration_are_those_of_the_plate_in_its_own_axes(chain):
    """A plate whose x points to the left: what the lab calls Fy is its Fx."""
    turned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    plate = replace(chain.plates[0], rotation=turned)
    error = np.full((6, 6), 1.0)
    error[1, 1] = 0.004  # gain of Fy
    error[0, 2] = 0.002  # Fz in Fx
    error[3, 2] = 0.003  # Mx by Fz: place along y
    (one,) = correction([plate], error).calibrations.plates
    usual = usual_plates(1).plates[0]
    found = calibrated(usual, one, plate)
    assert [each.size for each in found.gain] == pytest.approx([0.004] + [0.01] * 5)
    assert [each.size for each in found.cross_talk] == pytest.approx([0.005, 0.002])
    assert [each.size for each in found.place] == pytest.approx([0.003, 0.005, 0.005])
    assert [each.size for each in found.direction] == pytest.approx([0.002, 0.01, 0.01], rel=0.01)


def test_what_a_calibration_did_not_excite_stays_as_unknown_as_it_was(chain):
    plate = chain.plates[0]
    (one,) = correction([plate], np.zeros((6, 6)), examined=("Fz",)).calibrations.plates
    usual = usual_plates(1).plates[0]
    found = calibrated(usual, one, plate)
    narrow = [each.size < before.size for each, before in zip(found.gain, usual.gain, strict=True)]
    assert narrow == [False, False, True, False, False, False]


def test_no_calibration_makes_a_plate_perfect(chain):
    plate = chain.plates[0]
    (one,) = correction([plate], np.zeros((6, 6))).calibrations.plates
    usual = usual_plates(1).plates[0]
    sizes = [each.size for each in calibrated(usual, one, plate).gain]
    assert sizes == pytest.approx([0.1 * each.size for each in usual.gain])


@pytest.mark.parametrize(
    ("stated_s", "measured_s", "kind"),
    [(None, None, "delay"), (0.004, None, "stated_delay"), (None, 0.004, "calibrated_delay")],
)
def test_a_delay_is_as_uncertain_as_how_it_is_known(chain, stated_s, measured_s, kind):
    trial = replace(chain, settings=Settings(plate_delay_s=stated_s), subtracted=None)
    known = correction(chain.plates, np.ones((6, 6)), delay_s=measured_s)
    found = known_plates(trial, replace(STILL, plates=known))
    assert found.delay == priors()[kind]


def test_markers_on_the_platform_show_how_late_its_plates_are():
    stated = with_platform(MARKERS)
    late = chain_of(moved(plate_delay_s=0.006, accelerometer_delay_s=0.006), stated)
    delay = known_plates(late, stated).delay
    assert abs(delay.mean - 0.006) < 0.001
    assert delay.size < 0.5 * priors()["delay"].size


def test_plates_of_a_compensated_trial_are_zero_as_the_calibration_left_them(chain):
    loaded_n = np.array([0, 0, 100.0, 0, 0, 0])
    always = [wrench + loaded_n for wrench in chain.wrenches]
    found = known_plates(chain.with_wrenches(always), laboratory())
    usual = usual_plates(2)
    for one, before in zip(found.plates, usual.plates, strict=True):
        assert all(new.size <= old.size for new, old in zip(one.zero, before.zero, strict=True))
        assert one.zero[0].size < before.zero[0].size


def test_what_is_known_of_plates_is_the_prior_of_their_causes(chain):
    known = known_plates(chain, laboratory())
    causes = {cause.name: cause for cause in plate_causes(chain, known)}
    assert causes["plate 2: zero of Fz"].prior == known.plates[1].zero[2]
    assert causes["plates are late"].prior == known.delay
    assert {cause.prior for cause in plate_causes(chain)} <= set(priors().values())


def test_every_usual_size_has_a_unit_and_a_source():
    assert all(each.unit and each.source and each.size > 0 for each in priors().values())


def test_every_cause_says_what_would_tell_more_of_it(chain):
    assert all(cause.prior.advice for cause in plate_causes(chain))
