"""Every trial has a state and a reason, and results say where their numbers come from."""

import hashlib
import json
import shutil
from dataclasses import replace

import pytest

from pipeline.config.schema import Figures, TrialName
from pipeline.config.study import read_study
from pipeline.run.job import trial_key
from pipeline.run.load import collect, select_trials
from pipeline.run.provenance import (
    input_digests,
    provenance,
    trial_states,
)
from tests.pipeline.fake_results import ENGINE, write_fake_results, write_fake_study


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = write_fake_study(tmp_path_factory.mktemp("study") / "study", subjects=3)
    subject = folder / "sub03.toml"
    text = subject.read_text().replace('file = "sub03_pitch.c3d"', 'exclude = "LPSI lost"')
    subject.write_text(text)
    return read_study(folder)


@pytest.fixture(scope="module")
def results(tmp_path_factory, study):
    folder = tmp_path_factory.mktemp("results")
    write_fake_results(
        folder,
        subjects=3,
        cycles=2,
        without={("sub02", "sway"), ("sub03", "pitch")},
        key=lambda subject, condition: trial_key(study, TrialName(subject, condition)),
    )
    return collect(folder)


def states(results, failures, study=None):
    return {s.name[:2]: s for s in trial_states(results, failures, study)}


def test_every_trial_of_the_study_has_a_state_and_a_reason(results, study):
    found = states(results, {"sub02 sway": "marker LHEE is missing"}, study)
    assert len(found) == 9
    assert found["sub01", "sway"].state == "done"
    assert found["sub02", "sway"].state == "failed"
    assert "LHEE" in found["sub02", "sway"].reason
    assert not found["sub02", "sway"].in_tables
    assert (found["sub03", "pitch"].state, found["sub03", "pitch"].reason) == (
        "excluded",
        "LPSI lost",
    )


def test_without_the_study_a_gap_is_missing(results):
    found = states(results, {})
    assert len(found) == 9
    assert found["sub02", "sway"].state == "missing"


def test_the_older_result_of_a_failed_trial_is_mentioned_and_left_out(results, study):
    found = states(results, {"sub01 pitch": "disk full"}, study)["sub01", "pitch"]
    assert (found.state, found.in_tables) == ("failed", False)
    assert "older result" in found.reason


def test_a_trial_excluded_after_it_was_processed_no_longer_counts(tmp_path, study):
    everything = collect(write_fake_results(tmp_path, subjects=3, cycles=2))
    found = states(everything, {}, study)
    assert (found["sub03", "pitch"].state, found["sub03", "pitch"].in_tables) == ("excluded", False)
    left = select_trials(everything, {state.name for state in found.values() if state.in_tables})
    assert set(everything.trials) - set(left.trials) == {TrialName("sub03", "pitch")}
    for table in (left.residuals, left.joints):
        keys = set(table[[*TrialName._fields]].drop_duplicates().itertuples(index=False))
        assert keys == set(left.trials)
    assert set(left.subjects["subject"]) == {"sub01", "sub02", "sub03"}


def test_results_of_changed_files_are_outdated(results, study, tmp_path):
    folder = shutil.copytree(study.folder, tmp_path / "study")
    (folder / "sub01_sway.c3d").write_bytes(b"another recording")
    found = states(results, {}, read_study(folder))["sub01", "sway"]
    assert found.state == "outdated"
    assert "have changed" in found.reason
    assert found.in_tables


def test_results_of_a_condition_removed_from_the_study_are_outdated(tmp_path, study):
    folder = write_fake_results(tmp_path, subjects=1, conditions=("running",), cycles=2)
    found = states(collect(folder), {}, study)["sub01", "running"]
    assert (found.state, found.in_tables) == ("outdated", False)


def test_every_file_of_the_study_is_hashed(study):
    found = input_digests(study)
    assert {"study.toml", "sub01.toml", "empty.json", "sub01_sway.c3d"} <= set(found)
    assert "sub03_pitch.c3d" not in found  # excluded
    assert found["sub01_sway.c3d"] == hashlib.sha256(b"sub01_sway.c3d").hexdigest()


def test_provenance_is_json_and_complete(results, study):
    stored = json.loads(provenance(results, trial_states(results, {}, study), study).to_json())
    assert stored["engines"] == [ENGINE]
    trial = next(t for t in stored["trials"] if (t["subject"], t["condition"]) == ("sub01", "sway"))
    assert (trial["state"], trial["source"]) == ("done", "sub01_sway.c3d")
    assert trial["key"] == trial_key(study, TrialName("sub01", "sway"))


def test_every_file_of_the_treadmill_makes_a_trial_outdated(tmp_path):
    folder = write_fake_study(tmp_path / "study", subjects=1)
    path = folder / "study.toml"
    text = path.read_text(encoding="utf-8")
    text = text.replace("empty.json", "empty.c3d")
    start, platform = "[treadmill]\n", "[treadmill.platform]"
    belt = '[treadmill.belt]\nspeed_channels = ["Belt"]\ncalibration = "belt.c3d"\n'
    text = text.replace(start, f'{start}check = "later.c3d"\nbeside = ["right.c3d"]\n')
    path.write_text(text.replace(platform, belt + platform), encoding="utf-8")
    names = ("empty.c3d", "later.c3d", "right.c3d", "belt.c3d")
    for name in names:
        (folder / name).write_text("first", encoding="utf-8")
    study = read_study(folder)
    keys = {trial_key(study, TrialName("sub01", "sway"))}
    for name in names:
        (folder / name).write_text("another", encoding="utf-8")
        keys.add(trial_key(study, TrialName("sub01", "sway")))
    assert len(keys) == 1 + len(names)


def test_how_figures_look_makes_no_trial_run_again(study):
    name = TrialName("sub01", "sway")
    drawn = study.file.model_copy(update={"figures": Figures(width_mm=85.0)})
    assert trial_key(replace(study, file=drawn), name) == trial_key(study, name)
