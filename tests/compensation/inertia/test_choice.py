"""The dynamic model is taken where it is clearly and safely better, and the reason is said."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import fit_inertia
from compensation.inertia.calibration import Calibration, from_json, to_json
from compensation.inertia.choice import Choice, Comparison, choose, choose_model
from tests.compensation.inertia.test_dynamic import SETUP, trial

ONE = np.ones((1, 2, 6))


def compared(static, dynamic, recording="empty.c3d"):
    return Comparison(recording, static * ONE, dynamic * ONE)


@pytest.fixture(scope="module")
def recordings():
    """Samples of a plate on soft load cells and of one on stiff ones: calibration and another."""
    return {hz: [(f"{n}.c3d", {"plate 1": trial(n, hz)}) for n in range(2)] for hz in (35.0, None)}


def chosen(recordings, stated="auto", checks=()):
    channels, wrench = recordings[0][1]["plate 1"]
    static = {"plate 1": fit_inertia(channels[:, :6], wrench, SETUP)}
    return static, *choose(recordings[:1], static, checks, stated)


def test_a_rigid_machine_keeps_the_static_model(recordings):
    _, choice, models = chosen(recordings[None], checks=recordings[None][1:])
    assert (choice.model, models) == ("static", {})


def test_a_machine_that_bends_gets_the_dynamic_model(recordings):
    _, choice, models = chosen(recordings[35.0], checks=recordings[35.0][1:])
    assert choice.model == "dynamic"
    assert models["plate 1"].lags_s
    assert "held-out parts of 0.c3d" in choice.reason
    assert "of 1.c3d the dynamic one leaves" in choice.reason


def test_a_stated_model_is_taken_and_the_better_one_named(recordings):
    _, choice, models = chosen(recordings[35.0], "static", recordings[35.0][1:])
    assert (choice.model, choice.better, models) == ("static", "dynamic", {})
    assert choice.note.code == "calibration_model_stated"
    _, choice, models = chosen(recordings[None], "dynamic")
    assert (choice.model, choice.better, list(models)) == ("dynamic", "static", ["plate 1"])


def test_a_short_recording_keeps_the_static_model_without_judging(recordings):
    channels, wrench = recordings[35.0][0][1]["plate 1"]
    _, choice, _ = chosen([("short.c3d", {"plate 1": (channels[:240], wrench[:240])})])
    assert choice.model == "static"
    assert "too short" in choice.reason


@pytest.mark.parametrize(
    ("own", "others", "model", "why"),
    [
        ((6, 2), ((6, 2),), "dynamic", "leaves"),
        ((6, 2), (), "static", "of one kind of motion"),
        ((6, 5.5), ((6, 5.5),), "static", "no clear gain"),
        ((6, 5), ((6, 4),), "dynamic", "leaves"),
        ((6, 2), ((6, 6.2),), "static", "no gain"),
        ((6, 2), ((6, 9),), "static", "clearly more of Fx"),
        ((0.1, 0.01), (), "static", "little"),
    ],
)
def test_a_gain_has_to_be_clear_and_nowhere_a_loss(own, others, model, why):
    choice = choose_model([compared(*own)], [compared(*one, "other.c3d") for one in others])
    assert choice.model == model
    assert why in choice.reason


def test_a_component_of_which_hardly_anything_is_left_does_not_count():
    static, dynamic = 6 * ONE, 2 * ONE
    static[0, :, 3:], dynamic[0, :, 3:] = 0.05, 0.1
    one = Comparison("empty.c3d", static, dynamic)
    assert choose_model([one, replace(one, recording="beside.c3d")]).model == "dynamic"


def test_choice_and_dynamic_model_survive_the_file(recordings):
    static, choice, models = chosen(recordings[35.0], checks=recordings[35.0][1:])
    calibration = Calibration(static, {}, dynamic=models, choice=choice)
    read = from_json(to_json(calibration), SETUP)
    assert read.choice == choice
    assert read.in_use is read.dynamic
    channels, _ = trial(3, 35.0)
    np.testing.assert_array_equal(
        read.dynamic["plate 1"].predict(channels), models["plate 1"].predict(channels)
    )
    assert replace(calibration, dynamic={}).in_use["plate 1"] is static["plate 1"]
    with pytest.raises(ValueError, match="a dynamic model of every plate, or of none"):
        replace(calibration, plates=static | {"plate 2": static["plate 1"]})
    other = replace(models["plate 1"], lags_s=[2 * lag_s for lag_s in models["plate 1"].lags_s])
    with pytest.raises(ValueError, match="need the same lags"):
        replace(
            calibration,
            plates=static | {"plate 2": static["plate 1"]},
            dynamic=models | {"plate 2": other},
        )


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(ValueError, match="nothing to compare"):
        choose_model([])
    with pytest.raises(ValueError, match=r"static must be \(plates, 2, 6\)"):
        Comparison("empty.c3d", np.ones(6), np.ones(6))
    with pytest.raises(ValueError, match="same plates"):
        Comparison("empty.c3d", ONE, np.ones((2, 2, 6)))
    with pytest.raises(ValueError, match="static or dynamic"):
        Choice("fast", "static", "")
