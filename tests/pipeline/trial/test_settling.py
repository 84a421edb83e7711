"""Ends of a recording and gaps reach no number: what lies where filters have not settled is out."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Belt, Settings, Subject, Treadmill
from pipeline.io.recording import Event
from pipeline.trial.gait.cycles import cut_cycles
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality, settled_frames, settling_s
from pipeline.trial.study_files import read_study_file
from tests.hbm.motions import without
from tests.pipeline import lab
from tests.pipeline.settling import LIMIT, cycle_change

PERSON = Subject(sex="male", mass_kg=74.6)
METHODS = ("zero_phase", "realtime")


@pytest.fixture(scope="module", params=METHODS)
def whole(request, walker):
    return process_recording(walker, PERSON, Settings(filter=request.param), static=walker)


def again(recording, whole, static):
    """Another recording of the same walk, processed in the same way."""
    return process_recording(recording, PERSON, whole.settings, static=static)


def test_cropping_a_trial_at_heel_strikes_changes_no_cycle(walker, whole):
    """Its first and last cycles begin and end with the crop, and count where they are settled."""
    count, stated = 0, replace(walker, events=whole.events)
    for first, part in lab.cropped_at_strikes(stated, whole.events, count=2):
        result = again(part, whole, walker)
        change = cycle_change(result, whole, first)
        count += len(change)
        assert (change < LIMIT).all()
        same = whole.measured.residual[first : first + len(part.markers.time)]
        assert np.nanmax(np.abs(result.measured.residual - same)) > 20
        assert sum(map(len, result.cycles.values())) == result.found_cycles
    assert count >= 6


@pytest.mark.parametrize("condition", ["sway", "pitch"])
def test_cropping_a_compensated_trial_changes_no_cycle(study, laboratory, condition):
    """Accelerometers and plates pass a filter of 20 Hz before; it settles sooner."""
    trial = read_study_file(study, f"sub01_{condition}.c3d")
    person, settings = study.subject("sub01").person, study.file.settings
    whole = process_recording(trial, person, settings, laboratory=laboratory)
    part = lab.cropped(trial, 0, 880)
    result = process_recording(part, person, settings, laboratory=laboratory)
    assert (cycle_change(result, whole, 0) < LIMIT).all()
    difference = result.compensated.residual - whole.compensated.residual[:881]
    assert np.abs(difference[result.counts]).max() < 1
    assert np.abs(difference[-1]).max() > 20


def peaks(result, spans):
    """Largest residuals of each cycle, (C, 6), over the frames that count."""
    time, counts = result.motion.time, result.counts
    found = [
        np.abs(result.measured.residual[counts & (time >= start) & (time < stop)]).max(axis=0)
        for start, stop in spans
    ]
    return np.array(found)


def test_a_gap_of_50_ms_of_all_markers_raises_no_peak_of_the_cycles_beside_it(walker, whole):
    """The cycle with the gap is left out; a causal filter carries it only to the one after it."""
    causal = whole.settings.filter == "realtime"
    gap_s = whole.cycles["right"][2, 0] + (-0.06 if causal else 0.01)
    time = walker.markers.time
    gap = (time >= gap_s) & (time < gap_s + 0.05)
    markers = without(walker.markers, walker.markers.names, gap)
    result = again(replace(walker, markers=markers, events=whole.events), whole, walker)
    spans = result.cycles["right"]
    assert len(spans) == len(whole.cycles["right"]) - 1
    assert (peaks(result, spans) - peaks(whole, spans) < LIMIT).all()
    unmasked = replace(result, quality=result.quality & ~int(Quality.SETTLING))
    assert (peaks(unmasked, spans) - peaks(whole, spans)).max() > 50
    (note,) = [note for note in result.notes if note.code == "cycles_left_out"]
    assert "excluded: 1 for" in note.text


def test_a_gap_of_a_plate_raises_no_peak_of_the_cycle(walker, whole):
    middle_s = float(np.mean(whole.cycles["right"][1]))
    plates = []
    for plate in walker.plates:
        wrench = plate.wrench_in_plate.copy()
        wrench[(plate.time > middle_s) & (plate.time < middle_s + 0.05)] = np.nan
        plates.append(replace(plate, wrench_in_plate=wrench))
    result = again(replace(walker, plates=tuple(plates)), whole, walker)
    spans = whole.cycles["right"]
    assert len(result.cycles["right"]) == len(spans)
    assert (peaks(result, spans) - peaks(whole, spans) < LIMIT).all()
    near = (result.motion.time > middle_s) & (result.motion.time < middle_s + 0.2)
    assert not result.counts[near].any()


@pytest.mark.parametrize(("last_s", "left"), [(2.6, 2), (2.4, 1)])
def test_a_cycle_with_too_little_left_is_left_out_by_name(last_s, left):
    """Cycles of 1 s from 1 and 2 s on, of which frames up to some time are settled."""
    time = np.arange(310) / 100
    events = [Event(t, "foot_strike", "left") for t in (1.0, 2.0, 3.0)]
    quality = np.where(time < last_s, 0, int(Quality.SETTLING))
    cycles, left_out = cut_cycles(events, time, quality, 0.5)
    assert len(cycles["left"]) == left
    assert len(left_out["left"]) == 2 - left
    assert all("to settle" in reason for reason in left_out["left"])


def test_filters_that_follow_one_another_settle_as_the_slowest_of_them():
    belt = Belt(calibration="belts.c3d", speed_channels=("Speed",), cutoff_hz=4.0)
    laboratory = Laboratory(Treadmill(belt=belt))
    assert settling_s(laboratory.filters(Settings())) == (0.25, 0.25)
    in_real_time = Settings(filter="realtime")  # in which compensation has no filter of its own
    assert settling_s(laboratory.filters(in_real_time)) == (0.25, 0.0)
    still = Laboratory(Treadmill())
    assert settling_s(still.filters(Settings(filter="realtime", cutoff_hz=5.0))) == (0.3, 0.0)


@pytest.mark.parametrize(("after_s", "before_s"), [(0.05, 0.0), (0.05, 0.05)])
def test_a_stretch_settles_after_its_start_and_until_before_its_end(after_s, before_s):
    time = np.arange(100) / 100
    known = (time < 0.395) | (time > 0.435)
    settled = settled_frames(known, time, (after_s, before_s))
    expected = np.zeros(100, bool)
    for start, stop in ((0, 39), (44, 99)):
        expected |= (time > start / 100 + after_s - 1e-6) & (time < stop / 100 - before_s + 1e-6)
    np.testing.assert_array_equal(settled, expected)
