"""Check and run agree on what counts in standing, short trials, stated spans and contacts."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from hbm.markers import marker_sets
from pipeline.cli.app import main
from pipeline.config.schema import Condition, PlateContact, Settings, Subject
from pipeline.config.study import read_study
from pipeline.io.recording import Event
from pipeline.run.check import check_study
from pipeline.run.run import run_study
from pipeline.run.store import read_trial
from pipeline.trial.gait.events import SIDES, zeni_events
from pipeline.trial.process import process_recording, process_trial
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.residuals import residual_table
from pipeline.trial.window import what_counts
from tests.pipeline import lab

CONTACT = '[[trials.quiet.contacts]]\nplate = {}\ntime_s = {}\nfoot = "{}"\n'


def first(recording, seconds, *, loaded=True):
    """The beginning of a recording, in which the subject stands; or nobody is on its plates."""
    part = lab.cropped(recording, 0, round(100 * seconds) - 1)
    plates = tuple(replace(p, wrench_in_plate=loaded * p.wrench_in_plate) for p in part.plates)
    return replace(part, plates=plates, analog=None)


@pytest.fixture
def study(walker, tmp_path):
    """Write a study of one subject with one condition; gives its folder."""

    def write(recording, condition="", trial=""):
        folder = tmp_path / "study"
        folder.mkdir()
        lab.save(recording, folder / "trial.c3d")
        (folder / "study.toml").write_text(f"[conditions.quiet]\n{condition}\n")
        person = f'id = "sub01"\nmass_kg = 74.6\n[trials.quiet]\nfile = "trial.c3d"\n{trial}\n'
        (folder / "sub01.toml").write_text(person)
        return folder

    return write


def checked_and_run(folder, out):
    """Faults of the check, and what became of the trial."""
    (outcome,) = run_study(read_study(folder), out)
    faults = [str(fault) for fault in check_study(read_study(folder)).faults]
    assert bool(faults) == (outcome.state == "failed")
    return faults, outcome


@pytest.mark.parametrize("seconds", [1.5, 0.4])
def test_a_trial_without_gait_cycles_counts_as_a_whole_however_short(
    walker, study, tmp_path, seconds
):
    folder = study(first(walker, seconds))
    _, outcome = checked_and_run(folder, tmp_path / "out")
    assert outcome.state == "done"
    summary = read_trial(outcome.job.target)
    start, stop = summary.span
    assert 0 <= start <= 0.17
    assert seconds - 0.2 < stop < seconds
    (note,) = [note for note in summary.notes if note.code == "no_gait_cycle"]
    assert "no foot strikes" in note.values["reason"]
    assert (residual_table(summary, "")["rms"] < 10).all()


def carried(walker, start_s, stop_s):
    """The walk over a floor whose plates are there between two times alone, without events."""
    plates = tuple(
        replace(
            p,
            wrench_in_plate=np.where(
                ((p.time >= start_s) & (p.time < stop_s))[:, None], p.wrench_in_plate, 0.0
            ),
        )
        for p in walker.plates
    )
    return replace(walker, plates=plates)


def test_plates_that_carry_one_step_give_its_residuals_and_say_so(walker, study, tmp_path):
    """Of the strides of 1.1 s each, less than half is carried: no gait cycle counts."""
    strikes = [e.time for e in zeni_events(walker.markers, marker_sets()["hbm2"])
               if e.label == "foot_strike" and e.time > 6]  # fmt: skip
    start, stop = sorted(strikes)[:2]
    short = carried(walker, start - 0.05, stop + 0.02)
    _, outcome = checked_and_run(study(short), tmp_path / "out")
    result = read_trial(outcome.job.target)
    assert result.unit == "step"
    (span,) = [own for spans in result.cycles.values() for own in spans.tolist()]
    assert span == pytest.approx((start, stop), abs=0.05)
    table = residual_table(result, "")
    assert set(table["window"]) == {"step"}
    assert (table["n_cycles"] == 1).all()
    assert (table["n_frames"] < 100 * (stop - start) + 1).all()
    assert (table["rms"] < 15).all()
    (note,) = [note for note in result.notes if note.code == "steps_for_cycles"]
    assert (note.values["count"], note.values["unit"]) == (1, "step")


@pytest.mark.parametrize("unit", ["step", "stance"])
def test_a_condition_can_ask_for_steps_or_stances(walker, study, tmp_path, unit):
    _, outcome = checked_and_run(study(walker, f'window = "{unit}"'), tmp_path / "out")
    result = read_trial(outcome.job.target)
    table = residual_table(result, "")
    assert set(table["window"]) == {unit}
    spans = np.concatenate(list(result.cycles.values()))
    union = np.any([(result.motion.time >= a) & (result.motion.time < b) for a, b in spans], axis=0)
    residual = result.measured.residual[union & result.counts, 0]
    assert table["rms"].iloc[0] == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert table["n_frames"].iloc[0] == len(residual), "no frame is counted twice"


@pytest.mark.parametrize(
    ("condition", "span"),
    [
        ("window = [0.5, 1.0]", (0.5, 1.0)),
        ("window = [0.0, 60.0]", (1 / 6, 1.49 - 1 / 6)),
    ],
)
def test_a_condition_states_what_counts(walker, study, tmp_path, condition, span):
    _, outcome = checked_and_run(study(first(walker, 1.5), condition), tmp_path / "out")
    assert outcome.state == "done"
    assert read_trial(outcome.job.target, frames=False).span == pytest.approx(span)


@pytest.mark.parametrize(
    ("condition", "fault"),
    [
        ("cycles = 5", "no foot strikes"),
        ("window = [2.0, 3.0]", "2 to 3 s"),
        ('window = "step"', "no foot strikes"),
        ('window = "stance"\n[settings]\nevents = "plates"', "no foot strikes"),
    ],
)
def test_what_a_condition_wants_and_a_trial_has_not_is_a_fault(
    walker, study, tmp_path, condition, fault
):
    faults, outcome = checked_and_run(study(first(walker, 1.5), condition), tmp_path / "out")
    assert any(fault in line for line in faults), faults
    assert fault in outcome.reason


def test_where_steps_are_asked_for_what_is_missing_are_steps(walker):
    flags = np.full(len(walker.markers.time), int(Quality.NOT_CARRIED))
    strikes = [Event(time, "foot_strike", side) for time, side in ((2.0, "left"), (2.6, "right"))]
    texts = []
    for events in (strikes[:1], strikes):
        counted = what_counts(walker, events, flags, Condition(window="step"), (0, 0), None, 0.5)
        texts += [note.text for note in counted.notes]
    needs, excluded, all_excluded = texts
    assert "both sides" in needs
    assert excluded.startswith("1 step excluded")
    assert re.search("all steps .*, 1 for plates", all_excluded)


def test_steps_that_stand_in_for_gait_cycles_say_why_these_are_excluded(walker):
    strikes = [(2.0, "left"), (2.6, "right"), (4.2, "left"), (4.8, "right"), (6.4, "left")]
    events = [Event(time, "foot_strike", side) for time, side in strikes]
    events += [Event(1.1 * k + 1.4, "foot_off", side) for k in range(6) for side in SIDES]
    sound = np.zeros(len(walker.markers.time), int)
    counted = what_counts(walker, events, sound, Condition(), (0, 0), None, 0.5)
    (note,) = (note for note in counted.notes if note.code == "steps_for_cycles")
    assert "3 for events" in note.text


@pytest.mark.parametrize("method", ["", '[settings]\nevents = "file"\n'])
def test_of_events_that_contradict_the_feet_the_check_says_what_the_run_does(
    walker, study, tmp_path, method
):
    """Events of a crop that begins elsewhere, and doubled besides."""
    events = zeni_events(walker.markers, marker_sets()["hbm2"])
    twice = [replace(e, time=e.time + 7.3 + s) for e in events for s in (0.0, 0.04)]
    folder = study(replace(walker, events=tuple(twice)))
    (folder / "study.toml").write_text((folder / "study.toml").read_text() + method)
    _, outcome = checked_and_run(folder, tmp_path / "out")
    notes = {note.code: note for note in read_trial(outcome.job.target, frames=False).notes}
    remarks = [str(remark) for remark in check_study(read_study(folder)).remarks]
    assert any(notes["events_contradicted"].text in remark for remark in remarks)
    assert f"{len(events)} of {len(twice)} gait events" in notes["joined"].text
    assert ("events_of_file" in notes) == bool(method)


def test_of_a_trial_with_events_of_the_left_foot_its_cycles_count(walker, study, tmp_path):
    events = zeni_events(walker.markers, marker_sets()["hbm2"])
    left = tuple(event for event in events if event.side == "left")
    folder = study(replace(walker, events=left), "cycles = 2")
    faults, outcome = checked_and_run(folder, tmp_path / "out")
    assert not faults
    summary = read_trial(outcome.job.target)
    assert list(summary.cycles) == ["left"]
    assert set(residual_table(summary, "")["window"]) == {"cycle"}


@pytest.mark.parametrize(
    ("condition", "trial"),
    [
        ("skip_s = 11.0", ""),
        ("", CONTACT.format(1, 60.0, "left")),
        ("", CONTACT.format(1, "{swing}", "left")),
    ],
)
def test_what_is_not_in_the_recording_is_found_by_the_check(
    walker, study, tmp_path, condition, trial
):
    unloaded = np.flatnonzero(walker.plates[0].wrench[5000:, 2] < 1)[20]
    swing_s = walker.plates[0].time[5000 + unloaded]
    folder = study(walker, condition, trial.replace("{swing}", f"{swing_s:.3f}"))
    faults, outcome = checked_and_run(folder, tmp_path / "out")
    assert len(faults) == 1
    assert outcome.state == "failed"


def test_one_contact_has_one_foot_in_a_check_as_in_a_run(walker, study, tmp_path):
    both = CONTACT.format(1, 1.0, "left") + CONTACT.format(1, 1.001, "right")
    (fault,), outcome = checked_and_run(study(walker, "", both), tmp_path / "out")
    assert "one contact" in fault
    assert fault == f"trial.c3d: {outcome.reason}"


def test_what_only_the_markers_events_suggest_is_a_warning(walker, study):
    """Plates show events of feet that stay in their place; markers show no swing."""
    hopping = first(walker, 2.5)
    plates = []
    for plate in hopping.plates:
        in_air = np.abs((plate.time % 1.0) - 0.6) < 0.1
        plates.append(replace(plate, wrench_in_plate=plate.wrench_in_plate * ~in_air[:, None]))
    condition = 'window = "stance"\n[settings]\nevents = "plates"'
    found = check_study(read_study(study(replace(hopping, plates=tuple(plates)), condition)))
    assert not found.faults
    said = [str(remark.said) for remark in found.remarks]
    assert any(re.search("gait events.*no foot strikes", remark) for remark in said)


@pytest.mark.parametrize("walks", [True, False])
def test_a_trial_that_begins_with_standing_is_checked_to_its_end(walker, study, tmp_path, walks):
    recording = walker if walks else first(walker, 1.8)
    _, outcome = checked_and_run(study(recording, "cycles = 3"), tmp_path / "out")
    assert (outcome.state == "done") == walks


def test_nobody_on_the_plates_is_one_line_and_frames_are_written(walker, tmp_path, capsys):
    trial = lab.save(first(walker, 1.5, loaded=False), tmp_path / "empty.c3d")
    out = tmp_path / "out"
    assert main(["residuals", str(trial), "--mass-kg", "74.6", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("hbm: error: empty.c3d: ")
    assert re.search("0 of 150 frames .*min_valid_share", error)
    assert error.count("\n") == 1
    frames = pd.read_parquet(out / "empty.parquet")
    quality = frames["quality"].to_numpy()
    assert (quality & Quality.NOT_CARRIED).all()
    assert free_of(quality, Quality.POSE_UNKNOWN).all()
    assert list(pd.read_csv(out / "empty_residuals.csv")["rms"]) == []


def test_a_stated_contact_moves_the_load_to_that_foot_and_no_residual(walker, study):
    """The left plate's contact after 7 s is given to the right foot."""
    time, left = walker.markers.time, walker.plates[0].wrench[::10, 2] > 30
    start = next(k for k in range(700, 1200) if left[k] and not left[k - 1])
    stop = next(k for k in range(start, 1200) if not left[k])
    middle = time[(start + stop) // 2]
    folder = study(walker, trial=CONTACT.format(1, middle, "right"))
    stated = process_trial(read_study(folder), "sub01", "quiet")
    (folder / "sub01.toml").write_text(
        (folder / "sub01.toml").read_text().replace('foot = "right"', 'foot = "left"')
    )
    usual = process_trial(read_study(folder), "sub01", "quiet")
    inside = slice(start + 20, stop - 20)
    moved = stated.ground["measured"]["right_foot"] - usual.ground["measured"]["right_foot"]
    assert (moved[inside, 2] > 300).all()
    assert np.abs(moved[: start - 60]).max() < 1
    np.testing.assert_allclose(stated.measured.residual, usual.measured.residual, atol=1e-6)
    knee = stated.measured.force("RKneeFlexion") - usual.measured.force("RKneeFlexion")
    assert np.abs(knee[inside]).max() > 10


def test_a_plate_is_meant_by_its_number_in_the_file_also_where_another_one_is_left_out(walker):
    left = replace(walker.plates[0], number=2)
    time, loaded = left.time, left.wrench[:, 2] > 300
    at_s = float(time[np.flatnonzero(loaded & (time > 7))[50]])
    of_2, of_1 = (PlateContact(plate=k, time_s=at_s, foot="right") for k in (2, 1))
    recording, person = replace(walker, plates=(left,)), Subject(mass_kg=74.6, sex="male")
    result = process_recording(recording, person, Settings(), contacts=[of_2])
    assert result.ground["measured"]["right_foot"][round(at_s * 100), 2] > 300
    with pytest.raises(ValueError, match=r"no plate 1; .*2 to 2"):
        process_recording(recording, person, Settings(), contacts=[of_1])


def test_motion_without_a_platform_is_found_by_the_check_alone(walker, study, tmp_path):
    folder = study(walker, 'perturbed = true\nwindow = "motion"\npulse_channel = "Pulse"')
    faults, _ = checked_and_run(folder, tmp_path / "out")
    assert sum('window = "motion"' in fault for fault in faults) == 1


@pytest.mark.parametrize(("stop_s", "exit_code"), [(0.6, 2), (1.2, 0)])
def test_a_recording_stands_in_for_gait_cycles_only_where_half_of_it_counts(
    walker, tmp_path, capsys, stop_s, exit_code
):
    """The plates record until some time of 1.5 s without a gait cycle."""
    short = first(walker, 1.5)
    plates = tuple(
        replace(p, wrench_in_plate=p.wrench_in_plate * (p.time < stop_s)[:, None])
        for p in short.plates
    )
    trial = lab.save(replace(short, plates=plates), tmp_path / "short.c3d")
    command = ["residuals", str(trial), "--mass-kg", "74.6", "--out", str(tmp_path / "out")]
    assert main(command) == exit_code
    error = capsys.readouterr().err
    assert ("min_valid_share" in error) == bool(exit_code)
    assert main([*command, "--span", "all"]) == 0
