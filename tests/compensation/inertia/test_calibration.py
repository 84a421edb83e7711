"""A calibration survives its file and refuses trials that it was not made for."""

import json
from dataclasses import replace

import numpy as np
import pytest

from compensation.inertia.calibration import Calibration, from_json, to_json
from compensation.inertia.fit import fit_inertia
from compensation.inertia.model import Setup
from compensation.inertia.quality import MAX_LEFT, PERSON_RMS

SETUP = Setup(sensors=("rear left", "front right"), rate_hz=100.0, cutoff_hz=20.0)


@pytest.fixture(scope="module")
def calibration(laboratory, assemblies):
    plates = {}
    for side, assembly in assemblies.items():
        trial = laboratory(assembly=assembly).random_trial(
            1, noise=11, cutoff_hz=20, duration=20, person=np.array([0, 0, 200.0, 0, 0, 0])
        )
        plates[side] = fit_inertia(trial.accelerations, trial.wrench, SETUP)
    return Calibration(plates, {"recording": "empty.c3d", "date": "2024-05-01"})


def test_every_number_survives_the_round_trip(calibration):
    read = from_json(to_json(calibration), SETUP)
    assert list(read.plates) == ["left", "right"]
    assert dict(read.provenance) == dict(calibration.provenance)
    for side, model in calibration.plates.items():
        again = read.plates[side]
        pairs = (again, model), (again.model_error, model.model_error)
        for found, expected in pairs:
            for name in set(expected.__dataclass_fields__) - {"model_error"}:
                np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert read.notes[0].code == "calibration_loaded"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sensors": ("front right", "rear left")}, "sensors .*recording"),
        ({"rate_hz": 1000.0}, "rate_hz 100.0, .* 1000.0"),
    ],
)
def test_a_trial_recorded_otherwise_is_refused_with_the_reason(calibration, change, message):
    with pytest.raises(ValueError, match=message):
        from_json(to_json(calibration), replace(SETUP, **change))


def test_the_verdict_survives_the_round_trip(calibration):
    poor = {n: replace(m, rms_slow=2 * MAX_LEFT) for n, m in calibration.plates.items()}
    for judged, codes in ((calibration, []), (Calibration(poor), ["calibration_leaves_much"])):
        read = from_json(to_json(judged))
        assert read.verdict == judged.verdict
        assert read.notes == judged.notes
        assert [n.code for n in read.notes if n.code != "calibration_loaded"] == codes
    (note,) = [n for n in read.notes if n.code == "calibration_leaves_much"]
    assert note.level == "warning"
    assert len(note.values["left"]) == 12
    assert any("Mx 7.5 N·m" in left for left in note.values["left"])


def test_what_both_plates_may_leave_raises_the_residuals_of_a_walking_person_by_five_percent():
    """Van de Loosdrecht (2018), Table III: N and N·m, horizontal moments as one vector."""
    _, _, up, roll, pitch, turn = PERSON_RMS
    for person, left in ((up, [2]), (np.hypot(roll, pitch), [3, 4]), (turn, [5])):
        of_both_plates = np.sqrt(2) * np.linalg.norm(MAX_LEFT[left])
        assert np.hypot(person, of_both_plates) == pytest.approx(1.05 * person)
    forces = MAX_LEFT[:2] * 1.0  # moment about the hips, 1 m above
    np.testing.assert_array_equal(forces, MAX_LEFT[3:5])


def test_a_file_of_the_release_before_is_of_noise_alone_and_not_judged(calibration):
    document = json.loads(to_json(calibration)) | {"version": 2}
    del document["dynamic"], document["sensors"], document["correlation"]
    for plate in document["plates"].values():
        del plate["model_error"], plate["lags_s"], plate["correlation"], plate["rms_slow"]
        plate["setup"] |= {"acceleration_unit": "m/s²", "wrench_unit": "N, N·m"}
    old = from_json(json.dumps(document), SETUP)
    model = old.plates["left"]
    assert model.model_error is None
    np.testing.assert_array_equal(model.gain, calibration.plates["left"].gain)
    np.testing.assert_array_equal(model.rms_slow, model.rms_compensated)
    assert not old.verdict
    assert old.notes[-1].code == "calibration_of_earlier_version"
    again = from_json(to_json(old)).plates["left"]
    at_rest = np.broadcast_to(model.acceleration_mean, (200, 6))
    np.testing.assert_array_equal(again.uncertainty(at_rest), model.uncertainty(at_rest))


@pytest.mark.parametrize("version", [1, 8, None])
def test_a_file_of_another_version_is_refused(calibration, version):
    document = json.loads(to_json(calibration)) | {"version": version}
    with pytest.raises(ValueError, match=rf"version {version}\b.* 2 and 7"):
        from_json(json.dumps(document))


def test_the_correlation_of_plates_survives_the_file_and_is_given_in_any_order(calibration):
    """Files without it, of older versions, have plates that are independent of each other."""
    joint = np.corrcoef(np.random.default_rng(0).normal(size=(12, 50)))
    read = from_json(to_json(replace(calibration, correlation=joint)))
    np.testing.assert_array_equal(read.correlation, joint)
    exchanged = np.roll(joint, 6, axis=(0, 1))
    np.testing.assert_array_equal(read.correlation_of(["right", "left"]), exchanged)
    np.testing.assert_array_equal(read.correlation_of(["right"]), joint[6:, 6:])
    independent = from_json(to_json(calibration)).correlation_of(["left", "right"])
    assert not independent[:6, 6:].any()
    np.testing.assert_array_equal(independent[6:, 6:], calibration.plates["right"].correlation)
    with pytest.raises(ValueError, match=r"\(12, 12\).*\(6, 6\)"):
        replace(calibration, correlation=joint[:6, :6])


def damaged(text, **changes):
    document = json.loads(text)
    document["plates"]["left"] |= changes
    return json.dumps(document)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda text: text[:100], "not JSON"),
        (lambda text: "[1, 2]", "no inertia calibration"),
        (lambda text: text.replace('"sigma"', '"sugma"'), "damaged"),
        (lambda text: damaged(text, sigma=[float("nan")] * 6), "not numbers"),
    ],
)
def test_a_damaged_calibration_gets_one_clear_error(calibration, spoil, message):
    with pytest.raises(ValueError, match=message):
        from_json(spoil(to_json(calibration)))
