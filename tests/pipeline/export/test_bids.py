"""A study in BIDS is valid, and holds the samples, participants and events of its recordings."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.cli.app import main
from pipeline.config.schema import Settings, Subject
from pipeline.export.bids import write_bids
from pipeline.io.recording import Event
from pipeline.trial.process import process_recording
from pipeline.virtual_lab.machine.c3d_file import write_c3d

VALIDATOR = shutil.which("bids-validator-deno", path=str(Path(sys.executable).parent))


@pytest.fixture(scope="module")
def data_set(walker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bids") / "treadmill"
    walker = replace(walker, events=[Event(1.5, "foot_strike", "left")])
    return (
        folder,
        write_bids(walker, folder, "01", "walk"),
        write_bids(walker, folder, "02", "pitch"),
    )


def test_samples_come_back_by_the_names_of_their_channels(walker, data_set):
    stem = data_set[0] / "sub-01" / "motion" / "sub-01_task-walk_tracksys-"
    for system, time, value in (
        ("optical", walker.markers.time, walker.markers.position[:, 2, 1]),
        ("plates", walker.plates[1].time, walker.plates[1].wrench[:, 5]),
    ):
        name = {"optical": f"{walker.markers.names[2]}_y", "plates": "plate2_moment_z"}[system]
        channels = pd.read_csv(f"{stem}{system}_channels.tsv", sep="\t", keep_default_na=False)
        values = pd.read_csv(f"{stem}{system}_motion.tsv", sep="\t", header=None)
        facts = json.loads(Path(f"{stem}{system}_motion.json").read_text(encoding="utf-8"))
        assert values.shape == (len(time), len(channels))
        column = values[list(channels["name"]).index(name)]
        np.testing.assert_allclose(column, value, rtol=1e-8, atol=1e-8)
        assert facts["SamplingFrequency"] == pytest.approx(1 / (time[1] - time[0]))


@pytest.fixture(scope="module")
def of_study(walker, tmp_path_factory):
    """A data set of a study with groups, sessions and repeated recordings, without events."""
    study = tmp_path_factory.mktemp("study")
    write_c3d(study / "walk.c3d", walker.markers, walker.plates)
    (study / "study.toml").write_text(
        '[conditions.no_shoes]\n[conditions.boots]\n[comparison]\ngroup = "group"\n'
    )
    walk = 'file = "walk.c3d"\nsession = "day1"\n'
    (study / "s1.toml").write_text(
        'id = "S_01"\nsex = "female"\nage_years = 91\nheight_m = 1.7\ngroup = "=risk"\n'
        f"[[trials.no_shoes]]\n{walk}[[trials.no_shoes]]\n{walk}[trials.boots]\n{walk}"
    )
    (study / "s2.toml").write_text(f'id = "NA"\ngroup = "control"\n[trials.boots]\n{walk}')
    out = tmp_path_factory.mktemp("bids") / "of_study"
    assert main(["export", str(study), "--format", "bids", "--out", str(out)]) == 0
    return out


def test_participants_have_sex_age_stature_mass_and_group_with_units(of_study):
    table = pd.read_csv(of_study / "participants.tsv", sep="\t", dtype=str, keep_default_na=False)
    first, second = (row.to_dict() for _, row in table.iterrows())
    assert float(first.pop("weight")) == pytest.approx(74.6, abs=0.5)
    assert first == {
        **{"participant_id": "sub-S01", "age": "89", "sex": "female", "height": "1.7"},
        "group": "'=risk",
    }
    assert (second["participant_id"], second["sex"], second["group"]) == (
        "sub-NA",
        "n/a",
        "control",
    )
    columns = json.loads((of_study / "participants.json").read_text(encoding="utf-8"))
    assert list(columns) == list(table)[1:]
    assert (columns["height"]["Units"], columns["weight"]["Units"]) == ("m", "kg")


def test_every_recording_has_its_gait_events_on_the_clock_of_its_markers(of_study, walker):
    tables = sorted(of_study.rglob("*_events.tsv"))
    assert [path.name for path in tables] == [
        "sub-NA_ses-day1_task-boots_events.tsv",
        "sub-S01_ses-day1_task-boots_events.tsv",
        "sub-S01_ses-day1_task-noshoes_run-01_events.tsv",
        "sub-S01_ses-day1_task-noshoes_run-02_events.tsv",
    ]
    result = process_recording(walker, Subject(), Settings())
    events = pd.read_csv(tables[0], sep="\t")
    assert list(events) == ["onset", "duration", "trial_type"]
    np.testing.assert_allclose(events["onset"], [e.time for e in result.events], atol=1e-3)
    assert set(events["trial_type"]) == {
        f"{side}_{label}" for side in ("left", "right") for label in ("foot_strike", "foot_off")
    }


def test_what_people_wrote_of_a_participant_stays(walker, tmp_path):
    people = tmp_path / "participants.tsv"
    people.write_text("participant_id\tsex\tscore\nsub-01\tF\t-3\nsub-01\tF\t=A1\n")
    write_bids(replace(walker, events=()), tmp_path, "01", "walk")
    assert [line.split("\t")[:3] for line in people.read_text().splitlines()[1:]] == [
        ["sub-01", "F", "-3"],
        ["sub-01", "F", "=A1"],
    ]


def test_labels_are_letters_and_digits(walker, tmp_path):
    for subject, task in (("sub-01", "walk"), ("01", "walk_fast"), ("", "walk")):
        with pytest.raises(ValueError, match="letters and digits"):
            write_bids(walker, tmp_path / "none", subject, task)
    assert not (tmp_path / "none").exists()


@pytest.mark.skipif(VALIDATOR is None, reason="bids-validator-deno is not installed")
@pytest.mark.parametrize("made", ["data_set", "of_study"])
def test_the_official_validator_finds_no_error_and_all_events(made, request):
    made = request.getfixturevalue(made)
    folder = made if isinstance(made, Path) else made[0]
    done = subprocess.run(
        [VALIDATOR, str(folder), "--format", "json"], capture_output=True, text=True
    )
    issues = json.loads(done.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue["severity"] == "error"] == []
    assert done.returncode == 0
    assert len(issues) > 0
    assert "EVENTS_TSV_MISSING" not in {issue["code"] for issue in issues}
