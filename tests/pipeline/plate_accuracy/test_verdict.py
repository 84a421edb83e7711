"""A plate is fit only where its errors are small at a person's loads; else the reason is named."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS
from pipeline.cli.app import main
from pipeline.config.plate_correction import read_plate_correction
from pipeline.config.plate_study import AccuracyLimits, PlatesFile, read_plates_study
from pipeline.config.toml_file import StudyFaults
from pipeline.io.axes import parse_axes
from pipeline.plate_accuracy.accuracy import examine_plates
from pipeline.plate_accuracy.faults import FaultEstimate, estimate_faults
from pipeline.plate_accuracy.judgement import Judged, delay_notes
from pipeline.plate_accuracy.report import use_of_calibration
from pipeline.plate_accuracy.response import fit_response
from pipeline.plate_accuracy.trials import UNALIGNED
from pipeline.plate_accuracy.verdict import Verdict, judge
from pipeline.virtual_lab.protocol import known_weights
from pipeline.virtual_lab.protocol.known_weights import THESIS_ERRORS, PlateErrors, simulate_plates

ONE = {"speeds": (1.0,), "weights": (22.56,), "positions": (0.25,)}
"""Two recordings, sine and square."""
DESIGN = {
    "speeds": (0.7, 1.0),
    "weights": (13.44, 22.56, 45.08),
    "positions": (0.15, 0.35),
    "belts": ("left",),
    "supports": (True,),
}
BODY_N = 75.0 * GRAVITY_MPS2


def examined(folder, errors=None, lines="", **changes):
    """The study of one plate with given errors and further lines of plates.toml."""
    simulate_plates(folder, errors, seed=5, **(DESIGN | changes))
    path = folder / "plates.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[[static]]", f"{lines}\n[[static]]", 1), encoding="utf-8")
    return examine_plates(read_plates_study(folder))


UP = BODY_N * np.sqrt(np.mean(np.square([1.2, 0.75, 1.2])))
FORWARD = BODY_N * np.sqrt(np.mean(np.square([0.25, 0.0, 0.25])))
"""Root mean square of a foot's force in braking, midstance and push-off [N]."""


@pytest.mark.parametrize(
    ("cross_talk", "fault", "size", "totals"),
    [
        ({(k, k): 0.1 for k in range(6)}, "gain of Fz", 0.1, {"Fz": 0.1 * UP}),
        ({(0, 0): 0.3}, "gain of Fx", 0.3, {"Fx": 0.3 * FORWARD, "My": 0.3 * FORWARD}),
        ({(0, 2): 0.05}, "Fz in Fx", 0.05, {"Fx": 0.05 * UP, "My": 0.05 * UP}),
    ],
    ids=["all gains 10 % too high", "Fx 30 % too high", "5 % of Fz in Fx"],
)
def test_a_bad_plate_is_never_fit_as_it_is_and_its_fault_is_named(
    tmp_path, cross_talk, fault, size, totals
):
    """A force along the belt that is wrong is that moment about a point 1 m above it."""
    weighed = "mass_uncertainty_percent = 0.05"
    (verdict,) = judge(examined(tmp_path, PlateErrors(cross_talk=cross_talk), weighed))
    assert verdict.verdict.answer == "fit after correction"
    assert verdict.sentence.startswith("left plate: not fit for inverse dynamics as it is")
    first = verdict.reasons[0]
    assert first.size == pytest.approx(size, rel=0.01)
    assert f"Found: {first.name}" in verdict.sentence
    assert "plate_calibration.json" in " ".join(verdict.corrections)
    reasons = {one.name: one for one in verdict.reasons}
    assert reasons[fault].size == pytest.approx(size, rel=0.01)
    for name, total in totals.items():
        assert reasons[f"total error of {name}"].size == pytest.approx(total, rel=0.01)
    assert f"total error of {next(iter(totals))}" in verdict.sentence


