"""Whether two trial results are equal to the last bit, all the way down."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np


def assert_identical(found, expected, where="result"):
    """Compare types, shapes, order of keys and every number; NaN equals NaN."""
    if isinstance(expected, np.ndarray):
        assert (found.dtype, found.shape) == (expected.dtype, expected.shape), where
        np.testing.assert_array_equal(found, expected, err_msg=where)
    elif is_dataclass(expected):
        assert type(found) is type(expected), where
        for field in fields(expected):
            own = f"{where}.{field.name}"
            assert_identical(getattr(found, field.name), getattr(expected, field.name), own)
    elif isinstance(expected, Mapping):
        assert list(found) == list(expected), where
        for key in expected:
            assert_identical(found[key], expected[key], f"{where}[{key!r}]")
    elif isinstance(expected, tuple):
        assert len(found) == len(expected), where
        for k, (one, other) in enumerate(zip(found, expected, strict=True)):
            assert_identical(one, other, f"{where}[{k}]")
    elif isinstance(expected, float) and np.isnan(expected):
        assert np.isnan(found), where
    else:
        assert found == expected, where
