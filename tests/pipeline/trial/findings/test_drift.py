"""Zeros that drift are found by phases in which no foot is on the plate, and followed."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pipeline
from hbm.markers import marker_sets
from hbm.spatial import rotate_wrench, shift_wrench
from pipeline.config.schema import Settings, Subject, Treadmill, TrialName
from pipeline.config.study import read_study
from pipeline.io.read_options import ReadOptions
from pipeline.trial.chain import Chain
from pipeline.trial.corrections import find_faults
from pipeline.trial.findings.drift import Course, zeros_of
from pipeline.trial.findings.words import row_of
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.inputs import Inputs
from pipeline.trial.notes import notes_of
from pipeline.trial.process import process_recording, trial_chain
from pipeline.trial.study_files import read_study_file, read_study_laboratory
from pipeline.virtual_lab.faults import AccelerometerFaults, Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.walking_protocol import DEMO, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.campaign.walks import legs_only, real
from tests.pipeline.equality import assert_identical

HBM2, STILL, MASS_KG = marker_sets()["hbm2"], Laboratory(Treadmill()), 74.6
PERSON = Subject(sex="male", mass_kg=MASS_KG)


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Forty seconds on two belts, with the noise of real plates."""
    path = tmp_path_factory.mktemp("walk") / "walk.c3d"
    simulate_trial(path, duration_s=40.0, plate_noise_n=1.1, seed=2)
    return pipeline.read_c3d(path)


@pytest.fixture(scope="module")
def chain(walk):
    """The chain of that walk: changes of its plates keep the motion."""
    chain = chain_of(walk)
    assert np.isfinite(chain.loads.dynamics["measured"].residual[chain.counts]).all()
    return chain


@pytest.fixture(scope="module")
def steady(walk):
    """The zero of its left plate."""
    return zeros_of(walk, HBM2, STILL)[0]


def drifting(recording, zero, plate=0):
    """The recording whose plate reads a zero, a function of time to (N, 6), in its axes."""
    plates = list(recording.plates)
    measured = plates[plate]
    wrench = measured.wrench_in_plate + zero(measured.time)
    plates[plate] = replace(measured, wrench_in_plate=wrench)
    return replace(recording, plates=tuple(plates))


def line(*per_s):
    return lambda time: np.outer(time, per_s)


def following(recording, *plates):
    """The recording with what a study states."""
    return replace(recording, options=ReadOptions(mend_plates=tuple(f"{k}: drift" for k in plates)))


def chain_of(recording, laboratory=STILL, **known):
    return Chain(
        Inputs(recording=recording, subject=PERSON, laboratory=laboratory, **known), Settings()
    )


def rms(chain):
    residual = chain.loads.dynamics[chain.ground.best].residual[chain.counts]
    return np.sqrt(np.mean(residual**2, axis=0))


def codes(result):
    return {note.code for note in result.notes}


@pytest.mark.slow
def test_drifts_of_ten_minutes_are_found_to_a_fifth_and_leave_no_residual(tmp_path):
    """0.05 N/s of the vertical force, 1 N·m of the moment."""
    simulate_trial(tmp_path / "long.c3d", duration_s=600.0, plate_noise_n=1.1, seed=3)
    steady = pipeline.read_c3d(tmp_path / "long.c3d")
    size = np.array([0.0, 0.0, 30.0, 1.0, 0.0, 0.0])
    chain = chain_of(drifting(steady, line(*size / 600)))
    assert chain.zeros[0].drifts.tolist() == [*(size > 0)]
    np.testing.assert_allclose(chain.zeros[0].change[size > 0], size[size > 0], rtol=0.2)
    assert not chain.zeros[1].drifts.any()
    np.testing.assert_allclose(rms(chain.mended(["1: drift"])), rms(chain_of(steady)), rtol=0.05)


SLOW = st.floats(-60, 60)


@settings(max_examples=15)
@given(forces=st.tuples(SLOW, SLOW, SLOW), warming=SLOW, constant_s=st.floats(8, 60))
def test_whatever_slow_sum_drifts_the_zero_is_known_to_the_error_of_its_phases(
    walk, steady, forces, warming, constant_s
):
    def zero(time):
        warm = warming * (1 - np.exp(-time / constant_s))
        return np.column_stack([*np.outer(forces, time / 40), warm / 5, -warm / 9, warm / 30])

    found = zeros_of(drifting(walk, zero), HBM2, STILL)[0]
    times = np.linspace(steady.time[0], steady.time[-1], 50)
    # what is smaller than the least that is named stays a constant
    least = np.repeat([3.0, 0.75], 3)
    assert (np.abs(found.at(times) - steady.at(times) - zero(times)) < least).all()


