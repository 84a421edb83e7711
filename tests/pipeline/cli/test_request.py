"""One trial as typed states the study that its files would state."""

from pathlib import Path

import pytest

from pipeline.cli.request import TrialRequest
from pipeline.config.study import read_study
from pipeline.config.toml_file import check_options

STUDY = """
axes = "left,back,up"
mend_plates = ["1: gain Fz 0.97"]
rename = {LASI = "LASIS"}
[settings]
cutoff_hz = 8.0
plate_delay_s = -0.004
marker_set = "hbm2"
[conditions.level]
window = [5.0, 15.0]
"""
PERSON = """
id = "subject"
sex = "female"
mass_kg = 55.3
static = "static.c3d"
[trials.level]
file = "walk.trc"
forces = "walk.mot"
"""
TYPED = {
    "trial": Path("walk.trc"),
    "forces": Path("walk.mot"),
    "static": Path("static.c3d"),
    "axes": "left,back,up",
    "mend_plates": ("1: gain Fz 0.97",),
    "rename": ("LASI=LASIS",),
    "cutoff_hz": 8.0,
    "plate_delay_ms": -4.0,
    "marker_set": "hbm2",
    "sex": "female",
    "mass_kg": 55.3,
    "span": "5, 15",
}


def test_options_state_what_the_files_of_a_study_would(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    (tmp_path / "subject.toml").write_text(PERSON, encoding="utf-8")
    written = read_study(tmp_path, recordings=False)
    typed = check_options(TrialRequest, TYPED).study()
    ((name, trial),) = typed.trials.items()
    ((of_file, expected),) = written.trials.items()
    assert trial == expected
    assert typed.path(trial.file) == Path("walk.trc")
    assert typed.stated_of(trial) == written.stated_of(expected)
    assert typed.file.settings == written.file.settings
    assert typed.rule(name) == written.rule(of_file)
    person, stated = typed.subject("subject"), written.subject("subject")
    assert (person.person, person.files) == (stated.person, stated.files)


@pytest.mark.parametrize("span", ["3", "5,4", "-1,4", "nan,4", "step,4", "1,2,3", ""])
def test_a_span_that_is_none_is_refused(span):
    request = TrialRequest(trial=Path("walk.c3d"), span=span)
    with pytest.raises(ValueError, match=r"--span .*: expected step"):
        request.study()
