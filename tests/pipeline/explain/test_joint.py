"""What trials share has one size: together they tell it as one long trial would."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.explain.budget import EstimatedCause, TrialEvidence
from pipeline.explain.joint import explain_together
from pipeline.explain.sizes import FAULT, Evidence, _faults, find_faults

B = 15
"""Coefficients of each axis."""
FAULTS = ("gain", "place", "body mass", "zero")
OTHERS = 8


def trial(rng, name, subject, sizes, told=3.0):
    """One trial: four faults of these sizes, causes of the subject and of the trial, and noise."""
    count = len(FAULTS) + OTHERS
    effects = rng.normal(size=(count, 6 * B))
    effects[: len(FAULTS)] *= told / 8
    every = np.concatenate([sizes, 0.5 * rng.normal(size=OTHERS)])
    of_subject = [f"{subject}: part {k}" for k in range(OTHERS // 2)]
    of_trial = [f"{name}: skin {k}" for k in range(OTHERS // 2)]
    names = (*FAULTS[:2], f"{subject}: {FAULTS[2]}", f"{name}: {FAULTS[3]}", *of_subject, *of_trial)
    half = OTHERS // 2
    return Evidence(
        values=every @ effects + rng.normal(size=6 * B),
        noise=np.full(6 * B, 0.5),
        axis=np.tile(np.arange(6), B),
        effects=effects,
        names=names,
        levels=(*[FAULT] * len(FAULTS), *["subject"] * half, *["trial"] * half),
        subject=subject,
    )


def said(evidence, first=None, second=None):
    """What a trial says, with no more than the tests need to know of its residuals."""
    count = len(evidence.names)
    units = np.ones(count)
    groups = ("gain", "place", "inertia", "zero", *["skin"] * OTHERS)
    causes = tuple(
        EstimatedCause(name.rpartition(": ")[2], group, "1", 0.0, 1.0, 1.0, 1.0, np.ones(6))
        for name, group in zip(evidence.names, groups, strict=True)
    )
    return TrialEvidence(
        *(evidence, first or evidence, second or evidence, causes),
        *(0.0 * units, units, 0.0 * units),
        mean_square=np.full(6, 100.0),
        frames=100,
        along=np.ones((count, 6)),
        square=np.ones((count, 6)),
    )


def test_sizes_integrated_out_trial_by_trial_are_those_integrated_out_at_once():
    """Oracle: one covariance of all coefficients of all trials, faults left out of it."""
    rng = np.random.default_rng(0)
    trials = [trial(rng, f"t{k}", f"s{k // 2}", np.zeros(4)) for k in range(5)]
    undescribed = [rng.uniform(0.5, 2, 6) for _ in trials]
    found, _ = _faults(trials, undescribed)

    names = list(dict.fromkeys(name for own in trials for name in own.names))
    effects = np.zeros((len(names), 5 * 6 * B))
    for k, own in enumerate(trials):
        rows = [names.index(name) for name in own.names]
        effects[rows, k * 6 * B : (k + 1) * 6 * B] = own.effects
    noise = [own.noise + square[own.axis] for own, square in zip(trials, undescribed, strict=True)]
    faults = [names.index(name) for name in found.names]
    others = np.delete(effects, faults, axis=0)
    weight = np.linalg.inv(others.T @ others + np.diag(np.concatenate(noise)))
    np.testing.assert_allclose(
        found.precision, effects[faults] @ weight @ effects[faults].T, rtol=1e-8, atol=1e-8
    )
    values = np.concatenate([own.values for own in trials])
    np.testing.assert_allclose(found.pull, effects[faults] @ weight @ values, rtol=1e-8, atol=1e-8)


def test_causes_that_only_one_trial_has_add_the_same_by_fewer_sizes():
    own = trial(np.random.default_rng(0), "t0", "s0", np.zeros(4))
    own = replace(own, effects=own.effects[:, :5])  # fewer coefficients than causes
    shared = [name for name in own.names if name.startswith("s0: part")]
    alone = [k for k, name in enumerate(own.names) if "skin" in name]
    own.effects[alone[1]] = own.effects[alone[0]]
    found = own.condensed(shared, "t0")
    assert found.names[:-3] == tuple(name for name in own.names if "skin" not in name)
    assert found.levels[-3:] == ("trial",) * 3  # of four causes, two add the same
    np.testing.assert_allclose(found.effects.T @ found.effects, own.effects.T @ own.effects)


def test_nine_trials_tell_what_they_share_three_times_as_well_as_one():
    rng = np.random.default_rng(1)
    trials = [trial(rng, f"t{k}", f"s{k}", np.array([6.0, 0, 0, 0])) for k in range(9)]
    alone = [find_faults([own]).if_there[1, 0] for own in trials]
    together = find_faults(trials)
    assert together.names[:2] == FAULTS[:2]
    assert np.sqrt(np.mean(np.square(alone))) / together.if_there[1, 0] == pytest.approx(3, abs=0.4)
    assert together.if_there[0, 0] == pytest.approx(6, abs=3 * together.if_there[1, 0])


def test_the_order_of_trials_changes_nothing_but_the_draws():
    rng = np.random.default_rng(2)
    sizes = np.array([4.0, 0, 3, 0])
    trials = [trial(rng, f"t{k}", f"s{k // 2}", sizes) for k in range(4)]
    one, other = find_faults(trials), find_faults(trials[::-1])
    place = [other.names.index(name) for name in one.names]
    np.testing.assert_allclose(one.size, other.size[place], atol=0.15)


@pytest.mark.parametrize("draws", [8, pytest.param(40, marks=pytest.mark.campaign)])
def test_intervals_of_shared_faults_hold_as_often_as_they_say(draws):
    """Faults of one to ten usual sizes, three trials of two subjects."""
    held, claimed = [], []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        size = rng.uniform(1, 10) * rng.choice([-1, 1])
        true = np.array([size, 0, 0, 0])
        trials = [trial(rng, f"t{k}", f"s{k // 2}", true, told=1.0) for k in range(3)]
        found = find_faults(trials)
        held.append(abs(found.if_there[0, 0] - size) < 1.96 * found.if_there[1, 0])
        claimed.append(found.chance[1:] > 0.95)
    assert np.mean(held) > 0.95 - 3 * np.sqrt(0.95 * 0.05 / draws)
    assert np.mean(claimed) < 0.02


def test_a_fault_of_one_subject_is_not_claimed_of_another():
    rng = np.random.default_rng(3)
    trials = [
        trial(rng, f"t{k}", f"s{k // 2}", np.array([0, 0, 8.0 * (k < 2), 0])) for k in range(4)
    ]
    found = explain_together({f"t{k}": said(own) for k, own in enumerate(trials)})
    mass = {own.name: own.cause for own in found if own.cause.name == "body mass"}
    assert mass["s0: body mass"].is_certain
    assert mass["s0: body mass"].size == pytest.approx(8, abs=1)
    assert not mass["s1: body mass"].is_certain


def test_a_fault_that_every_trial_has_holds_in_trials_in_which_it_was_not_found():
    rng = np.random.default_rng(4)
    trials = [trial(rng, f"t{k}", f"s{k}", np.array([6.0, 0, 0, 0])) for k in range(4)]
    found = explain_together({f"t{k}": said(own) for k, own in enumerate(trials)})
    gain = next(own for own in found if own.name == "gain")
    assert gain.trials == ("t0", "t1", "t2", "t3")
    assert gain.holds
    assert gain.held_out.min() > 0


def test_a_fault_that_one_half_of_a_trial_shows_alone_does_not_hold():
    rng = np.random.default_rng(5)
    with_fault = trial(rng, "t", "s", np.array([0, 0, 0, 8.0]))
    without = replace(with_fault, values=with_fault.values - 16 * with_fault.effects[3])
    (zero,) = (
        own
        for own in explain_together({"t": said(with_fault, with_fault, without)})
        if own.cause.name == "zero"
    )
    assert zero.cause.is_certain
    assert not zero.holds


def test_a_delay_that_bodies_show_is_surer_with_every_subject_but_not_with_every_trial():
    rng = np.random.default_rng(6)

    def late(own, seconds):
        found = said(own)
        found.found[1], found.mean[1], found.size[1] = 0.004, seconds, 0.004e-3
        return replace(found, whole=replace(own, levels=("fault", "laboratory", *own.levels[2:])))

    trials = {f"t{k}": late(trial(rng, f"t{k}", f"s{k // 2}", np.zeros(4)), 0.01) for k in range(8)}
    (found,) = (own for own in explain_together(trials) if own.name == "place")
    assert found.cause.size == pytest.approx(0.01)
    assert found.cause.deviation == pytest.approx(0.004 / np.sqrt(4))
