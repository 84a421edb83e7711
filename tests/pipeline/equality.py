"""Whether two trial results are equal, all the way down."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np


def assert_identical(found, expected, where="result", lost=0.0):
    """Compare types, shapes, order of keys and every number; NaN equals NaN.

    Of arrays, that share of the peak of a column may be lost.
    """
    if isinstance(expected, np.ndarray):
        assert (found.dtype, found.shape) == (expected.dtype, expected.shape), where
        if found.dtype != float or not lost:
            np.testing.assert_array_equal(found, expected, err_msg=where)
            return
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected), err_msg=where)
        peaks = np.nan_to_num(np.abs(expected)).max(axis=0, initial=0.0)
        differences = np.nan_to_num(np.abs(found - expected))
        assert (differences <= lost * peaks).all(), (where, (differences / (peaks + 1e-300)).max())
    elif is_dataclass(expected):
        assert type(found) is type(expected), where
        for field in fields(expected):
            own = f"{where}.{field.name}"
            assert_identical(getattr(found, field.name), getattr(expected, field.name), own, lost)
    elif isinstance(expected, Mapping):
        assert list(found) == list(expected), where
        for key in expected:
            assert_identical(found[key], expected[key], f"{where}[{key!r}]", lost)
    elif isinstance(expected, tuple):
        assert len(found) == len(expected), where
        for k, (one, other) in enumerate(zip(found, expected, strict=True)):
            assert_identical(one, other, f"{where}[{k}]", lost)
    elif isinstance(expected, float) and np.isnan(expected):
        assert np.isnan(found), where
    else:
        assert found == expected, where
