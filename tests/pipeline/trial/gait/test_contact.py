"""The foot on a plate is found where steps cross, sums are exact, and doubt is flagged."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from compensation import center_of_pressure
from pipeline.config.schema import PlateContact
from pipeline.trial.gait.contact import (
    ambiguous_contacts,
    by_foot,
    far_from_feet,
    share_between_feet,
)

LEFT, RIGHT = 0, 1
STEP_M, WIDTH_M, HALF_S = 0.6, 0.15, 0.55
DOUBLE_S = 0.12
WEIGHT_N = 700.0
RATE_HZ = 100.0


def share(wrenches, feet, **options):
    """Share plates between feet at 100 Hz, with a threshold of 30 N."""
    time = np.arange(len(feet)) / RATE_HZ
    found = share_between_feet(time, wrenches, feet, 30.0, **options)
    under = by_foot(np.stack(wrenches, axis=1), found.on)
    each = {"left_foot": under[:, LEFT], "right_foot": under[:, RIGHT]}
    return SimpleNamespace(
        on=found.on,
        ambiguous=found.ambiguous.any(axis=1),
        contacts=found.contacts,
        by_foot=each,
    )


def ramp(x):
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def walking(steps=8, rate_hz=RATE_HZ):
    """Feet in treadmill walking and the force under each: (T, 2, 3) [m] and (T, 2) [N].

    Strides last 1.1 s, stance 61 % of it; the standing foot drifts back, the swinging one passes
    half a hand's width beside it and 8 cm higher.
    """
    time = np.arange(round(steps * HALF_S * rate_hz)) / rate_hz
    feet, load = np.zeros((len(time), 2, 3)), np.zeros((len(time), 2))
    for side in (LEFT, RIGHT):
        phase = (time / (2 * HALF_S) - 0.5 * side) % 1
        stance = (HALF_S + DOUBLE_S) / (2 * HALF_S)
        standing = phase < stance
        swing = np.clip((phase - stance) / (1 - stance), 0, 1)
        back = np.where(standing, phase / stance, 1 - ramp(swing))
        feet[:, side, 0] = STEP_M * (0.5 - back)
        feet[:, side, 1] = (0.5 - side) * WIDTH_M
        feet[:, side, 2] = 0.06 + 0.08 * np.sin(np.pi * swing) ** 2 * ~standing
        at = phase * 2 * HALF_S
        load[:, side] = ramp(at / DOUBLE_S) * (1 - ramp((at - HALF_S) / DOUBLE_S)) * standing
    return feet, WEIGHT_N * load / load.sum(axis=1, keepdims=True)


def wrench_of(load, point):
    """An upward force through a point on the floor, (T, 6)."""
    wrench = np.zeros((len(load), 6))
    wrench[:, 2] = load
    wrench[:, 3], wrench[:, 4] = point[:, 1] * load, -point[:, 0] * load
    return wrench


def pressures(feet):
    """Points under both feet that roll from 12 cm behind to 12 cm ahead of the middle."""
    roll = np.clip(-feet[..., 0] / STEP_M, -0.5, 0.5) * 0.24
    points = feet.copy()
    points[..., 0] += roll
    points[..., 2] = 0
    return points


def on_own_belts():
    """Feet, their loads and pressures in walking, and a plate under each foot."""
    feet, load = walking()
    points = pressures(feet)
    return feet, load, points, [wrench_of(load[:, k], points[:, k]) for k in (LEFT, RIGHT)]


@settings(max_examples=25)
@given(
    arrays(float, (2, 30, 6), elements=st.floats(-1000, 1000)),
    arrays(float, (30, 2, 3), elements=st.floats(-1, 1)),
)
def test_both_feet_together_carry_what_the_plates_carry(wrenches, feet):
    shared = share(list(wrenches), feet).by_foot
    together = shared["left_foot"] + shared["right_foot"]
    np.testing.assert_allclose(together, wrenches.sum(axis=0), atol=1e-9, rtol=0)


def test_gaps_stay_gaps_and_disturb_no_other_frame():
    feet, _, _, wrenches = on_own_belts()
    whole = share(wrenches, feet).by_foot
    wrenches[LEFT][200:210] = np.nan
    feet[100:105] = np.nan
    shared = share(wrenches, feet).by_foot
    missing = np.isnan(shared["left_foot"] + shared["right_foot"]).all(axis=1)
    assert np.flatnonzero(missing).tolist() == list(range(200, 210))
    for foot in whole:
        np.testing.assert_array_equal(shared[foot][~missing], whole[foot][~missing])


def test_each_foot_on_its_own_belt_gets_its_belt():
    feet, _, _, wrenches = on_own_belts()
    shared = share(wrenches, feet)
    np.testing.assert_array_equal(shared.by_foot["left_foot"], wrenches[LEFT])
    np.testing.assert_array_equal(shared.by_foot["right_foot"], wrenches[RIGHT])
    assert not shared.ambiguous.any()
    for plate, foot in ((1, "left_foot"), (2, "right_foot")):
        own = [contact for contact in shared.contacts if contact.plate == plate]
        assert len(own) == 4 + (plate == 2)
        assert all(contact.feet == (foot,) for contact in own)


def test_a_step_across_the_gap_gives_both_plates_to_that_foot():
    feet, load = walking()
    points = pressures(feet)
    inner, outer = points[:, LEFT] - [0, 0.04, 0], points[:, LEFT] + [0, 0.04, 0]
    plates = [
        wrench_of(load[:, LEFT] / 2, outer),
        wrench_of(load[:, LEFT] / 2, inner) + wrench_of(load[:, RIGHT], points[:, RIGHT]),
    ]
    single = load[:, RIGHT] == 0
    shared = share(plates, feet).by_foot
    both = plates[0] + plates[1]
    np.testing.assert_allclose(shared["left_foot"][single], both[single], atol=1e-9)


def test_on_one_plate_alone_the_foot_changes_at_every_step():
    """The plate is never unloaded; the foot changes nevertheless, within double support."""
    feet, load, _, wrenches = on_own_belts()
    plate = sum(wrenches)
    found = share([plate, np.zeros_like(plate)], feet)
    shared, ambiguous = found.by_foot, found.ambiguous
    for foot, k in (("left_foot", LEFT), ("right_foot", RIGHT)):
        single = load[:, k] == load.sum(axis=1)
        np.testing.assert_allclose(shared[foot][single], plate[single], atol=1e-9)
    assert not ambiguous[load.min(axis=1) == 0].any()
    halved = load.min(axis=1) > WEIGHT_N / 3
    assert halved.any()
    assert ambiguous[halved].all()


def test_a_heel_on_the_other_foot_s_plate_makes_it_uncertain_while_both_feet_stand():
    """The third right foot bears 60 % on the left plate; the pressure shows it later."""
    feet, load, points, wrenches = on_own_belts()
    right_stance = np.diff(load[:, RIGHT] > 0, prepend=False, append=False).nonzero()[0][4:6]
    third = slice(*right_stance)
    aside = 0.6 * wrench_of(load[:, RIGHT], points[:, RIGHT])[third]
    wrenches[LEFT][third] += aside
    wrenches[RIGHT][third] -= aside
    both = load.min(axis=1) > 0
    shared = share(wrenches, feet, standing=both).ambiguous
    without_times = share(wrenches, feet).ambiguous
    in_third = np.zeros(len(load), bool)
    in_third[third] = True
    assert shared[both & in_third & (load[:, LEFT] > 30)].all()
    assert not shared[~(both & in_third)].any()
    assert without_times.sum() < 0.7 * shared.sum()


def test_standing_with_both_feet_on_one_plate_is_flagged():
    feet = np.tile([[[0, 0.1, 0.06], [0, -0.1, 0.06]]], (50, 1, 1))
    plate = wrench_of(np.full(50, WEIGHT_N), np.tile([0.05, 0.01, 0.0], (50, 1)))
    ambiguous = share([plate, 0 * plate], feet).ambiguous
    assert ambiguous.all()
    each = [wrench_of(np.full(50, WEIGHT_N / 2), feet[:, k]) for k in (LEFT, RIGHT)]
    ambiguous = share(each, feet).ambiguous
    assert not ambiguous.any()


def test_a_downward_force_is_no_contact():
    """Inertia of an empty belt may pull: that is no foot, and has no centre of pressure."""
    feet, load, _, wrenches = on_own_belts()
    wrenches[LEFT][load[:, LEFT] == 0, 2] = -60.0
    shared = share(wrenches, feet).by_foot
    np.testing.assert_array_equal(shared["left_foot"], wrenches[LEFT])
    assert np.isnan(center_of_pressure(wrenches[LEFT], 30.0)).any()


def test_feet_are_assigned_by_the_forces_of_the_subject_alone():
    """A swaying platform's inertia moves the measured centre of pressure by metres."""
    feet, _, _, alone = on_own_belts()
    artefact = np.array([0, 400.0, 40.0, 300.0, 0, 100.0])
    measured = [wrench + artefact for wrench in alone]
    by_themselves = share(measured, feet).by_foot
    assert not np.array_equal(by_themselves["left_foot"], measured[LEFT])
    shared = by_foot(np.stack(measured, axis=1), share(alone, feet).on)
    np.testing.assert_array_equal(shared, np.stack([measured[LEFT], measured[RIGHT]], axis=1))


