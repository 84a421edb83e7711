"""A run does every trial once, redoes and loses nothing, and a failure stops no other trial."""

import json
import os
import re
import shutil
import signal
from pathlib import Path

import pytest

from pipeline.cli.app import main
from pipeline.config.study import Study, read_study
from pipeline.run import cluster, program
from pipeline.run.run import plan, run_jobs, run_study
from pipeline.run.store import read_trial
from pipeline.trial import process
from tests.pipeline.lab import edit

TRIALS = [f"sub0{n}_{c}" for n in (1, 2) for c in ("baseline", "pitch", "sway")]


@pytest.fixture
def study(moving_study, tmp_path):
    """A copy of the study; tests may change it."""
    return shutil.copytree(moving_study, tmp_path / "study")


@pytest.fixture
def out(finished, tmp_path):
    """A copy of its finished results."""
    return shutil.copytree(finished, tmp_path / "out")


def contents(out):
    return {path.name: path.read_bytes() for path in (out / "trials").glob("*.parquet")}


def states(outcomes):
    return {o.job.name.stem: o.state for o in outcomes}


def only(outcomes, state):
    return {o.job.target.stem: o.reason for o in outcomes if o.state == state}


def forget(out, *names):
    for name in names:
        (out / "trials" / f"{name}.parquet").unlink()


def test_finished_results_are_kept_untouched(moving_study, out, monkeypatch):
    monkeypatch.setattr(process, "process_chain", None)
    before = {path: path.stat().st_mtime_ns for path in (out / "trials").iterdir()}
    outcomes = list(run_study(read_study(moving_study), out, jobs=2))
    assert set(states(outcomes).values()) == {"kept"}
    assert {path: path.stat().st_mtime_ns for path in (out / "trials").iterdir()} == before


def rewrite(name):
    def change(folder):
        path = folder / name
        content = bytearray(path.read_bytes())
        content[-1] ^= 1
        path.write_bytes(content)

    return change


def retype(name, old, new):
    return lambda folder: edit(folder / name, old, new)


def add_axes(folder):
    edit(folder / "study.toml", 'name = "Moving numbers"', 'axes = "left,back,up"')


@pytest.mark.parametrize(
    ("change", "redone"),
    [
        (retype("study.toml", "Moving numbers", "Numbers that move"), []),
        (retype("study.toml", "[treadmill]", "[comparison]\nmargin = 0.1\n[treadmill]"), []),
        (rewrite("sub01_sway.c3d"), ["sub01_sway"]),
        (rewrite("empty.c3d"), TRIALS),
        (retype("study.toml", "skip_s = 6.0\n[", "skip_s = 5.0\n["), ["baseline"]),
        (retype("study.toml", "cycles = 2", "cycles = 1"), ["sway"]),
        (retype("study.toml", "[treadmill]", "[settings]\ncutoff_hz = 8.0\n[treadmill]"), TRIALS),
        (retype("study.toml", "[treadmill]", "[treadmill]\ncutoff_hz = 10.0"), TRIALS),
        (add_axes, TRIALS),
        (retype("sub02.toml", 'sex = "female"', 'sex = "male"'), ["sub02"]),
        (
            retype("sub02.toml", 'sex = "female"', 'static = "sub02_sway.c3d"\nsex = "female"'),
            ["sub02"],
        ),
    ],
)
def test_what_changed_is_redone_and_nothing_else(study, out, change, redone):
    before = {job.target.stem: job.key for job in plan(read_study(study), out)}
    change(study)
    after = {job.target.stem: job.key for job in plan(read_study(study), out)}
    changed = {name for name in TRIALS if before[name] != after[name]}
    assert changed == {name for name in TRIALS if any(part in name for part in redone)}


def test_another_program_or_library_redoes_everything(moving_study, out, monkeypatch):
    before = [job.key for job in plan(read_study(moving_study), out)]
    program.computation_digest.cache_clear()
    real = program.version
    other = {"scipy": real("scipy") + "1"}
    monkeypatch.setattr(program, "version", lambda name: other.get(name) or real(name))
    after = [job.key for job in plan(read_study(moving_study), out)]
    program.computation_digest.cache_clear()
    assert not set(before) & set(after)


@pytest.mark.parametrize(
    ("table", "place"), [("settings", "settings."), ("variants.slow", "variants.slow: ")]
)
def test_an_engine_that_an_older_study_states_is_one_line_that_says_to_remove_it(
    study, out, capsys, table, place
):
    edit(study / "study.toml", "[treadmill]", f'[{table}]\nengine = "kernels"\n[treadmill]')
    line = f"study.toml: {place}engine: no longer needed"
    for command in (["run", str(study), "--out", str(out)], ["check", str(study)]):
        assert main(command) == 2
        (message,) = capsys.readouterr().err.splitlines()
        assert message.startswith(f"hbm: error: {line}")


def test_two_trials_at_a_time_give_the_same_results_as_one(moving_study, finished, tmp_path):
    outcomes = list(run_study(read_study(moving_study), tmp_path, subjects=["sub01"], jobs=2))
    assert sorted(states(outcomes).values()) == ["done"] * 3
    whole = contents(finished)
    assert contents(tmp_path) == {name: whole[name] for name in contents(tmp_path)}


