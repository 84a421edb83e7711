"""What is wrong with markers and plates is noted as it arises, and what is right is not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.config.schema import Settings, Subject
from pipeline.live.frames.frame import LiveFrame, Quality
from pipeline.live.watch.delay import DelayWatch
from pipeline.live.watch.fit import FitWatch
from pipeline.live.watch.markers import GONE_S, MarkerGaps
from pipeline.live.watch.plates import PlateWatch
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import reported
from tests.pipeline import lab

MASS_KG = 70.0
STEP_S = 0.001


def walking(minutes, drift_n_per_min=0.0, rest_n=0.0, rate_hz=250):
    """A plate's load of a foot that is on it 60 % of the time, with noise: (N,) and (N, 6)."""
    time = np.arange(round(60 * minutes * rate_hz)) / rate_hz
    phase = time % 1.1 / 1.1
    load = np.where(phase < 0.6, 700 * np.sin(np.pi * phase / 0.6).clip(0) ** 0.3, 0.0)
    wrench = np.random.default_rng(3).normal(0, 1, (len(time), 6))
    wrench[:, 2] += load + rest_n + drift_n_per_min * time / 60
    return time, wrench


def noted(watch, time, wrench, each=25):
    parts = [slice(k, k + each) for k in range(0, len(time), each)]
    return [note for part in parts for note in watch.add(time[part], wrench[part])]


def test_a_good_plate_is_not_noted():
    assert noted(PlateWatch(1, MASS_KG), *walking(3)) == []


@pytest.mark.parametrize("drift", [3.0, -5.0])
def test_a_plate_that_drifts_is_noted_with_its_drift(drift):
    first, *_ = noted(PlateWatch(2, MASS_KG), *walking(3, drift))
    assert (first.code, first.values["plate"]) == ("live_plate_drifts", 2)
    assert first.values["drift_n_per_min"] == pytest.approx(drift, rel=0.1)


def test_drift_is_noted_once_a_minute_at_most():
    notes = noted(PlateWatch(1, MASS_KG), *walking(4, 2.0))
    assert 1 <= len(notes) <= 3


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_plate_that_is_not_zero_is_noted_within_seconds(up):
    """As a load, whether its z axis points up or down."""
    time, wrench = walking(0.4, rest_n=14.0)
    first, *_ = noted(PlateWatch(1, MASS_KG, up), time, up * wrench)
    assert first.code == "live_plate_not_zero"
    assert first.values["rest_n"] == pytest.approx(14.0, abs=0.5)


def test_a_saturated_component_is_noted_once_with_its_limit():
    time, wrench = walking(0.5)
    wrench[:, 2] = wrench[:, 2].clip(None, 600.0)
    (note,) = noted(PlateWatch(1, MASS_KG), time, wrench)
    assert note.values == {"plate": 1, "component": "Fz", "value": 600.0}


def test_a_converters_steps_are_no_saturation_at_rest_and_of_one_who_stands():
    time, wrench = walking(0.5)
    assert noted(PlateWatch(1, MASS_KG), time, wrench.round()) == []
    assert noted(PlateWatch(1, MASS_KG), time, np.full((len(time), 6), 350.0)) == []


@given(gone=st.integers(0, 100), each=st.integers(1, 30))
def test_a_marker_is_noted_once_for_each_time_that_it_is_gone_for_long(gone, each):
    position = np.ones((300, 2, 3))
    position[50 : 50 + gone, 1] = np.nan
    position[200:230, 0] = np.nan  # shorter
    gaps, notes, time = MarkerGaps(["LASIS", "RASIS"]), [], np.arange(300) / 100
    for k in range(0, 300, each):
        notes += gaps.add(time[k : k + each], position[k : k + each])
    assert [note.values["marker"] for note in notes] == ["RASIS"] * (gone >= 100 * GONE_S)
    assert gaps.missing.tolist() == [30, gone]


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """A walk of 35 s, in which plates can be later."""
    return lab.walk(tmp_path_factory.mktemp("watch"), duration_s=35.0)


def frames_of(recording):
    result = process_recording(recording, Subject(sex="female"), Settings(filter="realtime"))
    residual = reported(result.measured.residual)
    ground = np.stack([result.ground["measured"][f"{s}_foot"] for s in ("left", "right")], 1)
    for k, time in enumerate(result.motion.time):
        yield LiveFrame(
            number=k,
            time=float(time),
            q=result.motion.q[k],
            tau={},
            residual={"measured": residual[k]},
            by_foot={"measured": ground[k]},
            contact=ground[k, :, 2] > 30,
            marker_error=result.motion.marker_error[k],
            quality=Quality(0) if result.validity.counts[k] else Quality.SETTLING,
            computing_s=0.0,
        )


@pytest.mark.parametrize("late_s", [0.0, 0.012])
def test_plates_that_are_late_are_noted_and_others_are_not(walk, late_s):
    plates = tuple(replace(p, time=p.time + late_s) for p in walk.plates)
    watch, notes = DelayWatch(), []
    for frame in frames_of(replace(walk, plates=plates)):
        notes += watch.add(frame)
    if not late_s:
        assert notes == []
        return
    assert [note.code for note in notes[:1]] == ["live_plates_late"]
    assert notes[0].values["delay_s"] == pytest.approx(late_s, abs=0.003)


def fitted(error_m, quality, seen=True, count=500):
    """Frames at 100 Hz with two markers of such errors; NaN where one is not used."""
    for k in range(count):
        yield LiveFrame(
            number=k,
            time=k / 100,
            q=np.zeros(46),
            tau={},
            residual={},
            by_foot={},
            contact=np.zeros(2, bool),
            marker_error=np.array(error_m),
            quality=quality,
            computing_s=0.0,
            markers=np.full((2, 3), 1.0 if seen else np.nan),
        )


@pytest.mark.parametrize(
    ("frames", "codes", "left_out"),
    [
        (fitted([0.012, 0.008], Quality(0)), [], None),
        (fitted([0.03, 0.03], Quality(0)), ["live_markers_misfit"], "none"),
        (fitted([0.003, np.nan], Quality.MARKERS_LEFT_OUT), ["live_markers_misfit"], "RASIS"),
        (fitted([0.003, np.nan], Quality(0), seen=False), [], None),
        (fitted([np.nan, np.nan], Quality.POSE_UNKNOWN, seen=False), [], None),
        (fitted([0.003, 0.003], Quality.FOOT_UNCERTAIN), ["live_foot_uncertain"], None),
    ],
)
def test_markers_that_do_not_fit_and_feet_beside_the_pressure_are_noted_once(
    frames, codes, left_out
):
    watch = FitWatch(["LASIS", "RASIS"], [0, 1])
    notes = [note for frame in frames for note in watch.add(frame)]
    assert [note.code for note in notes] == codes
    if left_out:
        assert notes[0].values["left_out"] == left_out
