"""A body as text."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.coordinates import PARENT, SEGMENTS
from hbm.description import describe
from tests.hbm.people import person
from tests.synthetic import MASS_KG, synthetic_body


def row(text, start, nth=0):
    return [line for line in text.splitlines() if line.startswith(start)][nth].split()


def test_a_body_prints_as_the_first_line_of_its_description():
    body = synthetic_body()
    assert str(body).startswith("74.6 kg, 1.78 m, male; markers: 46 of Human Body Model 2")
    assert describe(body).splitlines()[0] == str(body)


def test_every_segment_and_every_joint_has_a_row():
    text = describe(synthetic_body())
    for s in SEGMENTS:
        assert row(text, s)
    joints = text[text.index("joint of") :]
    for s in PARENT:
        assert row(joints, s)


def test_numbers_are_the_body_s_own():
    body = synthetic_body()
    mass, length, *rest = row(describe(body), "right_thigh")[1:]
    thigh = body.segments["right_thigh"]
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
    assert "locked at neutral because no marker shows them: LShoulderAbduction" in text
