"""Speed, cadence, steps and stance are those of walks of which they are known."""

import numpy as np
import pytest

import pipeline
from pipeline.io.recording import Event
from pipeline.trial.gait.carried import places_of
from pipeline.trial.gait.spatiotemporal import QUANTITIES, spatiotemporal
from pipeline.trial.joints import joint_spans
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial

CYCLE_S, STANCE_S, STRIDE_M, WIDTH_M = 1.0, 0.6, 1.4, 0.12
TIME = np.arange(500) / 100


def events():
    return tuple(
        Event(round(k + delay + shift, 3), label, side)
        for side, shift in (("left", 0.0), ("right", 0.5))
        for k in range(5)
        for label, delay in (("foot_strike", 0.0), ("foot_off", STANCE_S))
    )


def stepping(belt_mps=0.0, turned_rad=0.0, wander_m=0.0):
    """Feet that rest for the stance and reach their next foothold straight, on a belt or not."""
    places = np.zeros((len(TIME), 4, 3))
    for foot, shift in enumerate((0.0, 0.5)):
        cycle, phase = np.divmod(TIME - shift, CYCLE_S)
        swing = np.clip((phase - STANCE_S) / (CYCLE_S - STANCE_S), 0, 1)
        forward = STRIDE_M * (cycle + swing + shift)
        side = WIDTH_M / 2 * (1 if foot == 0 else -1)
        for point in (foot, foot + 2):
            places[:, point, 0] = forward
            places[:, point, 1] = side
    c, s = np.cos(turned_rad), np.sin(turned_rad)
    places[..., :2] = places[..., :2] @ np.array([[c, s], [-s, c]])
    places[..., 0] -= (belt_mps * TIME)[:, None]
    return places


@pytest.mark.parametrize(("belt_mps", "turned_rad"), [(0.0, 0.0), (1.4, 0.0), (0.0, 2.0)])
def test_steps_are_measured_on_the_ground_whether_it_moves_or_not_in_any_direction(
    belt_mps, turned_rad
):
    spans = {"left": np.array([[1.0, 2.0], [2.0, 3.0]]), "right": np.array([[1.5, 2.5]])}
    measured = spatiotemporal(TIME, stepping(belt_mps, turned_rad), events(), spans)
    known = [STRIDE_M / CYCLE_S, 120.0, STRIDE_M / 2, WIDTH_M, 60.0]
    for side, values in measured.items():
        np.testing.assert_allclose(values, [known] * len(spans[side]), atol=1e-9)


def test_what_events_do_not_show_is_unknown():
    spans = {"left": np.array([[1.0, 2.0]])}
    strikes = [event for event in events() if event.label == "foot_strike"]
    (values,) = spatiotemporal(TIME, stepping(), strikes, spans)["left"]
    assert {name for name, value in zip(QUANTITIES, values, strict=True) if np.isfinite(value)} == {
        "cadence"
    }


def measured(result):
    feet = places_of(result.body, result.motion.q)[:, 1:]
    return spatiotemporal(result.motion.time, feet, result.events, joint_spans(result))


def test_a_simulated_walk_has_the_speed_of_its_belt_and_steps_that_add_up_to_it(tmp_path):
    simulate_trial(tmp_path / "walk.c3d", duration_s=14.0, speed_mps=1.3)
    walk = pipeline.read_c3d(tmp_path / "walk.c3d")
    result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    spans = joint_spans(result)
    for side, values in measured(result).items():
        inside = spans[side][:, 0] > 7.0  # the belts run at full speed after 6 s
        speed, cadence, length, width, stance = values[inside].mean(axis=0)
        assert speed == pytest.approx(1.3, rel=0.02)
        assert length == pytest.approx(1.3 * 60 / cadence, rel=0.05)
        assert 0.0 < width < 0.25
        assert 55 < stance < 66


def test_a_real_walk_on_a_treadmill_is_plausible(shared_data):
    path = shared_data / "treadmill_hbm2" / "treadmill_events.c3d"
    result = pipeline.process_recording(
        pipeline.read_c3d(path), pipeline.Subject(), pipeline.Settings()
    )
    left, right = (values.mean(axis=0) for values in measured(result).values())
    np.testing.assert_allclose(left[:3], right[:3], rtol=0.03)
    speed, cadence, length, width, stance = right
    assert speed == pytest.approx(1.1, abs=0.03)  # the balls of the feet that stand on the belt
    assert length == pytest.approx(speed * 60 / cadence, rel=0.02)
    assert 0.03 < width < 0.2
    assert 60 < stance < 66
