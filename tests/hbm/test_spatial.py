"""Arrays that cannot be changed are shared; what can still be changed is copied."""

import numpy as np
import pytest

from hbm.spatial import frozen, read_only


def test_an_array_that_cannot_be_changed_is_not_copied():
    fixed = read_only(np.arange(6.0))
    assert read_only(fixed) is fixed
    assert np.shares_memory(read_only(fixed[::2]), fixed)


def test_a_read_only_view_of_an_array_that_can_be_changed_is_copied():
    values = np.arange(6.0)
    view = values.view()
    view.setflags(write=False)
    fixed = read_only(view)
    values[:] = -1
    np.testing.assert_array_equal(fixed, np.arange(6.0))


def test_a_part_of_an_array_that_nobody_else_holds_is_shared_once_it_is_frozen():
    values = frozen(np.arange(6.0).reshape(2, 3).T)
    assert np.shares_memory(read_only(values), values)
    assert np.shares_memory(read_only(values[1:]), values)
    with pytest.raises(ValueError, match="read-only"):
        values[0] = 0


@pytest.mark.parametrize("value", [[1, 2], np.array([1, 2]), np.array([True, False])])
def test_other_types_become_floats_that_cannot_be_changed(value):
    fixed = read_only(value)
    assert fixed.dtype == float
    with pytest.raises(ValueError, match="read-only"):
        fixed[0] = 0
