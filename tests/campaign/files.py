"""Damaged files of every format: mutations, truncations, single bits; read, and as commands."""

import random
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from tests.campaign.formats import Format
from tests.campaign.judgement import commanded, printed_raw, refusal
from tests.campaign.mutations import Damage, flip_bit, mutate, truncate
from tests.campaign.outcome import TOLD, Attack, Outcome

STORED = "stored trial"


def mutations(formats: Sequence[Format], count: int) -> Iterator[Attack]:
    """Mutate files of all formats, ``count`` in all."""
    for each in formats:
        for number in range(-(-count // len(formats))):
            yield _attack("mutation", each, number, _mutated)


def truncations(formats: Sequence[Format], count: int) -> Iterator[Attack]:
    """Cut files of all formats, ``count`` in all."""
    for each in formats:
        for number in range(-(-count // len(formats))):
            yield _attack("truncation", each, number, _truncated)


def bits(formats: Sequence[Format], count: int) -> Iterator[Attack]:
    """Flip single bits: ``count`` in stored trials, as many in recordings of all formats."""
    trials = [each for each in formats if each.request]
    for each in formats:
        share = count if each.name == STORED else -(-count // len(trials)) if each.request else 0
        for number in range(share):
            yield _attack("bit flip", each, number, _flipped)


def commands(formats: Sequence[Format], count: int) -> Iterator[Attack]:
    """Process mutated recordings with ``hbm residuals``, ``count`` in all."""
    trials = [each for each in formats if each.request]
    for each in trials:
        for number in range(-(-count // len(trials))):

            def act(folder: Path, chance: random.Random, each: Format = each) -> Outcome:
                damage = _mutated(chance, each)
                (folder / TOLD).write_text(damage.what, encoding="utf-8", errors="replace")
                return _processed(each, folder, damage)

            yield Attack("command", each.name, number, act)


def _attack(
    campaign: str, each: Format, number: int, damage_of: Callable[[random.Random, Format], Damage]
) -> Attack:
    def act(folder: Path, chance: random.Random) -> Outcome:
        damage = damage_of(chance, each)
        (folder / TOLD).write_text(damage.what, encoding="utf-8", errors="replace")
        path = folder / each.file.name
        path.write_bytes(damage.content)
        outcome = each.judge(path, damage)
        return Outcome(outcome.kind, f"{damage.what}; {outcome.detail}")

    return Attack(campaign, each.name, number, act)


def _mutated(chance: random.Random, each: Format) -> Damage:
    return mutate(chance, each.content, text=each.text)


def _truncated(chance: random.Random, each: Format) -> Damage:
    return truncate(chance, each.content)


def _flipped(chance: random.Random, each: Format) -> Damage:
    return flip_bit(chance, each.content, whole=each.name == STORED)


def _processed(each: Format, folder: Path, damage: Damage) -> Outcome:
    assert each.request is not None
    path, out = folder / each.file.name, folder / "out"
    path.write_bytes(damage.content)
    request = each.request(path)
    options = [request.trial, "--static", request.static, "--sex", "male", "--out", out]
    for name in ("forces", "record"):
        if file := getattr(request, name):
            options += [f"--{name}", file]
    ended = commanded("residuals", *options)
    if ended.code:
        outcome = refusal(ended, (path.name, request.trial.name))
    elif raw := printed_raw(ended.out + ended.err):
        outcome = Outcome("leak", raw)
    elif missing := {".parquet", ".csv", ".png", ".svg"} - {f.suffix for f in out.glob("*")}:
        outcome = Outcome("unclear", f"exit code 0 without {', '.join(sorted(missing))}")
    elif left := [file.name for file in out.glob(".*")]:
        outcome = Outcome("leftover", ", ".join(left))
    else:
        outcome = Outcome("fine")
    return Outcome(outcome.kind, f"{damage.what}; {outcome.detail}")
