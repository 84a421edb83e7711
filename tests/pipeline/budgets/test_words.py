"""A cause is said with its size, its unit and what to do, and only where it is sure."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.budgets.explanation import Explanation
from pipeline.budgets.words import (
    MASS,
    WITH_MARKERS,
    budget_lines,
    budget_table,
    size_in_words,
    what_to_do,
    what_to_fix_first,
)
from pipeline.config.schema import Settings, Subject
from pipeline.explain.budget import Budget, EstimatedCause, GroupShare, alike_in_plates
from pipeline.report.blocks import templates
from pipeline.report.trials import causes
from pipeline.trial.result import Procedure

CAUSE = EstimatedCause("x", "gain", "1", 0.012, 0.001, 0.01, 1.0, np.ones(6))


@pytest.mark.parametrize(
    ("unit", "size", "deviation", "words"),
    [
        ("m", -0.0025, 0.0002, "−2.50 ± 0.39 mm"),
        ("rad", 0.0174533, 0.0174533, "1.0 ± 2.0 °"),
        ("1", 0.5, 0.1, "50 ± 20 %"),
    ],
)
def test_sizes_are_in_units_that_people_read(unit, size, deviation, words):
    assert size_in_words(replace(CAUSE, unit=unit, size=size, deviation=deviation)) == words


def budget(*causes):
    axes = np.ones(6)
    return Budget("walk.c3d", False, 2 * axes, axes, 3 * axes, 9, 9, (), axes, causes, axes, ())


UNCALIBRATED = SimpleNamespace(
    procedure=Procedure(),
    settings=Settings(),
    body=SimpleNamespace(mass=70.7),
    subject=Subject(),
)
"""What a trial was processed with."""


CALIBRATED = SimpleNamespace(
    **{**vars(UNCALIBRATED), "procedure": Procedure(plate_calibration="plates.json")}
)


def test_a_mass_is_advised_as_the_scales_would_show_it():
    (found,) = what_to_fix_first(budget(replace(CAUSE, name=MASS, size=0.01)), UNCALIBRATED)
    assert re.search("1.00 ± 0.20 % too large; weigh .*70.0 kg", found.action)


def test_a_delay_that_a_calibration_gives_is_not_stated_a_second_time():
    late = replace(CAUSE, name="plates delayed", group="delay", unit="s")
    (found,) = what_to_fix_first(budget(late), CALIBRATED)
    assert found.action.startswith("Measure the plates' delay")
    assert "12.0 ± 2.0 ms" in found.action


@pytest.mark.parametrize(
    "changed",
    [{"deviation": 0.01}, {"left": 2 * np.ones(6)}, {"group": "skin"}, {"group": "unseen_trunk"}],
    ids=["may be zero", "changes no residual", "nothing to do", "only markers help"],
)
def test_what_is_not_sure_or_changes_nothing_is_not_worth_mending(changed):
    own = budget(replace(CAUSE, **changed))
    assert what_to_fix_first(own, UNCALIBRATED) == ()


def test_a_fault_is_said_with_its_plate_size_and_what_to_do_in_twenty_words():
    left = np.array([2, 2, 1.4, 2, 2, 2])
    gain = replace(CAUSE, name="plate 1: gain of Fz", size=0.029, deviation=0.003, left=left)
    (found,) = what_to_fix_first(budget(gain), UNCALIBRATED)
    first, second = str(found).split(". ", 1)
    assert re.match("Plate 1 .*2.90 ± 0.59 % too much vertically; recalibrate", first)
    assert "Fz from 2.0 to 1.4" in second
    for name in ("zero of Fx", "Fz in Fy", "place along x", "direction about z"):
        cause = replace(gain, name=f"plate 2: {name}", size=-0.029)
        (found,) = what_to_fix_first(budget(cause), UNCALIBRATED)
        assert found.action.startswith("Plate 2")
        assert len(found.action.split()) <= 20


@pytest.mark.parametrize(
    ("groups", "said"),
    [
        (
            ("unseen_trunk",),
            "Trunk without markers: 60 ± 20 % of Fx; put markers on the trunk (C7, T10, sternum).",
        ),
        (
            ("unseen_trunk", "unseen_arms"),
            "Trunk without markers, or arms without markers: 60 ± 20 % of Fx; "
            "put markers on the trunk (C7, T10, sternum); put markers on elbows and wrists.",
        ),
        (("markers", "unseen_trunk"), None),
        (("markers",), None),
    ],
)
def test_what_moves_unseen_and_surely_counts_is_to_get_markers(groups, said):
    share = np.array([0.6, 0.3, 0.0, 0.0, 0.5, 0.0])
    whole = replace(budget(), groups=(GroupShare(groups, share, np.full(6, 0.1 / 0.98)),))
    lines = [line for line in budget_lines(whole, ()) if " % of Fx; " in line]
    assert lines == ([said] if said else [])


@pytest.mark.parametrize(
    ("size_kg", "stated", "acts"), [(0.3, False, True), (-0.3, False, False), (-0.3, True, True)]
)
def test_a_shoe_is_to_be_weighed_unless_none_is_stated_and_none_is_missing(size_kg, stated, acts):
    shoes = replace(CAUSE, name="shoes: missing mass", group="shoes", unit="kg", size=size_kg)
    known = {**vars(UNCALIBRATED), "subject": Subject(shoe_mass_kg=0.4 if stated else None)}
    action = what_to_do(shoes, SimpleNamespace(**known))
    assert action.startswith("Weigh one shoe") == acts
    assert bool(action) == acts


@pytest.mark.parametrize(("group", "said"), [("unseen_arms", True), ("skin", False)])
def test_an_interval_that_is_of_a_residual_with_more_markers_is_said_to_be(group, said):
    lines = budget_lines(budget(CAUSE, replace(CAUSE, group=group)), ())
    assert (WITH_MARKERS in lines) == said


def test_faults_that_a_trial_does_not_tell_are_named():
    unknown = replace(CAUSE, name="plate 1: gain of Mz", deviation=0.05, chance=0.5)
    told = replace(CAUSE, name="plate 1: gain of Fz", chance=0.2)
    said = list(budget_lines(budget(unknown, told), ()))
    (line,) = (line for line in said if "1 of 2" in line)
    assert line.endswith(": gain of Mz.")


def test_gains_alike_in_all_plates_are_not_certain():
    left = np.array([2, 2, 2, 2, 1.4, 2])
    gain = replace(CAUSE, size=0.06, left=left)
    both = budget(*(replace(gain, name=f"plate {k}: gain of Mx") for k in (1, 2)))
    assert what_to_fix_first(both, UNCALIBRATED) == ()
    first, second, *_ = budget_lines(both, ())
    assert "no certain fault" in first
    assert re.match("Not certain: gain of Mx .*alike, plate 1 6.00 ± 0.20 %", second)
    assert "shoes" in second


def test_gains_are_alike_along_the_same_direction_of_the_lab_whatever_the_plates_call_it():
    left = np.array([2, 2, 2, 2, 1.4, 2])
    pitch = replace(CAUSE, size=0.06, left=left, in_lab="pitch moment")
    turned = [replace(pitch, name=f"plate {k}: gain of {m}") for k, m in ((1, "Mx"), (2, "My"))]
    _, second, *_ = budget_lines(budget(*turned), ())
    assert re.match(r"Not certain: .*Mx, .*My \(pitch moment .*alike", second)
    apart = budget(turned[0], replace(turned[1], in_lab="roll moment", chance=0.3))
    assert alike_in_plates(apart.causes) == {turned[0].name: [turned[0]]}


@pytest.mark.parametrize("fault", ["gain of Mx", "zero of Mx"])
def test_a_fault_of_a_component_says_what_the_component_is_in_the_lab(fault):
    cause = replace(CAUSE, name=f"plate 1: {fault}", in_lab="pitch moment")
    assert "Mx (pitch moment" in what_to_do(cause, UNCALIBRATED)


def test_the_size_of_a_cause_that_the_trial_does_not_tell_is_unknown():
    share = GroupShare(("delay",), 0.1 * np.ones(6), np.zeros(6))
    for deviation, expected in ((0.002, "9.0 ± 3.9 ms"), (0.010, "unknown")):
        cause = EstimatedCause(
            "plates delayed", "delay", "s", 0.009, deviation, 0.01, 0.5, np.ones(6)
        )
        _, _, columns = budget_table(
            replace(budget(cause), source=Path("walk.c3d"), groups=(share,))
        )
        assert columns[2][0] == f"plates' delay: {expected}"


def test_gains_alike_that_change_no_residual_are_not_worth_a_word():
    gain = replace(CAUSE, size=0.06, left=np.full(6, 1.96))
    both = budget(*(replace(gain, name=f"plate {k}: gain of Mz") for k in (1, 2)))
    first, *_ = budget_lines(both, ())
    assert "no certain fault" in first


def test_a_cause_that_the_other_half_contradicts_is_not_to_be_mended():
    both = budget(replace(CAUSE, name="plate 1: gain of Fz"))
    assert what_to_fix_first(both, UNCALIBRATED)
    assert not what_to_fix_first(replace(both, held_out=-0.3 * np.ones(6)), UNCALIBRATED)


def test_a_gain_of_the_only_plate_may_be_the_body_model_but_not_one_of_fz():
    left = np.array([2, 2, 2, 2, 1.4, 2])
    only = budget(replace(CAUSE, name="plate 1: gain of My", size=0.06, left=left))
    assert what_to_fix_first(only, UNCALIBRATED) == ()
    _, second, *_ = budget_lines(only, ())
    assert re.match("Not certain: gain of My .*only plate, plate 1 6.00 ± 0.20 %", second)
    (found,) = what_to_fix_first(
        budget(replace(only.causes[0], name="plate 1: gain of Fz")), UNCALIBRATED
    )
    assert found.action.startswith("Plate 1 reads")


def test_shares_are_drawn_as_intervals_on_one_scale_that_holds_zero_and_all():
    """From one group to the next and over all axes; what reaches far beyond ends at the border."""
    shares = np.array([-0.2, 0.0, 0.25, 0.5, 1.0, 1.6])
    groups = (
        GroupShare(("delay",), shares, np.full(6, 0.05)),
        GroupShare(("zero",), shares[::-1], np.full(6, 3.0)),
    )
    of_trial = replace(budget(CAUSE), source=Path("walk.c3d"), groups=groups)
    _, table = causes("walk", Explanation("", of_trial, ()))
    drawn = {head: cells for head, *cells in table.rows if not isinstance(cells[0], str)}
    sure, unsure, rest = drawn.values()
    low, middle, high, zero, whole = np.transpose(
        [[float(place.rstrip("%")) for place in cell.places] for cell in (*sure, *unsure, *rest)]
    )
    assert len({*zero}) == len({*whole}) == 1
    np.testing.assert_allclose(middle[:6], zero[0] + shares * (whole[0] - zero[0]), atol=0.15)
    np.testing.assert_allclose(middle[6:12], middle[5::-1])
    half = 1.96 * 0.05 * (whole[0] - zero[0])
    np.testing.assert_allclose(high[:6] - middle[:6], half, atol=0.2)
    assert (np.stack([low, high]) >= 0).all()
    assert (np.stack([low, high]) <= 100).all()
    assert np.ptp(low[6:12]) == np.ptp(high[6:12]) == 0  # both ends are beyond the border
    assert sure[2].text == "25 ± 10 %"
    shown = re.sub("<[^>]+>", "", str(templates().get_template("blocks.html").module.table(table)))
    assert "25 ± 10 %" in shown  # for those who do not see the dots
    once = replace(of_trial, cycles=1, found_cycles=1)
    assert re.search(r"\b1 of 1 gait cycle\b", budget_table(once)[0])
