"""A chain that is changed gives what a fresh one gives, and computes nothing twice."""

import re
from dataclasses import replace

import numpy as np
import pytest

from compensation import PlateCalibration, PlateCalibrations
from hbm.segments import SegmentOverride
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Condition, PlateContact, Settings, Subject, Treadmill
from pipeline.io.mended_plates import mended_plates, with_mended_plates
from pipeline.io.read_options import ReadOptions
from pipeline.trial.chain import DEPENDS_ON, Chain
from pipeline.trial.findings.words import note_of
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.inputs import Inputs
from pipeline.trial.process import result_of
from tests.campaign.plants import amplified, channel, exchanged, moved, overflowing, turned
from tests.overground_walk import simulate_overground
from tests.pipeline.equality import assert_identical

WALK = simulate_overground(seed=5)
MASS_KG = WALK.subject.person.mass_kg
SETTINGS = {
    "marker_set": "hbm2",
    "cutoff_hz": 8.0,
    "filter": "realtime",
    "hip": "bell",
    "marker_offset_m": 0.012,
    "plate_delay_s": 0.01,
    "contact_threshold_n": 60.0,
    "min_valid_share": 0.95,
    "events": "zeni",
}


def lowered(markers):
    """All markers 4 mm lower."""
    return replace(markers, position=markers.position - [0.0, 0.0, 0.004])


GAINS, NONE = np.diag([1.0, 1.0, 1.03, 1.0, 1.0, 1.0]), np.zeros((6, 6))
PLACE = WALK.walk.plates[1].center
WEAK = PlateCalibration(2, GAINS, NONE[0], NONE, PLACE, ("Fz",), delay_s=0.004)
CORRECTED = Laboratory(
    Treadmill(), plates=PlateCorrection("plates.json", "", PlateCalibrations((WEAK,)))
)
INPUTS = {
    "laboratory": CORRECTED,
    "static": replace(WALK.static, plates=mended_plates(WALK.static.plates, ["2: gain Fz 1.02"])),
    "no static": None,
    "subject": Subject(sex="male", mass_kg=1.02 * MASS_KG),
    "sex": Subject(sex="female"),
    "contacts": (PlateContact(plate=2, time_s=1.6, foot="right"),),
    "condition": Condition(window="recording"),
    "static_window_s": (0.2, 0.9),
    "segments": {"right_foot": SegmentOverride(mass_kg=1.4)},
    "recording": replace(WALK.walk, markers=lowered(WALK.walk.markers)),
    "static markers": replace(WALK.static, markers=lowered(WALK.static.markers)),
}
PLATES = ("3: move y 0.03", "1: exchange 2")


def fresh(settings=None, **inputs):
    """A chain of which nothing is computed yet."""
    usual = {"recording": WALK.walk, "static": WALK.static, "subject": Subject(sex="male")}
    return Chain(Inputs(**usual | inputs), settings or Settings())


@pytest.fixture(scope="module")
def chain():
    """One of which every stage is computed, those that a residual needs and those of a result."""
    whole = fresh()
    result_of(whole)
    for stage in DEPENDS_ON:
        getattr(whole, stage)
    return whole


def assert_as_fresh(changed, anew):
    assert_identical(result_of(changed), result_of(anew))
    np.testing.assert_array_equal(changed.residual, anew.residual)
    np.testing.assert_array_equal(changed.counts, anew.counts)


def test_every_setting_is_changed_here():
    assert {*SETTINGS} == {*Settings.model_fields}


@pytest.mark.parametrize("name", SETTINGS)
def test_a_chain_with_another_setting_is_as_a_fresh_one(chain, name):
    settings = Settings(**{name: SETTINGS[name]})
    assert_as_fresh(chain.changed(settings=settings), fresh(settings))


@pytest.mark.parametrize("name", INPUTS)
def test_a_chain_with_another_input_is_as_a_fresh_one(chain, name):
    field = {"no static": "static", "static markers": "static", "sex": "subject"}.get(name, name)
    change = {field: INPUTS[name]}
    assert_as_fresh(chain.changed(**change), fresh(**change))


@pytest.mark.parametrize("mending", PLATES)
def test_a_chain_with_other_plates_is_as_a_fresh_one(chain, mending):
    recording = replace(WALK.walk, plates=mended_plates(WALK.walk.plates, [mending]))
    assert_as_fresh(chain.changed(recording=recording), fresh(recording=recording))


def test_a_chain_changed_twice_is_as_a_fresh_one(chain):
    settings, subject = Settings(cutoff_hz=8.0), Subject(sex="male", mass_kg=1.02 * MASS_KG)
    twice = chain.changed(settings=settings).changed(subject=subject)
    assert_as_fresh(twice, fresh(settings, subject=subject))
    assert_as_fresh(twice.changed(settings=Settings()), fresh(subject=subject))


@pytest.mark.parametrize("name", ["contacts", "condition", "recording"])
def test_a_stage_that_is_given_stays_and_the_others_are_as_in_a_fresh_chain(chain, name):
    given = fresh().changed(body=chain.body)
    changed = chain.changed(body=chain.body).changed(**{name: INPUTS[name]})
    assert changed.body is chain.body
    assert_as_fresh(changed, given.changed(**{name: INPUTS[name]}))


@pytest.fixture(scope="module")
def following():
    whole = fresh(
        recording=replace(WALK.walk, options=ReadOptions(mend_plates=("1: drift", "2: drift")))
    )
    result_of(whole)
    return whole


