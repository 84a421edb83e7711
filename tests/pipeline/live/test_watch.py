"""What is wrong with markers and plates is noted as it arises, and what is right is not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.config.schema import Settings, Subject
from pipeline.live.chain import LiveFrame
from pipeline.live.cycles import GaitTracker
from pipeline.live.light import Finding, Kind
from pipeline.live.monitor import (
    LIMITS,
    DelayWatch,
    FitWatch,
    MarkerGaps,
    WeightWatch,
    plate_watch,
)
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality
from pipeline.trial.subject import differing_masses
from tests.pipeline import lab
from tests.pipeline.live.playing import frames_of

MASS_KG = 70.0


def walking(minutes, rest_n=0.0, rate_hz=250):
    """A plate's load of a foot that is on it 60 % of the time, with noise: (N,) and (N, 6)."""
    time = np.arange(round(60 * minutes * rate_hz)) / rate_hz
    phase = time % 1.1 / 1.1
    load = np.where(phase < 0.6, 700 * np.sin(np.pi * phase / 0.6).clip(0) ** 0.3, 0.0)
    wrench = np.random.default_rng(3).normal(0, 1, (len(time), 6))
    wrench[:, 2] += load + rest_n
    return time, wrench


def new(watch, *samples):
    """What a watch finds with these samples that it had not found before."""
    before = {finding.kind for finding in watch.found}
    watch.add(*samples)
    return [finding for finding in watch.found if finding.kind not in before]


def noted(watch, time, wrench, each=25):
    parts = [slice(k, k + each) for k in range(0, len(time), each)]
    return [note for part in parts for note in new(watch, time[part], wrench[part])]


def test_a_good_plate_is_not_noted():
    assert noted(plate_watch(1, MASS_KG), *walking(3)) == []


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_plate_that_is_not_zero_is_noted_within_seconds(up):
    """As a load, whether its z axis points up or down."""
    time, wrench = walking(0.4, rest_n=14.0)
    first, *_ = noted(plate_watch(1, MASS_KG, up), time, up * wrench)
    assert (first.kind, first.subject) == (Kind.PLATE_NOT_ZERO, ("1",))
    assert first.values["rest_n"] == pytest.approx(14.0, abs=0.5)


def test_what_a_plate_reads_on_a_platform_that_moves_is_no_offset():
    time, wrench = walking(1.0, rest_n=14.0)
    assert noted(plate_watch(1, MASS_KG), time, wrench)
    assert noted(plate_watch(1, MASS_KG, moves=True), time, wrench) == []


def test_a_saturated_component_is_noted_once_with_its_limit():
    time, wrench = walking(0.5)
    wrench[:, 2] = wrench[:, 2].clip(None, 600.0)
    (finding,) = noted(plate_watch(1, MASS_KG), time, wrench)
    assert finding == Finding(Kind.PLATE_SATURATED, ("1",), {"component": "Fz", "value": 600.0})


def test_a_converters_steps_are_no_saturation_at_rest_and_of_one_who_stands():
    time, wrench = walking(0.5)
    assert noted(plate_watch(1, MASS_KG), time, wrench.round()) == []
    assert noted(plate_watch(1, MASS_KG), time, np.full((len(time), 6), 350.0)) == []


@given(gone=st.integers(0, 100), each=st.integers(1, 9))
def test_a_marker_is_found_as_long_as_it_is_hidden_once_it_has_been_for_long(gone, each):
    position = np.ones((300, 2, 3))
    position[50 : 50 + gone, 1] = np.nan
    position[200:230, 0] = np.nan  # shorter
    gaps, time = MarkerGaps(["LASIS", "RASIS"]), np.arange(300) / 100
    for k in range(0, 300, each):
        part = slice(k, k + each)
        gaps.add(time[part], position[part])
        last_s = time[part][-1]
        hidden = 0.49 + LIMITS.hidden_marker - 1e-9 <= last_s < 0.5 + gone / 100 - 1e-9
        assert [finding.subject for finding in gaps.found] == [("RASIS",)] * int(hidden)


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """A walk of 35 s, in which plates can be later."""
    return lab.walk(tmp_path_factory.mktemp("watch"), duration_s=35.0)


@pytest.fixture(scope="module")
def result(walk):
    return processed(walk)


