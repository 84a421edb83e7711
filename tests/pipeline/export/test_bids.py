import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.export.bids import write_bids
from pipeline.io.recording import Event

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


def test_labels_are_letters_and_digits(walker, tmp_path):
    for subject, task in (("sub-01", "walk"), ("01", "walk_fast"), ("", "walk")):
        with pytest.raises(ValueError, match="letters and digits"):
            write_bids(walker, tmp_path / "none", subject, task)
    assert not (tmp_path / "none").exists()


@pytest.mark.skipif(VALIDATOR is None, reason="bids-validator-deno is not installed")
def test_the_official_validator_finds_no_error(data_set):
    done = subprocess.run(
        [VALIDATOR, str(data_set[0]), "--format", "json"], capture_output=True, text=True
    )
    issues = json.loads(done.stdout)["issues"]["issues"]
    assert [issue for issue in issues if issue["severity"] == "error"] == []
    assert done.returncode == 0
    assert len(issues) > 0
