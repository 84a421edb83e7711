"""End points of trunk and head on recordings of others agree with those of the body."""

from xml.etree import ElementTree

import numpy as np
import pytest

from hbm.body import build_body
from hbm.calibration_pose.functional import functional_hips
from hbm.coordinates import FIXED_TO, MOVING
from hbm.ik.tracking import solve_ik
from hbm.markers import marker_sets
from hbm.poses import segment_frames
from hbm.segments import NO_INERTIA, Inertia
from pipeline.config.schema import Settings, Subject
from pipeline.trial.process import process_recording
from tests.recordings.recorded import (
    MASS_KG,
    STATURE_M,
    TESTS,
    generated,
    marker_set,
    recorded,
    standing,
    steps,
)


@pytest.mark.parametrize(
    ("read", "table", "names"),
    [
        (standing, "quiet_standing", ("LMAS", "RMAS")),
        (steps, "plug_in_gait", ("LFHD", "RFHD", "LBHD", "RBHD")),
    ],
)
def test_the_head_s_centre_is_near_the_mastoids_and_the_middle_of_the_head_band(
    shared_data, read, table, names
):
    """It was 7 cm behind both while the head ended at the marker on C7."""
    recording, known = recorded(read, shared_data)
    chosen = marker_set(TESTS / "recordings" / f"{table}.toml")
    pose = known.get("static", recording).markers
    body = build_body(pose, mass=80.0, marker_set=chosen)
    own = [body.marker_position[body.markers.index(name), 0] for name in names]
    assert 0 < np.mean(own) - body.segments["head"].center[0] < 0.04


def test_standing_still_the_centre_of_mass_is_nearly_above_the_centre_of_pressure(shared_data):
    """It was 8 mm behind, 6.8 N·m, with the ends of version 0.2."""
    chosen = marker_set(TESTS / "recordings" / "quiet_standing.toml")
    recording, _ = recorded(standing, shared_data)
    result = process_recording(recording, Subject(), Settings(), marker_set=chosen)
    assert abs(np.nanmean(result.measured.residual[50:-50, 4])) < 5


def turned(part, rotation, origin):
    """Inertia in lab axes."""
    return Inertia(part.mass, rotation @ part.center + origin, rotation @ part.tensor @ rotation.T)


def registered(local, lab):
    """Rotation and origin that bring points to their lab positions (Kabsch 1976)."""
    a, b = local.mean(axis=0), lab.mean(axis=0)
    u, _, v = np.linalg.svd((local - a).T @ (lab - b))
    rotation = v.T @ np.diag([1, 1, np.linalg.det(v.T @ u.T)]) @ u.T
    return rotation, b - rotation @ a


def numbers(element, key):
    return np.array([float(x) for x in element.findtext(key).split()])


def test_the_generated_walk_s_trunk_is_near_that_of_the_model_that_made_it(shared_data):
    """Pelvis, trunk and head about mid-hip; the rest is that model's other masses.

    With the midpoints of version 0.2 the centre was 47 mm too low, the moment of inertia 2.4 kg·m²
    too small.
    """
    walk, _ = recorded(generated, shared_data)
    chosen, markers = marker_sets()["rajagopal"], walk.markers
    hips = functional_hips(markers, chosen)
    body = build_body(
        markers, mass=MASS_KG, sex="male", height_m=STATURE_M, marker_set=chosen, hip=hips
    )
    frame = len(markers.time) // 2
    measured = dict(zip(markers.names, markers.position[frame], strict=True))
    root, truth = ElementTree.parse(shared_data / "truth_walk" / "subject01.osim"), NO_INERTIA
    for name in ("pelvis", "torso"):
        place = {
            m.get("name"): numbers(m, "location")
            for m in root.iter("Marker")
            if (m.findtext("socket_parent_frame") or "").endswith("/" + name)
        }
        shown = [n for n in place if n in measured and np.isfinite(measured[n]).all()]
        part = next(b for b in root.iter("Body") if b.get("name") == name)
        pose = registered(*(np.array([of[n] for n in shown]) for of in (place, measured)))
        tensor = np.diag(numbers(part, "inertia")[:3])
        own = Inertia(float(part.findtext("mass")), numbers(part, "mass_center"), tensor)
        truth += turned(own, *pose)
    rotation, origin = segment_frames(body, solve_ik(body, markers).q[frame : frame + 1])
    ours = NO_INERTIA
    for name in ("pelvis", "mid_trunk", "thorax", "head"):
        i = MOVING.index(FIXED_TO.get(name, name))
        ours += turned(body.segments[name], rotation[0, i], origin[0, i])
    mid_hip = np.mean([measured[name] for name in ("RHJC", "LHJC")], axis=0)
    truth, ours = (part.in_frame(np.eye(3), mid_hip) for part in (truth, ours))
    assert 0 < truth.center[2] - ours.center[2] < 0.04
    assert abs(truth.center[0] - ours.center[0]) < 0.02
    pitch = [p.tensor[1, 1] + p.mass * (p.center[0] ** 2 + p.center[2] ** 2) for p in (ours, truth)]
    assert 0.75 * pitch[1] < pitch[0] < pitch[1]
