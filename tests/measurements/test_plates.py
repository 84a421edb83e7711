"""A planted fault of a plate is found, and its truth is what hands compute."""

import numpy as np
import pytest

from hbm.spatial import GRAVITY_MPS2
from pipeline.plate_accuracy.response import QUANTITIES
from pipeline.virtual_lab.protocol.known_weights import SUPPORTED_VIBRATION, PlateErrors
from tests.campaign.plates import FAULTS, faulty, true_totals, true_verdict

BODY_N = 75.0 * GRAVITY_MPS2
UP = BODY_N * np.array([1.2, 0.75, 1.2])
FAULT = {fault.name: fault for fault in FAULTS}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "share"),
    [("gain of Fz", 1.1), ("Fz in Fx", 0.9), ("offset along", 1.1), ("vibration", 3.0)],
)
def test_a_fault_is_found_and_the_verdict_is_that_of_the_known_fault(fault, share):
    plates = faulty(fault, share, seed=77)
    assert plates.found.all()
    assert (plates.verdict == plates.truth).all()


@pytest.mark.campaign
@pytest.mark.parametrize("fault", FAULT)
def test_every_fault_far_beyond_its_limit_is_found_and_never_fit(fault):
    plates = faulty(fault, 3.0, seed=78)
    assert plates.found.all() or fault == "noise"  # a noise is not tested against none
    assert (plates.verdict == plates.truth).all()
    assert (plates.truth != "fit").all()


@pytest.mark.parametrize(
    ("errors", "quantity", "expected"),
    [
        ({"cross_talk": {(2, 2): 0.02}}, "Fz", 0.02 * np.sqrt(np.mean(UP**2))),
        ({"cross_talk": {(0, 2): 0.02}}, "My", 0.02 * np.sqrt(np.mean(UP**2))),
        ({"offset_m": (0.004, 0.0)}, "COPx", 0.004),
        ({"vibration_m": 0.02}, "COPx", 0.02 * SUPPORTED_VIBRATION / np.sqrt(2)),
        ({"drift_n_per_s": 0.3}, "Fz", 0.3 * 60 / np.sqrt(3)),
        ({"curvature": 0.02}, "Fz", 0.02 * np.sqrt(np.mean(UP**4)) / 510),
    ],
)
def test_the_true_total_error_is_what_the_known_fault_does_to_the_loads(errors, quantity, expected):
    found = true_totals(PlateErrors(noise_n=1e-6, **errors), "right")
    assert found[QUANTITIES.index(quantity)] == pytest.approx(expected, rel=0.005)


def test_a_fault_within_its_limit_may_still_be_too_much_for_a_person():
    assert true_verdict(FAULT["curvature"], 0.9 * FAULT["curvature"].limit, "left") == "not fit"
    assert true_verdict(FAULT["drift"], 1.1 * FAULT["drift"].limit, "left") == "not fit"
    assert true_verdict(FAULT["delay"], 1.1 * FAULT["delay"].limit, "left") == (
        "fit after correction"
    )
    assert true_verdict(FAULT["delay"], 0.9 * FAULT["delay"].limit, "left") == "fit"
