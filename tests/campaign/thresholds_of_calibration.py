"""What do calibrations, plates and bodies say at half and at twice each number of judgement?

    python -m tests.campaign.thresholds_of_calibration [--data ../shared/data] [NUMBER …]

Of `compensation/thresholds.toml` and `hbm/thresholds.toml`, by default of all. Sound recordings,
real and virtual ones, and the same with planted faults (`calibration_faults`, `body_faults`) are
given to the functions that read a section, with one number changed. Prints for each number how
many say something else then, of sound and of faulty ones; with --details, which.
"""

import re
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from hbm.numbers import read_numbers
from tests.campaign import body_faults, calibration_faults
from tests.campaign.numbers import FACTORS, numbers, scaled
from tests.tables import command

ROOMS = {"compensation": calibration_faults.trials, "hbm": body_faults.trials}
Said = dict[str, str]
"""Name of a trial -> all that is said of it."""


def said(act: Callable[[], object]) -> str:
    """What a trial says, or why it is refused."""
    try:
        return repr(act())
    except (ArithmeticError, LookupError, ValueError) as error:
        # reasons state limits, which are not what is judged
        return re.sub(r"\d[\d.e+−-]*", "…", f"{type(error).__name__}: {error}")


def all_said(room: str, section: str, data: Path) -> tuple[Said, Said]:
    """What sound and faulty trials say that a section may change."""
    sound, faulty = ROOMS[room](section, data)
    return tuple({name: said(act) for name, act in of.items()} for of in (sound, faulty))


usual = cache(all_said)


def line(room: str, section: str, name: str, value: Any, data: Path) -> tuple[str, str]:
    """In how many trials half and twice a number change what is said, and in which."""
    values = read_numbers(room, "thresholds.toml", section)
    before, parts, names = usual(room, section, data), [], []
    for words, factor in FACTORS.items():
        kept = getattr(values, name)
        setattr(values, name, scaled(value, factor))
        now = all_said(room, section, data)
        setattr(values, name, kept)
        changed = [
            [key for key, text in ours.items() if text != theirs[key]]
            for ours, theirs in zip(now, before, strict=True)
        ]
        counts = [f"{len(keys)} of {len(of)}" for keys, of in zip(changed, now, strict=True)]
        parts.append(f"{words} the value: {counts[0]} sound, {counts[1]} faulty")
        names.append(f"{words}: {'; '.join([*changed[0], *changed[1]])}")
    return f"{room}.{section}.{name}: {', '.join(parts)}", " | ".join(names)


def chosen(names: list[str]) -> Iterator[tuple[str, str, str, Any]]:
    """Rooms, sections, names and values of both files, of those that are asked for."""
    for room in ROOMS:
        for section, name, value in numbers(room, []):
            called = {room, f"{room}.{section}", f"{room}.{section}.{name}"}
            if not names or called & {*names}:
                yield room, section, name, value


def main() -> int:
    parser = command("tests.campaign.thresholds_of_calibration", __doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--details", action="store_true", help="which trials say something else")
    parser.add_argument("names", nargs="*", metavar="NUMBER", help="ROOM, ROOM.SECTION or a number")
    given = parser.parse_args()
    for number in chosen(given.names):
        text, details = line(*number, given.data)
        print(f"{text}\t{details}" if given.details else text, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
