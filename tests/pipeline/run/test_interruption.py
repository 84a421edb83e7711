"""A run that is interrupted, started twice or without disk space leaves nothing half-written."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from pipeline.cli.app import main
from pipeline.run.processes import recorded_requests
from pipeline.trial import process
from tests.campaign.kills import environment
from tests.pipeline.fake_results import write_fake_results

needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="lists processes")

pytestmark = pytest.mark.skipif(os.name == "nt", reason="process groups and signals")


def hbm(*arguments):
    """Start the command line as a terminal does in the foreground: an interrupt ends it.

    Without the reset, the process would ignore interrupts wherever the tests run in the background
    of a shell, for it inherits that.
    """
    return subprocess.Popen(
        [sys.executable, "-m", "pipeline.cli", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment("test of interruption"),
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


@contextmanager
def handled(number, handler):
    """Let a signal to this process have another handler."""
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


def results(out):
    return {path.name: path.read_bytes() for path in (out / "trials").glob("*.parquet")}


@pytest.mark.slow
def test_two_runs_at_once_do_not_harm_each_other(moving_study, finished, tmp_path):
    both = [hbm("run", moving_study, "--out", tmp_path) for _ in range(2)]
    printed = [running.communicate()[0] for running in both]
    assert [running.returncode for running in both] == [0, 0], printed
    assert all("0 failed" in text for text in printed)
    assert results(tmp_path) == results(finished)
    assert not list((tmp_path / "trials").glob(".*"))


def members(group):
    """Command lines of the processes of a group that have not ended."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, _, its_group = (folder / "stat").read_text().rpartition(")")[2].split()[:3]
            command = (folder / "cmdline").read_text(errors="replace").replace("\0", " ")
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(its_group) == group and state != "Z":
            found.append(command)
    return found


def wait_until(condition, patience_s=60.0):
    give_up = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.05)


def has_workers(running):
    return lambda: sum("LokyProcess" in each for each in members(running.pid)) == 2


@needs_proc
@pytest.mark.parametrize(
    ("send", "number", "code", "word", "delay_s"),
    [
        (os.killpg, signal.SIGINT, 130, "interrupted", 0.0),
        (os.kill, signal.SIGTERM, 143, "terminated", 1.5),
    ],
)
def test_a_stopped_run_says_how_to_go_on_and_leaves_no_process(
    moving_study, tmp_path, send, number, code, word, delay_s
):
    """Stopped while the workers import what they need, and while they work."""
    running = hbm("run", moving_study, "--out", tmp_path, "--jobs", 2)
    wait_until(has_workers(running))
    time.sleep(delay_s)
    send(running.pid, number)
    _, errors = running.communicate(timeout=30)
    assert running.returncode == code, errors
    assert re.fullmatch(rf"hbm: {word}: .*\d of 6 trials; .*same command.*\n", errors)
    wait_until(lambda: not members(running.pid), 10.0)
    assert json.loads((tmp_path / "failures.json").read_text("utf-8")) == {}
    assert not list(tmp_path.rglob("*.part"))


def test_requests_to_stop_that_are_recorded_interrupt_nothing_however_close_they_come():
    handlers = [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)]
    with recorded_requests() as requests:
        for number in (signal.SIGTERM, signal.SIGTERM, signal.SIGINT):
            signal.raise_signal(number)
    assert requests == [signal.SIGTERM, signal.SIGTERM, signal.SIGINT]
    assert handlers == [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)]


@pytest.mark.parametrize(
    ("words", "suffix", "number"),
    [
        ("residuals {study}/sub01_sway.c3d --out {out} --json", ".svg", signal.SIGINT),
        ("report {out} --no-pages", ".csv", signal.SIGTERM),
        ("export {study}/sub01_sway.c3d --format tables --out {out}", ".csv", signal.SIGINT),
    ],
)
def test_any_command_that_is_stopped_says_so_and_leaves_no_half_written_file(
    moving_study, tmp_path, monkeypatch, capsys, words, suffix, number
):
    out, replace = tmp_path / "out", Path.replace
    if words.startswith("report"):
        write_fake_results(out, subjects=2, conditions=("sway",), cycles=2)

    def stopped(self, target):
        if str(target).endswith(suffix):
            signal.raise_signal(number)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", stopped)
    words = words.format(study=moving_study, out=out).split()
    with handled(signal.SIGINT, signal.default_int_handler):
        returned = main(words)
    printed, error = capsys.readouterr()
    code, word = {signal.SIGTERM: (143, "terminated"), signal.SIGINT: (130, "interrupted")}[number]
    assert returned == code
    assert re.fullmatch(rf"hbm: {word}: .*same command.*\n", error)
    assert not list(out.rglob("*.part"))
    if "--json" in words:
        said = json.loads(printed)["error"]
        assert (said["code"], f"hbm: {said['text']}\n") == (word, error)


@needs_proc
def test_the_workers_of_a_killed_run_end_with_it(moving_study, tmp_path):
    running = hbm("run", moving_study, "--out", tmp_path, "--jobs", 2)
    wait_until(has_workers(running))
    running.kill()
    wait_until(lambda: not members(running.pid), 20.0)
    running.communicate(timeout=20)


@needs_proc
def test_a_stopped_simulation_says_how_to_go_on_and_leaves_no_process(tmp_path):
    running = hbm("demo", "--out", tmp_path, "--jobs", 2)
    wait_until(has_workers(running))
    os.killpg(running.pid, signal.SIGINT)
    _, errors = running.communicate(timeout=30)
    assert running.returncode == 130, errors
    assert re.fullmatch(r"hbm: interrupted: .*same command (goes on|begins again)\n", errors)
    wait_until(lambda: not members(running.pid), 10.0)


def test_a_run_that_the_shell_shields_from_interrupts_goes_on(
    moving_study, finished, tmp_path, monkeypatch, capsys
):
    """As a shell does for what it starts in the background, with ``&`` or ``nohup``."""

    real = process.process_chain

    def interrupted(*given, **named):
        signal.raise_signal(signal.SIGINT)
        return real(*given, **named)

    monkeypatch.setattr(process, "process_chain", interrupted)
    one = ["--subject", "sub01", "--condition", "sway"]
    with handled(signal.SIGINT, signal.SIG_IGN):
        assert main(["run", str(moving_study), "--out", str(tmp_path), *one]) == 0
    assert capsys.readouterr().err == ""
    assert results(tmp_path).items() <= results(finished).items()
    assert len(results(tmp_path)) == 1


def test_files_that_may_not_grow_fail_with_one_line_each(moving_study, tmp_path, capsys):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, before[1]))
    try:
        assert main(["run", str(moving_study), "--out", str(tmp_path), "--condition", "pitch"]) == 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    printed = capsys.readouterr().out
    failed = [line for line in printed.splitlines() if line.startswith("FAILED")]
    assert len(failed) == 2
    assert all("file too large" in line for line in failed), failed
    assert not results(tmp_path)
    assert not list((tmp_path / "trials").glob(".*"))
    failures = json.loads((tmp_path / "failures.json").read_text("utf-8"))
    assert len(failures) == 2


def test_a_folder_without_permission_gives_one_clear_line(moving_study, tmp_path, capsys):
    forbidden = tmp_path / "read_only"
    forbidden.mkdir(mode=0o555)
    if os.access(forbidden, os.W_OK):
        forbidden = Path("/proc")
    assert main(["run", str(moving_study), "--out", str(forbidden / "results")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "cannot write there" in lines[0]