def processed(recording):
    return process_recording(recording, Subject(sex="female"), Settings(filter="realtime"))


def test_plates_that_are_late_are_noted_and_others_are_not(walk, result):
    def noted_of(trial):
        watch = DelayWatch()
        return [note for frame in frames_of(trial) for note in new(watch, frame)]

    assert noted_of(result) == []
    plates = tuple(replace(p, time=p.time + 0.012) for p in walk.plates)
    first, *_ = noted_of(processed(lab.cropped(replace(walk, plates=plates), 0, 1500)))
    assert first.kind is Kind.PLATES_LATE
    assert first.values["delay_s"] == pytest.approx(0.012, abs=0.003)


def weighed(result, gain):
    """What a session's strides show of the weight that the plates carry: times and notes."""
    tracker, watch, found = GaitTracker(0.042), WeightWatch(result.body.mass), []
    for frame in frames_of(result, gain):
        for stride in tracker.add(frame):
            found += [(frame.time, note) for note in new(watch, stride)]
    return found


@pytest.mark.parametrize("gain", [0.95, 1.05])
def test_plates_of_a_wrong_gain_are_noted_once_with_what_they_carry(result, gain):
    ((_, finding),) = weighed(result, lambda time: np.full(2, gain))
    assert finding.kind is Kind.WEIGHT_DIFFERS
    assert finding.values["carried_kg"] == pytest.approx(gain * result.body.mass, rel=0.01)
    assert finding.values["difference"] == pytest.approx(gain - 1, abs=0.01)


def test_a_trial_is_judged_alike_by_its_whole_and_by_its_strides(result):
    """One limit: what `mass_differs` says of the trial, a session says of its strides."""
    for gain in (0.96, 0.98, 1.02, 1.04):
        carried_kg = gain * result.body.mass
        whole = differing_masses({"stated": result.body.mass}, carried_kg)
        assert len(whole) == len(weighed(result, lambda time, g=gain: np.full(2, g)))


@pytest.mark.parametrize("foot", [0, 1])
def test_a_foot_beside_the_plates_for_a_while_is_noted(result, foot):
    """Its plate carries nothing then: the other foot's strides are no gait cycles, but weigh."""

    def gain(time):
        return np.where(np.arange(2) == foot, not 12 < time < 26, 1.0)

    ((gone_s, gone),) = weighed(result, gain)
    assert gone.values["difference"] == pytest.approx(-0.5, abs=0.15)
    assert 12 < gone_s < 26


def test_one_step_beside_a_plate_is_not_noted(result):
    assert weighed(result, lambda time: np.array([1.0, not 15.0 < time < 15.8])) == []


def test_strides_with_frames_that_do_not_count_are_not_weighed(result):
    tracker, watch = GaitTracker(0.042), WeightWatch(1.2 * result.body.mass)
    for k, frame in enumerate(frames_of(result)):
        late = replace(frame, quality=Quality.LATE if k % 50 == 0 else frame.quality)
        for stride in tracker.add(late):
            assert np.isnan(stride.vertical_n)
            assert new(watch, stride) == []


def fitted(error_m, quality, seen=True, count=500):
    """Frames at 100 Hz with two markers of such errors; NaN where one is not used."""
    for k in range(count):
        yield LiveFrame(
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
    ("frames", "kinds"),
    [
        (fitted([0.012, 0.008], Quality(0)), []),
        (fitted([0.03, 0.03], Quality(0)), [Kind.MARKERS_MISFIT]),
        (fitted([0.003, np.nan], Quality.MARKERS_LEFT_OUT), [Kind.MARKERS_LEFT_OUT]),
        (fitted([0.003, np.nan], Quality(0), seen=False), []),
        (fitted([0.003, 0.003], Quality.FOOT_UNCERTAIN), [Kind.FOOT_UNCERTAIN]),
    ],
)
def test_markers_that_do_not_fit_and_feet_beside_the_pressure_are_noted_once(frames, kinds):
    fit = FitWatch(["LASIS", "RASIS"], [0, 1])
    found = [finding for frame in frames for finding in new(fit, frame)]
    assert [finding.kind for finding in found] == kinds
    if kinds == [Kind.MARKERS_LEFT_OUT]:
        assert found[0].note.light.endswith(" RASIS")