def test_what_no_calibration_takes_away_makes_a_plate_not_fit(tmp_path):
    (verdict,) = judge(examined(tmp_path, PlateErrors(curvature=0.05)))
    assert verdict.verdict.answer == "not fit"
    assert verdict.reasons[0].name == "curvature"
    assert "total error of Fz after correction" in {one.name for one in verdict.reasons}
    assert verdict.sentence.startswith("left plate: not fit for inverse dynamics; not examined: ")
    assert "Found: curvature 25." in verdict.sentence


def test_a_calibration_that_would_make_a_total_error_too_large_is_not_written(tmp_path):
    """Too high a gain and a negative curvature are nearly right at the load of a person."""
    errors = PlateErrors(cross_talk={(2, 2): 0.014}, curvature=-0.008)
    (verdict,) = judge(examined(tmp_path, errors))
    sizes = {one.name: one.size for one in (*verdict.judged, *verdict.corrected)}
    assert sizes["total error of Fz"] < 7.5 < sizes["total error of Fz after correction"]
    assert verdict.verdict.answer == "not fit"
    assert verdict.calibration is None
    assert "gain of Fz 1.4" in verdict.sentence


def test_no_correction_is_advised_for_a_plate_that_it_does_not_make_fit(tmp_path):
    errors = PlateErrors(cross_talk={(2, 2): 0.1}, drift_n_per_s=0.3)
    (verdict,) = judge(examined(tmp_path, errors))
    assert verdict.verdict.answer == "not fit"
    assert verdict.calibration is not None
    assert verdict.corrections == ()
    assert use_of_calibration([verdict], tmp_path) is None


def dead(found, component):
    """The same recordings of a plate of which one channel was not recorded, and its response."""
    trials = []
    for trial in found.trials:
        measured, slow = trial.measured.copy(), trial.slow_measured.copy()
        measured[:, component] = slow[:, component] = 0.0
        constant = np.arange(6) == component
        trials.append(replace(trial, measured=measured, slow_measured=slow, constant=constant))
    response = fit_response(trials, UNALIGNED, 510.0, height_stated=True)
    faults = estimate_faults(trials, {"left": response}, {}, {}, height_stated=True)
    return replace(found, trials=tuple(trials), responses={"left": response}, faults=faults)


@pytest.fixture(scope="module")
def perfect(tmp_path_factory):
    return examined(tmp_path_factory.mktemp("perfect"))


@pytest.mark.parametrize("component", [0, 1, 3, 5], ids=["Fx", "Fy", "Mx", "Mz"])
def test_a_plate_of_which_a_channel_is_dead_is_not_fit_and_has_no_calibration(perfect, component):
    (verdict,) = judge(dead(perfect, component))
    name = WRENCH_COMPONENTS[component]
    assert verdict.verdict.answer == "not fit"
    assert verdict.calibration is None
    assert f"{name} in the plate's own axes never changed" in verdict.sentence
    beyond = {one.name: one.size for one in verdict.judged if one.status == "beyond"}
    if component != 1:  # no weight exerts a lateral force: it has no gain
        assert beyond[f"gain of {name}"] == pytest.approx(1.0, abs=1e-3)


def test_a_channel_that_shows_the_same_in_every_sample_is_found_when_it_is_read(
    tmp_path, monkeypatch
):
    measure = known_weights._SetUp.measure

    def without_fy(self, wrench, belt):
        return measure(self, wrench, belt) * [1, 0, 1, 1, 1, 1]

    assert not any(trial.constant.any() for trial in examined(tmp_path / "whole", **ONE).trials)
    monkeypatch.setattr(known_weights._SetUp, "measure", without_fy)
    (verdict,) = judge(examined(tmp_path / "dead", **ONE))
    assert verdict.verdict.answer == "not fit"
    assert "in the plate's own axes never changed" in verdict.sentence


def test_the_verdict_names_the_load_beyond_which_it_is_extrapolated(perfect):
    (verdict,) = judge(perfect)
    assert f"above the largest recorded one ({45.08 * GRAVITY_MPS2:.0f} N)" in verdict.sentence


