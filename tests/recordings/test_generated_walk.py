"""A walk generated from an OpenSim model gives its joint centres, masses and residuals."""

from xml.etree import ElementTree

import numpy as np
import pytest

from hbm.body import build_body
from hbm.calibration_pose.functional import functional_hips
from hbm.coordinates import MOVING
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.ik.tracking import solve_ik
from hbm.markers import marker_sets
from hbm.poses import segment_frames
from hbm.segments import SegmentOverride
from hbm.signals.filtering import butterworth
from hbm.signals.resampling import resample
from tests.recordings.recorded import MASS_KG, STATURE_M, generated, recorded

INNER = slice(20, -20)
PARTS = {
    "pelvis": ("pelvis",),
    "thigh": ("femur_r", "patella_r"),
    "shank": ("tibia_r",),
    "foot": ("talus_r", "calcn_r", "toes_r"),
    "upper_arm": ("humerus_r",),
    "forearm": ("ulna_r", "radius_r"),
    "hand": ("hand_r",),
}


@pytest.fixture(scope="module")
def trial(shared_data):
    return recorded(generated, shared_data)[0]


@pytest.fixture(scope="module")
def marker_set():
    return marker_sets()["rajagopal"]


@pytest.fixture(scope="module")
def hips(trial, marker_set):
    return functional_hips(trial.markers, marker_set)


def masses_of_model(folder):
    """Masses of the segments of the model that the walk was generated from [kg]."""
    root = ElementTree.parse(folder / "subject01.osim").getroot()
    mass = {
        b.get("name"): float(b.findtext("mass"))
        for b in root.iter("Body")
        if b.find("mass") is not None
    }
    return {s: sum(mass[name] for name in parts) for s, parts in PARTS.items()}


@pytest.fixture(scope="module")
def true_masses(shared_data):
    return masses_of_model(shared_data / "truth_walk")


def build(trial, marker_set, hips, **options):
    return build_body(
        trial.markers,
        mass=MASS_KG,
        sex="male",
        height_m=STATURE_M,
        marker_set=marker_set,
        hip=hips,
        **options,
    )


@pytest.fixture(scope="module")
def body(trial, marker_set, hips):
    return build(trial, marker_set, hips)


@pytest.fixture(scope="module")
def motion(body, trial):
    return solve_ik(body, trial.markers)


def at(trial, name):
    return trial.markers.position[:, trial.markers.names.index(name)]


def joint(body, motion, segment):
    return segment_frames(body, motion.q)[1][:, MOVING.index(segment)]


def rms(away):
    return np.sqrt((away**2).sum(axis=1).mean())


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize(
    ("segment", "center", "limit_m"), [("thigh", "HJC", 0.005), ("shank", "KJC", 0.012)]
)
def test_hips_and_knees_are_found(trial, body, motion, side, segment, center, limit_m):
    """Hips from the walk itself."""
    away = joint(body, motion, f"{side}_{segment}") - at(trial, side[0].upper() + center)
    assert rms(away) < limit_m


@pytest.mark.parametrize("side", ["right", "left"])
def test_ankles_are_where_the_malleoli_are(trial, body, motion, side):
    """In this model the malleolar markers' middle is 20 mm from the talus; 12 mm are impossible."""
    s = side[0].upper()
    middle = (at(trial, s + "LMAL") + at(trial, s + "MMAL")) / 2
    assert rms(joint(body, motion, f"{side}_foot") - middle) < 0.005
    assert rms(middle - at(trial, s + "AJC")) == pytest.approx(0.0205, abs=0.0005)


def residual_rms(body, motion, trial):
    wrenches = {
        foot: butterworth(
            resample(plate.time, plate.wrench, motion.time), motion.time, 6.0, "zero_phase"
        ).value
        for foot, plate in zip(("right_foot", "left_foot"), trial.plates, strict=True)
    }
    smooth = filter_motion(motion, cutoff=6.0, method="zero_phase")
    residual = inverse_dynamics(body, smooth, wrenches).residual[INNER]
    return np.sqrt(np.mean(residual**2, axis=0))


def test_with_de_leva_s_masses_residuals_stay_below_3_5_percent_of_body_weight(trial, body, motion):
    """The truth has 1 N; what remains here is its other masses, ankles and unseen head."""
    assert motion.converged.all()
    assert np.sqrt(np.mean(motion.marker_error**2)) < 0.002
    ours = residual_rms(body, motion, trial)
    assert (ours[:3] < 0.035 * MASS_KG * 9.81).all()
    assert (ours[3:] < 12).all()


def test_the_true_masses_halve_what_de_leva_s_leave(
    trial, marker_set, hips, motion, body, true_masses
):
    """So the largest part of the residual is anthropometry, not mechanics."""
    overrides = {"pelvis": SegmentOverride(true_masses["pelvis"])}
    for part in list(PARTS)[1:]:
        for side in ("right", "left"):
            overrides[f"{side}_{part}"] = SegmentOverride(true_masses[part])
    better = build(trial, marker_set, hips, overrides=overrides)
    before, after = (residual_rms(b, motion, trial) for b in (body, better))
    assert after[0] < 0.6 * before[0]
    assert after[4] < 0.6 * before[4]
    assert (after < 1.05 * before).all()
