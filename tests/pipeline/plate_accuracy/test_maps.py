"""Maps of errors over a plate and the tables of the laboratory's page show the numbers found."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.plate_accuracy.report import errors_table, place_errors, write_report
from pipeline.plate_accuracy.verdict import TOTAL, judge
from pipeline.report.laboratory import write_laboratory
from tests.pipeline.plate_accuracy.conftest import spoiled

PLACES = np.array([-0.6, 0.0, 0.5]), np.array([0.1, -0.1, 0.05])


@pytest.fixture(scope="module")
def strong(good_plate):
    """A plate that shows 10 % too much in the vertical."""
    return spoiled(good_plate, {(2, 2): 0.1}, mass_uncertainty_percent=0.05)


def test_a_gain_of_10_percent_is_10_percent_at_every_place_and_is_gone_after_correction(strong):
    (verdict,) = judge(strong)
    before, after = (
        place_errors(strong.responses["left"], *PLACES, 700.0, one)
        for one in (None, verdict.calibration)
    )
    np.testing.assert_allclose(before[:, 2], 70, rtol=0.02)
    np.testing.assert_allclose(before[:, 0], -PLACES[0] * (1 - 1 / 1.1), atol=0.002)
    assert np.abs(after[:, 2]).max() < 1
    assert np.abs(after[:, :2]).max() < 0.001


def test_a_shift_of_the_plate_is_the_same_shift_of_the_centre_of_pressure_everywhere(good_plate):
    response = good_plate.responses["left"]
    matrix = response.matrix.copy()
    matrix[:, 4, 2] -= 0.02  # My of a force that seems 20 mm farther forward
    shifted = place_errors(replace(response, matrix=matrix), *PLACES, 700.0, None)
    usual = place_errors(response, *PLACES, 700.0, None)
    np.testing.assert_allclose(shifted[:, 0] - usual[:, 0], 0.02, rtol=0.01)


def test_the_page_has_the_errors_before_and_after_correction_and_where_extrapolation_begins(
    strong, tmp_path
):
    part = write_report(strong, tmp_path)
    page = write_laboratory(tmp_path, part).read_text(encoding="utf-8")
    (verdict,) = judge(strong)
    totals = [one for one in verdict.judged if one.name.startswith(TOTAL)]
    rows = errors_table([verdict]).rows
    assert [row[2][0][1] for row in rows] == [one.texts[0] for one in totals]
    for one in (*totals, *verdict.corrected):
        assert one.texts[0] in page
    assert f"above {verdict.largest_n:.0f} N" in page
    assert (tmp_path / "figures" / "map_left.png").stat().st_size > 10_000