class VanishingCluster:
    """A stand-in for dask.distributed whose workers or scheduler disappear for good."""

    CancelledError = KilledWorker = RuntimeError

    def __init__(self, answers):
        self.answers = iter(answers)
        self.status = "pending"

    def Client(self, *_, **__):
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def nthreads(self):
        answer = next(self.answers)
        if isinstance(answer, Exception):
            raise answer
        return {"worker": answer} if answer else {}

    def submit(self, *_, **__):
        return VanishingCluster(())

    def wait(self, *_, **__):
        raise TimeoutError


@pytest.mark.parametrize("answers", [[0, 1, 2, 0], [1, OSError("connection lost")]])
def test_a_cluster_that_disappears_is_abandoned(moving_study, tmp_path, monkeypatch, answers):
    monkeypatch.setattr(cluster, "import_module", lambda _: VanishingCluster([*answers, 0, 0]))
    monkeypatch.setattr(cluster, "MAX_WITHOUT_WORKERS_S", 1e-9)
    outcomes = list(run_study(read_study(moving_study), tmp_path, scheduler="tcp://somewhere:1"))
    failed = only(outcomes, "failed")
    assert set(failed) == set(TRIALS)
    assert all("cluster is gone" in reason for reason in failed.values())


def test_only_what_is_asked_for_is_planned(moving_study, out):
    study = read_study(moving_study)
    planned = plan(study, out, subjects=["sub02", "sub02"], conditions=["sway", "pitch"])
    assert [job.target.stem for job in planned] == ["sub02_sway", "sub02_pitch"]