@pytest.mark.parametrize("count", [12, 60, 300])
@pytest.mark.parametrize("alike", [0.0, 0.6])
def test_intervals_hold_drifts_and_steady_zeros_are_not_named_though_neighbours_err_alike(
    count, alike
):
    rng, time = np.random.default_rng(count), np.arange(float(count))
    noise = rng.normal(size=(150, count))
    for k in range(1, count):
        noise[:, k] += alike * noise[:, k - 1]
    found = [Course.through(time, each + 20 * time / (count - 1)) for each in noise]
    assert np.mean([abs(each.change - 20) < each.interval for each in found]) > 0.87
    assert np.mean([Course.through(time, each).sure for each in noise]) < 0.03


def test_vibration_in_step_with_gait_is_no_drift():
    time = np.arange(35.0)
    wobble = 1.5 * np.sin(2 * np.pi * time / 7) + np.random.default_rng(4).normal(0, 0.5, 35)
    course = Course.through(time, wobble)
    assert not course.sure


def test_steady_walks_are_as_they_were_and_say_nothing(chain):
    assert not any(zero.drifts.any() for zero in chain.zeros)
    assert find_faults(chain) == ()


def test_healthy_recordings_of_laboratories_show_no_drift(shared_data):
    for base in (*real(shared_data), legs_only(shared_data)):
        chain = base.chain()
        shown = [zero for zero in chain.zeros if zero is not None]
        assert not any(zero.drifts.any() for zero in shown), base.name
        assert "drift" not in {finding.kind for finding in find_faults(chain)}


def test_a_zero_that_is_wrong_and_steady_is_a_constant_as_before(walk, chain):
    wrong = drifting(walk, lambda t: np.tile([0, 0, 57.0, 0, 0, 0], (len(t), 1)))
    (finding,) = find_faults(chain.changed(recording=wrong))
    assert (finding.kind, finding.correction.mendings) == ("zero", ("1: zero Fz 56.9",))


def test_what_a_warning_advises_is_not_advised_again(tmp_path):
    """160 N in 13 s, of which the walk shows the second half: not one constant after the other."""
    simulate_trial(tmp_path / "walk.c3d", duration_s=13.0, seed=1)
    steady = pipeline.read_c3d(tmp_path / "walk.c3d")
    faulty = drifting(steady, line(0, 0, 160 / 13, 0, 0, 0))
    result = process_recording(faulty, PERSON, Settings())
    (note,) = (note for note in result.notes if note.code in ("plates_not_zeroed", "plate_drifts"))
    mendings = re.findall(r'--mend-plates "([^"]+)"', note.advice)
    assert (note.code, mendings) == ("plate_drifts", ["1: drift"])
    row = row_of(result.findings[0], faulty.plates, result.motion.time)
    assert row.what.startswith("plate 1: zero")
    assert "without load" in row.evidence
    assert re.fullmatch(r"Fz \+\d+\.\d ± [\d.]+ N", row.size)
    mended = process_recording(following(faulty, 1), PERSON, Settings())
    assert codes(mended).isdisjoint({"plates_not_zeroed", "plate_drifts"})
    assert "plate_zero_followed" in codes(mended)
    whole = process_recording(steady, PERSON, Settings())
    left, right = (np.nanstd(each.measured.residual[600:1250], axis=0) for each in (mended, whole))
    np.testing.assert_allclose(left, right, rtol=0.1)


def test_what_a_drift_explains_is_no_fault_of_mass_or_gain(shared_data):
    """A real walk whose residual My is small only as long as the drift cancels it."""
    base = next(real(shared_data))
    faulty = drifting(base.recording, line(0, 0, -160 / 13, 0, 0, 0))
    chain = Chain(Inputs(recording=faulty, **base.known), Settings())
    (found,) = find_faults(chain)
    assert (found.kind, found.plates, found.correction.helps) == ("drift", (1,), True)
    start_s, stop_s = found.span_s
    assert found.size[0] / (stop_s - start_s) == pytest.approx(-160 / 13, rel=0.02)
    told = {note.code for note in notes_of(chain, [found])}
    assert "plate_drifts" in told
    assert told.isdisjoint({"plates_unclear", "mass_differs", "mass_carried", "carried_in_part"})


def test_two_plates_that_drift_either_way_are_corrected_together(walk, chain):
    both = drifting(drifting(walk, line(0, 0, 1.0, 0, 0, 0)), line(0, 0, -0.7, 0, 0, 0), plate=1)
    faulty = chain.changed(recording=both)
    found = find_faults(faulty)
    assert [(each.kind, each.plates) for each in found] == [("drift", (1,)), ("drift", (2,))]
    for each in found:
        assert each.correction.helps
        assert each.correction.mendings == ("1: drift", "2: drift")
    assert find_faults(faulty.mended(found[0].correction.mendings)) == ()


def test_somebody_else_on_an_empty_plate_does_not_move_its_zero(walk, steady):
    def steps(time):
        return np.where((time > 20.0) & (time < 21.6), 300.0, 0.0)[:, None] * np.eye(6)[2]

    stepped = zeros_of(drifting(walk, steps), HBM2, STILL)[0]
    times = walk.plates[0].time
    assert np.abs(stepped.at(times) - steady.at(times)).max() < 0.5


