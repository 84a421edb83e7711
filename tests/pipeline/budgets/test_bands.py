"""Files, figure and viewer show residuals over time with how sure they are."""

import subprocess
import sys

import numpy as np
import pytest

from pipeline.budgets.explanation import read_bands, write_bands
from pipeline.explain.budget import Bands
from pipeline.figures.residuals import residual_figure
from pipeline.trial.residuals import AXES
from pipeline.viewer.trial import write_recording
from tests.pipeline.fake_results import fake_trial
from tests.pipeline.viewer.test_trial import Stored
from tests.pipeline.viewer_trial import viewer_trial


def bands_at(time):
    residual = np.sin(2 * np.pi * time)[:, None] * np.arange(1, 7)
    return Bands(time, (time - time[0]).astype(int), residual, np.full((len(time), 6), 0.5))


BANDS = bands_at(np.arange(300) / 100)


def test_bands_come_back_as_they_were_written(tmp_path):
    path = tmp_path / "walk_bands.parquet"
    write_bands(BANDS, path)
    found = read_bands(path)
    for name in ("time", "cycle", "residual", "deviation"):
        np.testing.assert_array_equal(getattr(found, name), getattr(BANDS, name))


def test_a_damaged_file_is_named(tmp_path):
    path = tmp_path / "walk_bands.parquet"
    path.write_bytes(b"not a table")
    with pytest.raises(ValueError, match=r"walk_bands.parquet"):
        read_bands(path)


def test_the_band_of_the_figure_is_the_interval_of_measurement_about_the_residual():
    trial = fake_trial(1, "baseline", cycles=4)
    bands = bands_at(trial.motion.time[50:250])
    panel = residual_figure(trial, bands).axes[2 + AXES.index("Fz")]
    (band,) = [drawn for drawn in panel.collections if "95 %" in str(drawn.get_label())]
    (curve,) = [line for line in panel.lines if line.get_label() == "compensated"]
    corners = np.concatenate([path.vertices for path in band.get_paths()])
    assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((0.5, 2.49))
    inside = np.isin(curve.get_xdata(), corners[:, 0])
    assert corners[:, 1].max() == pytest.approx(
        curve.get_ydata()[inside].max() + 1.96 * 0.5, rel=1e-3
    )


def test_the_viewer_has_the_ends_of_the_interval_where_a_trial_is_explained(tmp_path):
    trial = viewer_trial(200)
    shown = slice(50, 150)
    bands = bands_at(trial.motion.time[shown])
    write_recording(trial, tmp_path / "walk.rrd", bands=bands)
    stored = Stored(tmp_path / "walk.rrd")
    names = list(stored.rows("residual/Fz", "names", static=True)[0])
    assert names[-2:] == ["95 % low", "95 % high"]
    curves = np.stack(stored.rows("residual/Fz", "scalars"))
    np.testing.assert_allclose(curves[shown, -1], bands.residual[:, 2] + 1.96 * 0.5)
    assert np.isnan(curves[:50, -2:]).all()


def test_a_trial_is_explained_without_what_takes_long_to_load():
    code = "import sys, pipeline.budgets.explanation; assert 'pandas' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
