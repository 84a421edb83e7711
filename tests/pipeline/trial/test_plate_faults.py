"""What is wrong with single plates is named, with what mends it; healthy plates are not doubted."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS
from pipeline.config.schema import Settings, Subject
from pipeline.io.mended_plates import with_mended_plates
from pipeline.io.read_options import ReadOptions, parse_mending
from pipeline.report.trial_tables import verdict_lines
from pipeline.trial.findings.evidence import Evidence, weight_of_steps
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import residual_table
from tests.campaign.plants import amplified, channel, exchanged, moved, overflowing, turned
from tests.campaign.walks import known_with_legs_alone, with_legs_alone
from tests.overground_walk import simulate_overground

CODES = {
    *("plate_wraps", "plate_jumps", "plates_exchanged", "plate_turned", "plate_reversed"),
    *("plate_elsewhere", "plate_askew", "plate_gain", "plate_late", "plates_unclear"),
    *("mass_differs", "pressure_far_from_feet"),
}


@given(mass_kg=st.floats(20, 150), rise_mps=st.floats(-1.0, 1.0), start=st.integers(20, 60))
def test_steps_weigh_a_body_that_gains_speed(mass_kg, rise_mps, start):
    """Over half a second, in which the centre of mass is accelerated upwards or downwards."""
    time = np.arange(150) / 100
    carried = (np.arange(150) >= start) & (np.arange(150) < start + 50)
    force = mass_kg * (GRAVITY_MPS2 + rise_mps / 0.5)
    stated_kg = 70.0
    wrench, needed = np.zeros((1, 150, 6)), np.zeros((150, 6))
    wrench[0, carried, 2] = force
    needed[carried, 2] = force * stated_kg / mass_kg
    seen = evidence(time, wrench, needed, carried, stated_kg * GRAVITY_MPS2)
    assert weight_of_steps(seen) == pytest.approx(mass_kg, rel=1e-9)


def test_steps_do_not_weigh_what_the_plates_carry_too_briefly():
    time, load = np.arange(150) / 100, np.full((1, 150, 6), 700.0)
    assert weight_of_steps(evidence(time, load, load[0], time < 0.2, 700.0)) is None


def evidence(time, wrenches, needed, carried, weight_n):
    """Evidence of what plates carry, without feet."""
    feet = np.zeros((len(time), 2, 3))
    return Evidence(
        plates=(),
        time=time,
        wrenches=wrenches,
        load=wrenches[..., 2],
        needed=needed,
        pelvis=feet[:, 0],
        carried=carried,
        ankle=feet,
        ball=feet,
        foot_m=np.full(2, 0.25),
        weight_n=weight_n,
        covariance=np.eye(6),
    )


@pytest.fixture(scope="module")
def laboratory():
    return simulate_overground(seed=5)


def doubts(laboratory, recording):
    result = process_recording(recording, Subject(sex="male"), Settings(), static=laboratory.static)
    return [note for note in result.notes if note.code in CODES]


def test_healthy_plates_are_not_doubted(laboratory):
    assert doubts(laboratory, laboratory.walk) == []


def test_a_mass_that_nothing_tells_is_weighed_by_steps(laboratory):
    """Over the steps on three plates, to 1 %; the pose is recorded beside them."""
    beside = replace(laboratory.static, plates=())
    result = process_recording(laboratory.walk, Subject(sex="male"), Settings(), static=beside)
    person = laboratory.subject.person
    assert result.body.mass == pytest.approx(person.mass_kg, rel=0.01)
    codes = {note.code for note in result.notes}
    assert "mass_by_steps" in codes
    assert "mass_stated" not in codes
    stated = process_recording(
        laboratory.walk,
        Subject(sex="male", mass_kg=0.83 * person.mass_kg),
        Settings(),
        static=beside,
    )
    (differs,) = [note for note in stated.notes if note.code == "mass_differs"]
    steps_kg = [*differs.values["known_kg"].values()][-1]
    assert steps_kg == pytest.approx(person.mass_kg, rel=0.01)


@pytest.mark.parametrize(
    ("code", "fault"),
    [
        ("plate_wraps", lambda walk: channel(walk, 1, 4, overflowing(0.6))),
        ("plate_turned", lambda walk: turned(walk, 1, 180, corners=False)),
        ("plate_turned", lambda walk: turned(walk, 0, 90, corners=False)),
        ("plate_reversed", lambda walk: amplified(walk, 2, 0, -1.0)),
        ("plate_reversed", lambda walk: amplified(walk, 1, 2, -1.0)),
        ("plates_exchanged", lambda walk: exchanged(walk, 0, 1)),
    ],
)
def test_a_fault_is_named_and_what_its_note_states_mends_it(laboratory, code, fault):
    faulty = fault(laboratory.walk)
    (note,) = doubts(laboratory, faulty)
    assert note.code == code
    mending = re.findall(r'--mend-plates "([^"]+)"', note.values["remedy"])
    mended = with_mended_plates(replace(faulty, options=ReadOptions(mend_plates=tuple(mending))))
    assert doubts(laboratory, mended) == []
    for one, other in zip(mended.plates, laboratory.walk.plates, strict=True):
        assert np.allclose(one.wrench, other.wrench, atol=2.0 if code == "plate_wraps" else 1e-6)


def test_behind_an_overflow_another_fault_is_named_with_what_mends_both(laboratory):
    faulty = amplified(channel(laboratory.walk, 1, 4, overflowing(0.6)), 2, 0, -1.0)
    wraps, reverses = doubts(laboratory, faulty)
    assert (wraps.code, reverses.code) == ("plate_wraps", "plate_reversed")
    assert "unwrap My" in reverses.values["remedy"]
    assert "reverse Fx" in reverses.values["remedy"]


def test_a_weak_channel_is_sized(laboratory):
    (note,) = doubts(laboratory, amplified(laboratory.walk, 1, 0, 0.35))
    assert (note.code, note.values["plate"], note.values["component"]) == ("plate_gain", 2, "Fx")
    assert note.values["low"] < 0.35 < note.values["high"]
    assert note.values["direction"] == "forward force"


def test_a_plate_that_lies_elsewhere_is_sized(laboratory):
    (note,) = doubts(laboratory, moved(laboratory.walk, 1, np.array([0.0, 0.08, 0.0])))
    assert (note.code, note.values["plate"]) == ("plate_elsewhere", 2)
    assert note.values["off_m"]["left"] == pytest.approx(0.08, abs=note.values["interval_m"])
    there = corrected(moved(laboratory.walk, 1, np.array([0.0, 0.08, 0.0])), note)
    off = there.plates[1].center - laboratory.walk.plates[1].center
    assert np.abs(off).max() < 0.08 / 2
    assert doubts(laboratory, there) == []


def corrected(recording, note):
    """The recording as the note's advice corrects it."""
    mendings = tuple(re.findall(r'--mend-plates "([^"]+)"', note.advice))
    return with_mended_plates(replace(recording, options=ReadOptions(mend_plates=mendings)))


