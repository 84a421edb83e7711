"""Soft tissue moves on springs as the equations of motion say, driven by the bones."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hbm.coordinates import INDEX
from hbm.spatial import GRAVITY_MPS2
from pipeline.explain.causes.body import oscillator_wrench, soft_tissue_causes
from tests.pipeline.explain.chains import chain_of

TIME = np.arange(400) / 100
SETTLED = slice(200, 350)
EVERYWHERE = np.eye(3)


def wobbling(acceleration, place=(0.0, 0.0, 0.0), along=EVERYWHERE, frequency_hz=5.0, damping=0.4):
    """The wrench of a kilogram on a spring, on a bone with an acceleration over time, (T, 3)."""
    pull = acceleration + np.array([0, 0, GRAVITY_MPS2])
    place = np.broadcast_to(place, (len(TIME), 3))
    return oscillator_wrench(frequency_hz, damping, TIME, place, pull, along)


def shaken(frequency_hz):
    """A vertical acceleration of 1 m/s²."""
    return np.sin(2 * np.pi * frequency_hz * TIME)[:, None] * [0, 0, 1.0]


@cache
def person(moves):
    """Someone who stands still, or moves up and down and swings a leg."""
    rise = 1 + moves * 0.02 * np.sin(4 * np.pi * TIME)
    swing = moves * 0.4 * np.sin(2 * np.pi * TIME)
    return chain_of(TIME, {"PelvisZ": rise, "RHipFlexion": swing})


@pytest.mark.parametrize(("frequency_hz", "zeta"), [(5.0, 0.4), (1.0, 0.8)])
def test_a_mass_on_a_spring_moves_as_an_independent_integration_of_its_equation(frequency_hz, zeta):
    omega = 2 * np.pi * frequency_hz

    def slope(t, state):
        drive = -np.sin(2 * np.pi * 2.0 * t)
        return [state[1], drive - 2 * zeta * omega * state[1] - omega**2 * state[0]]

    solved = solve_ivp(slope, (0, TIME[-1]), [0, 0], t_eval=TIME, rtol=1e-9, atol=1e-12)
    force = [slope(t, state)[1] for t, state in zip(TIME, solved.y.T, strict=True)]
    found = wobbling(shaken(2.0), frequency_hz=frequency_hz, damping=zeta)
    np.testing.assert_allclose(found[:, 2], force, atol=0.01)


def test_a_mass_moves_only_where_it_may():
    wrench = wobbling(shaken(2.0) + shaken(3.0)[:, ::-1], along=np.diag([1.0, 1.0, 0.0]))
    np.testing.assert_allclose(wrench[:, 2], 0, atol=1e-12)
    assert np.abs(wrench[SETTLED, 0]).max() > 0.1


def test_a_force_beside_the_origin_has_its_moment():
    wrench = wobbling(shaken(2.0), (0.5, 0.0, 1.0))
    np.testing.assert_allclose(wrench[:, 4], -0.5 * wrench[:, 2], atol=1e-12)


def test_gaps_of_the_motion_stay_finite():
    acceleration = shaken(2.0)
    acceleration[180:190] = np.nan
    wrench = wobbling(acceleration)
    assert np.isfinite(wrench[:180]).all()
    assert np.isfinite(wrench[190:, :3]).all()


def test_soft_tissue_of_a_person_at_rest_adds_nothing():
    chain = person(moves=False)
    for cause in soft_tissue_causes(chain):
        np.testing.assert_allclose(cause.effect(chain)[SETTLED], 0, atol=1e-4)


def test_effects_of_soft_tissue_add_up_exactly():
    chain = person(moves=True)
    changed, expected = chain, np.zeros_like(chain.residual)
    for k, cause in enumerate(soft_tissue_causes(chain)):
        changed = cause.change(changed, 0.1 * k)
        expected += 0.1 * k * cause.effect(chain)
    np.testing.assert_allclose(changed.residual - chain.residual, expected, atol=1e-9)


def test_tissue_of_all_segments_carries_the_mass_that_it_is_a_share_of():
    """At high frequency tissue stays behind: what it takes away is its mass times acceleration."""
    chain = person(moves=True)
    causes = {cause.name: cause for cause in soft_tissue_causes(chain)}
    effect = causes["soft tissue of trunk: mass of vertical motion"].effect(chain)
    trunk = sum(chain.body.segments[name].mass for name in ("mid_trunk", "thorax"))
    up = chain.filtered.acceleration[:, INDEX["PelvisZ"]]
    ratio = (effect[SETTLED, 2] @ up[SETTLED]) / (up[SETTLED] @ up[SETTLED])
    # the real part of ω² / (ω₀² - ω² + 2 i ζ ω₀ ω), with ω of 2 Hz, ω₀ of 4.5 Hz and ζ of 0.5
    response = 4 / (4.5**2 - 4 + 1j * 2 * 0.5 * 4.5 * 2)
    assert ratio == pytest.approx(-0.5 * trunk * response.real, rel=0.05)


def test_differences_of_frequency_are_the_slope_of_the_response():
    chain = person(moves=True)
    causes = {cause.name: cause for cause in soft_tissue_causes(chain)}
    mass, frequency = (
        causes[f"soft tissue of legs: {kind} of vertical motion"] for kind in ("mass", "frequency")
    )
    # far below the natural frequency the force falls with its square
    slope = (frequency.effect(chain)[SETTLED, 2] @ mass.effect(chain)[SETTLED, 2]) / (
        mass.effect(chain)[SETTLED, 2] @ mass.effect(chain)[SETTLED, 2]
    )
    assert slope == pytest.approx(-2, abs=0.2)
