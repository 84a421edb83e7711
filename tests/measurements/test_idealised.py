"""With perfect instruments residuals vanish, and artefacts are those of rigid-body mechanics."""

from functools import cache

import numpy as np
import pytest

from hbm.coordinates import COORDINATES, N_Q
from hbm.ik.tracking import solve_ik
from hbm.spatial import GRAVITY_MPS2
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    ANALOG_HZ,
    SAMPLES_PER_FRAME,
    make_treadmill,
)
from pipeline.virtual_lab.machine.platform import BELT_ASSEMBLIES
from pipeline.virtual_lab.protocol.walking_protocol import MOTION, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_calibration, run_trial, study_subject
from tests.pipeline.virtual_lab.conftest import SHORT
from tests.validation.ablation import Case, fit_models, residual_of
from tests.validation.true_body import true_body

CONDITIONS = ("baseline", "sway", "pitch")
TRANSPARENT_HZ = 30.0
TOES = {"LToeFlexion", "RToeFlexion"}
FORWARD, LEFTWARD, UP, ROLL, PITCHING, YAW = range(6)


def rms(values):
    return np.sqrt(np.nanmean(values**2, axis=0))


def steady(motion):
    """Frames of walking at full belt speed."""
    time = motion.time[::SAMPLES_PER_FRAME]
    return (time > SHORT.steady_s + 1) & (time < time[-1] - 1)


def perturbed(walk, motion):
    """Frames of the gait cycles that contain a perturbation."""
    time, stride = motion.time[::SAMPLES_PER_FRAME], 2 * walk.placement.step_s
    since = time[:, None] - motion.onsets + MOTION.onset * stride
    return ((since >= 0) & (since < stride)).any(axis=1)


def counted(walk, motion):
    return perturbed(walk, motion) if len(motion.onsets) else steady(motion)


@pytest.fixture(scope="module")
def left_over(perfect):
    """Give a function of condition, and of what its case states: the residual that is left."""

    @cache
    def residual(condition, **case):
        trial, treadmill = perfect(condition)
        rng = np.random.default_rng(0)
        return residual_of(Case(**case), trial.walk, trial.motion, treadmill, rng)

    return residual


@pytest.mark.parametrize("condition", CONDITIONS)
def test_perfect_instruments_and_the_true_body_leave_no_residual(perfect, left_over, condition):
    """The equations of motion hold to half a newton; the rest is filter and interpolation."""
    walking = steady(perfect(condition)[0].motion)
    assert (rms(left_over(condition, cutoff_hz=TRANSPARENT_HZ)[walking]) < 0.5).all()


@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_filter_at_6_hz_leaves_newtons_because_it_does_not_commute_with_the_dynamics(
    perfect, left_over, condition
):
    """Coordinates and forces are filtered alike, but forces are no linear function of coordinates:
    what 6 Hz leaves with perfect instruments is due to the filter, and vanishes as the cut-off
    frequency rises."""
    walking = steady(perfect(condition)[0].motion)
    low, high = (rms(left_over(condition, cutoff_hz=hz)[walking]) for hz in (6.0, TRANSPARENT_HZ))
    assert (low > 5 * high).all()
    assert (low[:3] < 8).all()
    assert (low[3:] < 4).all()


@pytest.mark.parametrize(("marker_set", "unseen"), [("hbm2", TOES), ("hbm1", set())])
def test_inverse_kinematics_finds_the_true_coordinates(marker_set, unseen):
    """All 46 with HBM1; HBM2 has no marker on the toes, whose flexion is not observed."""
    protocol = SHORT.model_copy(update={"marker_set": marker_set, "pitch_s": 8.0})
    setting = Setting(protocol=protocol, faults=Faults.none())
    treadmill = make_treadmill(setting.faults, setting.seed)
    trial = run_trial(setting, treadmill, study_subject(setting, 2), 2, "pitch")
    markers = trial.recording.markers
    motion = solve_ik(true_body(trial.walk.subject), markers)
    seen = motion.observed.all(axis=0)
    assert {name for name, visible in zip(COORDINATES, seen, strict=True) if not visible} == unseen
    np.testing.assert_allclose(
        motion.q[:, seen], trial.walk.motion.at(markers.time)[:, :N_Q][:, seen], atol=1e-6
    )


def test_pitch_without_compensation_leaves_the_weight_of_the_belt_assemblies(perfect, left_over):
    """Fx = M g sin φ: plates that are tilted carry part of the assemblies' weight as shear."""
    trial, _ = perfect("pitch")
    mass = sum(part.mass for part in BELT_ASSEMBLIES)
    assert mass == 300.0
    expected = (
        mass * GRAVITY_MPS2 * rms(np.sin(pitch_angle(np.linspace(0, MOTION.pitch_period, 1000))))
    )
    assert expected == pytest.approx(330, rel=0.15)
    since = trial.motion.time[::SAMPLES_PER_FRAME][steady(trial.motion)] - SHORT.steady_s
    expected = mass * GRAVITY_MPS2 * rms(np.sin(pitch_angle(since)))
    found = rms(left_over("pitch", removal="none")[steady(trial.motion)])
    assert found[FORWARD] == pytest.approx(expected, rel=0.1)


def pitch_angle(since):
    return np.radians(MOTION.pitch) * np.sin(2 * np.pi * since / MOTION.pitch_period)


