"""What is wrong with real recordings is doubted, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Settings, Subject
from pipeline.io.mended_plates import mended_plates
from pipeline.trial.process import process_recording
from tests.campaign.plants import amplified, channel, moved, overflowing, raw
from tests.hbm.motions import exchanged, relabelled
from tests.recordings.recorded import (
    TESTS,
    child,
    generated,
    marker_set,
    overground,
    processed,
    recorded,
    standing,
    steps,
    treadmill,
    two_plates,
)

DOUBTS = {
    *("sides_exchanged", "labels_exchanged", "marker_distances_changed"),
    *("markers_frozen", "markers_constant"),
    *("marker_error_large", "joint_angles_impossible"),
    *("events_of_other_side", "events_offset"),
    *("plates_not_zeroed", "mass_differs"),
    *("plate_wraps", "plate_jumps", "plates_exchanged", "plate_turned", "plate_reversed"),
    *(
        "plate_elsewhere",
        "plate_askew",
        "plate_gain",
        "plates_late",
        "plate_late",
        "plates_unclear",
        "platform_moves",
    ),
}


def doubts(recording, subject=None, **options):
    """The doubts about a recording, by their codes."""
    return doubts_of(process_recording(recording, subject or Subject(), Settings(), **options))


def doubts_of(result):
    return {note.code: note for note in result.notes if note.code in DOUBTS}


@pytest.fixture(scope="module")
def walk(shared_data):
    return recorded(treadmill, shared_data)[0]


def test_treadmill_walking_is_not_doubted(walk):
    """Nobody stands in it: its own mass is taken, 1 % from what the plates carry over strides."""
    assert doubts(walk) == doubts(walk, Subject(mass_kg=55.9)) == {}


def test_quiet_standing_is_not_doubted(shared_data):
    recording, _ = recorded(standing, shared_data)
    chosen = marker_set(TESTS / "recordings" / "quiet_standing.toml")
    assert doubts(recording, marker_set=chosen) == {}


@pytest.mark.parametrize("read", [overground, generated])
def test_overground_and_generated_walking_is_not_doubted(shared_data, read):
    assert doubts_of(processed(read, shared_data)) == {}


def test_of_a_descent_of_steps_the_plates_zeros_are_doubted_and_explain_the_mass_they_carry(
    shared_data,
):
    """Four plates that read 6 to 12 N each without anybody on them, 36 N or 4 kg in all."""
    trial, known = recorded(steps, shared_data)
    chosen = marker_set(TESTS / "recordings" / "plug_in_gait.toml")
    found = doubts(trial, static=known["static"], marker_set=chosen)
    assert set(found) == {"plates_not_zeroed"}
    assert found["plates_not_zeroed"].values["total_n"] == pytest.approx(36, abs=2)


def test_a_walk_over_two_plates_is_not_doubted_and_a_wrong_mass_is_no_fault_of_theirs(shared_data):
    """Each of them then measures too little; the note has the mass that the steps weigh."""
    trial, known = recorded(child("HC030"), shared_data)
    right = process_recording(trial, settings=Settings(), **known)
    assert doubts_of(right) == {}
    assert "plate_samples_zero" not in {note.code for note in right.notes}
    heavier = known | {"subject": Subject(mass_kg=52.0)}
    found = doubts_of(process_recording(trial, settings=Settings(), **heavier))
    assert set(found) == {"mass_differs"}
    assert min(found["mass_differs"].values["known_kg"].values()) == pytest.approx(45.5, abs=0.5)


def test_masses_that_differ_between_the_files_of_pose_and_walk_are_named(shared_data):
    trial, known = recorded(child("HC030"), shared_data)
    heavier = replace(trial, metadata=replace(trial.metadata, mass_kg=55.0))
    (note,) = doubts(heavier, **known).values()
    assert note.code == "mass_differs"
    assert note.values["known_kg"]["in the trial's file"] == 55.0


def later(recording, number, delay_s):
    """One plate later than the others."""
    plates = tuple(
        replace(p, time=p.time + delay_s) if p.number == number else p for p in recording.plates
    )
    return replace(recording, plates=plates)


@pytest.mark.parametrize(
    ("fault", "code", "plate"),
    [
        (lambda walk: later(walk, 1, 0.025), "plate_late", 1),
        (lambda walk: moved(walk, 0, np.array([0.06, 0.0, 0.0])), "plate_elsewhere", 1),
        (lambda walk: amplified(walk, 1, 2, 0.8), "plate_gain", 2),
        (lambda walk: channel(walk, 1, 1, lambda values: values + 30.0), "plates_not_zeroed", None),
    ],
    ids=["late", "moved", "weak", "not zero"],
)
def test_of_two_steps_one_fault_is_named_with_its_plate(shared_data, fault, code, plate):
    for name in ("HC030", "HC031"):
        trial, known = recorded(child(name), shared_data)
        found = doubts(fault(trial), **known)
        named = {name for name in found if name.startswith("plate")}
        if named == {"plates_unclear"}:  # a place, or the gain of a moment
            assert code == "plate_elsewhere"
            assert f"plate {plate}: centre" in found["plates_unclear"].text
            continue
        assert named == {code}
        assert found[code].values.get("plate") == plate


def test_a_load_that_overflows_is_undone_where_the_recording_begins_during_a_step(shared_data):
    walk, known = recorded(treadmill, shared_data)
    faulty = raw(walk, 0, 2, overflowing(0.6))
    (note,) = doubts(faulty, **known).values()
    assert note.code == "plate_wraps"
    (mended, _) = mended_plates(faulty.plates, ("1: unwrap Fz",))
    np.testing.assert_allclose(mended.wrench_in_plate, walk.plates[0].wrench_in_plate, atol=0.1)


@pytest.mark.parametrize("delay_s", [-0.025, 0.025])
def test_of_two_steps_plates_that_are_all_late_or_early_are_named_so(shared_data, delay_s):
    trial, known = recorded(child("HC030"), shared_data)
    for number in (1, 2):
        trial = later(trial, number, delay_s)
    (note,) = doubts(trial, **known).values()
    assert note.code == "plates_late"
    assert note.values["delay_s"] == pytest.approx(delay_s, abs=note.values["uncertainty_s"])


def test_exchanged_labels_of_the_knees_are_no_fault_of_plates(shared_data):
    trial, known = recorded(child("HC030"), shared_data)
    markers = relabelled(trial.markers, ("LKNE", "RKNE"))
    found = doubts(replace(trial, markers=markers), **known)
    assert "sides_exchanged" in found
    assert not {code for code in found if code.startswith("plate")}


def test_exchanged_heels_are_doubted_throughout_a_trial_and_for_a_few_seconds(walk):
    heels, markers = ("LHEE", "RHEE"), walk.markers
    whole = doubts(replace(walk, markers=relabelled(markers, heels)), static=walk)
    assert whole["sides_exchanged"].values["pairs"] == "/".join(heels)
    assert "marker_error_large" in whole
    some = doubts(replace(walk, markers=exchanged(markers, slice(400, 700), heels)))
    values = some["labels_exchanged"].values
    assert values["pairs"] == "/".join(heels)
    assert (values["first_s"], values["last_s"]) == pytest.approx((4.0, 7.0))


def test_a_plate_that_rests_below_zero_is_doubted_and_a_mass_that_the_steps_contradict(shared_data):
    """Overground walking over two plates; the second one reads −16 N before anybody steps on it.

    The file states no mass, and the one that is stated of it here was guessed.
    """
    found = doubts_of(processed(two_plates, shared_data))
    assert set(found) == {"plates_not_zeroed", "mass_differs"}
    rest_n = found["plates_not_zeroed"].values["rest_n"]
    assert rest_n == {"plate 1": pytest.approx(0, abs=1), "plate 2": pytest.approx(-16, abs=1)}
    _, steps_kg = found["mass_differs"].values["known_kg"].values()
    trial, known = recorded(two_plates, shared_data)
    known = known | {"subject": Subject(mass_kg=steps_kg)}
    again = process_recording(trial, settings=Settings(), **known)
    assert set(doubts_of(again)) == {"plates_not_zeroed"}
