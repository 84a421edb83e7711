"""A plate's correction undoes its errors in any axes; every number of its file is checked."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensation import PlateCalibration, PlateCalibrations
from compensation.plate_calibration import from_json, to_json
from hbm.spatial import rotate_wrench, rotation_about, transform_wrench

RNG = np.random.default_rng(16)
RESPONSE = np.eye(6) + 0.03 * RNG.normal(size=(6, 6))
OFFSET = np.array([3.0, -2.0, 12.0, 0.5, -0.7, 0.2])
CENTER = np.array([0.1, 0.25, 0.0])
LOADS = RNG.normal(size=(50, 6)) * [50, 50, 700, 100, 100, 20]


def plate(number=1, **changes):
    own = {
        "plate": number,
        "matrix": np.linalg.inv(RESPONSE),
        "offset": OFFSET,
        "standard_error": np.full((6, 6), 1e-4),
        "center": CENTER,
        "examined": ("Fx", "Fz", "Mx", "My", "Mz"),
        "delay_s": 0.004,
    }
    return PlateCalibration(**own | changes)


def test_what_a_wrong_plate_measures_is_corrected_to_what_acted_on_it():
    measured = LOADS @ RESPONSE.T + OFFSET
    np.testing.assert_allclose(plate().correct(measured), LOADS, rtol=1e-11, atol=1e-9)


@given(
    angle=st.floats(-np.pi, np.pi),
    axis=st.sampled_from([(0, 0, 1.0), (1.0, 0, 0), (0, 0.6, 0.8)]),
    x=st.floats(-2, 2),
    y=st.floats(-2, 2),
)
def test_it_makes_no_difference_in_which_axes_and_about_which_point_a_file_holds_the_wrench(
    angle, axis, x, y
):
    rotation, origin = rotation_about(np.array(axis), angle), np.array([x, y, 0.0])
    in_lab = LOADS @ RESPONSE.T + OFFSET

    def in_plate(about_center):
        return rotate_wrench(transform_wrench(about_center, np.eye(3), CENTER - origin), rotation.T)

    corrected = plate().correct_in_plate(in_plate(in_lab), rotation, origin)
    np.testing.assert_allclose(corrected, in_plate(LOADS), rtol=1e-9, atol=1e-9)


def test_every_number_survives_the_round_trip():
    written = PlateCalibrations((plate(), plate(2, delay_s=None)), {"study": "Größe"})
    read = from_json(to_json(written))
    assert dict(read.provenance) == {"study": "Größe"}
    for one, other in zip(written.plates, read.plates, strict=True):
        for name in one.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"matrix": np.eye(5)}, r"plate 1: matrix .*shape \(6, 6\)"),
        ({"matrix": 1000 * np.eye(6)}, "matrix .*1e.03, .* 100 "),
        ({"matrix": np.diag([1, 1, 0, 1, 1, 1])}, "singular"),
        ({"delay_s": 4.0}, "delay_s .*±0.5 s, got 4.0"),
    ],
)
def test_a_correction_that_cannot_be_one_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        plate(**changes)


def spoilt(**changes):
    """The file with other values of its first plate."""
    document = json.loads(to_json(PlateCalibrations((plate(),), {"study": "plates"})))
    document["plates"][0] |= changes
    return json.dumps(document)


def with_document(**changes):
    return json.dumps(json.loads(spoilt()) | changes)


HUGE = 10**400


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (spoilt()[:100], "is not JSON"),
        (with_document(version=2), "version 2, .* 1"),
        (with_document(plates=[3]), "damaged"),
        (spoilt(offset=[None] * 6), "offset"),
        (spoilt(offset=[HUGE] * 6), "damaged"),
    ],
)
def test_a_damaged_file_gets_one_line(text, message):
    with pytest.raises(ValueError, match=message) as caught:
        from_json(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500
