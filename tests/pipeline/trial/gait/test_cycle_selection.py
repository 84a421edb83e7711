"""The gait cycles that count are the first fifty, or those that the platform perturbed."""

from pathlib import Path

import numpy as np
import pytest

from hbm.markers import Markers
from hbm.notes import Note
from pipeline.config.schema import Condition
from pipeline.io.recording import Analog, Recording
from pipeline.trial.gait.cycles import pulse_onsets, select_cycles

STRIDE_S = 1.1
ONSETS = (17.0, 75.3, 112.4)
NONE = np.empty(0)


def walking(duration_s, start_s=2.0):
    """Cycles of both sides in steady walking, the left half a stride later."""
    count = int((duration_s - start_s) / STRIDE_S) - 1
    right = start_s + STRIDE_S * np.arange(count)
    spans = np.column_stack([right, right + STRIDE_S])
    return {"right": spans, "left": spans + STRIDE_S / 2}


def recording_with(signal, rate_hz=1000.0):
    time = np.arange(len(signal)) / rate_hz
    frames = time[:: round(rate_hz / 100)]
    nobody = Markers(frames, (), np.empty((len(frames), 0, 3)))
    analog = Analog(time, ("Pulse",), ("V",), signal[:, None])
    return Recording(Path("walk.c3d"), nobody, analog=analog)


def pulses(onsets, *, rest=0.0, height=5.0, width_s=0.05, noise=0.02, duration_s=130.0):
    time = np.arange(round(duration_s * 1000)) / 1000
    signal = rest + np.random.default_rng(1).normal(0, noise, len(time))
    for onset in onsets:
        signal[(time >= onset) & (time < onset + width_s)] += height
    return signal


def test_fifty_cycles_of_the_right_foot_count_from_the_start_that_is_skipped():
    cycles = walking(120)
    chosen, notes = select_cycles(cycles, Condition(cycles=50, skip_s=10.0), NONE)
    assert list(chosen) == ["right"]
    expected = cycles["right"][cycles["right"][:, 0] >= 10.0][:50]
    np.testing.assert_array_equal(chosen["right"], expected)
    assert notes == ()


def test_cycles_of_the_left_foot_count_where_the_right_has_none():
    cycles = walking(60.0) | {"right": np.empty((0, 2))}
    selected, notes = select_cycles(cycles, Condition(cycles=10, skip_s=10.0), NONE)
    assert list(selected) == ["left"]
    np.testing.assert_array_equal(selected["left"], cycles["left"][cycles["left"][:, 0] >= 10][:10])
    assert notes == (Note.of("cycles_of_left"),)


def test_a_perturbation_counts_the_cycle_whose_contact_came_last_before_it():
    cycles = walking(130)
    right, left = cycles["right"][20, 0] + 0.1, cycles["left"][40, 0] + 0.1
    chosen, notes = select_cycles(
        cycles, Condition(perturbed=True, skip_s=4.0), np.array([2.5, right, left])
    )
    np.testing.assert_array_equal(chosen["right"], cycles["right"][20:21])
    np.testing.assert_array_equal(chosen["left"], cycles["left"][40:41])
    assert notes == ()


def test_the_first_twenty_perturbed_cycles_count_whatever_the_foot():
    cycles = walking(300)
    onsets = np.sort(np.concatenate([spans[5:60:4, 0] + 0.1 for spans in cycles.values()]))
    chosen, _ = select_cycles(cycles, Condition(perturbed=True, cycles=20), onsets)
    starts = np.sort(np.concatenate([spans[:, 0] for spans in chosen.values()]))
    np.testing.assert_allclose(starts, onsets[:20] - 0.1, atol=1e-12)


def test_two_perturbations_in_one_cycle_count_it_once():
    cycles = walking(60)
    onsets = cycles["right"][10, 0] + np.array([0.1, 0.2])
    chosen, _ = select_cycles(cycles, Condition(perturbed=True), onsets)
    assert sum(len(spans) for spans in chosen.values()) == 1


def test_a_perturbation_without_a_cycle_is_noted():
    condition = Condition(perturbed=True, cycles=2)
    _, notes = select_cycles(walking(60), condition, np.array([1.0, 20.0]))
    assert notes == (
        Note.of("perturbation_without_cycle", onsets=["1.00 s"]),
        Note.of("cycles_missing", found=1, wanted=2),
    )


@pytest.mark.parametrize(
    "shape",
    [
        {"rest": 2.5, "height": -2.5},
        {"width_s": 0.001, "noise": 0.0},
        {"width_s": 7.0, "noise": 0.05},
    ],
)
def test_pulse_onsets_are_exact_to_the_sample(shape):
    found = pulse_onsets(recording_with(pulses(ONSETS, **shape)), "Pulse")
    np.testing.assert_allclose(found, ONSETS, atol=1e-9)


def test_a_train_of_pulses_is_one_perturbation():
    train = [at + 0.3 * k for at in ONSETS for k in range(8)]
    found = pulse_onsets(recording_with(pulses(train)), "Pulse")
    np.testing.assert_allclose(found, ONSETS, atol=1e-9)


def test_a_channel_that_never_pulses_has_no_onset():
    assert not len(pulse_onsets(recording_with(pulses((), rest=1.0)), "Pulse"))
