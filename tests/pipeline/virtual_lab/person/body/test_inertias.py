"""Segment inertias are those of two published tables, scaled to people."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import BodyFaults
from pipeline.virtual_lab.person.subject import PAIRED, Person, make_subject, table

SEXES = ("male", "female")
SOURCES = ("de_leva", "dumas")


@pytest.mark.parametrize("sex", SEXES)
@pytest.mark.parametrize("source", SOURCES)
def test_the_segments_make_a_whole_body(source, sex):
    total = sum(row.mass * (2 if name in PAIRED else 1) for name, row in table(source, sex).items())
    assert total == pytest.approx(1.0)


@pytest.mark.parametrize("sex", SEXES)
@pytest.mark.parametrize("source", SOURCES)
def test_every_tensor_is_one_that_a_rigid_body_can_have(source, sex):
    """Positive principal moments, none larger than the sum of the others."""
    for row in table(source, sex).values():
        low, middle, high = np.linalg.eigvalsh(row.tensor)
        assert low > 0
        assert high <= low + middle


def test_both_sides_mirror_each_other_before_they_vary():
    faults = BodyFaults(joint_scale=0, segment_scale=0, ankle_scale=0)
    parts = make_subject(Person(), faults=faults).skeleton.inertias
    for name in PAIRED:
        right, left = parts[f"right_{name}"], parts[f"left_{name}"]
        mirror = np.array([1.0, -1.0, 1.0])
        np.testing.assert_allclose(left.center * mirror, right.center, atol=1e-9)
        np.testing.assert_allclose(left.tensor * np.outer(mirror, mirror), right.tensor, atol=1e-9)