def cross_over():
    """Walking in which the third left step lands on the right plate."""
    feet, load = walking()
    points = pressures(feet)
    stance = np.diff(load[:, LEFT] > 0, prepend=False).nonzero()[0]
    third = slice(stance[4], stance[5])
    plates = [wrench_of(load[:, k], points[:, k]) for k in (LEFT, RIGHT)]
    plates[RIGHT][third] += plates[LEFT][third]
    plates[LEFT][third] = 0
    return feet, load, plates, third


def test_a_foot_on_the_other_s_plate_gets_what_it_carries():
    feet, load, plates, third = cross_over()
    shared = share(plates, feet).by_foot
    single = np.zeros(len(load), bool)
    single[third] = load[third, RIGHT] == 0
    assert single.any()
    np.testing.assert_allclose(shared["left_foot"][single], plates[RIGHT][single], atol=1e-9)
    np.testing.assert_allclose(shared["right_foot"][single], 0, atol=1e-9)


def test_a_brief_stretch_of_pressure_near_the_other_foot_does_not_split_a_contact():
    """A plate that is hardly loaded has a centre of pressure anywhere."""
    feet, load, points, wrenches = on_own_belts()
    start = int(np.flatnonzero((load[:, LEFT] > 30) & (np.arange(len(load)) > 100))[0])
    astray = points[:, RIGHT].copy()
    wrenches[LEFT][start : start + 4] = wrench_of(load[:, LEFT], astray)[start : start + 4]
    shared = share(wrenches, feet)
    np.testing.assert_array_equal(shared.by_foot["left_foot"], wrenches[LEFT])
    assert all(len(contact.feet) == 1 for contact in shared.contacts)


