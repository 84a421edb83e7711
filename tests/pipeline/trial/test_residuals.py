"""Residuals have the signs, both RMS, thresholds and marker errors that are reported."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.poses import center_of_mass
from hbm.spatial import GRAVITY_MPS2
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import (
    cycle_residuals,
    marker_rows,
    reported,
    residual_table,
    threshold_rows,
)

SPANS = np.array([[6.0, 7.0], [7.0, 8.5]])


def with_residual(result, residual, spans=SPANS):
    """The trial with another residual, both variants, and other cycles of the right foot."""
    measured = replace(result.measured, residual=residual)
    return replace(result, variants={"measured": measured}, cycles={"right": spans})


def time_of(result):
    return result.motion.time


def test_reported_axes_are_forward_right_and_up():
    lab_axes = np.array([1.0, 2, 3, 4, 5, 6])
    assert reported(lab_axes).tolist() == [1, -2, 3, 4, -5, 6]
    np.testing.assert_array_equal(reported(reported(lab_axes)), lab_axes)


def test_rms_over_samples_and_over_cycles_are_equal_when_cycles_last_equally_long(processed):
    """A sine over whole periods: RMS = amplitude / √2 by either definition."""
    wave = np.sin(2 * np.pi * 2 * time_of(processed))
    residual = wave[:, None] * np.arange(1, 7)
    spans = np.array([[6.0, 7.0], [7.0, 8.0]])
    table = residual_table(with_residual(processed, residual, spans), "pitch")
    np.testing.assert_allclose(table["rms"], np.arange(1, 7) / np.sqrt(2), rtol=1e-3)
    np.testing.assert_allclose(table["rms_of_cycles"], np.arange(1, 7) / np.sqrt(2), rtol=1e-2)
    np.testing.assert_allclose(table["mean"], 0, atol=1e-3)
    np.testing.assert_allclose(table["peak"], np.arange(1, 7), rtol=0.01)


def test_a_long_cycle_has_more_weight_over_samples_but_not_over_cycles(processed):
    """1 N over 1 s and 3 N over 1.5 s: √(14.5/2.5) over samples, √((1 + 9)/2) over cycles."""
    size = np.where(time_of(processed) < 7.0, 1.0, 3.0)
    residual = np.tile(size[:, None], 6)
    table = residual_table(with_residual(processed, residual), "pitch")
    np.testing.assert_allclose(table["rms"], np.sqrt((1 + 9 * 1.5) / 2.5), rtol=1e-9)
    np.testing.assert_allclose(table["rms_of_cycles"], np.sqrt(5), rtol=0.02)
    assert (table["n_cycles"] == 2).all()
    np.testing.assert_allclose(table["rms"] ** 2, table["mean"] ** 2 + table["sd"] ** 2)


def test_only_samples_in_window_count_and_overlapping_cycles_count_them_once(processed):
    time = time_of(processed)
    residual = np.where((time >= 6.0) & (time < 8.0), 2.0, 1000.0)[:, None] * np.ones(6)
    result = with_residual(processed, residual)
    result = replace(
        result, cycles={"right": np.array([[6.0, 7.0]]), "left": np.array([[6.5, 8.0]])}
    )
    assert np.count_nonzero(result.counted) == 200
    np.testing.assert_allclose(residual_table(result, "pitch")["rms"], 2.0)


def test_percentages_are_of_body_weight_and_of_weight_times_stature(processed):
    table = residual_table(with_residual(processed, np.ones((len(time_of(processed)), 6))), "pitch")
    weight = processed.body.mass * GRAVITY_MPS2
    expected = [100 / weight] * 3 + [100 / weight / processed.body.height_m] * 3
    np.testing.assert_allclose(table["rms_percent"], expected, rtol=1e-12)


def masked(result, *, plates):
    """The trial with other frames in which the plates carry the subject."""
    return replace(result, quality=np.where(plates, 0, int(Quality.NOT_CARRIED)))


def test_frames_that_do_not_count_are_in_no_number(processed):
    """1 N where the plates carry the subject and 1000 N where they do not."""
    time = time_of(processed)
    carried = (time < 6.4) | (time >= 6.6)
    result = with_residual(processed, np.where(carried, 1.0, 1000.0)[:, None] * np.ones(6))
    table = residual_table(masked(result, plates=carried), "pitch")
    for column in ("rms", "rms_of_cycles", "peak"):
        np.testing.assert_allclose(table[column], 1.0, rtol=1e-9)
    np.testing.assert_allclose(table["valid_share"], 1 - 0.2 / 2.5, atol=0.002)
    limits = threshold_rows(masked(result, plates=carried))
    assert limits[0].peak == pytest.approx(np.sqrt(3))
    curves = cycle_residuals(masked(result, plates=carried), "measured")["right"]
    assert np.isnan(curves[0, 42:58]).all()
    assert np.isfinite(curves[0, :38]).all()
    assert np.isfinite(curves[1]).all()


def test_a_span_counts_in_place_of_gait_cycles(processed):
    time = time_of(processed)
    residual = np.where((time >= 7.0) & (time < 9.0), 2.0, 1000.0)[:, None] * np.ones(6)
    table = residual_table(replace(with_residual(processed, residual), span=(7.0, 9.0)), "pitch")
    np.testing.assert_allclose(table["rms"], 2.0)
    assert set(table["window"]) == {"span"}
    assert (table["n_cycles"] == 0).all()
    assert table["rms_of_cycles"].isna().all()


def test_curves_run_from_contact_to_contact_in_reported_axes(processed):
    ramp = np.tile(time_of(processed)[:, None], 6)
    curves = cycle_residuals(with_residual(processed, ramp), "measured")["right"]
    assert curves.shape == (2, 101, 6)
    np.testing.assert_allclose(curves[1, [0, 50, 100], 0], [7.0, 7.75, 8.5], atol=1e-9)
    np.testing.assert_allclose(curves[1, :, 1], -curves[1, :, 0])


def test_hicks_limits_are_shares_of_the_peak_force_and_of_the_height_of_the_centre_of_mass(
    processed,
):
    residual = np.tile([3.0, 4.0, 0, 0, 0, 2.0], (len(time_of(processed)), 1))
    result = with_residual(processed, residual)
    force, moment = threshold_rows(result)
    inside = result.counted
    ground = sum(result.ground["measured"].values())[inside, :3]
    peak = np.linalg.norm(ground, axis=1).max()
    above_belts = center_of_mass(result.body, result.motion.q[inside])[:, 2].mean()
    assert force.peak == pytest.approx(5.0)
    assert force.limit == pytest.approx(0.05 * peak)
    assert force.passed
    assert moment.peak == pytest.approx(2.0)
    height = moment.limit / (0.01 * peak)
    assert above_belts - 0.1 < height < above_belts  # the lowest joint of a foot is in the shoe
    worse = with_residual(processed, 100 * residual)
    assert not any(row.passed for row in threshold_rows(worse))


def test_hicks_limits_do_not_depend_on_where_the_laboratory_has_its_origin(processed):
    q = processed.motion.q + 2.0 * (np.arange(46) == 2)
    moved = replace(processed, motion=replace(processed.motion, q=q))
    limits, before = ([row.limit for row in threshold_rows(r)] for r in (moved, processed))
    np.testing.assert_allclose(limits, before, rtol=1e-9)


def test_marker_errors_leave_gaps_out_and_count_them(processed):
    motion = processed.motion
    error = np.full(motion.marker_error.shape, 0.003)
    error[:, 0] = 0.004
    error[: len(error) // 2, 0] = np.nan
    error[:, 1] = np.nan
    rows = marker_rows(replace(processed, motion=replace(motion, marker_error=error)))
    first, second, third, every = *rows[:3], rows[-1]
    assert (first.rms_mm, first.missing_percent) == pytest.approx((4.0, 50.0))
    assert np.isnan(second.rms_mm)
    assert second.missing_percent == 100.0
    assert (third.rms_mm, third.peak_mm) == pytest.approx((3.0, 3.0))
    others = len(motion.markers) - 2
    rms = np.sqrt((0.5 * 16 + others * 9) / (0.5 + others))
    assert (every.marker, every.rms_mm) == ("all", pytest.approx(rms))
