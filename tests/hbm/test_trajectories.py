"""A marker that lacks one coordinate is a gap, and no caller can change its positions."""

import numpy as np
import pytest

from hbm.markers import Markers


def test_a_gap_in_one_direction_is_a_gap():
    position = np.zeros((2, 1, 3))
    position[1, 0, 2] = np.nan
    assert np.isnan(Markers([0.0, 0.1], ("A",), position).position[1]).all()


def test_markers_keep_a_read_only_copy():
    position = np.zeros((2, 1, 3))
    markers = Markers([0.0, 0.1], ("A",), position)
    position[:] = 9
    assert markers.position.max() == 0
    with pytest.raises(ValueError, match="read-only"):
        markers.position[:] = 1
    assert markers.rate_hz == pytest.approx(10)