def test_the_error_of_a_person_grows_from_that_of_the_weights(tmp_path):
    """A curvature of 1 % at 510 N is 3 % of 1.2 body weights of 75 kg, and more of 110 kg."""
    totals = []
    for n, mass in enumerate((75.0, 110.0)):
        found = examined(tmp_path / str(n), PlateErrors(curvature=0.01), f"body_mass_kg = {mass}")
        (verdict,) = judge(found)
        totals.append(next(one for one in verdict.judged if one.name == "total error of Fz"))
        loads = mass * GRAVITY_MPS2 * np.array([1.2, 0.75, 1.2])
        true = np.sqrt(np.mean((0.01 * loads**2 / 510) ** 2))
        assert totals[-1].low < np.hypot(true, 0.2) < totals[-1].high
    widths = [one.high - one.low for one in totals]
    assert widths[1] > widths[0]


def test_an_interval_that_holds_the_limit_tells_nothing_and_says_what_to_record(tmp_path):
    found = examined(tmp_path, PlateErrors(cross_talk={(2, 2): 0.005}))
    gain = next(one for one in found.faults if one.fault == "gain of Fz")
    near = 100 * (gain.value - 0.3 * gain.uncertainty)
    file = found.study.file.model_copy(update={"limits": AccuracyLimits(gain_percent=near)})
    (verdict,) = judge(replace(found, study=replace(found.study, file=file)))
    assert verdict.verdict.answer == "cannot be told"
    assert "gain of Fz" in {one.name for one in verdict.reasons}
    assert "record more weights on this plate" in verdict.sentence


def test_a_plate_that_is_wrong_in_too_few_recordings_is_not_fit_and_may_not_be_correctable(
    tmp_path,
):
    few = {"weights": (22.56, 45.08), "positions": (0.25,)}
    (verdict,) = judge(examined(tmp_path, PlateErrors(cross_talk={(0, 2): 0.05}), **few))
    assert verdict.verdict.answer == "not fit"
    assert "Fz in Fx" in verdict.sentence
    assert "Whether a correction is enough cannot be told: record 3 different weights" in (
        verdict.sentence
    )


def unstated(found):
    """The same study, the height of the weights' centre of mass not stated."""
    stated = dict(found.study.file)
    kept = found.study.file.model_fields_set - {"center_height_m"}
    file = PlatesFile(**{name: stated[name] for name in kept})
    return replace(found, study=replace(found.study, file=file))


def test_without_the_height_of_the_weights_no_plate_is_fit_but_a_bad_one_is_not_fit(tmp_path):
    (verdict,) = judge(unstated(examined(tmp_path / "perfect")))
    assert verdict.verdict.answer == "cannot be told"
    assert "To do: state center_height_m" in verdict.sentence
    assert set(verdict.verdict.unexamined) == {"Fy", "COPx", "Mx", "My", "Mz"}
    (verdict,) = judge(unstated(examined(tmp_path / "bad", PlateErrors(curvature=0.05))))
    assert verdict.verdict.answer == "not fit"


def test_stated_limits_are_those_of_the_verdict(tmp_path):
    (verdict,) = judge(examined(tmp_path, lines="[limits]\nnoise_n = 0.01\nmoment_nm = 3.0"))
    assert verdict.verdict.answer == "not fit"
    assert [one.name for one in verdict.reasons] == ["noise of forces"]
    limits = {one.name: one.limit for one in verdict.judged}
    assert limits["total error of My"] == 3.0
    path = tmp_path / "plates.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("noise_n", "nose_n"), encoding="utf-8")
    with pytest.raises(StudyFaults, match="nose_n: unknown key"):
        read_plates_study(tmp_path)


