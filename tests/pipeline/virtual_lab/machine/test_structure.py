"""The structure has the masses, frequencies and shapes that it states."""

import numpy as np
import pytest

from pipeline.virtual_lab.machine.platform import LEFT_ASSEMBLY, RIGHT_ASSEMBLY
from pipeline.virtual_lab.machine.structure import (
    ASSEMBLIES,
    COORDINATES,
    FRAME,
    STRUCTURE,
    frame_shape,
    make_structure,
    rigid_shape,
    state_matrix,
)

RIGID = np.vstack([np.eye(FRAME, 6), np.eye(6), np.eye(6)])
"""All parts move as one."""


def natural_modes(structure):
    """Frequencies in rising order [Hz] and damping ratios of its free vibration."""
    values = np.linalg.eigvals(state_matrix(structure))
    values = values[values.imag > 0]
    values = values[np.argsort(np.abs(values))]
    return np.abs(values) / (2 * np.pi), -values.real / np.abs(values)


def test_moving_as_one_it_has_the_mass_of_all_its_parts_and_strains_only_the_base():
    structure = make_structure()
    together = RIGID.T @ structure.mass @ RIGID
    np.testing.assert_allclose(
        together[:3, :3], (STRUCTURE.frame_mass + 300) * np.eye(3), atol=1e-9
    )
    lever = sum(a.mass * np.array(a.center) for a in (LEFT_ASSEMBLY, RIGHT_ASSEMBLY))
    assert together[1, 3] == pytest.approx(-lever[2] - STRUCTURE.frame_mass * -0.3)
    for by_displacement, by_velocity in structure.cells:
        assert np.abs(by_displacement @ RIGID).max() < 1e-6 * np.abs(by_displacement).max()
        assert np.abs(by_velocity @ RIGID).max() < 1e-6 * np.abs(by_velocity).max()


def test_cells_push_frame_and_assembly_apart_with_equal_and_opposite_wrenches():
    """A displacement of one assembly alone: what its cells do to it, the frame gets back."""
    structure = make_structure()
    for part, (by_displacement, _) in zip(ASSEMBLIES, structure.cells, strict=True):
        moved = np.zeros(COORDINATES)
        moved[part] = np.random.default_rng(0).normal(size=6) * 1e-4
        on_assembly = by_displacement @ moved
        on_frame = -(structure.stiffness @ moved)[:6]
        np.testing.assert_allclose(on_frame, -on_assembly, rtol=1e-9)


def test_natural_frequencies_are_those_of_the_base_then_the_frame_then_the_cells():
    hz, ratio = natural_modes(make_structure())
    assert len(hz) == COORDINATES
    sway, pitch = (STRUCTURE.base_frequency[k] for k in (1, 4))
    np.testing.assert_allclose(hz[:2], [sway, pitch], rtol=0.05)
    assert np.all((hz[2:6] > 25) & (hz[2:6] < 40))
    assert np.all(hz[6:] > 40)
    assert np.all((ratio > 0.01) & (ratio < 0.35))


@pytest.mark.parametrize("flexibility", [0.25, 4.0])
def test_frequencies_fall_with_the_root_of_flexibility_and_damping_ratios_stay(flexibility):
    hz, ratio = natural_modes(make_structure())
    softer_hz, softer_ratio = natural_modes(make_structure(flexibility=flexibility))
    np.testing.assert_allclose(softer_hz, hz / np.sqrt(flexibility), rtol=1e-6)
    np.testing.assert_allclose(softer_ratio, ratio, rtol=1e-6)


def test_the_rotation_of_a_place_of_the_frame_is_half_the_curl_of_its_displacement():
    place, step = np.array([0.7, -0.5, -0.2]), 1e-5
    gradient = [
        (frame_shape(place + step * e)[:3] - frame_shape(place - step * e)[:3]) / (2 * step)
        for e in np.eye(3)
    ]
    curl = np.array(
        [
            gradient[1][2] - gradient[2][1],
            gradient[2][0] - gradient[0][2],
            gradient[0][1] - gradient[1][0],
        ]
    )
    np.testing.assert_allclose(frame_shape(place)[3:], curl / 2, atol=1e-9)
    np.testing.assert_array_equal(frame_shape(np.zeros(3)), np.eye(6, FRAME))
    np.testing.assert_array_equal(frame_shape(place)[:, :6], rigid_shape(place))


def test_matrices_are_symmetric_and_no_motion_stores_or_returns_negative_energy():
    structure = make_structure()
    for matrix in (structure.mass, structure.damping, structure.stiffness):
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-9 * np.abs(matrix).max())
        assert np.linalg.eigvalsh(matrix).min() > 0


@pytest.mark.parametrize("axis", range(3))
def test_an_assembly_on_a_held_frame_has_the_stated_frequencies(axis):
    structure = make_structure()
    part = ASSEMBLIES[0]
    omega = np.sqrt(structure.stiffness[part, part][axis, axis] / LEFT_ASSEMBLY.mass)
    assert omega / (2 * np.pi) == pytest.approx(STRUCTURE.cell_frequency[axis])
