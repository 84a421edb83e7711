"""Parts of the gait cycle that differ: exact p, and as many false alarms as stated."""

from itertools import product

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from pipeline.statistics.curves import curve_differences


def smooth(rng, subjects, sigma=6.0):
    """Noise over the gait cycle that varies as residuals do, of unit variance."""
    noise = gaussian_filter1d(rng.normal(size=(subjects, 141)), sigma, axis=1)[:, 20:121]
    return noise * np.sqrt(2 * np.sqrt(np.pi) * sigma)


def by_hand(differences):
    """p of every instant by the definition, one change of signs after the other."""
    count = len(differences)

    def t(values):
        return np.abs(values.mean(axis=0)) / values.std(axis=0, ddof=1) * np.sqrt(count)

    own = t(differences)
    reached = np.zeros(len(own))
    for signs in product((1, -1), repeat=count):
        reached += t(differences * np.array(signs)[:, None]).max() >= own - 1e-9
    return reached / 2**count


def test_p_is_the_share_of_changes_of_signs_that_reach_it():
    differences = smooth(np.random.default_rng(1), 7) + np.linspace(0, 3, 101)
    expected, found = by_hand(differences), curve_differences(differences)
    significant = np.flatnonzero(expected < 0.05)
    shown = np.concatenate([np.arange(part.start, part.stop + 1) for part in found])
    np.testing.assert_array_equal(shown, significant)
    for part in found:
        assert part.p == pytest.approx(expected[part.start : part.stop + 1].min())


@pytest.mark.campaign
def test_false_alarms_are_as_many_as_stated():
    """In 2,000 studies of eight people without a difference: 5 %, give or take 1 %."""
    rng = np.random.default_rng(2)
    alarms = sum(bool(curve_differences(smooth(rng, 8))) for _ in range(2000))
    assert 0.04 < alarms / 2000 < 0.06


def test_drawn_signs_agree_with_all_of_them(monkeypatch):
    differences = smooth(np.random.default_rng(3), 10) + 3 * np.sin(np.linspace(0, np.pi, 101))
    (exact,) = curve_differences(differences)
    monkeypatch.setattr("pipeline.statistics.curves.MAX_EXACT", 1)
    (drawn,) = curve_differences(differences)
    assert abs(drawn.start - exact.start) <= 2
    assert abs(drawn.stop - exact.stop) <= 2
    assert drawn.p == pytest.approx(exact.p, abs=0.005)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_scale_and_sign_of_the_differences_do_not_matter(scale):
    differences = smooth(np.random.default_rng(4), 8) + 1.0
    found = curve_differences(differences)
    assert found
    assert curve_differences(-scale * differences) == found


def test_few_subjects_and_unknown_instants_show_nothing():
    differences = np.ones((5, 101)) + 0.01 * np.random.default_rng(5).normal(size=(5, 101))
    assert curve_differences(differences) == ()
    many = np.vstack([differences, differences])
    many[3, 20:40] = np.nan
    assert [(part.start, part.stop) for part in curve_differences(many)] == [(0, 19), (40, 100)]


def test_it_agrees_with_statistical_parametric_mapping():
    """Random field theory (Pataky 2010, J Biomech 43:1976): the same parts to a few percent."""
    spm1d = pytest.importorskip("spm1d", reason="spm1d is not installed")
    differences = smooth(np.random.default_rng(6), 12) + 3 * np.sin(np.linspace(0, np.pi, 101))
    (part,) = curve_differences(differences)
    (cluster,) = spm1d.stats.ttest(differences).inference(0.05, two_tailed=True).clusters
    assert np.abs(np.array([part.start, part.stop]) - cluster.endpoints).max() <= 5