def test_a_calibration_makes_a_load_right_that_it_has_not_seen(tmp_path, capsys):
    """A step of a person on the simulated plate, by no weight: right within the interval."""
    cross = {(0, 0): 0.08, (2, 2): -0.06, (0, 2): 0.02, (2, 0): 0.03, (4, 4): 0.05, (3, 2): 0.01}
    errors = PlateErrors(
        cross_talk=cross, zero=(4.0, 0.0, -8.0, 0.0, 3.0, 0.0), delay_s=0.005, noise_n=1.0
    )
    folder, out = tmp_path / "study", tmp_path / "out"
    simulate_plates(folder, errors, seed=6, **DESIGN)
    assert main(["plates", str(folder), "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "not fit for inverse dynamics as it is; fit after correction for forward and" in said
    assert "[plates] calibration =" in said
    assert "--plate-calibration" in said
    page = (out / "verdict.md").read_text(encoding="utf-8")
    assert '[plates]\ncalibration = "plate_calibration.json"' in page

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


@pytest.mark.parametrize("gain", [-1.0, 0.3], ids=["dead channel", "30 % too much"])
def test_a_plate_whose_lateral_channel_is_wrong_is_fit_only_for_what_was_examined(
    tmp_path, gain, capsys
):
    """No weight on a belt pushes sideways; that force acts on the moments about x and z too."""
    folder, out = tmp_path / "study", tmp_path / "out"
    simulate_plates(folder, PlateErrors(cross_talk={(1, 1): gain}), seed=5, **DESIGN)
    assert main(["plates", str(folder), "--out", str(out)]) == 0
    verdict = (
        "left plate: fit for forward and vertical force, forward and lateral centre of pressure, "
        "moment about the lateral axis; not examined: lateral force, moment about the forward and "
        "vertical axis"
    )
    assert verdict in " ".join(capsys.readouterr().out.split())
    page = (out / "verdict.md").read_text(encoding="utf-8")
    assert page.count(verdict) == 2
    status = pd.read_csv(out / "judged.csv").set_index("error")["status"]
    unknown = {"gain of Fy", *(f"total error of {name}" for name in ("Fy", "Mx", "Mz"))}
    assert set(status.index[status == "not examined"]) == unknown


def test_a_correction_is_fit_only_for_what_was_examined(tmp_path):
    errors = PlateErrors(cross_talk={(1, 1): 0.3, (2, 2): 0.03})
    (verdict,) = judge(examined(tmp_path, errors))
    assert verdict.verdict == Verdict("fit after correction", ("Fy", "Mx", "Mz"))
    assert "fit after correction for forward and vertical force" in str(verdict.verdict)
    assert verdict.calibration.unexamined == ("Fy",)


def test_belts_at_constant_speed_examine_no_force_along_them(tmp_path):
    errors = PlateErrors(cross_talk={(0, 0): 0.3, (2, 2): 0.03})
    found = examined(tmp_path, errors, profiles=("constant",), speeds=(0.3, 0.7))
    (verdict,) = judge(found)
    assert verdict.verdict == Verdict("not fit", ("Fx", "Fy", "Mx", "My", "Mz"))
    assert verdict.calibration is None
    assert not {"gain of Fx", "gain of Mz"} & {one.fault for one in found.faults}


def every_gain(share):
    return PlateErrors(cross_talk={(k, k): share for k in range(6)})


def judged_with_masses(folder, real_over_stated, errors=None, lines="", belts=("left", "right")):
    """The verdicts on plates whose weights are all heavier than stated by one factor."""
    stated = tuple(mass / real_over_stated for mass in DESIGN["weights"])
    simulate_plates(folder, errors, seed=5, **(DESIGN | {"belts": belts}))
    path = folder / "plates.toml"
    text = path.read_text(encoding="utf-8")
    for mass, wrong in zip(DESIGN["weights"], stated, strict=True):
        text = text.replace(f"mass_kg = {mass}\n", f"mass_kg = {wrong}\n")
    path.write_text(text.replace("[[static]]", f"{lines}\n[[static]]", 1), encoding="utf-8")
    return judge(examine_plates(read_plates_study(folder)))


@pytest.mark.parametrize("real_over_stated", [1.012, 0.988], ids=["too light", "too heavy"])
def test_masses_that_are_all_misstated_alike_do_not_correct_perfect_plates(
    tmp_path, real_over_stated
):
    for verdict in judged_with_masses(tmp_path, real_over_stated):
        assert verdict.verdict.answer == "cannot be told"
        assert (verdict.calibration, verdict.corrections) == (None, ())
        assert verdict.shared == pytest.approx(real_over_stated - 1, abs=1e-4)
        assert "weigh the masses with a second balance" in verdict.sentence
        assert "all gains of every plate are 1.2 % too" in verdict.sentence


def test_a_common_gain_of_all_plates_is_corrected_once_the_masses_are_certain(tmp_path):
    unsure = judged_with_masses(tmp_path / "unsure", 1.0, every_gain(0.012))
    weighed = judged_with_masses(
        tmp_path / "weighed", 1.0, every_gain(0.012), "mass_uncertainty_percent = 0.02"
    )
    assert [one.verdict.answer for one in unsure] == ["cannot be told"] * 2
    assert [one.verdict.answer for one in weighed] == ["fit after correction"] * 2
    for one in weighed:
        assert one.calibration.matrix[2, 2] == pytest.approx(1 / 1.012, abs=4e-4)


@pytest.mark.parametrize(
    "cross_talk",
    [{(k, k): 0.012 for k in range(6)}, {(2, 2): 0.012}, {(0, 0): 0.03}],
    ids=["all gains", "gain of Fz", "gain of Fx"],
)
def test_a_gain_that_only_one_plate_has_is_corrected(tmp_path, cross_talk):
    strong, right = judged_with_masses(tmp_path, 1.0, {"left": PlateErrors(cross_talk=cross_talk)})
    assert strong.verdict.answer == "fit after correction"
    assert right.verdict.answer == "fit"
    for (k, _), share in cross_talk.items():
        if k != 1:  # no weight exerts a lateral force
            assert strong.calibration.matrix[k, k] == pytest.approx(1 / (1 + share), abs=5e-4)


def test_what_misstated_masses_explain_of_a_gain_is_left_out_of_a_correction(tmp_path):
    """A perfect plate, turned by 1.5°, under masses that are 0.5 % heavier than stated."""
    errors = PlateErrors(angle_rad=np.radians(1.5))
    (verdict,) = judged_with_masses(tmp_path, 1.005, errors, belts=("left",))
    assert verdict.verdict.answer == "fit after correction"
    assert np.linalg.det(verdict.calibration.matrix[:2, :2]) == pytest.approx(1.0, abs=3e-3)
    assert verdict.calibration.matrix[2, 2] == pytest.approx(1.0, abs=5e-4)


def test_a_fault_that_masses_do_not_explain_stays_one_under_misstated_masses(tmp_path):
    """Whether its correction is enough is not known before the masses are."""
    errors = PlateErrors(cross_talk={(0, 2): 0.05})
    (verdict,) = judged_with_masses(tmp_path, 1.012, errors, belts=("left",))
    assert verdict.verdict.answer == "not fit"
    assert verdict.calibration is None
    assert "Fz in Fx" in verdict.sentence
    assert "cannot be told: weigh the masses" in verdict.sentence


@pytest.mark.slow
def test_perfect_plates_with_the_design_of_the_thesis_are_fit(tmp_path):
    simulate_plates(tmp_path, seed=8, supports=(True,))
    found = examine_plates(read_plates_study(tmp_path))
    assert [one.verdict.answer for one in judge(found)] == ["fit", "fit"]


def test_delays_that_contradict_each_other_are_a_warning():
    hammer = FaultEstimate("left", "delay", 0.0015, 0.0001, "s", 14)
    motion = FaultEstimate("left", "delay in motion", 0.0040, 0.00001, "s", 15)
    (note,) = delay_notes([hammer, motion])
    assert note.level == "warning"
    assert "the one in motion is used" in str(note)
    assert delay_notes([replace(hammer, value=0.0040), motion]) == ()
    assert delay_notes([motion]) == ()


@pytest.mark.parametrize(
    ("low", "high", "status"), [(0, 1, "within"), (0, 2, "unclear"), (1.5, 2, "beyond")]
)
def test_an_estimate_is_beyond_its_limit_only_with_all_of_its_interval(low, high, status):
    assert Judged("gain", (low + high) / 2, low, high, 1.2, "1", "none").status == status


def test_the_simulated_offset_is_that_of_the_thesis_in_its_own_axes():
    """It states 1.5 mm in x and -1.8 mm in z, x to the right and z to the back."""
    in_lab = parse_axes("right,up,back") @ [0.0015, 0.0, -0.0018]
    np.testing.assert_allclose(THESIS_ERRORS.offset_m, in_lab[:2], atol=1e-12)
