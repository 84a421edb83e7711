"""A plate is fit only where its errors are small at a person's loads; else the reason is named."""

import re
from dataclasses import replace

import numpy as np
import pytest

from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS
from pipeline.cli.app import main
from pipeline.config.plate_correction import read_plate_correction
from pipeline.config.plate_study import AccuracyLimits, PlatesFile, read_plates_study
from pipeline.io.axes import parse_axes
from pipeline.plate_accuracy.accuracy import check_plates
from pipeline.plate_accuracy.response import stance_loads
from pipeline.plate_accuracy.verdict import Judged, judge
from pipeline.virtual_lab.protocol.known_weights import THESIS_ERRORS, PlateErrors, simulate_plates
from tests.pipeline.plate_accuracy.conftest import DESIGN, again, spoiled, with_masses

BODY_N = 75.0 * GRAVITY_MPS2
UP = BODY_N * np.sqrt(np.mean(np.square([1.2, 0.75, 1.2])))
FORWARD = BODY_N * np.sqrt(np.mean(np.square([0.25, 0.0, 0.25])))
"""Root mean square of a foot's force in braking, midstance and push-off [N]."""
EVERY = tuple((k, k) for k in range(6))


def answers(verdict):
    """The rows of a verdict: question -> answer."""
    return dict(verdict.table.rows)


@pytest.mark.parametrize(
    ("cross_talk", "fault", "size", "totals"),
    [
        (dict.fromkeys(EVERY, 0.1), "gain of Fz", 0.1, {"Fz": 0.1 * UP}),
        ({(0, 0): 0.3}, "gain of Fx", 0.3, {"Fx": 0.3 * FORWARD, "My": 0.3 * FORWARD}),
        ({(0, 2): 0.05}, "Fz in Fx", 0.05, {"Fx": 0.05 * UP, "My": 0.05 * UP}),
    ],
    ids=["all gains 10 % too high", "Fx 30 % too high", "5 % of Fz in Fx"],
)
def test_a_bad_plate_is_never_fit_as_it_is_and_its_fault_is_named(
    good_plate, cross_talk, fault, size, totals
):
    """A force along the belt that is wrong is that moment about a point 1 m above it."""
    (verdict,) = judge(spoiled(good_plate, cross_talk, mass_uncertainty_percent=0.05))
    assert verdict.answer == "fit after correction"
    assert verdict.table.caption.startswith("Left plate")
    reasons = {one.name: one for one in verdict.reasons}
    assert reasons[fault].size == pytest.approx(size, rel=0.01)
    for name, total in totals.items():
        assert reasons[f"total error of {name}"].size == pytest.approx(total, rel=0.01)


def test_what_no_calibration_takes_away_makes_a_plate_not_fit(good_plate):
    (verdict,) = judge(spoiled(good_plate, curvature=0.05))
    assert verdict.answer == "not fit"
    assert verdict.reasons[0].name == "curvature"
    assert "total error of Fz after correction" in {one.name for one in verdict.reasons}


def test_a_calibration_that_would_make_a_total_error_too_large_is_not_written(good_plate):
    """Too high a gain and a negative curvature are nearly right at the load of a person."""
    (verdict,) = judge(spoiled(good_plate, {(2, 2): 0.014}, curvature=-0.008))
    sizes = {one.name: one.size for one in (*verdict.judged, *verdict.corrected)}
    assert sizes["total error of Fz"] < 7.5 < sizes["total error of Fz after correction"]
    assert (verdict.answer, verdict.calibration) == ("not fit", None)


def test_no_correction_is_advised_for_a_plate_that_it_does_not_make_fit(good_plate):
    (verdict,) = judge(spoiled(good_plate, {(2, 2): 0.1}, drift=0.3))
    assert verdict.answer == "not fit"
    assert verdict.calibration is not None
    assert verdict.corrections == ()


