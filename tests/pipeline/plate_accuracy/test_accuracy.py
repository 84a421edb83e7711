"""Experiment 1: every error of a plate is found within its uncertainty, and none in a good plate.

Estimates may be four standard errors off: some forty of them are tested.
"""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest

from pipeline.cli.app import main
from pipeline.config.plate_study import read_plates_study
from pipeline.plate_accuracy.accuracy import check_plates
from pipeline.plate_accuracy.report import trial_errors
from pipeline.plate_accuracy.response import find_vibration
from pipeline.plate_accuracy.verdict import judge
from pipeline.virtual_lab.protocol import known_weights
from pipeline.virtual_lab.protocol.known_weights import FULL_SCALE_N, PlateErrors, simulate_plates
from tests.pipeline.plate_accuracy.conftest import DESIGN, again, spoiled

FEW = DESIGN | {"belts": ("left",)}
ONE = FEW | {"speeds": (1.0,), "weights": (22.56,), "positions": (0.25,)}
CROSS = {(0, 2): 0.01, (2, 0): 0.02, (5, 0): 0.01}
ERRORS = PlateErrors(
    cross_talk=CROSS,
    angle_rad=np.radians(0.8),
    offset_m=(0.004, -0.005),
    delay_s=0.006,
    curvature=0.02,
    drift_n_per_s=0.05,
)


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    folder = tmp_path_factory.mktemp("faulty")
    simulate_plates(folder, ERRORS, seed=2, **FEW)
    return check_plates(read_plates_study(folder))