def test_pressure_under_neither_foot_makes_a_contact_ambiguous_from_its_start_to_its_end():
    """Somebody else steps on the plate, or its moments are wrong."""
    feet, load, points, wrenches = on_own_belts()
    wrenches[LEFT] = wrench_of(load[:, LEFT], points[:, LEFT] + [0.6, 0, 0])
    found = share(wrenches, feet)
    assert {contact.ambiguous for contact in found.contacts if contact.plate == 1} == {True}
    assert {contact.ambiguous for contact in found.contacts if contact.plate == 2} == {False}
    np.testing.assert_array_equal(found.ambiguous, load[:, LEFT] > 30)
    (far,), (note,) = (
        far_from_feet(found),
        ambiguous_contacts(found, np.arange(len(feet)) / RATE_HZ),
    )
    assert (far.code, far.level, far.values["plate"]) == ("pressure_far_from_feet", "warning", 1)
    assert far.values["distance_m"] == pytest.approx(0.6, abs=0.1)
    assert (note.code, note.values["contacts"]) == ("contacts_ambiguous", 4)


def test_a_person_s_word_overrules_the_centre_of_pressure():
    feet, load, points, plates = on_own_belts()
    plates[LEFT] = wrench_of(load[:, LEFT], points[:, LEFT] + [0.6, 0, 0])
    contact = next(c for c in share(plates, feet).contacts if c.plate == 1 and c.start > 0)
    at = (contact.start + contact.stop) / 2 / RATE_HZ
    found = share(plates, feet, by_hand=[PlateContact(plate=1, time_s=at, foot="right")])
    frames = slice(contact.start, contact.stop)
    np.testing.assert_array_equal(
        found.by_foot["right_foot"][frames], (plates[LEFT] + plates[RIGHT])[frames]
    )
    assert not found.ambiguous[frames].any()


def test_a_contact_that_is_stated_where_there_is_none_is_refused():
    feet, load, _, plates = on_own_belts()
    swing = np.flatnonzero(load[:, LEFT] == 0)[5] / RATE_HZ
    with pytest.raises(ValueError, match=r"nobody .*plate 1 at [\d.]+ s; .*: [\d.]+–"):
        share(plates, feet, by_hand=[PlateContact(plate=1, time_s=swing, foot="left")])
    with pytest.raises(ValueError, match=r"contacts: .*no plate 3; .*1 to 2"):
        share(plates, feet, by_hand=[PlateContact(plate=3, time_s=1.0, foot="left")])
