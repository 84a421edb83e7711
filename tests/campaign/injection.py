"""Texts of files that terminals, pages, tables or paths may act on, and names of people."""

import random
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from hbm.markers import Markers
from pipeline.cli.request import TrialRequest
from pipeline.io.recording import Analog, Recording
from tests.campaign.judgement import CODES, Ended, commanded, printed_raw
from tests.campaign.outcome import Attack, Outcome
from tests.campaign.study_files import SEGMENTS, STUDY, SUBJECT, write_recordings
from tests.pipeline.lab import save

PERSON: Final = "JANE DOE"
SCRIPT: Final = "<script>alert(7)</script>"
FORMULA: Final = "=cmd|' /C calc'!A0"
PAYLOADS: Final = {
    "person": PERSON,
    "script": SCRIPT,
    "formula": FORMULA,
    "escape": "\x1b[2J\x1b]0;owned\x07",
    "C1": "a\x9b31mb",
    "markup": "[bold red]x[/nothing]",
    "path": "../../outside",
    "absolute path": "/outside",
    "reserved": "con.x",
    "line": 'a\nFAULT b"',
    "template": "{{ 7 * 7 }}%s{0}",
    "right to left": "a\u202egnp.exe",
    "long": "x" * 300,
}
TEXTS: Final = frozenset(
    {".csv", ".tsv", ".json", ".html", ".svg", ".md", ".mot", ".sto", ".trc", ".osim", ".urdf"}
)
RESERVED: Final = frozenset({"con", "prn", "aux", "nul", *(f"com{k}" for k in range(1, 10))})
MAX_COMMANDS_S: Final = 120.0
OF_RECORDING: Final[dict[str, Callable[[Recording, str], Recording]]] = {
    "label prefix": lambda walk, text: _labelled(walk, lambda name: f"{text}:{name}"),
    "label": lambda walk, text: _labelled(walk, lambda name: text if name == "LFHD" else name),
    "channel": lambda walk, text: replace(walk, analog=_channel(walk, text, "V")),
    "unit": lambda walk, text: replace(walk, analog=_channel(walk, "A", text)),
}
"""Where in a recording a text may stand."""
OF_STUDY: Final[dict[str, Callable[[str], tuple[str, str, str]]]] = {
    "study name": lambda text: (STUDY.replace('"Small"', _toml(text)), "sub01", SUBJECT),
    "subject id": lambda text: (STUDY, text, SUBJECT),
    "condition": lambda text: (
        STUDY.replace("conditions.level", f"conditions.{_toml(text)}"),
        "sub01",
        SUBJECT.replace("trials.level", f"trials.{_toml(text)}"),
    ),
    "exclude": lambda text: (STUDY, "sub01", _other_trial("exclude", text)),
    "file": lambda text: (STUDY, "sub01", _other_trial("file", text)),
    "rename": lambda text: (STUDY.replace("LASI =", f"{_toml(text)} ="), "sub01", SUBJECT),
    "key": lambda text: (f"{_toml(text)} = 1\n{STUDY}", "sub01", SUBJECT),
}
"""Where in a study's files a text may stand: study.toml, the subject's id, the subject's file."""
OF_PEOPLE: Final = frozenset({"label prefix", "subject", "software", "marker set"})
"""Where people's names stand in files, which nobody who processes them has typed."""


def injections(
    request: TrialRequest, recording: Recording, count: int, chance: random.Random
) -> Iterator[Attack]:
    """Inject texts into a recording and its study, ``count`` of all places and texts."""
    walk, static = request.trial, request.static
    assert static is not None
    attacks = [
        Attack("injection", where, number, act, MAX_COMMANDS_S)
        for number, (name, text) in enumerate(PAYLOADS.items())
        for where, act in (
            *((w, _into_recording(recording, static, w, name, text)) for w in OF_RECORDING),
            *((w, _into_study(walk.parent, w, name, text)) for w in OF_STUDY),
        )
        if text != PERSON or where in OF_PEOPLE
    ]
    yield from chance.sample(attacks, min(count, len(attacks)))


Act = Callable[[Path, random.Random], Outcome]


