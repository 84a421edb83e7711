"""Each variant of processing is a study of its own, and what they share is computed once."""

import re
import shutil

import pytest

from pipeline.cli.app import main
from pipeline.config.study import read_study
from pipeline.run.run import forecast, plan, run_study
from pipeline.run.store import LOST, read_trial
from pipeline.trial import chain, process
from tests.pipeline.equality import assert_identical
from tests.pipeline.fake_results import without_figures
from tests.pipeline.lab import edit

CUTOFFS_HZ = (5, 8)


@pytest.fixture
def study(moving_study, tmp_path):
    """One trial of the moving treadmill, processed with the study's own cut-off and two others."""
    folder = shutil.copytree(moving_study, tmp_path / "study")
    for path in folder.glob("sub02*"):
        path.unlink()
    person = folder / "sub01.toml"
    for name in ("baseline", "pitch"):
        edit(person, f'file = "sub01_{name}.c3d"', 'exclude = "not recorded"')
    variants = "".join(f"[variants.cutoff_{c}]\ncutoff_hz = {c}\n" for c in CUTOFFS_HZ)
    file = folder / "study.toml"
    file.write_text(file.read_text() + variants)
    return folder


def counting(monkeypatch, module, name):
    """Count the calls of a function of a module."""
    calls, function = [], getattr(module, name)

    def counted(*args, **kwargs):
        calls.append(args)
        return function(*args, **kwargs)

    counted.__qualname__, counted.__module__ = function.__qualname__, function.__module__
    monkeypatch.setattr(module, name, counted)
    return calls


def test_several_cut_offs_need_inverse_kinematics_once_and_give_what_each_gives_alone(
    study, tmp_path, monkeypatch
):
    calls = counting(monkeypatch, chain, "solve_motion")
    out = tmp_path / "out"
    (outcome,) = run_study(read_study(study), out)
    assert outcome.failure is None
    assert len(calls) == 1
    loaded = read_study(study)
    for name, own in loaded.variants.items():
        together = read_trial(out / "variants" / name / "trials" / "sub01_sway.parquet")
        alone = process.process_trial(own, "sub01", "sway")
        assert together.settings.cutoff_hz == own.file.settings.cutoff_hz
        assert_identical(together.motion.q, alone.motion.q, lost=LOST)
        for variant, dynamics in alone.variants.items():
            stored = together.variants[variant].residual
            assert_identical(stored, dynamics.residual, lost=LOST)


def test_a_variant_that_fails_costs_nothing_but_itself(study, tmp_path, monkeypatch, capsys):
    function = process.process_chain

    def failing(chain, study, name):
        if study.file.settings.cutoff_hz == 8:
            raise ValueError("too smooth")
        return function(chain, study, name)

    monkeypatch.setattr(process, "process_chain", failing)
    out = tmp_path / "out"
    assert main(["run", str(study), "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert re.search("sub01 sway; FAILED variant cutoff_8: ", said)
    there = {path.parts[-3] for path in (out / "variants").glob("*/trials/*.parquet")}
    assert there == {"cutoff_5"}
    assert (out / "trials" / "sub01_sway.parquet").is_file()
    monkeypatch.undo()
    assert main(["run", str(study), "--out", str(out)]) == 0
    with without_figures():
        assert main(["report", str(out), "--no-pages"]) == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "depend on the choices" in page
    assert "cutoff_8" in (out / "variants.csv").read_text(encoding="utf-8")


def test_a_run_says_what_is_new_what_is_outdated_and_why(study, tmp_path):
    out = tmp_path / "out"

    def said():
        return forecast(plan(read_study(study), out))

    assert said() == "trials: 1 new"
    list(run_study(read_study(study), out))
    assert said() == "trials: 1 up to date"
    edit(study / "study.toml", "cutoff_hz = 8", "cutoff_hz = 9")
    assert re.fullmatch("trials: 1 outdated .*cutoff_hz 8.0 → 9.0.*", said())
