"""Calibrations, statements and phases without load narrow the plates' priors."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import PlateCalibration, PlateCalibrations
from hbm.spatial import rotation_about
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Settings, Treadmill
from pipeline.explain.cause import priors
from pipeline.explain.causes.plates import (
    components_in_lab,
    plate_causes,
    swing_zero,
    zeros,
)
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline.explain.moving_trial import (
    MARKERS,
    chain_of,
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


def test_components_of_plates_are_named_by_the_axes_of_the_lab_that_they_are_parallel_to(chain):
    plate = chain.plates[0]
    ahead, left, up = np.eye(3)
    usual = components_in_lab(replace(plate, rotation=np.column_stack([left, ahead, -up])))
    assert [usual[k] for k in range(6)] == [
        *("sideways force", "forward force", "vertical force"),
        *("pitch moment", "roll moment", "yaw moment"),
    ]
    oblique = rotation_about(up, np.pi / 4)
    assert components_in_lab(replace(plate, rotation=oblique)) == {
        2: "vertical force",
        5: "yaw moment",
    }


def test_the_zero_of_a_plate_that_is_unloaded_in_swing_is_found_also_through_noise(chain):
    zero, least = np.array([2.0, -3.0, 5.0, 0.5, -1.0, 0.3]), [0.3, 0.3, 0.3, 0.2, 0.2, 0.2]
    plate = chain.plates[0]
    mean, error = swing_zero(*loaded(plate, zero), plate, 30.0)
    np.testing.assert_allclose(mean, zero, atol=1e-9)
    np.testing.assert_allclose(error, least)
    mean, error = swing_zero(*loaded(plate, zero, noise=5.0), plate, 30.0)
    assert np.all(np.abs(mean - zero) < 3 * error)
    assert np.all(error > least)


def test_a_plate_that_is_always_loaded_shows_no_zero(chain):
    plate = chain.plates[0]
    time, wrench = loaded(plate, np.concatenate([100.0 * plate.rotation[2], np.zeros(3)]))
    assert swing_zero(time, wrench, plate, 30.0) is None


def sizes(chain, name):
    """The priors' sizes of a plate's causes."""
    return [cause.prior.size for cause in plate_causes(chain) if cause.name.startswith(name)]


def in_laboratory(chain, **known):
    """The chain in a laboratory of which something else is known."""
    return chain.changed(lab=replace(chain.lab, laboratory=replace(STILL, **known)))


def test_a_large_zero_that_was_measured_is_not_drawn_to_the_usual_one(chain):
    """Its usual size is 3 N; what is less sure than that says nothing."""
    time, wrench = loaded(chain.plates[0], np.array([25.0, 0, 0, 0, 0, 0]), noise=0.5)
    differs = wrench.copy()
    differs[:, 0] += 60 * (-1.0) ** np.floor(time / 1.5)  # from swing to swing
    sure, unsure = (
        zeros(chain.changed(wrenches=(own, chain.wrenches[1])), 0)[0] for own in (wrench, differs)
    )
    assert sure.mean == pytest.approx(25.0, abs=3 * sure.size)
    assert (sure.size < 3.0, sure.rare) == (True, False)
    assert unsure == priors()["zero_force"]


def test_errors_of_a_calibration_are_those_of_the_plate_in_its_own_axes(chain):
    """A plate whose x points to the left: what the lab calls Fy is its Fx."""
    turned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    plate = replace(chain.plates[0], rotation=turned)
    error = np.full((6, 6), 1.0)
    error[1, 1] = 0.004  # gain of Fy
    error[0, 2] = 0.002  # Fz in Fx
    error[3, 2] = 0.003  # Mx by Fz: place along y
    known = in_laboratory(chain, plates=correction([plate], error))
    recording = replace(chain.lab.recording, plates=(plate,))
    own = known.changed(lab=replace(known.lab, recording=recording))
    assert sizes(own, "plate 1: gain") == pytest.approx([0.004] + [0.01] * 5)
    assert sizes(own, "plate 1: Fz in") == pytest.approx([0.005, 0.002])
    assert sizes(own, "plate 1: place") == pytest.approx([0.003, 0.005, 0.005])
    assert sizes(own, "plate 1: direction") == pytest.approx([0.002, 0.01, 0.01], rel=0.01)


@pytest.mark.parametrize(
    ("examined", "shares"), [(("Fz",), [1, 1, 0.1, 1, 1, 1]), (ALL, [0.1] * 6)]
)
def test_a_calibration_narrows_what_it_examined_to_no_less_than_a_tenth(chain, examined, shares):
    plates = correction(chain.plates, np.zeros((6, 6)), examined=examined)
    found = sizes(in_laboratory(chain, plates=plates), "plate 1: gain")
    assert found == pytest.approx([0.01 * share for share in shares])


@pytest.mark.parametrize(
    ("stated_s", "measured_s", "kind"),
    [(None, None, "delay"), (0.004, None, "stated_delay"), (None, 0.004, "calibrated_delay")],
)
def test_a_delay_is_as_uncertain_as_how_it_is_known(chain, stated_s, measured_s, kind):
    plates = correction(chain.plates, np.ones((6, 6)), delay_s=measured_s)
    known = in_laboratory(chain, plates=plates)
    late = next(plate_causes(known.changed(settings=Settings(plate_delay_s=stated_s))))
    assert late.prior == priors()[kind]


@pytest.mark.parametrize("shown_s", [0.007, np.nan])
def test_the_delay_that_the_body_shows_is_taken_unless_the_plates_were_measured(chain, shown_s):
    unknown = in_laboratory(chain)
    found = next(plate_causes(unknown, (shown_s, 0.001))).found
    assert found == ((0.007, 0.001) if shown_s == 0.007 else (0.0, priors()["delay"].size))
    measured = correction(chain.plates, np.ones((6, 6)), delay_s=0.004)
    assert next(plate_causes(in_laboratory(chain, plates=measured), (shown_s, 0.001))).found is None


def test_markers_on_the_platform_show_how_late_its_plates_are():
    late = chain_of(moved(plate_delay_s=0.006, accelerometer_delay_s=0.006), with_platform(MARKERS))
    delay = next(plate_causes(late)).prior
    assert abs(delay.mean - 0.006) < 0.001
    assert delay.size < 0.5 * priors()["delay"].size


def test_plates_of_a_compensated_trial_are_zero_as_the_calibration_left_them(chain):
    loaded_n = np.array([0, 0, 100.0, 0, 0, 0])
    always = chain.changed(wrenches=tuple(wrench + loaded_n for wrench in chain.wrenches))
    for name in ("plate 1: zero", "plate 2: zero"):
        found = np.array(sizes(always, name))
        assert (found <= [3.0, 3.0, 3.0, 1.0, 1.0, 1.0]).all()
        assert found[0] < 3.0
