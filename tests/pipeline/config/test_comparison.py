"""What a study states of its comparison is read as a design, and every fault is one line."""

import re

import pytest

from pipeline.config.comparison import study_design
from pipeline.config.schema import StudyFile
from pipeline.config.study import read_study
from pipeline.config.toml_file import StudyFaults
from pipeline.statistics.design import EXPERIMENT_3
from tests.pipeline.fake_results import write_fake_study

SHOES = """
[conditions.own]
[conditions.boots]
[conditions.barefoot]
"""


@pytest.fixture
def written(tmp_path):
    """Write a study of two subjects with a comparison; of shoes where ``conditions`` says so."""

    def write(comparison="", conditions=None, groups=()):
        folder = write_fake_study(tmp_path / "study", subjects=2)
        path = folder / "study.toml"
        text = path.read_text(encoding="utf-8")
        if conditions is not None:
            text = conditions
            for subject in ("sub01", "sub02"):
                trials = (folder / f"{subject}.toml").read_text(encoding="utf-8")
                for old, new in zip(
                    ("baseline", "sway", "pitch"), ("own", "boots", "barefoot"), strict=True
                ):
                    trials = trials.replace(f"[trials.{old}]", f"[trials.{new}]")
                (folder / f"{subject}.toml").write_text(trials, encoding="utf-8")
        path.write_text(f"{text}\n[comparison]\n{comparison}", encoding="utf-8")
        for subject, group in groups:
            person = folder / f"{subject}.toml"
            person.write_text(f'group = "{group}"\n{person.read_text()}', encoding="utf-8")
        return folder

    return write


def design(folder):
    return study_design(read_study(folder).file)


def test_a_study_of_experiment_3_has_its_design(tmp_path):
    assert design(write_fake_study(tmp_path / "study", subjects=1)) == EXPERIMENT_3


def test_a_study_of_shoes_without_a_calibration_has_one_factor(written):
    found = design(written('factor = "shoes"', SHOES))
    assert (found.factors, found.reference) == (("shoes",), "own")
    assert found.pairs == (("boots", "own"), ("barefoot", "own"))


def test_nothing_is_compared_with_a_perturbation_unless_that_is_stated():
    conditions = {"push": {"perturbed": True, "pulse_channel": "Push"}, "level": {}}
    file = StudyFile.model_validate({"conditions": conditions})
    assert study_design(file).pairs == (("push", "level"),)


def test_everything_that_is_stated_is_in_the_design(written):
    found = design(
        written(
            'levels = ["pitch", "sway"]\nreference = "sway"\ncorrection = "holm"\nmargin = 0.1\n'
            'pairs = ["pitch IC - sway no IC"]\ncovariates = ["mass_kg"]\ngroup = "group"',
            groups=(("sub01", "before"), ("sub02", "after")),
        )
    )
    assert (found.conditions, found.reference) == (("pitch", "sway"), "sway")
    assert found.pairs == (("pitch IC", "sway no IC"),)
    assert (found.correction, found.margin, found.group) == ("holm", 0.1, "group")
    assert found.covariates == ("mass_kg",)


def test_a_group_by_sex_is_no_covariate(tmp_path, written):
    folder = written('group = "sex"')
    for subject, sex in (("sub01", "male"), ("sub02", "female")):
        person = folder / f"{subject}.toml"
        person.write_text(f'sex = "{sex}"\n{person.read_text()}', encoding="utf-8")
    assert design(folder).covariates == ("height_m",)


@pytest.mark.parametrize(
    ("stated", "fault"),
    [
        ('levels = ["baseline", "swya"]', "comparison.levels: .*'swya', .*'sway'"),
        (
            'levels = ["sway", "pitch"]\nreference = "baseline"',
            "comparison.reference: 'baseline' .*sway, pitch",
        ),
        ('pairs = ["sway IC - nothing"]', "comparison.pairs: .*'nothing'; .*baseline no IC"),
        (
            'pairs = ["sway IC - sway no IC", "sway no IC - sway IC"]',
            "'sway no IC - sway IC' .*turned round",
        ),
    ],
)
def test_a_fault_of_the_comparison_is_one_line(written, stated, fault):
    with pytest.raises(StudyFaults) as found:
        read_study(written(stated))
    (line,) = found.value.faults
    assert line.startswith("study.toml: comparison")
    assert re.search(fault, line)


def test_every_subject_without_a_group_is_named(written):
    with pytest.raises(StudyFaults) as found:
        read_study(written('group = "group"', groups=(("sub01", "before"),)))
    (line,) = found.value.faults
    assert line.startswith("subject sub02: group: ")
    assert "comparison.group" in line