def test_pitch_without_compensation_leaves_the_moment_of_that_weight(perfect, left_over):
    """About mid-hip: My = Fx z, z above the assemblies' centre, and the lever of their weight."""
    trial, treadmill = perfect("pitch")
    masses = np.array([part.mass for part in BELT_ASSEMBLIES])
    center = masses @ [part.center for part in BELT_ASSEMBLIES] / masses.sum()
    hip = trial.walk.motion.at(trial.motion.time[::SAMPLES_PER_FRAME])[:, :3]
    pivot = np.array(treadmill.machine.pivot_m)
    angle = trial.motion.platform.pitch[0][::SAMPLES_PER_FRAME]
    sine, cosine = np.sin(angle), np.cos(angle)
    away = center - pivot
    lever_x = pivot[0] + away[0] * cosine + away[2] * sine - hip[:, 0]
    lever_z = pivot[2] + away[2] * cosine - away[0] * sine - hip[:, 2]
    weight = masses.sum() * GRAVITY_MPS2
    force_x, force_z = -weight * sine, weight * (1 - cosine)
    expected = lever_z * force_x - lever_x * force_z
    found = left_over("pitch", removal="none")
    inside = steady(trial.motion)
    assert rms(found[inside, PITCHING]) == pytest.approx(rms(expected[inside]), rel=0.1)
    assert np.corrcoef(found[inside, PITCHING], expected[inside])[0, 1] ** 2 > 0.99


def test_sway_without_compensation_leaves_mass_times_acceleration(perfect, left_over):
    """Fy = M ÿ after a 6 Hz filter, from the command and the actuator's bandwidth alone."""
    trial, treadmill = perfect("sway")
    mass = sum(part.mass for part in BELT_ASSEMBLIES)
    push = mass * pulse_acceleration(
        treadmill.machine.sway_hz, trial.motion.time, trial.motion.onsets
    )
    inside = perturbed(trial.walk, trial.motion)
    expected = rms(push[::SAMPLES_PER_FRAME][inside])
    found = rms(left_over("sway", removal="none")[inside])
    assert found[LEFTWARD] == pytest.approx(expected, rel=0.1)
    hip = trial.walk.motion.at(trial.motion.time[::SAMPLES_PER_FRAME][inside])[:, 2].mean()
    depth = np.mean([part.center[2] for part in BELT_ASSEMBLIES])
    assert found[ROLL] == pytest.approx(expected * (hip - depth), rel=0.1)


def pulse_acceleration(bandwidth_hz, time, onsets):
    """The acceleration of 5 cm at 0.3 m/s after a critically damped actuator and a 6 Hz filter.

    Both are written out as spectra: ``ω²/(iω' + ω)²`` and ``1/(1 + (f/c)⁴)``, whose cut-off for two
    passes of the second order is where the amplitude has fallen to 1/√2.
    """
    speed = sum(
        MOTION.sway_speed * ((time >= onset) & (time < onset + 0.05 / MOTION.sway_speed))
        for onset in onsets
    )
    f = np.fft.rfftfreq(len(time), 1 / ANALOG_HZ)
    actuator = 1 / (1 + 1j * f / bandwidth_hz) ** 2
    cutoff = 6.0 / (np.sqrt(2) - 1) ** 0.25
    smoothing = 1 / (1 + (f / cutoff) ** 4)
    return np.fft.irfft(2j * np.pi * f * actuator * smoothing * np.fft.rfft(speed), len(time))


@pytest.fixture(scope="module")
def rms_residual(walked):
    """Give a function of condition and removal: RMS residuals in a laboratory with all faults.

    But that plates and accelerometers are equally late: this processing estimates no delays.
    """
    faults = Faults()
    late = {"delay_s": faults.plates.delay_s}
    plates = faults.plates.model_copy(update={"right_later_s": 0.0})
    together = faults.accelerometers.model_copy(update=late)
    faults = faults.model_copy(update={"plates": plates, "accelerometers": together})
    setting = Setting(protocol=SHORT, faults=faults)
    treadmill = make_treadmill(setting.faults, setting.seed)
    models = fit_models(treadmill, run_calibration(setting, treadmill))

    @cache
    def left(condition, removal):
        walk, motion = walked(3, condition)
        case = Case(setting.faults, body_from_markers=True, removal=removal)
        found = residual_of(case, walk, motion, treadmill, np.random.default_rng(0), models)
        return rms(found[counted(walk, motion)])

    return left


@pytest.mark.slow
@pytest.mark.parametrize("condition", ["sway", "pitch"])
def test_compensation_leaves_what_is_left_where_the_treadmills_own_wrench_is_known(
    rms_residual, condition
):
    """With all faults of instruments, skin and body, which alone leave more than at baseline.

    The calibration also takes the plates' zero away, which the known wrench does not hold.
    """
    known, before = rms_residual(condition, "known"), rms_residual(condition, "none")
    after = rms_residual(condition, "calibrated")
    worst = np.argmax(before)
    assert before[worst] > 10 * known[worst]
    assert after[worst] < before[worst] / 10
    assert (after < 1.1 * known + [1.5, 1.5, 1.5, 0.5, 0.5, 0.5]).all()


@pytest.mark.slow
def test_residuals_of_nine_subjects_differ_plausibly_between_them(walked):
    """In one laboratory the coefficient of variation between subjects is some tens of per cent."""
    treadmill = make_treadmill(Faults(), 1)
    case = Case(Faults(), body_from_markers=True)
    found = []
    for subject in range(9):
        walk, motion = walked(subject)
        rng = np.random.default_rng((1, subject))
        left = residual_of(case, walk, motion, treadmill, rng)
        found.append(rms(left[900:-100]))
    spread = np.std(found, axis=0, ddof=1) / np.mean(found, axis=0)
    assert (spread > 0.08).all()
    assert (spread < 0.7).all()
    force, moment = np.mean(found, axis=0)[:3], np.mean(found, axis=0)[3:]
    weight = 74.6 * GRAVITY_MPS2
    assert (force < 0.05 * weight).all()  # Hicks et al. 2015: what good residuals are below
    assert (force > 3).all()
    assert (moment > 1).all()