@pytest.mark.parametrize(
    "change",
    [
        *({"settings": Settings(**{n: SETTINGS[n]})} for n in ("filter", "hip", "plate_delay_s")),
        *({n.split()[0]: INPUTS[n]} for n in ("laboratory", "static markers", "subject")),
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_chain_that_follows_zeros_is_as_a_fresh_one(following, change):
    followed = following.inputs.recording
    assert_as_fresh(following.changed(**change), fresh(**{"recording": followed} | change))


BODY = {"mass", "body", "solved", "pose", "labels"}
GROUND = {"trial", "lab", "ground"}


@pytest.mark.parametrize(
    ("change", "kept", "anew"),
    [
        ({"settings": Settings(cutoff_hz=8.0)}, {"body", "solved", "lab"}, {"pose", "ground"}),
        ({"settings": Settings(plate_delay_s=0.01)}, BODY | {"trial"}, {"lab", "loads", "gait"}),
        ({"settings": Settings(hip="bell")}, GROUND | {"mass"}, {"body", "loads"}),
        ({"settings": Settings(min_valid_share=0.95)}, BODY | GROUND | {"gait"}, {"window"}),
        ({"settings": Settings(events="zeni")}, BODY | GROUND | {"judged"}, {"gait", "window"}),
        ({"condition": INPUTS["condition"]}, BODY | GROUND | {"gait", "loads"}, {"window"}),
        ({"contacts": INPUTS["contacts"]}, GROUND | {"settling"}, {"loads", "window"}),
        ({"laboratory": CORRECTED}, {"raw_faults"}, {"trial", "ground"}),
        ({"subject": INPUTS["subject"]}, GROUND | {"raw_faults"}, {"mass", "body", "loads"}),
        ({"static": INPUTS["static"]}, GROUND | {"raw_faults"}, {"standing", "mass"}),
    ],
)
def test_what_does_not_depend_on_a_change_is_kept(chain, change, kept, anew):
    changed = chain.changed(**change)
    held = {name for name in DEPENDS_ON if changed.__dict__.get(name) is chain.__dict__[name]}
    assert kept <= held
    assert not anew & held


def test_every_stage_is_named_with_what_it_depends_on(chain):
    """Each is either a stage, a setting, or an input, with or without one of its fields."""
    others = {*DEPENDS_ON, *(f"settings.{name}" for name in Settings.model_fields)}
    for names in DEPENDS_ON.values():
        for name in {*names.split()} - others:
            first, _, rest = name.partition(".")
            value = getattr(chain.inputs, first)
            assert not rest or hasattr(value, rest), name


MENDED = (
    ["2: gain Fz 1.1"],
    ["1: reverse Fx", "2: move y 0.02"],
    ["1: exchange 2"],
    ["3: drift", "1: gain Fz 0.99"],
)


@pytest.fixture(scope="module", params=[MASS_KG, None], ids=["stated mass", "weighed mass"])
def faulty(request):
    """A chain of a subject whose mass is stated or weighed, as far as a result needs it."""
    whole = fresh(subject=Subject(sex="male", mass_kg=request.param))
    result_of(whole)
    return whole


@pytest.mark.parametrize("mendings", MENDED, ids="; ".join)
def test_mended_plates_are_those_of_a_recording_read_with_what_was_stated(faulty, mendings):
    mended, reading = faulty.mended(mendings), stating(faulty, mendings)
    assert (mended.body is faulty.body) == (mended.mass.mass_kg == faulty.mass.mass_kg)
    one, other = result_of(mended), result_of(reading)
    said = {note for note in other.notes if note.code == "plates_mended"}
    assert one.notes == tuple(note for note in other.notes if note not in said)
    assert_identical(one, replace(other, notes=one.notes))
    np.testing.assert_array_equal(mended.residual, reading.residual)


def stating(chain, mendings):
    """A fresh chain of the recordings as they are read with stated mendings."""
    typed = ReadOptions(mend_plates=tuple(mendings))
    recordings = (chain.inputs.recording, chain.inputs.static)
    walk, static = (with_mended_plates(replace(one, options=typed)) for one in recordings)
    return fresh(chain.settings, recording=walk, static=static, subject=chain.inputs.subject)


@pytest.mark.parametrize("mass_kg", [MASS_KG, None], ids=["stated mass", "weighed mass"])
@pytest.mark.parametrize(
    "fault",
    [
        lambda walk: amplified(walk, 2, 0, -1.0),
        lambda walk: amplified(walk, 1, 0, 0.35),
        lambda walk: channel(walk, 1, 4, overflowing(0.6)),
        lambda walk: turned(walk, 1, 180, corners=False),
        lambda walk: exchanged(walk, 0, 1),
        lambda walk: moved(walk, 0, np.array([0.1, 0.0, 0.0])),
    ],
    ids=["reversed", "gain", "wraps", "turned", "exchanged", "moved"],
)
def test_a_correction_typed_as_printed_does_what_was_printed(fault, mass_kg):
    subject = Subject(sex="male", mass_kg=mass_kg)
    faulty = fresh(recording=fault(WALK.walk), subject=subject)
    result = result_of(faulty)
    tried = [f.correction for f in result.findings if f.correction and f.correction.helps]
    assert tried
    said = [note_of(finding, result.plates, result.motion.time) for finding in result.findings]
    assert [note for note in result.notes if note in said] == said
    printed = " ".join(note.advice for note in result.notes)
    typed = re.findall(r'--mend-plates "([^"]+)"', printed)
    assert typed == [mending for correction in tried for mending in correction.mendings]
    mended = stating(faulty, typed)
    rows = mended.counts & np.isfinite(faulty.residual + mended.residual).all(axis=1)
    rms = np.sqrt(np.mean(np.square(mended.residual[rows]), axis=0))
    np.testing.assert_allclose(rms, tried[-1].after, rtol=1e-9)
