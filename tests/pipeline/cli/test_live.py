"""``hbm live`` gives the residuals of a replayed recording, a recording and a summary."""

import re
import signal
import subprocess
import sys
import time
from collections import deque
from contextlib import contextmanager
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from socket import gethostname
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline.cli import live_session
from pipeline.cli.app import main
from pipeline.cli.live_session import LightLine, follow
from pipeline.cli.terminal import PlainConsole
from pipeline.config.live import Live
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.io.read import read_recording
from pipeline.live.chain import LiveChain
from pipeline.live.monitor import Monitor
from pipeline.live.output import RESULTS_FOLDER, STREAMS
from pipeline.live.replay import RecordedSource
from pipeline.live.session import Session
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.pipeline.live.playing import body_of

DURATION_S = 14.0
PATIENCE_S = 60
needs_lsl = pytest.mark.skipif(find_spec("pylsl") is None, reason="the extra live is not installed")


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "walk.c3d"
    simulate_trial(path, duration_s=DURATION_S)
    return path


def prepare(most_bytes):
    """Let Ctrl-C interrupt, and files grow no further, in a new process."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if most_bytes:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes))


@contextmanager
def hbm(*arguments, most_bytes=None):
    command = [sys.executable, "-m", "pipeline.cli", "live", *map(str, arguments)]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=Path(__file__).resolve().parents[3],
        preexec_fn=lambda: prepare(most_bytes),
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def study_of(folder, stated):
    """Give a study of one subject who has no recordings."""
    folder.mkdir()
    (folder / "study.toml").write_text(stated, encoding="utf-8")
    subject = 'id = "s1"\n[trials.level]\nexclude = "none"\n'
    (folder / "s1.toml").write_text(subject, encoding="utf-8")
    return folder


def refused(capsys, *arguments):
    assert main(["live", *map(str, arguments)]) == 2
    return capsys.readouterr().err


def said_of_a_replay(walk, *options):
    """What a session prints that follows a whole replay and is interrupted then."""
    with hbm("--replay", walk) as replay:
        assert "playing walk.c3d as Markers, Plates" in replay.stdout.readline()
        with hbm(*options) as live:
            assert replay.wait(PATIENCE_S) == 0
            time.sleep(1.0)
            live.send_signal(signal.SIGINT)
            said = live.communicate(timeout=PATIENCE_S)[0]
            assert live.returncode == 0
    return said


@pytest.mark.slow
@needs_lsl
def test_a_replayed_walk_gives_its_residuals_until_ctrl_c_and_is_recorded(walk, tmp_path, capsys):
    out = tmp_path / "out"
    said = said_of_a_replay(walk, "--static", walk, "--out", out)
    assert f"Markers (100 Hz) from {gethostname()}, Plates (1000 Hz)" in said
    lights = re.findall(r"^(GOOD|LOOK|STOP): ", said, re.MULTILINE)
    assert lights[0] == "LOOK"  # it waits for streams, then for two seconds of frames
    assert re.search(r"^GOOD: \d+ of 25 .*RMS Fx \d+", said, re.MULTILINE)
    assert len(lights) < DURATION_S  # a line each five seconds, and one when the light changes
    received, solved, marked = map(
        int, re.search(r"(\d+) frames received: (\d+) used, (\d+) not used", said).groups()
    )
    assert received == solved + marked >= 100 * DURATION_S - 20
    assert solved > 0.5 * received  # a busy machine makes some late
    assert len(pd.read_parquet(out / RESULTS_FOLDER)) == received
    rms = re.search(r"residuals measured: RMS Fx (\d+) Fy (\d+) Fz (\d+)", said)

    capsys.readouterr()
    options = ["--static", str(walk), "--filter", "realtime", "--out", str(tmp_path / "offline")]
    assert main(["residuals", str(out / STREAMS), *options]) == 0
    table = pd.read_csv(tmp_path / "offline" / "streams_residuals.csv").set_index("axis")
    for axis, ours in zip(("Fx", "Fy", "Fz"), rms.groups(), strict=True):
        assert float(ours) == pytest.approx(table.rms[axis], rel=0.2, abs=1)


@pytest.mark.slow
@needs_lsl
def test_without_any_file_the_body_is_of_the_pose_and_the_plates_are_where_streams_state(
    walk, tmp_path
):
    out = tmp_path / "out"
    said = said_of_a_replay(walk, "--pose", "--out", out)
    assert "stand still" in said
    assert re.search(r"RMS Fx (\d+) Fy (\d+) Fz (\d+)", said)
    recorded, true = read_recording(out / STREAMS), read_recording(walk)
    for ours, plate in zip(recorded.plates, true.plates, strict=True):
        np.testing.assert_array_equal(ours.center, plate.center)


@pytest.mark.slow
@needs_lsl
@pytest.mark.parametrize(
    ("signals", "code"),
    [([signal.SIGINT, signal.SIGINT], 0), ([signal.SIGTERM, signal.SIGTERM], 128 + signal.SIGTERM)],
)
def test_a_session_that_is_stopped_twice_still_ends_with_a_whole_recording(
    walk, tmp_path, signals, code
):
    out = tmp_path / "out"
    with hbm("--replay", walk), hbm("--static", walk, "--out", out) as live:
        while "recording to" not in live.stdout.readline():
            assert live.poll() is None
        time.sleep(2.0)
        for each in signals:
            live.send_signal(each)
            time.sleep(0.003)
        said = live.communicate(timeout=PATIENCE_S)[0]
    assert live.returncode == code
    assert "frames received" in said
    assert "Traceback" not in said
    codes = [note.code for note in read_recording(out / STREAMS).notes]
    assert "cut_short" not in codes


@pytest.mark.slow
@needs_lsl
def test_a_recording_that_cannot_go_on_is_said_at_once_and_the_session_goes_on(walk, tmp_path):
    out = tmp_path / "out"
    with hbm("--replay", walk), hbm("--static", walk, "--out", out, most_bytes=500_000) as live:
        while "recording stopped: File too large; all else goes on" not in live.stdout.readline():
            assert live.poll() is None
        time.sleep(0.5)
        live.send_signal(signal.SIGINT)
        said = live.communicate(timeout=PATIENCE_S)[0]
    assert live.returncode == 1
    assert re.search(r"recording stopped: .*\d+ entries", said)
    assert len(read_recording(out / STREAMS).markers.time) > 100


def test_a_folder_that_cannot_take_a_recording_is_refused_before_anything_is_awaited(
    walk, tmp_path, capsys
):
    (tmp_path / STREAMS).touch()
    said = refused(capsys, "--static", walk, "--out", tmp_path)
    assert "recording already" in said


def test_what_is_missing_is_said_in_one_line(walk, tmp_path, capsys):
    assert re.search("--static FILE.* --pose", refused(capsys))
    lab = refused(capsys, "--static", walk, "--calibration", tmp_path / "lab.json")
    assert re.search(r"lab\.json .*\[treadmill\.platform\]", lab)
    assert "absent.c3d" in refused(capsys, "--static", tmp_path / "absent.c3d")


@needs_lsl
def test_the_address_is_that_of_the_option_or_of_the_study(walk, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pipeline.live.output._listening", [])
    stated = '[conditions.level]\n[live]\nlisten = "192.0.2.1"\n'
    played = "--replay", walk, "--study", study_of(tmp_path / "study", stated)
    assert "192.0.2.1 is not" in refused(capsys, *played)
    assert "'cameras' is no" in refused(capsys, *played, "--listen", "cameras")


def test_the_light_is_opened_to_others_at_an_address_of_this_computer_alone(walk, capsys):
    for address in ("192.0.2.1", "0.0.0.0"):
        line = refused(capsys, "--static", walk, "--page-host", address)
        assert re.search(rf"{re.escape(address)}\S* is no .*this computer", line)


@pytest.mark.slow
@needs_lsl
def test_a_search_that_is_stopped_ends_with_one_line(walk, tmp_path):
    with hbm("--static", walk, "--out", tmp_path / "out") as live:
        assert live.stdout.readline() == f"calibration pose: {walk.name}\n"
        assert " http://127.0.0.1:" in live.stdout.readline()
        assert re.search(r"127\.0\.0\.1 .*Markers, Plates", live.stdout.readline())
        waiting = "LOOK: Waiting for streams Markers, Plates · 0 / 25 gait cycles"
        assert live.stdout.readline() == f"{waiting}\n"
        time.sleep(0.5)
        live.send_signal(signal.SIGTERM)
        said = live.communicate(timeout=PATIENCE_S)[0]
    assert live.returncode == 128 + signal.SIGTERM
    assert re.fullmatch("hbm: terminated: .*nothing is recorded\n", said)
    assert not (tmp_path / "out").exists()


class Picture:
    """A view whose picture is late."""

    address, fault, late_s = None, None, 1.23

    def show(self, frame):
        pass

    show_board = show


@pytest.fixture(scope="module")
def trial(walk):
    """The recording of the walk and the body."""
    recording = read_recording(walk)
    return recording, body_of(recording, Subject())


@pytest.mark.parametrize("view", [None, Picture()])
def test_a_terminal_has_one_line_with_the_light_that_says_how_late_the_picture_is(
    trial, view, monkeypatch
):
    recording, body = trial
    source, plates, still = RecordedSource(recording), recording.plates, Laboratory(Treadmill())
    chain = LiveChain(body, still, Settings(), Live(), source.streams, plates)
    session, monitor = Session(source, chain), Monitor(chain, plates)
    monkeypatch.setattr(live_session, "STATUS_S", 0.05)
    shown = StringIO()
    with LightLine(PlainConsole(file=shown, force_terminal=True, width=200), 25) as line:
        line.wait_for_streams(["Markers"], ["Plates"])
        line._live.refresh()
        assert re.search("stream Markers; .*Plates · 0 / 25 ", shown.getvalue())
        recorder = SimpleNamespace(fault=None)
        deadline = time.monotonic() + PATIENCE_S

        def goes_on():
            seen = line.board.colour == "good" and line.board.rms
            return not seen and time.monotonic() < deadline

        follow(session, source, monitor, recorder, view, line, goes_on, deque())
        line._live.refresh()
    newest = shown.getvalue().rsplit(" GOOD ", 1)[-1]
    assert "· RMS Fx" in newest
    assert ("1.2 s late" in newest) == (view is not None)
    assert shown.getvalue().count("\n") == 1  # at its end
