"""One trial of a study is processed from files to residuals, with notes of what was done."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.calibration_pose.anatomy import LimbMeasures
from hbm.ik.tracking import solve_ik
from hbm.signals.filtering import butterworth
from pipeline.config.schema import Condition, Settings, Subject, Treadmill
from pipeline.io.c3d.read import read_c3d
from pipeline.io.recording import Metadata
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording, process_trial
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.residuals import residual_table
from pipeline.trial.subject import subject_body
from tests.hbm.motions import displaced
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import ground_of

PERSON = Subject(id="sub01", sex="male")
MASS_KG = lab.PEOPLE[0].mass_kg


@pytest.fixture(scope="module")
def results(study):
    return {name: process_trial(study, "sub01", name) for name in study.file.conditions}


@pytest.fixture(scope="module")
def standing_still(walker):
    """The same walk on a treadmill that stands still: the result expected in all conditions."""
    return process_recording(walker, PERSON, Settings())


def test_a_file_that_is_not_read_yet_is_named_with_what_reads_it(walker):
    for name, rest in (("recording", {}), ("static", {"recording": walker})):
        with pytest.raises(TypeError, match=rf"^{name}: .*'x.c3d'.*{name}=hr.read"):
            process_recording(**rest | {name: "x.c3d"}, subject=PERSON, settings=Settings())


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("walk.c3d", "its plates"), ("walk.trc", "MOT or .forces"), ("walk.tsv", "walk_f_1.tsv ")],
)
def test_what_a_trial_lacks_is_said_at_once_labels_plates_mass(walker, name, remedy):
    names = tuple(f"P{k}" for k in range(len(walker.markers.names)))
    bare = replace(
        walker,
        source=Path(name),
        markers=replace(walker.markers, names=names, position=walker.markers.position[:, ::-1]),
        plates=(),
        metadata=Metadata(),
    )
    said = f"no shipped set; labels: P0, .*; residuals need .*{remedy}.*mass is missing"
    with pytest.raises(ValueError, match=said):
        process_recording(bare, PERSON, Settings())


def rms(result, compensated):
    table = residual_table(result, "condition")
    return table[table.compensated == compensated].set_index("axis")["rms"]


def total(by_foot):
    return sum(by_foot.values())


@pytest.mark.parametrize("condition", ["baseline", "sway", "pitch"])
def test_the_persons_own_wrench_reaches_the_model_whatever_the_platform_did(
    results, standing_still, condition
):
    found = total(results[condition].ground["compensated"])
    true = total(standing_still.ground["measured"])
    error = np.abs(found - true)[60:-60].max(axis=0)
    assert (error < [2, 2, 2, 1, 1, 1]).all()


@pytest.mark.parametrize(
    ("condition", "axes"), [("sway", ["Fy", "Mx"]), ("pitch", ["Fx", "Fz", "My"])]
)
def test_compensation_removes_the_platform_from_the_residuals(results, condition, axes):
    """Above baseline, less than a tenth of the platform's contribution remains."""
    baseline = rms(results["baseline"], True)
    measured = rms(results[condition], False) - baseline
    compensated = rms(results[condition], True) - baseline
    assert (measured[axes] > 20).all()
    assert (compensated[axes].abs() < 0.1 * measured[axes]).all()


def test_a_platform_at_rest_has_nothing_to_compensate(results, standing_still):
    for compensated in (False, True):
        difference = rms(results["baseline"], compensated) - rms(standing_still, False)
        assert difference.abs().max() < 1


def test_sway_counts_the_cycles_with_a_pulse(results):
    spans = np.concatenate(list(results["sway"].cycles.values()))
    assert len(spans) == 2
    for onset in lab.SWAYS_S:
        assert np.count_nonzero((spans[:, 0] <= onset) & (onset < spans[:, 1])) == 1
    np.testing.assert_allclose(results["sway"].onsets, lab.SWAYS_S, atol=1e-9)


def test_without_a_pulse_the_platforms_motion_selects_the_same_cycles(study, results):
    rule = study.file.conditions["sway"].model_copy(update={"pulse_channel": None})
    conditions = study.file.conditions | {"sway": rule}
    file = study.file.model_copy(update={"conditions": conditions})
    result = process_trial(replace(study, file=file), "sub01", "sway")
    for side, spans in results["sway"].cycles.items():
        np.testing.assert_array_equal(result.cycles[side], spans)


