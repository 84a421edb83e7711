"""All programs of the benchmarks solve the same problem and agree; nothing is timed."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pipeline.io.recording import Event
from tests.benchmarks import events
from tests.benchmarks.accuracy import check_optimum, force_error, kinematic_error
from tests.benchmarks.comparison import COMPILED, MACHINE, implementations
from tests.benchmarks.trial import export_trial, write_trial
from tests.benchmarks.walker import walk

FRAMES = 120
OPENSIM = pytest.param("OpenSim", marks=pytest.mark.opensim)


@pytest.fixture(scope="module")
def whole():
    return walk(FRAMES)


@pytest.fixture(scope="module")
def trial(whole, tmp_path_factory):
    trial = write_trial(tmp_path_factory.mktemp("compared") / "trial", whole)
    export_trial(trial, whole)
    return trial


@pytest.fixture(scope="module")
def result(trial):
    with implementations(trial) as running:

        def result_of(name, task):
            if name not in running:
                pytest.skip(f"{name} is not installed")
            return running[name].result(task)

        yield result_of


def test_velocities_and_accelerations_of_the_walk_are_derivatives_of_its_coordinates(whole):
    for value, rate in ((whole.q, whole.v), (whole.v, whole.a)):
        slope = np.gradient(value, whole.time, axis=0)[1:-1]
        np.testing.assert_allclose(slope, rate[1:-1], atol=0.01 * np.abs(rate).max())


def test_scipy_on_pinocchios_model_finds_our_optimum(trial):
    check = check_optimum(trial)
    assert check.scipy_distance < 1e-6
    assert check.gauss_newton_step < 1e-9


@pytest.mark.parametrize("name", [COMPILED, MACHINE, "MuJoCo", "Pinocchio"])
def test_all_inverse_kinematics_reach_the_optimum(trial, result, name):
    error = kinematic_error(trial, result(name, "ik"))
    assert max(error.angle_max_rad, error.translation_max_m) < 1e-5
    assert error.marker_rms_m == pytest.approx(kinematic_error(trial, trial.optimum.q).marker_rms_m)


@pytest.mark.parametrize("name", [OPENSIM, "MuJoCo", "Pinocchio"])
def test_no_other_program_fits_the_markers_better(trial, result, name):
    ours, theirs = (trial.marker_rms(result(program, "ik")) for program in (COMPILED, name))
    assert ours <= theirs + 1e-6


@pytest.mark.parametrize(
    ("name", "task"),
    [
        (COMPILED, "id from rates"),
        *((name, "id") for name in (COMPILED, MACHINE, "MuJoCo", "Pinocchio")),
        pytest.param("OpenSim", "id", marks=pytest.mark.opensim),
    ],
)
def test_all_inverse_dynamics_give_the_same_forces(trial, result, name, task):
    assert force_error(trial, result(name, task)) < 1e-6


def test_errors_of_events_count_what_is_late_missed_and_invented():
    true = [Event(10 + 1.1 * k, "foot_strike", "left") for k in range(10)]
    late = [replace(event, time=event.time + 0.005) for event in true if event is not true[4]]
    found = [*late, Event(12.6, "foot_strike", "left"), Event(3.0, "foot_strike", "left")]
    row, off = events.tabulate([("baseline", {"ours": found}, true)])
    assert json.loads(json.dumps(row)) == row
    assert (row["missed"], row["invented"]) == (1, 1)
    assert row["mean_ms"] == pytest.approx(5)
    assert row["sd_ms"] == pytest.approx(0, abs=1e-6)
    assert off["found"] == off["missed"] == 0
