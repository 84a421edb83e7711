"""The dynamic model is taken where it is clearly and safely better, and the reason is said."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import fit_inertia
from compensation.inertia.calibration import Calibration, from_json, to_json
from compensation.inertia.choice import choose, weigh_beside
from tests.compensation.inertia.test_dynamic import SETUP, trial


@pytest.fixture(scope="module")
def recordings():
    """Samples of a plate on soft load cells and of one on stiff ones: calibration and another."""
    return {hz: [(f"{n}.c3d", {"plate 1": trial(n, hz)}) for n in range(2)] for hz in (35.0, None)}


def chosen(recordings, stated="auto", checks=(), setup=SETUP):
    channels, wrench = recordings[0][1]["plate 1"]
    static = {"plate 1": fit_inertia(channels[:, :6], wrench, setup)}
    return static, *choose(recordings[:1], static, checks, stated)


def test_a_machine_that_bends_gets_the_dynamic_model(recordings):
    _, reason, models = chosen(recordings[35.0], checks=recordings[35.0][1:])
    assert reason.startswith("dynamic model: ")
    assert models["plate 1"].lags_s


def test_one_kind_of_motion_does_not_show_how_the_dynamic_model_does_in_others(recordings):
    _, reason, models = chosen(recordings[35.0])
    assert "one kind" in reason
    assert models == {}


def test_a_loss_in_any_component_of_other_motion_keeps_the_static_model(recordings):
    channels, wrench = recordings[35.0][1][1]["plate 1"]
    bad = channels.copy()
    bad[:, 6:] += np.random.default_rng(0).normal(0, 2, bad[:, 6:].shape)
    _, reason, models = chosen(recordings[35.0], checks=[("bad.c3d", {"plate 1": (bad, wrench)})])
    assert "of bad.c3d" in reason
    assert models == {}


def test_a_stated_model_is_taken(recordings):
    _, reason, models = chosen(recordings[35.0], "static", recordings[35.0][1:])
    assert (reason.partition(": ")[0], models) == ("static model, as given", {})
    _, _, models = chosen(recordings[None], "dynamic")
    assert list(models) == ["plate 1"]


def test_the_dynamic_model_survives_the_file(recordings):
    static, _, models = chosen(recordings[35.0], checks=recordings[35.0][1:])
    calibration = Calibration(static, {}, dynamic=models)
    read = from_json(to_json(calibration), SETUP)
    assert read.in_use is read.dynamic
    channels, _ = trial(3, 35.0)
    np.testing.assert_array_equal(
        read.dynamic["plate 1"].predict(channels), models["plate 1"].predict(channels)
    )
    assert replace(calibration, dynamic={}).in_use["plate 1"] is static["plate 1"]
    with pytest.raises(ValueError, match="dynamic model of every"):
        replace(calibration, plates=static | {"plate 2": static["plate 1"]})


def test_people_whose_shaking_the_sensors_do_not_show_weigh_little(recordings):
    """They shake the plate by a force of which the accelerometers show nothing that is its own."""
    (felt, wrench), (other, _) = (one["plate 1"] for _, one in recordings[None])
    alike = [("empty.c3d", {"plate 1": (felt, wrench)})]
    assert weigh_beside([*alike, ("same.c3d", {"plate 1": (felt, wrench)})], SETUP)[0] == 1.0
    shaken = 2 * wrench[: len(other)]
    weight, why = weigh_beside([*alike, ("b.c3d", {"plate 1": (felt, shaken)})], SETUP)
    assert weight < 1
    assert "times as large" in why


@pytest.mark.parametrize("hz", [35.0, None])
def test_as_few_samples_as_hold_the_filtered_signal_choose_as_all_of_them_do(recordings, hz):
    """Without a stated cut-off every sample counts; with it, every second one."""
    by_setup = [
        (
            *chosen(recordings[hz], checks=recordings[hz][1:], setup=setup)[1:],
            weigh_beside(recordings[hz], setup),
        )
        for setup in (SETUP, replace(SETUP, cutoff_hz=None))
    ]
    (reason, models, weight), (of_all, models_of_all, weight_of_all) = by_setup
    assert (reason, [*models], weight) == (of_all, [*models_of_all], weight_of_all)