def test_on_a_single_belt_drift_cannot_be_seen_and_that_is_said_where_it_is_stated(walk):
    left, right = walk.plates
    both = left.wrench + right.wrench
    corners = np.array([[0.9, 0.5, 0], [-0.9, 0.5, 0], [-0.9, -0.5, 0], [0.9, -0.5, 0]])
    belt = replace(
        left,
        center=np.zeros(3),
        corners=corners,
        wrench_in_plate=both @ np.kron(np.eye(2), left.rotation),
    )
    single = replace(walk, plates=(belt,))
    plain, stated = (
        process_recording(each, PERSON, Settings()) for each in (single, following(single, 1))
    )
    assert "plate_drift_unseen" not in codes(plain)
    assert "plate_drift_unseen" in codes(stated)
    assert_identical(replace(stated, notes=plain.notes), plain)


def test_a_calibration_pose_beside_the_plates_does_not_hinder(walk):
    beside = replace(walk, plates=(), options=ReadOptions(mend_plates=("1: drift",)))
    chain = chain_of(following(walk, 1), static=beside)
    assert "plate_zero_followed" in {note.code for note in chain.trial.notes}
    assert chain.standing.plates == ()


def test_in_real_time_a_zero_depends_on_no_later_sample(walk):
    faulty = following(drifting(walk, line(0, 0, 0.5, 0, 0, 0)), 1)
    frames, samples = slice(0, 2500), slice(0, 25000)
    markers = replace(
        walk.markers, time=walk.markers.time[frames], position=walk.markers.position[frames]
    )
    cut = [
        replace(p, time=p.time[samples], wrench_in_plate=p.wrench_in_plate[samples])
        for p in faulty.plates
    ]
    begun = replace(faulty, markers=markers, plates=tuple(cut))
    realtime = Settings(filter="realtime")
    whole, part = (Chain(Inputs(recording=r, subject=PERSON), realtime) for r in (faulty, begun))
    known = slice(0, 24900)
    np.testing.assert_allclose(
        part.trial.plates[0].wrench_in_plate[known], whole.trial.plates[0].wrench_in_plate[known]
    )
    after = whole.trial.plates[0].wrench_in_plate[30000:]
    truth = walk.plates[0].wrench_in_plate[30000:]
    assert np.abs(after - truth).max(axis=0)[2] < 4.0  # five seconds late, and noise


def test_on_a_platform_that_moves_it_is_seen_behind_the_platforms_inertia(study, laboratory):
    pitch = read_study_file(study, "sub01_pitch.c3d")
    chain = chain_of(pitch, laboratory)
    assert not any(zero.drifts.any() for zero in chain.zeros)
    faulty = chain.changed(recording=drifting(pitch, line(0, 0, 3.0, 0, 0, 0)))
    slope = faulty.zeros[0].change[2] / np.ptp(faulty.zeros[0].time)
    assert slope == pytest.approx(3.0, rel=0.2)
    np.testing.assert_allclose(rms(faulty.mended(["1: drift"])), rms(chain), rtol=0.05)


@pytest.mark.campaign
def test_plates_of_a_simulated_study_that_hardly_drift_are_hardly_ever_named(tmp_path):
    """27 trials that are level, sway or pitch: 0.3 N in a minute, behind vibration of the belts."""
    folder = simulate_study(tmp_path / "study", Setting(seed=5, protocol=DEMO), jobs=1)
    study = read_study(folder)
    laboratory = read_study_laboratory(study)
    chains = [trial_chain(study, name, laboratory) for name in study.trials]
    zeros = [zero for chain in chains for zero in chain.zeros]
    assert len(zeros) == 54
    assert None not in zeros
    assert sum(bool(zero.drifts.any()) for zero in zeros) <= 1


@pytest.mark.campaign
def test_drifts_of_ten_minutes_on_a_simulated_platform_are_those_that_it_has(tmp_path):
    """The plates' own, 0.3 N in a minute (SD) and a third of it in N·m, as they were drawn."""
    faults = Faults(accelerometers=AccelerometerFaults(error_scale=0))  # which drift as well
    protocol = DEMO.model_copy(update={"subjects": 1, "baseline_s": 600.0})
    setting = Setting(seed=6, faults=faults, protocol=protocol)
    study = read_study(simulate_study(tmp_path / "study", setting, jobs=1))
    chain = trial_chain(study, TrialName("sub01", "baseline", ""), read_study_laboratory(study))
    drawn = (plate.drift for plate in make_treadmill(faults, 6).plates)
    for zero, per_s, plate in zip(chain.zeros, drawn, chain.trial.plates, strict=True):
        in_plate = rotate_wrench(shift_wrench(per_s, plate.center), plate.rotation.T)
        wrong = np.abs(zero.change - np.ptp(zero.time) * in_plate)
        assert (wrong < zero.interval).all()