def test_a_perturbed_condition_without_perturbation_is_refused(study):
    rule = Condition(perturbed=True, pulse_channel="Pulse")
    path = study.path("sub01_pitch.c3d")
    with pytest.raises(ValueError, match=r"sub01_pitch\.c3d: Pulse .*no perturbation"):
        process_recording(read_c3d(path), PERSON, Settings(), condition=rule)


@pytest.mark.parametrize("method", ["zero_phase", "realtime"])
def test_motion_and_forces_pass_the_filter_that_is_stated(walker, method):
    result = process_recording(walker, PERSON, Settings(filter=method, cutoff_hz=8.0))
    time = walker.markers.time
    plates = ground_of(walker, Laboratory(Treadmill()), time, cutoff_hz=8.0, method=method)
    raw = np.sum(plates.variants["measured"], axis=0)
    expected = butterworth(raw, time, 8.0, method).value
    np.testing.assert_allclose(total(result.ground["measured"]), expected, atol=1e-6)
    solved = solve_ik(result.body, walker.markers)
    expected = butterworth(solved.q, time, 8.0, method)
    np.testing.assert_allclose(result.motion.q, expected.value, atol=1e-9)
    np.testing.assert_allclose(result.motion.a, expected.acceleration, atol=1e-6)


def test_the_delay_of_the_plates_is_estimated_and_removed(walker, standing_still):
    late = lab.on_platform(walker, lab.still(12.0), plate_delay_s=0.02, noise=0)
    unaware = process_recording(late, PERSON, Settings())
    aware = process_recording(late, PERSON, Settings(plate_delay_s=0.02))
    assert unaware.delay_s - standing_still.delay_s == pytest.approx(0.02, abs=0.002)
    assert aware.delay_s == pytest.approx(standing_still.delay_s, abs=0.001)
    assert (rms(unaware, False) > 1.5 * rms(standing_still, False)).any()
    assert (rms(aware, False) - rms(standing_still, False)).abs().max() < 0.5


def test_frames_without_accelerations_count_in_neither_variant(study, laboratory, results):
    """Frames that only one variant defines would compare different parts of steps."""
    recording = read_c3d(study.path("sub01_pitch.c3d"))
    values = recording.analog.values.copy()
    values[8000:8100, 0] = np.nan
    broken = replace(recording, analog=replace(recording.analog, values=values))
    result = process_recording(broken, PERSON, Settings(), laboratory=laboratory)
    assert residual_table(result, "pitch")["rms"].notna().all()
    time, whole = result.motion.time, results["pitch"]
    near = (time > 7.85) & (time < 8.25)
    assert not result.counts[near].any()
    assert free_of(result.quality, Quality.POSE_UNKNOWN)[near].all()
    for variant in ("measured", "compensated"):
        difference = getattr(result, variant).residual - getattr(whole, variant).residual
        assert np.abs(difference[result.counts]).max() < 1.0


def warnings(result):
    return [note for note in result.notes if note.level == "warning"]


def test_a_stated_mass_that_the_plates_contradict_is_noted(walker, results):
    true = lab.PEOPLE[0].mass_kg
    assert warnings(results["baseline"]) == warnings(results["pitch"]) == []
    (beyond,) = warnings(results["sway"])
    assert beyond.code == "calibration_range_exceeded"
    (note,) = warnings(process_recording(walker, Subject(mass_kg=1.1 * true), Settings()))
    assert note.code == "mass_differs"
    assert note.values["difference"] == pytest.approx(0.1, abs=0.01)
    stated_kg, *others_kg = note.values["known_kg"].values()
    assert stated_kg == 1.1 * true
    assert others_kg == pytest.approx([true] * 3, abs=0.5)


def test_a_marker_that_moved_since_the_calibration_pose_is_noted(walker):
    moved = replace(walker, markers=displaced(walker.markers, "LLTHI", [0.0, 0.0, 0.06]))
    notes = warnings(process_recording(moved, PERSON, Settings(), static=walker))
    changed = [note for note in notes if note.code == "marker_distances_changed"]
    assert "left_thigh" in [note.values["segment"] for note in changed]


