"""What is opened, and what is said of it: regular files only, one short printable line."""

import os
import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.config.study import read_study
from pipeline.config.toml_file import read_segments
from pipeline.io.c3d.read import read_c3d
from pipeline.io.dflow import read_dflow
from pipeline.io.input_file import MAX_MESSAGE, FileFault, naming
from pipeline.io.mox import read_mox
from pipeline.io.nexus import read_nexus
from pipeline.io.opensim import read_mot, read_trc
from pipeline.io.read import read_recording
from tests.pipeline.other_formats import excerpt, write_dflow, write_mox, write_nexus, write_opensim

READERS = [read_recording, read_c3d, read_trc, read_mot, read_dflow, read_mox, read_nexus]
NASTY = st.one_of(
    st.text(st.characters(exclude_characters='\n\r\t,;"&<>', exclude_categories=["Cs"])),
    st.sampled_from(
        [
            "\x1b[31mred\x1b[0m",
            "\x1b]0;title\x07",
            "[red]x[/red]",
            "[/]",
            "\u202eSISAL",
            "\x9b2J",
            "A" * 10_000,
            "S01:" * 3000,
        ]
    ),
)


def renamed(markers, names):
    unique = dict.fromkeys(names)
    return type(markers)(markers.time, tuple(unique), markers.position[:, : len(unique)])


def opened_within_5_s(read, path):
    """Give what a reader raises; a writer frees it where it waits for the other end of a pipe."""
    raised = []

    def call():
        try:
            read(path)
        except (OSError, ValueError) as error:
            raised.append(error)

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(5)
    return raised


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
@pytest.mark.parametrize(
    "read", [*READERS[:2], read_mot, read_segments], ids=lambda read: read.__name__
)
def test_a_pipe_is_refused_and_not_waited_for(tmp_path, read):
    pipe = tmp_path / "pipe.c3d"
    os.mkfifo(pipe)
    (error,) = opened_within_5_s(read, pipe)
    assert isinstance(error, OSError)
    assert error.filename == str(pipe)
    assert error.strerror.startswith("is a pipe or a device")


@given(NASTY)
def test_of_a_long_fault_both_ends_are_told_in_one_printable_line(text):
    with pytest.raises(FileFault) as caught, naming(type("Path", (), {"name": "a.txt"})):
        raise ValueError(f"{text}{text}; export the file again")
    line = str(caught.value)
    assert line.startswith("a.txt: ")
    assert line.endswith("; export the file again")
    assert line.isprintable()
    assert len(line) <= MAX_MESSAGE


@pytest.fixture(scope="module")
def trial(walker):
    return excerpt(walker, 400, 406)


def shown_of(read, path):
    """Give the labels and notes of a file, or why it is refused: a short line with its name."""
    refusal = ""
    try:
        recording = read(path)
    except ValueError as error:
        refusal = str(error)
    if refusal:
        assert refusal.startswith(f"{path.name}: ")
        assert len(refusal) < 300
        return [refusal]
    names = recording.analog.names if recording.analog is not None else ()
    return [*recording.markers.names, *names, *(note.text for note in recording.notes)]


WRITERS = {
    "TRC": lambda trial, path: write_opensim(trial, path, path.with_suffix(".mot")),
    "D-Flow": write_dflow,
    "MOX": write_mox,
    "Nexus": write_nexus,
}


@pytest.mark.parametrize("name", WRITERS)
@given(labels=st.lists(NASTY, min_size=1, max_size=3))
@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_whatever_labels_hold_notes_and_refusals_are_printable(trial, tmp_path, name, labels):
    markers = trial.markers
    named = (*labels, *markers.names[len(labels) :])
    path = tmp_path / "nasty.dat"
    WRITERS[name](replace(trial, markers=renamed(markers, named)), path)
    for text in shown_of(read_recording, path):
        assert text.isprintable()


@given(labels=st.lists(NASTY, min_size=1, max_size=3))
@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_whatever_labels_of_a_c3d_file_hold_they_are_printable(raw_c3d, trial, labels):
    points = trial.markers.position[:, : len(labels)]
    samples = np.concatenate([1000 * points, np.zeros((*points.shape[:2], 1))], axis=-1)
    texts = [label.encode()[:60].decode("utf-8", "ignore") for label in labels]
    path = raw_c3d(samples, POINT={"LABELS": texts, "UNITS": texts[0] or "mm"})
    for text in shown_of(lambda path: read_c3d(path, "forward,left,up"), path):
        assert text.isprintable()


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 5000,
        "a = " + "0x" + "F" * 6000,
        ".".join(["a"] * 5000) + " = 1",
        '"\\u001b[31m" = 1',
        f'"{"k" * 10_000}" = 1',
    ],
    ids=["brackets", "digits", "keys", "escape", "long"],
)
@pytest.mark.parametrize("name", ["study.toml", "sub01.toml", "segments.toml"])
def test_whatever_a_toml_file_holds_its_faults_are_short_printable_lines(tmp_path, name, text):
    (tmp_path / "study.toml").write_text("[conditions.walk]\n", encoding="utf-8")
    (tmp_path / name).write_text(text, encoding="utf-8")
    read = read_segments if name == "segments.toml" else lambda path: read_study(path.parent)
    with pytest.raises(ValueError, match="toml") as caught:
        read(tmp_path / name)
    for fault in getattr(caught.value, "faults", [str(caught.value)]):
        assert fault.isprintable()
        assert len(fault) < 300
