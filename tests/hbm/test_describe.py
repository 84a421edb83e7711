"""A body in words."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.coordinates import SEGMENTS, SEGMENTS_WITH_MASS
from hbm.describe import changed_distances, describe, implausible
from hbm.markers import Markers
from tests.hbm.motions import markers_of, swinging, with_noise, without
from tests.hbm.people import person
from tests.synthetic import MASS_KG, T_POSE_MM, synthetic_body


@pytest.fixture(scope="module")
def walk():
    exact = markers_of(synthetic_body(), swinging(np.random.default_rng(30), frames=100))
    return with_noise(exact, np.random.default_rng(31), 0.004)


def row(text, start, nth=0):
    return [line for line in text.splitlines() if line.startswith(start)][nth].split()


def test_a_body_prints_itself():
    assert str(synthetic_body()) == describe(synthetic_body())


def test_every_moving_segment_and_every_joint_has_a_row():
    text = describe(synthetic_body())
    for s in SEGMENTS_WITH_MASS:
        assert row(text, s)
    joints = text[text.index("joint of") :]
    for s in SEGMENTS[1:]:
        assert row(joints, s)


def test_numbers_are_the_body_s_own():
    body = synthetic_body()
    mass, length, *rest = row(describe(body), "right_thigh")[1:]
    thigh = body.inertias["right_thigh"]
    assert float(mass) == pytest.approx(thigh.mass, abs=0.005)
    assert float(length) == pytest.approx(body.lengths["right_thigh"], abs=0.0005)
    np.testing.assert_allclose([float(x) for x in rest[:3]], 1000 * thigh.center, atol=0.51)
    moments = np.linalg.eigvalsh(thigh.tensor)
    np.testing.assert_allclose([float(x) for x in rest[3:]], moments, atol=5e-5)
    knee = row(describe(body), "right_shank", 1)
    np.testing.assert_allclose(
        [float(x) for x in knee[2:5]], 1000 * body.offsets["right_shank"], atol=0.51
    )


def test_a_description_ends_with_notes_and_locked_coordinates():
    text = describe(build_body(person("LLEE"), mass=MASS_KG))
    assert "the joints of the left arm need LLEE" in text
    assert "locked at neutral, for no marker shows them: LShoulderAbduction" in text


def test_a_plausible_body_raises_no_warning(walk):
    assert implausible(synthetic_body(), carried_kg=MASS_KG * 1.02) == ()
    assert changed_distances(synthetic_body(), walk) == ()


def test_legs_of_different_length_are_noticed():
    short = {
        n: (*T_POSE_MM[n][:2], T_POSE_MM[n][2] + 40) for n in ("LLM", "LMM", "LHEE", "LMT2", "LMT5")
    }
    body = build_body(person(**short), mass=MASS_KG)
    (note,) = implausible(body)
    assert (note.code, note.level) == ("legs_differ", "warning")
    assert str(note) in describe(body)


def test_a_mass_that_the_plates_contradict_is_noticed():
    (note,) = implausible(synthetic_body(), carried_kg=80.0)
    assert note.level == "warning"
    assert "74.6 kg differs by -7 % from the 80.0 kg that the plates carry" in note.text


def test_a_marker_that_moved_is_noticed(walk):
    position = walk.position.copy()
    position[:, walk.names.index("RLTHI"), 2] += 0.08
    (note,) = changed_distances(synthetic_body(), Markers(walk.time, walk.names, position))
    assert (note.code, note.level) == ("marker_distances_changed", "warning")
    assert note.values["segment"] == "right_thigh"
    assert all("RLTHI" in pair for pair in note.values["largest_m"])


def test_two_swapped_markers_are_noticed(walk):
    names = list(walk.names)
    a, b = names.index("LLEK"), names.index("LLTHI")
    names[a], names[b] = names[b], names[a]
    notes = changed_distances(synthetic_body(), Markers(walk.time, tuple(names), walk.position))
    assert any(note.values["segment"] == "left_thigh" for note in notes)


def test_gaps_do_not_count_as_changes(walk):
    gone = without(without(walk, ["RLTHI"]), ["LLTHI"], slice(0, 60))
    assert changed_distances(synthetic_body(), gone) == ()