def _into_recording(recording: Recording, static: Path, where: str, name: str, text: str) -> Act:
    def act(folder: Path, _: random.Random) -> Outcome:
        home = folder / "a" / "b"
        home.mkdir(parents=True)
        try:
            save(OF_RECORDING[where](recording, text), home / "walk.c3d")
        except ValueError as error:
            return Outcome("refused", f"{name}: cannot be written: {error}")
        shutil.copy(static, home / "static.c3d")
        calls = [
            ["residuals", home / "walk.c3d", "--static", home / "static.c3d", "--sex", "male"],
            ["export", home / "walk.c3d", "--static", home / "static.c3d", "--sex", "male"],
        ]
        calls[0] += ["--out", home / "out"]
        calls[1] += ["--format", "osim", "--format", "tables", "--format", "bids"]
        calls[1] += ["--out", home / "out/export"]
        return _judged(name, calls, home, folder)

    return act


def _into_study(source: Path, where: str, name: str, text: str) -> Act:
    def act(folder: Path, _: random.Random) -> Outcome:
        home = folder / "a" / "b"
        study, subject, person = OF_STUDY[where](text)
        home.mkdir(parents=True)
        write_recordings(home, source, "sub01")
        (home / "study.toml").write_text(study, encoding="utf-8")
        (home / "own_segments.toml").write_text(SEGMENTS, encoding="utf-8")
        own = person.replace('"{id}"', _toml(subject)).replace("{id}", "sub01")
        (home / "sub01.toml").write_text(own, encoding="utf-8")
        calls = [
            ["check", home],
            ["run", home, "--out", home / "out"],
            ["report", home / "out"],
            ["view", home / "out", "--save", home / "out" / "trial.rrd"],
        ]
        return _judged(name, calls, home, folder)

    return act


def _judged(name: str, calls: list[list[object]], home: Path, folder: Path) -> Outcome:
    """Run commands and look at all that they printed and wrote."""
    given = {path for path in folder.rglob("*")}
    codes = []
    for call in calls:
        ended = commanded(*call)
        codes.append(f"{call[0]} {ended.code}")
        if bad := _printed(ended):
            return Outcome(bad[0], f"{name}: {call[0]}: {bad[1]}")
    for path in folder.rglob("*"):
        if path in given:
            continue
        if home / "out" not in (path, *path.parents):
            return Outcome("leak", f"{name}: {path.relative_to(folder)} is outside of --out")
        if path.is_file() and (bad_text := _written(path)):
            return Outcome("leak", f"{name}: {path.name} holds {bad_text}")
    refused = all(code.endswith(" 2") for code in codes)
    return Outcome("refused" if refused else "fine", f"{name}: {', '.join(codes)}")


def _printed(ended: Ended) -> tuple[str, str] | None:
    text = ended.out + ended.err
    if "Traceback" in text:
        return "traceback", ended.err.strip().splitlines()[-1]
    if ended.code not in CODES:
        return "unclear", f"exit code {ended.code}"
    raw = printed_raw(text)
    return ("leak", raw) if raw else None


def _written(path: Path) -> str:
    """Say what of a written file is raw; empty where nothing is."""
    content = path.read_bytes()
    if PERSON.encode() in content or PERSON in path.name:
        return "a person's name"
    if path.name.split(".")[0].lower() in RESERVED:
        return "in its name what Windows reserves"
    if path.suffix not in TEXTS:
        return ""
    text = content.decode("utf-8", errors="replace")
    if path.suffix in (".html", ".svg", ".osim", ".urdf") and SCRIPT in text:
        return "a script"
    if path.suffix in (".csv", ".tsv"):
        cells = (cell for line in text.splitlines() for cell in line.replace("\t", ",").split(","))
        if any(cell.strip('"').startswith("=cmd") for cell in cells):
            return "a formula"
    return printed_raw(text)


def _other_trial(key: str, text: str) -> str:
    """Give a subject's file whose second trial states one thing."""
    old = '[trials.again]\nfile = "{id}_again.c3d"'
    return SUBJECT.replace(old, f"[trials.again]\n{key} = {_toml(text)}")


def _toml(text: str) -> str:
    """Give a text as a TOML string that says it exactly."""
    return '"' + "".join(c if c.isalnum() else f"\\U{ord(c):08x}" for c in text) + '"'


def _labelled(walk: Recording, change: Callable[[str], str]) -> Recording:
    markers = walk.markers
    names = tuple(map(change, markers.names))
    return replace(walk, markers=Markers(markers.time, names, markers.position))


def _channel(walk: Recording, name: str, unit: str) -> Analog:
    plate = walk.plates[0]
    return Analog(plate.time, (name,), (unit,), plate.wrench_in_plate[:, :1])