def test_a_zero_is_corrected_by_what_its_note_advises(laboratory):
    walk = channel(laboratory.walk, 0, 2, lambda values: values + 40.0)
    walk = channel(walk, 1, 3, lambda values: values - 9.0)
    result = process_recording(walk, Subject(sex="male"), Settings(), static=laboratory.static)
    (note,) = (note for note in result.notes if note.code == "plates_not_zeroed")
    back = corrected(walk, note)
    for one, other in zip(back.plates, laboratory.walk.plates, strict=True):
        np.testing.assert_allclose(one.wrench_in_plate, other.wrench_in_plate, atol=1.0)


@pytest.mark.parametrize("delay_s", [0.04, -0.04])
def test_a_delay_is_named_as_one_and_not_as_gains(laboratory, delay_s):
    late = replace(
        laboratory.walk,
        plates=tuple(replace(p, time=p.time + delay_s) for p in laboratory.walk.plates),
    )
    result = process_recording(late, Subject(sex="male"), Settings(), static=laboratory.static)
    codes = [note.code for note in result.notes if note.code in {*CODES, "plates_late"}]
    assert codes == ["plates_late"]
    assert result.delay_s == pytest.approx(delay_s, abs=result.delay_uncertainty_s)
    (note,) = (note for note in result.notes if note.code == "plates_late")
    stated_s = float(re.search(r"plate_delay_s = (-?[\d.]+)", note.advice)[1])
    again = process_recording(
        late, Subject(sex="male"), Settings(plate_delay_s=stated_s), static=laboratory.static
    )
    assert not [note for note in again.notes if note.code in {*CODES, "plates_late"}]


@pytest.mark.parametrize(
    "text",
    [
        "turn 90",
        "2: turn 45",
        "2: reverse Fw",
        "2 reverse Fx",
        "0x2: turn 90",
        "2: unwrap all",
        "1: gain Fz",
        "1: zero all 2",
        "1: move w 1",
        "1: drift Fz",
    ],
)
def test_what_cannot_be_mended_is_refused_with_what_can(text):
    with pytest.raises(ValueError, match="3: reverse Fx, 2:"):
        parse_mending(text)