@pytest.fixture(scope="module")
def shaking(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shaking")
    errors = PlateErrors(vibration_m=0.03, vibration_hz=3.2)
    simulate_plates(folder, errors, seed=3, **(FEW | {"speeds": (1.0,), "supports": (True, False)}))
    return check_plates(read_plates_study(folder))


def estimate(found, fault):
    return next(one for one in found.faults if one.fault == fault)


def test_a_faultless_plate_is_found_faultless(good_plates):
    assert [one for one in good_plates.faults if one.significant] == []
    for verdict in judge(good_plates):
        assert verdict.answer == "fit"
        assert verdict.calibration is None
        assert verdict.reasons == ()
        full_scale_n = good_plates.study.file.full_scale_n
        assert good_plates.linearities[verdict.belt].nonlinearity < 0.002 * full_scale_n


@pytest.mark.parametrize(
    ("fault", "truth"),
    [
        ("angle", 0.8),
        ("delay", 0.006),
        ("delay in motion", 0.006),
        ("curvature", 0.02 * 510),
        ("drift", 0.05),
        ("Fz in Fx", 0.01),
        ("Fx in Fz", 0.02),
    ],
)
def test_every_error_is_found_within_its_uncertainty(faulty, fault, truth):
    one = estimate(faulty, fault)
    assert one.significant
    assert abs(one.value - truth) < 4 * one.standard_error + 0.02 * abs(
        truth
    )  # errors act on each other
    assert one.standard_error < 0.1 * abs(truth)


@pytest.mark.parametrize(
    ("error", "truth"),
    [
        ({"curvature": 0.02}, {"curvature": 0.02 * FULL_SCALE_N}),
        ({"drift": 0.05}, {"drift": 0.05}),
        ({"cross_talk": CROSS}, {"Fz in Fx": 0.01, "Fx in Fz": 0.02, "Fx in Mz": 0.01}),
        ({"cross_talk": {(2, 2): 0.01}}, {"gain of Fz": 0.01}),
    ],
)
def test_a_single_error_is_found_within_its_uncertainty_and_no_other(good_plate, error, truth):
    """Ten estimates may be off by twice their 95 %: one in ten thousand is by chance."""
    assert_only(spoiled(good_plate, **error), truth)


def test_a_rotation_and_a_delay_are_found_within_their_uncertainty_and_no_other(tmp_path):
    simulate_plates(
        tmp_path, PlateErrors(angle_rad=np.radians(0.19), delay_s=0.004), seed=10, **FEW
    )
    truth = {"angle": 0.19, "delay": 0.004, "delay in motion": 0.004}
    assert_only(check_plates(read_plates_study(tmp_path)), truth)


def assert_only(found, truth):
    assert {one.fault for one in found.faults if one.significant} == set(truth)
    for fault, value in truth.items():
        one = estimate(found, fault)
        assert abs(one.value - value) < 2 * one.uncertainty


def test_a_vibration_is_found_and_named_with_and_without_supports(shaking):
    free = estimate(shaking, "vibration without supports")
    held = estimate(shaking, "vibration with supports")
    for one, truth in ((free, 0.03), (held, 0.0075)):
        assert one.frequency_hz == pytest.approx(3.2, abs=0.01)
        assert abs(one.value - truth) < 4 * one.standard_error + 0.01 * truth
    (verdict,) = judge(shaking)
    assert verdict.answer == "not fit"
    assert "vibration with supports" in {one.name for one in verdict.reasons}


def test_every_plate_is_judged_by_its_own_recordings_with_supports(shaking):
    """The right plate has recordings without supports only, the left plate has both."""
    free = [t for t in shaking.trials if not t.weight.supports]
    other = [replace(t, weight=t.weight.model_copy(update={"belt": "right"})) for t in free]
    left, right = judge(again(shaking, [*shaking.trials, *other]))
    assert (left.with_supports, right.with_supports) == (True, False)
    assert "vibration without supports" not in {one.name for one in left.judged}


def test_where_a_true_load_has_no_centre_of_pressure_no_vibration_is_found(shaking):
    held = [t for t in shaking.trials if t.weight.supports]
    assert find_vibration(held) is not None
    unloaded = held[0].truth.copy()
    unloaded[len(unloaded) // 2, 2] = 0.0
    assert find_vibration([replace(held[0], truth=unloaded), *held[1:]]) is None


def test_the_calibration_takes_delay_and_rotation_away(faulty):
    """The response to Fz of a plate that is turned and shifted is in its matrix."""
    (verdict,) = judge(faulty)
    calibration = verdict.calibration
    assert calibration.delay_s == pytest.approx(0.006, abs=1e-4)
    response = ERRORS.plate.gain.copy()
    c, s = np.cos(ERRORS.angle_rad), np.sin(ERRORS.angle_rad)
    along, across = np.array([[c, -s], [s, c]]) @ calibration.center[:2] + ERRORS.offset_m
    x, y = along - calibration.center[0], across - calibration.center[1]
    true = np.array([0.0, 0.0, 500.0, 0.0, 0.0, 0.0])
    reported = response @ [0.0, 0.0, 500.0, 500.0 * y, -500.0 * x, 0.0]
    off = np.abs(calibration.correct(reported) - true)
    assert (off < 2.2 * calibration.standard_error @ np.abs(reported) + 0.1).all()


def test_orthogonal_errors_leave_out_what_a_line_explains(good_plate, faulty):
    across = []
    for found in (good_plate, faulty):
        errors = trial_errors(found.trials)
        whole = errors[errors["zone"] == "all"]
        means = whole.groupby("quantity")[["difference", "orthogonal"]].mean()
        assert (means["orthogonal"] <= means["difference"] + 1e-12).all()
        across.append(means.loc["COPy", "difference"])
    assert across[1] == pytest.approx(across[0], rel=0.2)  # the alignment was corrected


def test_slow_errors_are_those_of_the_plate_and_not_of_the_marker_s_noise(good_plate, faulty):
    """Its curvature shows in them, with half a newton of drift; at 20 Hz noise hides it."""
    slow, fast = [], []
    for found in (good_plate, faulty):
        errors = trial_errors(found.trials)
        vertical = errors[(errors["zone"] == "all") & (errors["quantity"] == "Fz")]
        slow.append(vertical["slow"].to_numpy())
        fast.append(vertical["difference"].to_numpy())
    weight = np.array([trial.truth[trial.used, 2].mean() for trial in faulty.trials])
    curved = ERRORS.curvature * weight**2 / faulty.study.file.full_scale_n
    assert (slow[0] < 0.5).all()
    assert (fast[0] > 5).all()
    np.testing.assert_allclose(slow[1], curved, atol=0.8)


def test_one_command_simulates_checks_and_leaves_tables_figures_and_a_verdict(
    tmp_path, monkeypatch, capsys
):
    few = FEW | {"positions": (0.25,)}
    monkeypatch.setattr(known_weights, "simulate_plates", partial(simulate_plates, **few))
    folder, out = tmp_path / "study", tmp_path / "out"
    assert main(["plates", str(folder), "--simulate", "--out", str(out)]) == 0
    faults = pd.read_csv(out / "faults.csv").set_index(["belt", "fault"])
    for fault, truth in (("angle", 0.19), ("delay", 0.004)):
        assert faults.loc[("left", fault), "value"] == pytest.approx(truth, rel=0.1)
    for name in ("table_1.csv", "anova.csv", "laboratory.html"):
        assert (out / name).is_file()
    capsys.readouterr()
    assert main(["plates", str(folder), "--simulate"]) == 2
    assert "not empty" in capsys.readouterr().err


def test_the_verdict_names_what_was_not_examined(tmp_path, capsys):
    simulate_plates(tmp_path, **(ONE | {"profiles": ("sine",)}))
    path = tmp_path / "plates.toml"
    text = path.read_text(encoding="utf-8")
    kept = text[: text.index("[[static]]")] + text[text.index("[[weights]]") :]
    path.write_text(kept, encoding="utf-8")
    assert main(["plates", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Left plate" in said
    assert "▲ cannot be determined" in said
    assert "3 different weights" in said
    path.write_text('marker = "TOP"\n' + kept, encoding="utf-8")
    assert main(["plates", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert re.search("'TOP'; .*: WEIGHT", capsys.readouterr().err)