def test_a_worker_may_run_in_another_folder(moving_study, tmp_path, monkeypatch):
    monkeypatch.chdir(moving_study.parent)
    job = plan(read_study(moving_study.name), Path("out"))[0]
    monkeypatch.chdir(tmp_path)
    assert job.target.parent == moving_study.parent.resolve() / "out" / "trials"
    assert job.study.path("empty.c3d").is_file()
    assert job.key == plan(read_study(moving_study), tmp_path)[0].key


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (["--subject", "sub3"], "no subject 'sub3', "),
        (["--condition", "swy"], "no condition 'swy', "),
    ],
)
def test_an_unknown_subject_or_condition_is_wrong_usage(
    moving_study, tmp_path, capsys, option, message
):
    assert main(["run", str(moving_study), *option, "--out", str(tmp_path / "new")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_in_python_a_study_is_read_first_and_one_subject_may_be_a_text(moving_study, tmp_path):
    with pytest.raises(TypeError, match=r"^study: .*hr\.read_study"):
        run_study(str(moving_study), tmp_path)
    planned = plan(read_study(moving_study), tmp_path, subjects="sub01", conditions="sway")
    assert [job.name.stem for job in planned] == ["sub01_sway"]


def test_a_failing_trial_is_listed_with_its_reason_and_stops_no_other(study, out, capsys):
    forget(out, "sub01_sway", "sub02_pitch")
    sound = (study / "sub01_sway.c3d").read_bytes()
    (study / "sub01_sway.c3d").write_bytes(sound[:100_000])
    assert main(["run", str(study), "--out", str(out)]) == 1
    printed = capsys.readouterr().out
    line = next(line for line in printed.splitlines() if line.startswith("FAILED"))
    assert line.startswith("FAILED sub01 sway: sub01_sway.c3d: ")
    assert re.search(r"1 trial processed, 4 .*, 1 failed", printed)
    failures = json.loads((out / "failures.json").read_text(encoding="utf-8"))
    assert list(failures) == ["sub01 sway"]
    assert failures["sub01 sway"] in line

    assert main(["run", str(study), "--out", str(out), "--subject", "sub02"]) == 0
    assert list(json.loads((out / "failures.json").read_text("utf-8"))) == ["sub01 sway"]
    (study / "sub01_sway.c3d").write_bytes(sound)
    assert main(["run", str(study), "--out", str(out)]) == 0
    assert json.loads((out / "failures.json").read_text("utf-8")) == {}


def test_a_damaged_result_is_made_again_and_named_by_the_report(study, out, finished, capsys):
    """Also where one bit of one number is wrong."""
    path = out / "trials" / "sub02_sway.parquet"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)
    assert main(["report", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("hbm: error: sub02_sway.parquet is damaged")
    assert main(["run", str(study), "--out", str(out)]) == 0
    assert re.search("1 trial processed, 5 ", capsys.readouterr().out)
    assert contents(out) == contents(finished)


def test_a_file_that_disappears_midway_fails_only_its_own_trial(study, out, finished):
    forget(out, "sub01_sway", "sub02_pitch")
    planned = plan(read_study(study), out)
    (study / "sub01_sway.c3d").unlink()
    outcomes = list(run_jobs(planned))
    failed = only(outcomes, "failed")
    assert list(failed) == ["sub01_sway"]
    assert failed["sub01_sway"].startswith("no file 'sub01_sway.c3d'")
    assert list(only(outcomes, "done")) == ["sub02_pitch"]
    whole = contents(finished)
    del whole["sub01_sway.parquet"]
    assert contents(out) == whole


def test_a_static_pose_that_is_missing_fails_only_the_trials_that_need_it(study, out, capsys):
    retype("sub02.toml", 'sex = "female"', 'sex = "female"\nstatic = "missing.c3d"')(study)
    forget(out, *TRIALS[3:])
    assert main(["run", str(study), "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert re.search(r"0 trials processed, 3 .*, 3 failed", said)
    first, others = (line for line in said.splitlines() if "no file 'missing.c3d' in " in line)
    assert first.startswith("FAILED sub02 ")
    assert others.startswith("FAILED sub02 ")
    assert ", sub02 " in others
    assert "kept" not in said


def test_results_made_with_other_settings_are_kept_unless_they_are_to_be_replaced(
    study, out, finished, capsys
):
    retype("study.toml", "[treadmill]", "[settings]\ncutoff_hz = 8.0\n[treadmill]")(study)
    command = ["run", str(study), "--subject", "sub01", "--condition", "sway", "--out", str(out)]
    assert main(command) == 2
    assert "6.0 → 8.0" in capsys.readouterr().err
    assert contents(out) == contents(finished)
    assert main([*command, "--overwrite"]) == 0
    assert read_trial(out / "trials" / "sub01_sway.parquet", frames=False).settings.cutoff_hz == 8.0
    others = [name for name in contents(out) if name != "sub01_sway.parquet"]
    assert all(contents(out)[name] == contents(finished)[name] for name in others)


def test_results_of_two_studies_are_not_mixed_and_their_folders_not_confused(
    study, tmp_path, capsys
):
    results = tmp_path / "results"
    command = ["--subject", "sub01", "--condition", "sway", "--out", str(results)]
    assert main(["run", str(study), *command]) == 0
    other = shutil.copytree(study, tmp_path / "other")
    assert main(["run", str(other), *command]) == 2
    assert "--out" in capsys.readouterr().err
    assert main(["run", str(study), *command]) == 0
    for words, mended in (
        (["run", str(results)], "hbm report"),
        (["report", str(study)], "hbm run"),
    ):
        assert main(words) == 2
        assert mended in capsys.readouterr().err


def test_a_file_that_changes_midway_gives_no_result_under_the_old_key(study, out, monkeypatch):
    forget(out, "sub01_sway")
    real = process.process_chain

    def changing(*given, **named):
        result = real(*given, **named)
        rewrite("sub01_sway.c3d")(study)
        return result

    monkeypatch.setattr(process, "process_chain", changing)
    outcomes = list(run_jobs(plan(read_study(study), out)))
    assert "changed while" in only(outcomes, "failed")["sub01_sway"]
    assert not (out / "trials" / "sub01_sway.parquet").exists()


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (ValueError("no markers\nat all"), "no markers at all"),
        (KeyError("LASIS"), "a fault of this program: KeyError: LASIS (test_run.py, line "),
    ],
)
def test_whatever_goes_wrong_in_a_trial_is_a_failure_of_that_trial(
    moving_study, out, monkeypatch, error, message
):
    def broken(*given, **named):
        raise error

    forget(out, "sub01_sway")
    monkeypatch.setattr(process, "process_chain", broken)
    failed = only(run_study(read_study(moving_study), out), "failed")
    assert list(failed) == ["sub01_sway"]
    assert failed["sub01_sway"].startswith(message)
    assert "\n" not in failed["sub01_sway"]


class StudyThatKillsItsWorker(Study):
    """A study with a trial that kills the process working on it, as lack of memory does."""

    __slots__ = ()

    def path(self, name):
        ours = (self.folder / "process_of_the_test").read_text()
        if name == "sub01_sway.c3d" and str(os.getpid()) != ours:
            os.kill(os.getpid(), signal.SIGKILL)
        return self.folder / name


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_a_worker_that_dies_fails_only_its_own_trial(study, out, finished):
    (study / "process_of_the_test").write_text(str(os.getpid()))
    forget(out, "sub01_sway", "sub02_pitch")
    read = read_study(study)
    study_that_kills = StudyThatKillsItsWorker(
        read.folder, read.file, read.subjects, read.marker_set
    )
    outcomes = list(run_study(study_that_kills, out, jobs=2))
    failed = only(outcomes, "failed")
    assert list(failed) == ["sub01_sway"]
    assert "died" in failed["sub01_sway"]
    assert list(only(outcomes, "done")) == ["sub02_pitch"]
    whole = contents(finished)
    del whole["sub01_sway.parquet"]
    assert contents(out) == whole


def test_leftovers_of_a_killed_run_are_removed(moving_study, out):
    dead = out / "trials" / ".sub01_sway.parquet.deadbeef.part"
    dead.write_bytes(b"half")
    os.utime(dead, (0, 0))
    assert main(["run", str(moving_study), "--out", str(out)]) == 0
    assert not dead.exists()
