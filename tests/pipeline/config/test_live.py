"""What a study states of live streams is what a session uses, and its faults are named."""

import re

import pytest

from pipeline.config.study import read_study
from pipeline.config.toml_file import StudyFaults

SUBJECT = 'id = "s1"\n[trials.level]\nexclude = "none"\n'


def study(folder, live):
    (folder / "study.toml").write_text(f"[conditions.level]\n{live}", encoding="utf-8")
    (folder / "s1.toml").write_text(SUBJECT, encoding="utf-8")
    return read_study(folder)


def test_channels_of_a_plate_are_those_stated_and_of_others_the_usual_ones(tmp_path):
    stated = '[live]\nmarkers = "Cameras"\n[live.plates]\n2 = ["a", "b", "c", "d", "e", "f"]'
    live = study(tmp_path, stated).file.live
    assert live.markers == "Cameras"
    assert live.listen == "127.0.0.1"
    assert live.channels_of(2) == ("a", "b", "c", "d", "e", "f")
    assert live.channels_of(1)[2] == "FP1.Fz"


@pytest.mark.parametrize(
    ("stated", "fault"),
    [
        ("wait_s = 20", "live.wait_s: .* 2, got 20"),
        ('analog = ["A", "A"]', "live: stream A"),
        ('plates.1 = ["Fx", "Fy"]', "live.plates.1"),
        ('listen = "0.0.0.0"', "live.listen: '0.0.0.0' "),
    ],
)
def test_faults_are_named(tmp_path, stated, fault):
    with pytest.raises(StudyFaults) as error:
        study(tmp_path, f"[live]\n{stated}")
    (line,) = str(error.value).splitlines()
    assert re.search(fault, line)
