"""Whether a damaged file is read rightly, noted, refused in one clear line, or silently wrong."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from pipeline.cli import app
from pipeline.io.recording import Recording
from pipeline.trial.residuals import cycle_residuals
from pipeline.trial.result import TrialResult
from tests.campaign.outcome import MAX_MESSAGE_CHARACTERS, Outcome
from tests.campaign.worker import fault_of

MAX_CHANGE: Final = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
"""Of a cycle's residual RMS without a note [N, N·m]."""
SAME: Final = 1e-9
"""Up to which two measured values are equal [m, N, N·m]: rounding of text."""
PREFIX: Final = "hbm: error: "
CODES: Final = (0, 1, 2, 130)
"""Documented exit codes."""
CONTROL: Final = frozenset(map(chr, (*range(9), 11, 12, *range(14, 32), *range(127, 160))))
BIDI: Final = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069\u2028\u2029")
"""Characters that change what a terminal or page shows of the rest of a line."""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command ended: its exit code and what it printed."""

    code: int
    out: str
    err: str


def commanded(*arguments: object) -> Ended:
    """Call the command line in this process."""
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = app.main([str(argument) for argument in arguments])
    return Ended(code, out.getvalue(), err.getvalue())


def attempted(act: Callable[[], Outcome], names: Iterable[str]) -> Outcome:
    """Do something as a command does, so that a refusal is printed as the program prints it.

    Parameters
    ----------
    act
        May raise what readers are documented to raise: ValueError, OSError, KeyError. Everything
        else is a traceback, although the command line may have a last resort for it.
    names
        One of them has to be in a refusal.
    """
    outcomes: list[Outcome] = []

    def attempt() -> None:
        try:
            outcomes.append(act())
        except (ValueError, OSError, KeyError):
            raise
        except Exception as error:
            outcomes.append(fault_of(error))

    commands = app.app
    app.app = lambda **_: attempt()
    try:
        ended = commanded("attempt")
    finally:
        app.app = commands
    return outcomes[0] if outcomes else refusal(ended, names)


def refusal(ended: Ended, names: Iterable[str]) -> Outcome:
    """Judge what a command printed that refused its input."""
    if "Traceback" in ended.err:
        return Outcome("traceback", ended.err.strip().splitlines()[-1])
    if ended.code != 2:
        return Outcome("unclear", f"exit code {ended.code}: {ended.err[:200]!r}")
    lines = ended.err.split("\n")
    if lines.pop() or not lines:
        return Outcome("unclear", f"no whole line: {ended.err[:200]!r}")
    for line in lines:
        if not line.startswith(PREFIX):
            return Outcome("unclear", f"not an error line: {line[:200]!r}")
        if len(line) >= MAX_MESSAGE_CHARACTERS:
            return Outcome("unclear", f"{len(line)} characters: {line[:200]!r}")
        if not line.isprintable() or BIDI.intersection(line):
            return Outcome("unclear", f"not printable: {line[:200]!r}")
        if not any(name in line for name in names):
            return Outcome("unclear", f"names no file: {line[:200]!r}")
    return Outcome("refused", lines[0][len(PREFIX) :])


def noted(found: Iterable[Note], known: Iterable[Note]) -> Outcome | None:
    """Say which notes there are beyond those of the undamaged file; None without any."""
    more = Counter(note.code for note in found) - Counter(note.code for note in known)
    return Outcome("noted", ", ".join(sorted(more))) if more else None


def values_changed(found: Recording, known: Recording, *, gaps: bool = False) -> float:
    """Count the measured values that differ in the frames that both have.

    A marker in one frame counts once, as do a plate and an analog channel in one sample; endless
    where there are others. With ``gaps``, values that are missing do not count.
    """
    both = [(found.markers.position, known.markers.position)]
    if len(found.plates) != len(known.plates):
        return np.inf
    for one, other in zip(found.plates, known.plates, strict=True):
        both.append((one.wrench_in_plate, other.wrench_in_plate))
    if found.analog is not None and known.analog is not None:
        both.append((found.analog.values[..., None], known.analog.values[..., None]))
    return sum(_differing(one, other, gaps) for one, other in both)


def otherwise_equal(found: Recording, known: Recording) -> bool:
    """Say whether all else is equal: names, clock, plates, events, the subject's measures."""
    pairs = [(found.markers.time, known.markers.time)]
    pairs += [(f.time, k.time) for f, k in zip(found.plates, known.plates, strict=False)]
    return (
        found.markers.names == known.markers.names
        and [p.number for p in found.plates] == [p.number for p in known.plates]
        and all(_equal_start(*pair) for pair in pairs)
        and all(
            np.allclose(getattr(f, name), getattr(k, name), 0, SAME, equal_nan=True)
            for f, k in zip(found.plates, known.plates, strict=True)
            for name in ("rotation", "center", "corners")
        )
        and _stated(found) == _stated(known)
    )


def _stated(recording: Recording) -> tuple[object, ...]:
    analog = recording.analog
    meta = recording.metadata
    channels = (analog.names, analog.units) if analog is not None else None
    limbs = {side: str(measures) for side, measures in meta.limbs.items()}
    return (channels, recording.events, meta.mass_kg, meta.height_m, limbs)


def _equal_start(one: Array, other: Array) -> bool:
    count = min(len(one), len(other))
    return count > 0 and np.allclose(one[:count], other[:count], 0, SAME)


def _differing(one: Array, other: Array, gaps: bool) -> float:
    """Count the rows of the last axis that differ in the frames that both have."""
    if one.shape[1:] != other.shape[1:]:
        return np.inf
    count = min(len(one), len(other))
    same = np.isclose(one[:count], other[:count], 0, SAME, equal_nan=True)
    if gaps:
        same |= np.isnan(one[:count])
    return int((~same.all(axis=-1)).sum())


def cycle_rms(result: TrialResult) -> dict[str, tuple[Array, Array]]:
    """Give start and residual RMS of each cycle: variant and side -> (C,), (C, 6)."""
    rms = {}
    for variant in result.variants:
        for side, values in cycle_residuals(result, variant).items():
            starts = np.reshape(result.cycles[side], (-1, 2))[:, 0]
            with np.errstate(invalid="ignore"):
                squares = np.nansum(values**2, axis=1) / np.isfinite(values).sum(axis=1)
            rms[f"{variant} {side}"] = (starts, np.sqrt(squares))
    return rms


def numbers_changed(found: TrialResult, known: TrialResult) -> Outcome | None:
    """Say by how much a cycle's RMS changed, if by too much; each beside the nearest known one."""
    reference, worst = cycle_rms(known), 0.0
    for name, (starts, rms) in cycle_rms(found).items():
        if name not in reference or not len(reference[name][0]):
            continue
        known_starts, known_rms = reference[name]
        for start, value in zip(starts, rms, strict=True):
            beside = known_rms[np.argmin(np.abs(known_starts - start))]
            change = np.abs(value - beside) / MAX_CHANGE
            worst = max(worst, float(np.nanmax(change, initial=0.0)))
    if worst > 1:
        return Outcome("silent", f"a cycle's RMS changed by {worst:.1f} times 1 N or 0.5 N·m")
    return None


def printed_raw(text: str, unwanted: Sequence[str] = ()) -> str:
    """Say what of a printed text controls a terminal or names a person; empty without any."""
    for character in text:
        if character in CONTROL or character in BIDI:
            return f"character {character!r}"
    return next((f"text {name!r}" for name in unwanted if name in text), "")
