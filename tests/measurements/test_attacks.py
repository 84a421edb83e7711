"""The campaign of attacks recognises each kind of outcome where it is planted."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("resource", reason="forks and limits")

from pipeline.config.schema import Settings, Subject
from pipeline.trial.process import process_recording
from tests.campaign import __main__ as campaign
from tests.campaign.judgement import (
    Ended,
    attempted,
    noted,
    numbers_changed,
    otherwise_equal,
    printed_raw,
    refusal,
    values_changed,
)
from tests.campaign.outcome import Attack, Outcome
from tests.campaign.worker import carry_out
from tests.pipeline.lab import walk
from tests.pipeline.other_formats import excerpt

pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")


@pytest.fixture(scope="module")
def walker(tmp_path_factory):
    return walk(tmp_path_factory.mktemp("walker"), duration_s=9.0)


def fail(folder, chance):
    raise TypeError("planted")


def sleep(folder, chance):
    time.sleep(60)


def crash(folder, chance):
    os.kill(os.getpid(), signal.SIGKILL)


def eat(folder, chance):
    return Outcome("fine", str(len(bytearray(3 << 30))))


def leave(folder, chance):
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    return Outcome("fine")


def end(folder, chance):
    return Outcome("fine")


PLANTED = {
    "traceback": fail,
    "hang": sleep,
    "crash": crash,
    "memory": eat,
    "orphan": leave,
    "fine": end,
}


@pytest.mark.parametrize("kind", PLANTED)
def test_an_attempt_that_is_not_survived_is_recognised_as_what_it_is(kind):
    attack = Attack("planted", kind, 0, PLANTED[kind], seconds=1.5 if kind == "hang" else 20)
    ((made, outcome),) = carry_out([attack], seed=0)
    assert (made, outcome.kind) == (attack, kind)
    assert outcome.survived == (kind == "fine")


@pytest.mark.parametrize(("act", "code"), [(fail, 1), (end, 0)])
def test_the_campaign_ends_with_1_where_an_attempt_is_not_survived(monkeypatch, capsys, act, code):
    planted = [Attack("planted", "here", number, act) for number in range(3)]
    monkeypatch.setattr(campaign, "attacks", lambda *_: iter(planted))
    monkeypatch.setattr(sys, "argv", ["campaign", "--short"])
    assert campaign.main() == code
    printed = capsys.readouterr().out
    assert ("planted/here/0: traceback: TypeError" in printed) == bool(code)


@pytest.mark.parametrize(
    ("code", "printed", "kind"),
    [
        (2, "hbm: error: walk.c3d: cut short\n", "refused"),
        (1, "hbm: error: walk.c3d: cut short\n", "unclear"),
        (2, "hbm: error: cut short\n", "unclear"),
        (2, f"hbm: error: walk.c3d: {'x' * 700}\n", "unclear"),
        (2, "hbm: error: walk.c3d: \x1b[2J\n", "unclear"),
        (2, "hbm: error: walk.c3d: a\u202eb\n", "unclear"),
        (1, "Traceback (most recent call last):\nKeyError: 3\n", "traceback"),
    ],
)
def test_a_refusal_is_one_clear_line_that_names_the_file(code, printed, kind):
    assert refusal(Ended(code, "", printed), ("walk.c3d",)).kind == kind


def test_an_error_that_readers_are_not_documented_to_raise_is_a_traceback():
    def refuse():
        raise ValueError("walk.c3d: cut short")

    assert attempted(refuse, ("walk.c3d",)).kind == "refused"
    assert attempted(lambda: fail(None, None), ("walk.c3d",)).kind == "traceback"


def test_changed_values_are_counted_apart_from_all_else_that_differs(walker):
    known = excerpt(walker, 600, 650)
    assert values_changed(known, known) == 0
    assert otherwise_equal(known, known)
    position = known.markers.position.copy()
    position[3, 5] += 0.1
    one = replace(known, markers=replace(known.markers, position=position))
    assert values_changed(one, known) == 1
    assert otherwise_equal(one, known)
    exchanged = replace(known, markers=replace(known.markers, names=known.markers.names[::-1]))
    assert not otherwise_equal(exchanged, known)
    plates = (replace(known.plates[0], center=known.plates[0].center + 0.01), known.plates[1])
    assert not otherwise_equal(replace(known, plates=plates), known)


def test_other_residuals_without_a_note_are_silent(walker):
    known = process_recording(walker, Subject(sex="male"), Settings())
    assert numbers_changed(known, known) is None
    residual = known.measured.residual
    for shift, kind in ((0.4, None), (2.0, "silent")):
        measured = replace(known.measured, residual=residual + shift * np.sign(residual))
        outcome = numbers_changed(replace(known, variants={"measured": measured}), known)
        assert (outcome and outcome.kind) == kind
    (note,) = (note for note in known.notes if note.code == "axes")
    assert noted(known.notes, known.notes) is None
    assert noted((*known.notes, note), known.notes) == Outcome("noted", "axes")


def test_control_characters_and_names_are_found_in_what_is_printed():
    assert printed_raw("5 N·m, “quoted”\n") == ""
    assert "\\x1b" in printed_raw("\x1b[1m")
    assert "x9b" in printed_raw("\x9b1m")
    assert "JANE DOE" in printed_raw("JANE DOE:LASI", ["JANE DOE"])
