"""Body mass is as stated, else weighed where the subject stands still, else from the file."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.notes import Note
from pipeline.config.schema import Subject
from pipeline.trial.subject import body_mass, differing_masses
from tests.pipeline.trial.standing import WEIGHT_N, late, standing, without_plates

NOBODY = Subject()
STATED = Subject(mass_kg=70.0)


def walking(time):
    """The load of a walker of 80 kg, half of it on each plate."""
    return (WEIGHT_N / 2 * (1 + 0.25 * np.sin(4 * np.pi * time)),) * 2


def walk_and_stand(begin_s, end_s):
    """Loads of somebody who walks, and stands for a while."""

    def loads(time):
        still = (time >= begin_s) & (time < end_s)
        return tuple(np.where(still, WEIGHT_N / 2, load) for load in walking(time))

    return loads


def test_a_stated_mass_is_taken_as_it_is():
    mass = body_mass(STATED, standing(file_kg=81.0))
    assert mass.mass_kg == 70.0
    assert mass.note == Note.of("mass_stated", mass_kg=70.0)
    assert list(mass.known_kg.values()) == pytest.approx([70.0, 80.0, 81.0], abs=0.01)


@settings(max_examples=20)
@given(begin_s=st.floats(0, 10), noise_n=st.floats(0, 40))
def test_the_plates_weigh_in_a_second_of_standing_wherever_it_is(begin_s, noise_n):
    loads = walk_and_stand(begin_s, begin_s + 1.3)
    mass = body_mass(NOBODY, standing(loads_n=loads, noise_n=noise_n, file_kg=81.0))
    assert mass.mass_kg == pytest.approx(80.0, abs=1.0)
    start_s, stop_s = mass.note.values["start_s"], mass.note.values["stop_s"]
    assert begin_s - 0.2 < start_s < stop_s < begin_s + 1.3 + 0.2
    assert stop_s == pytest.approx(start_s + 1.0)
    assert mass.note.code == "mass_weighed"


@pytest.mark.parametrize("plate", [0, 1])
@settings(max_examples=20)
@given(begin_s=st.floats(0.5, 9.5))
def test_a_plate_that_begins_late_does_not_spoil_the_weighing(plate, begin_s):
    mass = body_mass(NOBODY, standing(loads_n=late(plate, begin_s)))
    assert mass.mass_kg == pytest.approx(80.0, abs=0.2)
    assert mass.note.values["start_s"] > begin_s - 0.1


@pytest.mark.parametrize("share", [0.3, 0.85])
def test_with_a_foot_beside_the_plates_the_file_s_mass_is_taken(share):
    def beside(time):
        return WEIGHT_N * share + 0 * time, 0 * time

    mass = body_mass(NOBODY, standing(loads_n=beside, file_kg=80.0))
    assert mass.mass_kg == 80.0
    assert mass.note.code == "mass_of_file"
    assert differing_masses(mass.known_kg, None)[0].code == "mass_differs"


def test_a_second_on_one_foot_is_no_weighing_where_the_rest_of_the_trial_carries_more():
    def loads(time):
        both = np.where(time < 2, WEIGHT_N / 4, walking(time)[0])
        return both, both

    with pytest.raises(ValueError, match=r"mass missing: nobody"):
        body_mass(NOBODY, standing(loads_n=loads))


def test_the_trial_weighs_where_the_pose_has_no_plates():
    pose = without_plates(standing(file_kg=83.0))
    mass = body_mass(NOBODY, pose, standing())
    assert mass.note.code == "mass_weighed"
    assert mass.mass_kg == pytest.approx(80.0, abs=0.1)
    assert body_mass(NOBODY, pose).mass_kg == 83.0


def test_a_file_that_states_another_mass_than_the_plates_is_not_believed():
    mass = body_mass(NOBODY, standing(file_kg=70.0))
    assert mass.mass_kg == pytest.approx(80.0, abs=0.1)
    (note,) = differing_masses(mass.known_kg, 80.2)
    assert (note.code, note.level) == ("mass_differs", "warning")
    assert "standing on the plates 80.0 kg, in the file 70.0 kg, on the plates over" in note.text


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        (standing(loads_n=lambda time: (0 * time, 0 * time)), "give the mass"),
        (standing(loads_n=walking), "would be 8[01]"),
        (standing(0.5), "nobody stands still"),
        (without_plates(standing()), "no plates"),
    ],
)
def test_a_mass_that_nothing_tells_has_to_be_stated(recording, message):
    with pytest.raises(ValueError, match=rf"stand\.c3d: mass missing.*{message}"):
        body_mass(NOBODY, recording)
    assert body_mass(STATED, recording).mass_kg == 70.0


@given(
    stated=st.floats(40, 120),
    share=st.floats(-0.06, 0.06),
    carried=st.one_of(st.none(), st.floats(-0.06, 0.06)),
)
def test_masses_are_compared_from_3_percent_on_and_never_below(stated, share, carried):
    known = {"stated": stated, "in the file": stated * (1 + share)}
    carried_kg = None if carried is None else stated * (1 + carried)
    every = [*known.values(), *([] if carried_kg is None else [carried_kg])]
    notes = differing_masses(known, carried_kg)
    assert bool(notes) == (max(every) / min(every) - 1 > 0.03)
    for note in notes:
        assert list(note.values["known_kg"].values()) == every