def test_stature_is_as_stated_else_as_recorded_else_from_the_legs(walker):
    person = PERSON.model_copy(update={"height_m": 1.9})
    assert subject_body(walker, person, Settings(), MASS_KG).height_m == 1.9
    assert subject_body(walker, PERSON, Settings(), MASS_KG).height_m == pytest.approx(1.78)
    bare = replace(walker, metadata=Metadata())
    notes = subject_body(bare, PERSON, Settings(), MASS_KG).notes
    assert any("legs" in note.values.get("source", "") for note in notes)


def test_widths_stand_in_for_medial_markers_as_stated_else_as_recorded_of_that_side(walker):
    markers = walker.markers
    kept = [k for k, name in enumerate(markers.names) if name not in ("LMEK", "RMEK")]
    names, position = tuple(markers.names[k] for k in kept), markers.position[:, kept]
    bare = replace(
        walker, markers=replace(markers, names=names, position=position), metadata=Metadata()
    )

    def beside_the_knees(recording, **stated):
        person = PERSON.model_copy(update=stated)
        body = subject_body(recording, person, Settings(), MASS_KG)
        lateral = [body.marker_position[body.markers.index(name)] for name in ("LLEK", "RLEK")]
        knees = [body.offsets[f"{side}_shank"] for side in ("left", "right")]
        return np.linalg.norm(np.subtract(lateral, knees), axis=1) - Settings().marker_offset_m

    widths = {"left": 0.13, "right": 0.11}
    limbs = {side: LimbMeasures(knee_width_m=width) for side, width in widths.items()}
    recorded = replace(bare, metadata=Metadata(limbs=limbs))
    np.testing.assert_allclose(beside_the_knees(recorded), [0.065, 0.055], atol=1e-3)
    np.testing.assert_allclose(beside_the_knees(recorded, knee_width_m=0.1), 0.05, atol=1e-3)


def test_the_body_is_built_from_the_static_recording(walker, standing_still):
    """Built from the first seconds alone, the body is the same as from all of the trial."""
    static = lab.cropped(walker, 0, 199)
    result = process_recording(walker, PERSON, Settings(), static=static)
    for name, offset in standing_still.body.offsets.items():
        np.testing.assert_allclose(result.body.offsets[name], offset, atol=1e-3)


@pytest.mark.parametrize(("load_n", "mass_kg"), [(0.0, None), (350.0, 75.0)])
def test_plates_that_never_change_give_notes_and_no_residuals(walker, load_n, mass_kg):
    """Dead plates, without or with an offset; nothing is divided by what they carry."""
    constant = np.tile([0.0, 0, load_n, 0, 0, 0], (len(walker.plates[0].time), 1))
    plates = tuple(replace(plate, wrench_in_plate=constant) for plate in walker.plates)
    dead = replace(walker, plates=plates)
    result = process_recording(dead, Subject(mass_kg=mass_kg), Settings())
    codes = [note.code for note in result.notes]
    assert codes.count("plate_dead") == 2
    assert "no_residuals" in codes


def test_an_unknown_trial_is_refused(study):
    with pytest.raises(ValueError, match=r"'sub1', .*'sub01'"):
        process_trial(study, "sub1", "sway")


def test_an_excluded_trial_is_refused_with_its_reason(study):
    person = study.subjects["sub01"]
    trial = person.trials["sway"][0].model_copy(update={"exclude": "fell"})
    subjects = {"sub01": person.model_copy(update={"trials": {"sway": (trial,)}})}
    changed = replace(study, subjects=subjects)
    with pytest.raises(ValueError, match=r"sub01 sway .*fell"):
        process_trial(changed, "sub01", "sway")


def test_a_moving_platform_changes_no_event(results, standing_still):
    """Of one walk, on plates that are compensated."""
    steady = [event for event in standing_still.events if event.time > 6]
    for result in results.values():
        for event, same in zip((e for e in result.events if e.time > 6), steady, strict=True):
            assert (event.label, event.side) == (same.label, same.side)
            assert abs(event.time - same.time) < 0.005