@pytest.mark.parametrize("component", [0, 1], ids=["Fx", "Fy"])
def test_a_plate_of_which_a_channel_is_dead_is_not_fit_and_has_no_calibration(
    good_plate, component
):
    dead = spoiled(good_plate, {(component, component): -1.0})
    constant = np.arange(6) == component
    trials = [replace(trial, constant=constant) for trial in dead.trials]
    (verdict,) = judge(again(dead, trials))
    name = WRENCH_COMPONENTS[component]
    assert (verdict.answer, verdict.calibration) == ("not fit", None)
    assert re.search(rf"\b{name} .*never changed", answers(verdict)["Found"])
    beyond = {one.name: one.size for one in verdict.judged if one.status == "beyond"}
    if component != 1:  # no weight exerts a lateral force: it has no gain
        assert beyond[f"gain of {name}"] == pytest.approx(1.0, abs=1e-3)


def test_a_channel_that_shows_the_same_in_every_sample_is_found_when_it_is_read(
    good_plate, tmp_path
):
    few = {"speeds": (1.0,), "weights": (22.56,), "positions": (0.25,), "belts": ("left",)}
    dead = PlateErrors(cross_talk={(1, 1): -1.0}, noise_n=0.0)
    simulate_plates(tmp_path, dead, **(DESIGN | few))
    (verdict,) = judge(check_plates(read_plates_study(tmp_path)))
    assert verdict.answer == "not fit"
    assert "never changed" in answers(verdict)["Found"]
    assert not any(trial.constant.any() for trial in good_plate.trials)


def test_the_error_of_a_person_grows_from_that_of_the_weights(good_plate):
    """A curvature of 1 % at 510 N is 3 % of 1.2 body weights of 75 kg, and more of 110 kg."""
    totals = []
    for mass in (75.0, 110.0):
        (verdict,) = judge(spoiled(good_plate, curvature=0.01, body_mass_kg=mass))
        totals.append(next(one for one in verdict.judged if one.name == "total error of Fz"))
        loads = mass * GRAVITY_MPS2 * np.array([1.2, 0.75, 1.2])
        true = np.sqrt(np.mean((0.01 * loads**2 / 510) ** 2))
        assert totals[-1].low < np.hypot(true, 0.2) < totals[-1].high
    widths = [one.high - one.low for one in totals]
    assert widths[1] > widths[0]


def test_an_interval_that_holds_the_limit_tells_nothing_and_says_what_to_record(good_plate):
    found = spoiled(good_plate, {(2, 2): 0.005})
    gain = next(one for one in found.faults if one.fault == "gain of Fz")
    near = AccuracyLimits(gain_percent=100 * (gain.value - 0.3 * gain.uncertainty))
    (verdict,) = judge(again(found, found.trials, limits=near))
    assert verdict.answer == "cannot be determined"
    assert "gain of Fz" in {one.name for one in verdict.reasons}
    assert "more weights" in answers(verdict)["Next"]


def test_a_plate_that_is_wrong_in_too_few_recordings_is_not_fit_and_may_not_be_correctable(
    tmp_path,
):
    few = {"speeds": (0.7, 1.0), "weights": (22.56, 45.08), "positions": (0.15,)}
    errors = PlateErrors(cross_talk={(0, 2): 0.05})
    simulate_plates(tmp_path, errors, **(DESIGN | few | {"belts": ("left",)}))
    (verdict,) = judge(check_plates(read_plates_study(tmp_path)))
    assert verdict.answer == "not fit"
    assert "Fz in Fx" in answers(verdict)["Found"]


def test_without_the_height_of_the_weights_no_plate_is_fit_but_a_bad_one_is_not_fit(good_plate):
    stated = dict(good_plate.study.file)
    kept = good_plate.study.file.model_fields_set - {"center_height_m"}
    file = PlatesFile(**{name: stated[name] for name in kept})
    unstated = replace(good_plate, study=replace(good_plate.study, file=file))
    (verdict,) = judge(again(unstated, unstated.trials))
    assert verdict.answer == "cannot be determined"
    assert "give center_height_m" in answers(verdict)["Next"]
    assert set(verdict.unexamined) == {"Fy", "COPx", "Mx", "My", "Mz"}
    (verdict,) = judge(spoiled(unstated, curvature=0.05))
    assert verdict.answer == "not fit"


