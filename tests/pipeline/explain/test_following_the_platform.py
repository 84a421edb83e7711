"""Sizes of causes that follow a platform, where nothing describes how a person answers to it."""

import numpy as np
import pytest

from pipeline.explain.sizes import estimate_sizes

CYCLES, FREQUENCY = 30, np.repeat(np.arange(6), 2)[1:] / 1.1
TILT = np.sin(2 * np.pi * np.arange(CYCLES) / CYCLES)[:, None, None]


def trial(rng, size, response):
    """Residual and effects: one cause of the plates, one that follows a slow tilt, and a person."""
    cycle, tilted = rng.normal(0, 1, (2, len(FREQUENCY), 6))
    effects = np.stack([np.tile(cycle, (CYCLES, 1, 1)), TILT * tilted])
    missed, changed = rng.normal(0, 1, (2, len(FREQUENCY), 6))
    noise = rng.normal(0, 0.3, (CYCLES, len(FREQUENCY), 6))
    residual = np.tensordot(size, effects, 1) + missed + response * TILT * changed + noise
    return residual, effects


@pytest.mark.parametrize("response", [0.0, 0.5, 2.0])
def test_intervals_hold_however_much_a_person_changes_with_the_platform(response):
    rng = np.random.default_rng(4)
    prior, held = np.array([1.0, 1.0]), []
    for _ in range(60):
        size = rng.normal(0, prior)
        residual, effects = trial(rng, size, response)
        found = estimate_sizes(residual, effects, prior, FREQUENCY, np.array([False, True]))
        held.append(np.abs(found.size - size) < 1.96 * found.deviation)
    assert np.all(np.mean(held, axis=0) > 0.85)


def test_a_cause_that_follows_the_platform_is_seen_in_how_cycles_differ():
    rng = np.random.default_rng(5)
    residual, effects = trial(rng, np.array([0.0, 0.8]), 0.0)
    follows, repeats = (
        estimate_sizes(residual, effects, np.ones(2), FREQUENCY, np.array([False, moving]))
        for moving in (True, False)
    )
    assert abs(follows.size[1] - 0.8) < 0.1
    assert follows.deviation[1] < 0.1
    assert repeats.deviation[1] > 0.9


def test_one_cycle_alone_tells_of_its_mean():
    residual, effects = trial(np.random.default_rng(6), np.array([0.5, 0.5]), 0.0)
    follow = np.array([False, True])
    found = estimate_sizes(residual[:1], effects[:, :1], np.ones(2), FREQUENCY, follow)
    assert np.isfinite(found.size).all()
    assert found.deviation[1] == pytest.approx(1.0)
