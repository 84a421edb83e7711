"""Figures of experiment 1 show the numbers that are in the recordings."""

import numpy as np
import pytest

from pipeline.config.plate_study import read_plates_study
from pipeline.plate_accuracy.figures import hammer_trace_figure, vibration_figure
from pipeline.plate_accuracy.trials import UNALIGNED, read_hammer_delay, read_weight
from pipeline.virtual_lab.protocol.known_weights import PlateErrors, simulate_plates


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plates")
    errors = PlateErrors(vibration_m=0.02, vibration_hz=3.0, delay_s=0.007)
    simulate_plates(
        folder,
        errors,
        speeds=(0.3,),
        weights=(22.56, 45.08),
        positions=(0.25,),
        profiles=("square",),
        belts=("left",),
    )
    return read_plates_study(folder)


@pytest.fixture(scope="module")
def trials(study):
    return [read_weight(study, weight, UNALIGNED) for weight in study.file.weights]


def amplitude(line, hz=3.0):
    """Of a sine in a line with gaps, in its unit."""
    time, value = line.get_data()
    seen = np.isfinite(value)
    turn = 2 * np.pi * hz * time[seen]
    columns = np.column_stack([np.cos(turn), np.sin(turn), np.ones(len(turn)), time[seen]])
    return np.hypot(*np.linalg.lstsq(columns, value[seen])[0][:2])


def test_the_vibration_is_seen_in_time_with_and_without_supports(trials):
    """20 mm without, a quarter of it with supports."""
    in_time, spectrum = vibration_figure(trials).axes
    assert sorted(map(amplitude, in_time.lines)) == pytest.approx([5.0, 20.0], rel=0.05)
    for line in spectrum.lines:
        hz, density = line.get_data()
        assert hz[np.argmax(density)] == pytest.approx(3.0, abs=0.2)


def test_the_two_instants_of_a_hit_are_as_far_apart_as_the_plate_is_late(study):
    _, trace = read_hammer_delay(study, study.file.hammer[0])
    marker_panel, force_panel = hammer_trace_figure({"left": trace}).axes
    for panel in (marker_panel, force_panel):
        marker, plate = (line.get_xdata()[0] for line in panel.lines[-2:])
        assert marker == 0
        assert plate == pytest.approx(7.0, abs=0.3)
    time, force = force_panel.lines[0].get_data()
    assert abs(time[np.argmax(force)] - plate) < 3.0  # the contact is 2 to 6 ms long
    samples, before, after = (line.get_data() for line in marker_panel.lines[:3])
    assert before[1][0] == pytest.approx(after[1][0], abs=1e-9)  # the paths meet
    for path, side in ((before, samples[0] < -10), (after, samples[0] > 10)):
        drawn = np.interp(samples[0][side], *(x[np.argsort(path[0])] for x in path))
        np.testing.assert_allclose(drawn, samples[1][side], atol=1.0)  # millimetres