def mended(recording, *mending):
    return with_mended_plates(replace(recording, options=ReadOptions(mend_plates=mending)))


@given(
    gain=st.floats(0.5, 1.5),
    zero=st.floats(-30, 30),
    metres=st.floats(-0.1, 0.1),
    which=st.integers(0, 5),
)
def test_stated_gains_zeros_and_moves_undo_those_of_a_plate(laboratory, gain, zero, metres, which):
    """Plate 2 measures gain * wrench + zero, and lies elsewhere along its own x."""
    component, plate = WRENCH_COMPONENTS[which], laboratory.walk.plates[1]
    faulty = channel(laboratory.walk, 1, which, lambda values: gain * values + zero)
    faulty = moved(faulty, 1, metres * plate.rotation[:, 0])
    back = mended(
        faulty,
        f"2: zero {component} {zero:.9f}",
        f"2: gain {component} {1 / gain:.9f}",
        f"2: move x {-metres:.9f}",
    )
    for one, other in zip(back.plates, laboratory.walk.plates, strict=True):
        np.testing.assert_allclose(one.center, other.center, atol=1e-8)
        np.testing.assert_allclose(one.wrench_in_plate, other.wrench_in_plate, atol=1e-4)
        np.testing.assert_allclose(one.wrench, other.wrench, atol=1e-4)


def test_mending_refuses_a_plate_that_is_not_there_beside_others(laboratory):
    for mending, message in {
        "4: turn 90": "no plate 4; the recording has plates 1, 2, 3",
        "1: exchange 7": "no plate 7",
    }.items():
        with pytest.raises(ValueError, match=message):
            mended(laboratory.walk, mending)
    beside = replace(laboratory.static, plates=())
    assert mended(beside, "4: turn 90").plates == ()


def test_unwrapping_leaves_channels_that_do_not_wrap_and_says_so(laboratory):
    """The same is stated of trial and calibration pose, and a channel may wrap in one of them."""
    every = [f"{k}: unwrap {name}" for k in (1, 2, 3) for name in ("Fx", "Fz", "Mx", "Mz")]
    (note,) = (n for n in mended(laboratory.walk, *every).notes if n.code == "plates_mended")
    assert all("does not wrap" in done for done in note.values["done"])
    for recording in (laboratory.walk, laboratory.static):
        for one, other in zip(mended(recording, *every).plates, recording.plates, strict=True):
            assert np.array_equal(one.wrench_in_plate, other.wrench_in_plate)


@pytest.fixture(scope="module")
def legs_alone(laboratory):
    """The same walk with markers on pelvis and legs alone: half of the body moves unseen."""
    known = {"subject": Subject(sex="male"), "static": laboratory.static}
    body = process_recording(laboratory.walk, settings=Settings(), **known).body
    walk = with_legs_alone(laboratory.walk, body)
    return walk, known_with_legs_alone(known, body)


def test_what_unseen_segments_do_is_expected_and_no_fault_of_plates(legs_alone):
    walk, known = legs_alone
    result = process_recording(walk, settings=Settings(), **known)
    assert not [note for note in result.notes if note.code in CODES]
    table = residual_table(result, "").set_index("axis")
    weight_n, stature_m = result.body.mass * GRAVITY_MPS2, result.body.height_m
    expected = table["expected"] / weight_n * [100, 100, 100, *3 * [100 / stature_m]]
    assert expected.Fx == pytest.approx(4.6, rel=0.05)
    assert expected.Mx == pytest.approx(0.87, rel=0.05)
    verdict, *_ = verdict_lines(result)
    assert "expected values" in verdict


@pytest.mark.parametrize(
    ("code", "fault"),
    [
        ("plate_turned", lambda walk: turned(walk, 1, 180, corners=False)),
        ("plate_turned", lambda walk: turned(walk, 1, 90, corners=False)),
        ("plate_reversed", lambda walk: amplified(walk, 1, 2, -1.0)),
        ("plate_reversed", lambda walk: amplified(walk, 1, 3, -1.0)),
        ("plate_elsewhere", lambda walk: moved(walk, 1, np.array([0.0, 0.08, 0.0]))),
    ],
)
def test_a_fault_that_exceeds_what_is_unseen_is_named(legs_alone, code, fault):
    walk, known = legs_alone
    result = process_recording(fault(walk), settings=Settings(), **known)
    (note,) = (note for note in result.notes if note.code in CODES)
    if note.code == "plates_unclear":  # a place may also be a gain of a moment
        assert code == "plate_elsewhere"
        assert "plate 2: centre" in note.text
    else:
        assert (note.code, note.values["plate"]) == (code, 2)
