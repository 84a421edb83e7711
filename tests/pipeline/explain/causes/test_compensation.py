"""What a compensation may leave is what one that is wrong by a known amount leaves."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import BeltModel
from compensation.inertia.model_error import ModelError
from pipeline.explain.causes.treadmill import compensation_causes, principal_directions
from tests.pipeline.explain.moving_trial import (
    SETTLED,
    chain_of,
    laboratory,
    moved,
    moving_chain,
)


@pytest.fixture(name="chain", scope="module")
def moving():
    return moving_chain()


@pytest.fixture(scope="module")
def of_gains(chain):
    """The chain as of a calibration that knows the uncertainty of its gains alone."""
    models = tuple(
        replace(model, model_error=None, covariance=10000 * model.covariance)
        for model in chain.lab.models
    )
    return chain.changed(lab=uncorrelated(chain.lab, models))


def uncorrelated(lab, models):
    """The laboratory with other models, what they leave of components being independent."""
    calibration = replace(lab.laboratory.calibration, correlation=None)
    return replace(lab, models=models, laboratory=replace(lab.laboratory, calibration=calibration))


def test_each_direction_of_the_gains_is_what_other_gains_leave(of_gains):
    directions = [c for c in compensation_causes(of_gains) if "direction" in c.name]
    for cause, (_, added) in zip(directions, principal_directions(of_gains), strict=True):
        wrong = []
        for model, felt, more, wrench in zip(
            of_gains.lab.models, of_gains.accelerations, added, of_gains.wrenches, strict=True
        ):
            design = np.column_stack([felt, np.ones(len(felt))])
            gain = np.linalg.lstsq(design, more)[0]
            other = replace(model, gain=model.gain + gain)
            wrong.append(wrench + model.predict(felt) - other.predict(felt))
        expected = of_gains.changed(wrenches=wrong).residual
        np.testing.assert_allclose(cause.change(of_gains, 1.0).residual, expected, atol=1e-6)


def test_directions_have_95_percent_of_what_all_gains_may_leave(of_gains):
    """All gains one by one, along the axes of their covariance, through the whole chain."""
    weight = np.sqrt(np.mean(of_gains.residual**2, axis=0))
    total = 0.0
    for k, (model, felt) in enumerate(
        zip(of_gains.lab.models, of_gains.accelerations, strict=True)
    ):
        design = np.column_stack([felt, np.ones(len(felt))])
        for component in range(6):
            variance, axes = np.linalg.eigh(model.covariance[component])
            for gain in (axes * np.sqrt(variance)).T:
                wrenches = [np.array(wrench) for wrench in of_gains.wrenches]
                wrenches[k][:, component] -= design @ gain
                left = of_gains.changed(wrenches=wrenches).residual - of_gains.residual
                total += np.sum((left / weight) ** 2)
    directions = [c for c in compensation_causes(of_gains) if "direction" in c.name]
    explained = sum(np.sum((cause.effect(of_gains) / weight) ** 2) for cause in directions)
    assert len(directions) <= 12
    assert explained < 1.001 * total
    assert explained > 0.94 * total or len(directions) == 12


def test_what_a_model_leaves_of_a_motion_has_the_variance_that_the_calibration_expects(chain):
    """A slow motion along one axis, in a laboratory whose error grows with its energy."""
    time = chain.time
    felt = np.zeros((len(time), 6))
    felt[:, 1] = 2.0 * np.sin(2 * np.pi * time)
    k, per_energy = 6, np.zeros((2, 36, 6))
    per_energy[:, :, 1] = 0.25
    error = ModelError(
        np.zeros(k), np.tile(np.eye(k), (6, 1, 1)), per_energy, np.zeros((2, 6)), np.zeros(6)
    )
    models = tuple(
        replace(model, model_error=error, covariance=np.zeros_like(model.covariance))
        for model in chain.lab.models
    )
    moved = chain.changed(lab=uncorrelated(chain.lab, models), accelerations=(felt, felt))
    added = [each for _, each in principal_directions(moved)]
    variance = np.sum([each[0] ** 2 for each in added], axis=0)[SETTLED]
    expected = error.variance(felt, 100.0)[SETTLED]
    np.testing.assert_allclose(variance[:, 1], expected[:, 1], rtol=0.08)
    np.testing.assert_allclose(variance[:, [0, 2, 3, 4, 5]], 0, atol=1e-9)


def test_late_accelerometers_leave_what_their_recording_leaves(chain):
    late = chain_of(moved(accelerometer_delay_s=0.005), laboratory())
    expected = (late.residual - chain.residual)[SETTLED]
    (cause,) = [c for c in compensation_causes(chain) if c.name == "accelerometers delayed"]
    found = (cause.change(chain, 0.005).residual - chain.residual)[SETTLED]
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(found, expected, atol=0.01 * np.abs(expected).max())


def test_the_delay_of_accelerometers_is_as_uncertain_as_the_calibration_says(chain):
    def prior(*sensors):
        lab = chain.lab
        calibration = replace(lab.laboratory.calibration, sensors=sensors)
        laboratory = replace(lab.laboratory, calibration=calibration)
        known = chain.changed(lab=replace(lab, laboratory=laboratory))
        (cause,) = [c for c in compensation_causes(known) if c.name == "accelerometers delayed"]
        return cause.prior

    rear, front = chain.lab.sensors
    vague = replace(rear, delay_error_s=0.003)
    assert 0.003 < prior(vague, front).size < 0.0031
    unknown = replace(rear, delay_error_s=None)
    assert prior(unknown, front).size == 0.002


def belt_chain(chain, share):
    """A chain of which only belts were compensated."""
    wave = np.sin(2 * np.pi * chain.time)[:, None] * [0, 0, 0, 0, 10.0, 0]
    left = BeltModel([-1.2, 0.5, 2.0, -1.0, 0.5], rms_measured=10.0, rms_compensated=10.0 * share)
    laboratory = replace(chain.lab.laboratory, belts=(left, left))
    lab = replace(chain.lab, laboratory=laboratory)
    return chain.changed(lab=lab, accelerations=(), belts=(wave, 0 * wave))


def test_a_belt_of_which_the_model_predicts_too_much_leaves_its_moment(chain):
    belts = belt_chain(chain, 0.2)
    share, *_ = compensation_causes(belts)
    wave = np.sin(2 * np.pi * chain.time) * 10.0
    plate = chain.plates[0]
    expected = [chain.wrenches[0].copy(), chain.wrenches[1]]
    expected[0][:, 4] -= 0.5 * wave
    assert share.prior.size == pytest.approx(0.2)
    assert share.name.startswith(f"plate {plate.number}: size ")
    np.testing.assert_allclose(
        share.change(belts, 0.5).residual, chain.changed(wrenches=expected).residual, atol=1e-9
    )


def test_a_late_belt_speed_leaves_the_difference_of_its_moments(chain):
    belts = belt_chain(chain, 0.2)
    late = next(c for c in compensation_causes(belts) if c.name.endswith("speed delayed"))
    wrong = [chain.wrenches[0].copy(), chain.wrenches[1]]
    for sign, delay_s in ((1, 0.0), (-1, 0.02)):
        wrong[0][:, 4] += sign * 10 * np.sin(2 * np.pi * (chain.time - delay_s))
    np.testing.assert_allclose(
        late.change(belts, 0.02).residual[SETTLED],
        chain.changed(wrenches=wrong).residual[SETTLED],
        atol=1e-3,
    )
