"""What raw samples of plates show is named before motion and feet judge them."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.notes import warnings_of
from hbm.spatial import WRENCH_COMPONENTS
from pipeline.config.schema import Settings, Subject
from pipeline.io.mended_plates import mended_plates, with_mended_plates
from pipeline.io.read_options import ReadOptions
from pipeline.trial.findings.raw import raw_faults
from pipeline.trial.process import process_recording
from tests.campaign.plants import channel, clipped, overflowing, raw
from tests.overground_walk import simulate_overground

CHANNELS = [*enumerate(WRENCH_COMPONENTS)]


@pytest.fixture(scope="module")
def laboratory():
    """Transducers 4 cm below the surface, as in most plates."""
    simulated = simulate_overground(seed=5)
    plates = tuple(
        replace(plate, transducer=np.array([0.002, -0.001, 0.04]))
        for plate in simulated.walk.plates
    )
    return replace(simulated, walk=replace(simulated.walk, plates=plates))


def doubts(laboratory, recording):
    """Warnings, and the mass that the steps weigh."""
    result = process_recording(recording, Subject(sex="male"), Settings(), static=laboratory.static)
    weighed = any(note.code == "mass_carried" for note in result.notes)
    return [*warnings_of(result.notes)], weighed


def kinds(recording):
    return {(fault.plate, fault.channel): fault.kind for fault in raw_faults(recording.plates)}


def test_healthy_plates_show_nothing(laboratory):
    assert kinds(laboratory.walk) == kinds(laboratory.static) == {}


@pytest.mark.parametrize(("axis", "name"), CHANNELS)
@pytest.mark.parametrize("about", ["transducer", "surface"])
def test_a_clipped_channel_is_found_about_the_transducer_and_about_the_surface(
    laboratory, axis, name, about
):
    plant = raw if about == "transducer" else channel
    clips = plant(laboratory.walk, 1, axis, clipped(0.6))
    assert kinds(clips) == {(2, name): "clipped"}


@pytest.mark.parametrize(("axis", "name"), CHANNELS[1:3])
def test_a_clipped_plate_is_named_alone_without_a_correction_and_steps_do_not_weigh(
    laboratory, axis, name
):
    warnings, weighed = doubts(laboratory, raw(laboratory.walk, 1, axis, clipped(0.6)))
    accused = [
        note
        for note in warnings
        if {"plate", "first"} & {*note.values} or note.code == "plates_late"
    ]
    assert [note.code for note in accused] == ["plate_clipped"]
    (note,) = accused
    assert (note.values["plate"], [*note.values["limits"]]) == (2, [name])
    assert note.values["frames"] > 5
    assert "--mend-plates" not in note.advice
    assert not weighed


@pytest.mark.parametrize("index", [0, 1, 2])
def test_a_plate_whose_vertical_force_wraps_is_not_said_to_be_reversed(laboratory, index):
    warnings, _ = doubts(laboratory, raw(laboratory.walk, index, 2, overflowing(0.6)))
    codes = {note.code for note in warnings}
    assert "plate_wraps" in codes
    assert not codes & {"in_doubt", "plate_reversed", "plate_gain", "plates_late"}


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize(("axis", "name"), CHANNELS)
def test_what_is_said_to_wrap_is_unwrapped(laboratory, axis, name, noise):
    """With noise the channel crosses its limit often."""
    rng = np.random.default_rng(3)

    def noisy(values):
        return values + noise * np.abs(values).max() * rng.normal(size=len(values))

    healthy = raw(laboratory.walk, 1, axis, noisy)
    wraps = raw(healthy, 1, axis, overflowing(0.6))
    assert kinds(wraps) == {(2, name): "wraps"}
    back = mended_plates(wraps.plates, [f"2: unwrap {name}"])[1]
    measured = healthy.plates[1].wrench_in_plate
    size = np.abs(measured[:, axis]).max()
    assert np.abs(back.wrench_in_plate - measured).max() < 0.04 * size


def test_a_channel_that_wraps_in_the_trial_is_mended_there_and_said_to_be(laboratory):
    wraps = raw(laboratory.walk, 1, 2, overflowing(0.6))
    stated = ReadOptions(mend_plates=("2: unwrap Fz",))
    mended = with_mended_plates(replace(wraps, options=stated))
    (note,) = (note for note in mended.notes if note.code == "plates_mended")
    assert note.values["done"] == ("2: unwrap Fz",)
    assert kinds(mended) == {}


@pytest.mark.parametrize("dead", ["constant", "noise"])
@pytest.mark.parametrize(("axis", "name"), CHANNELS)
def test_a_dead_channel_is_named_while_others_are_loaded(laboratory, axis, name, dead):
    noise = np.random.default_rng(4).normal(size=len(laboratory.walk.plates[1].time))
    silent = raw(
        laboratory.walk, 1, axis, lambda values: 0 * values + 2 + (dead == "noise") * noise
    )
    assert kinds(silent) == {(2, name): "dead"}


def test_a_plate_that_nobody_is_on_is_not_dead(laboratory):
    plate = laboratory.walk.plates[1]
    noise = np.random.default_rng(4).normal(size=plate.wrench_in_plate.shape)
    assert raw_faults([replace(plate, wrench_in_plate=noise)]) == ()


def test_heels_that_strike_between_slow_samples_are_no_jumps(laboratory):
    slow = [
        replace(p, time=p.time[::5], wrench_in_plate=p.wrench_in_plate[::5])
        for p in laboratory.walk.plates
    ]
    assert raw_faults(slow) == ()


def test_findings_are_of_the_channels_as_recorded(laboratory):
    """A plate's calibration mixes channels: two that are clipped are no longer flat after it."""
    clips = raw(raw(laboratory.walk, 1, 2, clipped(0.6)), 1, 4, clipped(0.7))
    found = raw_faults(clips.plates)
    assert [(fault.channel, fault.kind) for fault in found] == [
        ("Fz", "clipped"),
        ("My", "clipped"),
    ]
    load = np.abs(clips.plates[1].wrench_in_plate[:, 2])
    assert abs(found[0].size) == pytest.approx(load.max(), rel=1e-6)
    assert found[0].count == np.count_nonzero(load > 0.9999 * load.max())
    assert found[0].first_s == pytest.approx(
        clips.plates[1].time[np.argmax(load > 0.9999 * load.max())]
    )