def test_a_calibration_makes_a_load_right_that_it_has_not_seen(tmp_path, capsys):
    """A step of a person on the simulated plate, by no weight: right within the interval."""
    cross = {(0, 0): 0.08, (2, 2): -0.06, (0, 2): 0.02, (2, 0): 0.03, (4, 4): 0.05, (3, 2): 0.01}
    errors = PlateErrors(
        cross_talk=cross, zero=(4.0, 0.0, -8.0, 0.0, 3.0, 0.0), delay_s=0.005, noise_n=1.0
    )
    folder, out = tmp_path / "study", tmp_path / "out"
    few = {"belts": ("left",), "speeds": (1.0,)}
    simulate_plates(folder, errors, seed=6, **(DESIGN | few))
    assert main(["plates", str(folder), "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "fit after correction" in said
    calibration = read_plate_correction(out / "plate_calibration.json").calibrations.of(1)
    assert calibration.unexamined == ("Fy",)
    assert calibration.delay_s == pytest.approx(0.005, abs=1e-4)
    up, forward = BODY_N * np.array([1.2, 0.8]), BODY_N * np.array([-0.22, 0.1])
    x, y = np.array([-0.3, 0.35]), np.array([0.08, -0.05])
    step = np.column_stack([forward, 0 * up, up, y * up, -x * up, -y * forward])
    still = replace(errors, noise_n=0.0).plate
    measured = still.measure(step, 1000.0, np.random.default_rng(0))
    off = np.abs(calibration.correct(measured) - step)
    allowed = 2.2 * np.abs(measured) @ calibration.standard_error.T + 0.1  # and that of the zero
    assert (off < allowed).all()
    assert off[:, 2].max() < 1.0 < np.abs(measured - step)[:, 2].min()


def test_a_plate_whose_lateral_channel_is_wrong_is_fit_only_for_what_was_examined(good_plate):
    """No weight on a belt pushes sideways; that force acts on the moments about x and z too."""
    (verdict,) = judge(spoiled(good_plate, {(1, 1): 0.3}))
    assert verdict.answer == "fit"
    assert verdict.unexamined == ("Fy", "Mx", "Mz")
    unknown = {"gain of Fy", *(f"total error of {name}" for name in ("Fy", "Mx", "Mz"))}
    assert {one.name for one in verdict.judged if one.status == "not examined"} == unknown


def test_belts_at_constant_speed_examine_no_force_along_them(good_plate):
    still = [
        replace(trial, weight=trial.weight.model_copy(update={"profile": "constant"}))
        for trial in good_plate.trials
    ]
    found = spoiled(again(good_plate, still), {(0, 0): 0.3, (2, 2): 0.03})
    (verdict,) = judge(found)
    assert (verdict.answer, verdict.unexamined) == ("not fit", ("Fx", "Fy", "Mx", "My", "Mz"))
    assert verdict.calibration is None
    assert not {"gain of Fx", "gain of Mz"} & {one.fault for one in found.faults}


@pytest.mark.parametrize("real_over_stated", [1.012, 0.988], ids=["too light", "too heavy"])
def test_masses_that_are_all_misstated_alike_do_not_correct_perfect_plates(
    good_plates, real_over_stated
):
    for verdict in judge(with_masses(good_plates, real_over_stated)):
        assert verdict.answer == "cannot be determined"
        assert (verdict.calibration, verdict.corrections) == (None, ())
        assert verdict.shared == pytest.approx(real_over_stated - 1, abs=1e-4)


def test_a_common_gain_of_all_plates_is_corrected_once_the_masses_are_certain(good_plates):
    strong = spoiled(good_plates, dict.fromkeys(EVERY, 0.012), belts=("left", "right"))
    weighed = again(strong, strong.trials, mass_uncertainty_percent=0.02)
    assert [one.answer for one in judge(strong)] == ["cannot be determined"] * 2
    for one in judge(weighed):
        assert one.answer == "fit after correction"
        assert one.calibration.matrix[2, 2] == pytest.approx(1 / 1.012, abs=4e-4)


@pytest.mark.parametrize(
    "cross_talk",
    [dict.fromkeys(EVERY, 0.012), {(2, 2): 0.012}, {(0, 0): 0.03}],
    ids=["all gains", "gain of Fz", "gain of Fx"],
)
def test_a_gain_that_only_one_plate_has_is_corrected(good_plates, cross_talk):
    strong, right = judge(spoiled(good_plates, cross_talk))
    assert (strong.answer, right.answer) == ("fit after correction", "fit")
    for (k, _), share in cross_talk.items():
        if k != 1:  # no weight exerts a lateral force
            assert strong.calibration.matrix[k, k] == pytest.approx(1 / (1 + share), abs=5e-4)


def test_what_misstated_masses_explain_of_a_gain_is_left_out_of_a_correction(good_plate):
    """A perfect plate that is turned, under masses that are 0.5 % heavier than stated."""
    turned = with_masses(spoiled(good_plate, {(0, 1): 0.02, (1, 0): -0.02}), 1.005)
    (verdict,) = judge(turned)
    assert verdict.answer == "fit after correction"
    assert verdict.calibration.matrix[2, 2] == pytest.approx(1.0, abs=5e-4)
    assert verdict.calibration.matrix[0, 0] == pytest.approx(1.0, abs=3e-3)


def test_a_fault_that_masses_do_not_explain_stays_one_under_misstated_masses(good_plate):
    """Whether its correction is enough is not known before the masses are."""
    (verdict,) = judge(with_masses(spoiled(good_plate, {(0, 2): 0.05}), 1.012))
    assert (verdict.answer, verdict.calibration) == ("not fit", None)
    assert "Fz in Fx" in answers(verdict)["Found"]
    assert "weigh the masses" in answers(verdict)["Next"]


@pytest.mark.parametrize(
    ("low", "high", "status"), [(0, 1, "within"), (0, 2, "unclear"), (1.5, 2, "beyond")]
)
def test_an_estimate_is_beyond_its_limit_only_with_all_of_its_interval(low, high, status):
    assert Judged("gain", (low + high) / 2, low, high, 1.2, "1", False).status == status


def test_the_simulated_offset_is_that_of_the_thesis_in_its_own_axes():
    """It states 1.5 mm in x and -1.8 mm in z, x to the right and z to the back."""
    in_lab = parse_axes("right,up,back") @ [0.0015, 0.0, -0.0018]
    np.testing.assert_allclose(THESIS_ERRORS.offset_m, in_lab[:2], atol=1e-12)


@pytest.mark.parametrize(("component", "quantity"), [(0, "Fx"), (4, "COPx")])
def test_a_gain_that_rises_with_the_load_is_extrapolated(good_plate, component, quantity):
    """By 8 % of itself per 75 kg: a linear correction fits the weights, not a person."""
    (verdict,) = judge(spoiled(good_plate, rise={component: 0.08}))
    assert verdict.answer == "not fit"
    loads = stance_loads(75)
    true = {"Fx": loads[:, 0], "COPx": -loads[:, 4] / loads[:, 2]}[quantity]
    expected = np.sqrt(np.mean((true * 0.08 * loads[:, 2] / BODY_N) ** 2))
    size = {one.name: one.size for one in verdict.judged}[f"total error of {quantity}"]
    assert size == pytest.approx(expected, rel=0.05)


def test_what_no_weight_excites_is_not_called_fit(good_plate):
    """No weight on a belt exerts a lateral force, so that a dead channel of it would not show."""
    (verdict,) = judge(good_plate)
    first, *_ = verdict.table.rows
    ((rating, text, _),) = first[1]
    assert verdict.answer == "fit"
    assert rating == "check"
    assert text.startswith("Fx, Fz, COPx, COPy, My: fit; ")
