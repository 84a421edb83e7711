"""The campaign of plates as the last section of docs/plates.md."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import pandas as pd

from pipeline.io.write import markdown
from tests.campaign.plates.cases import FAULTS, SIZES, PlateOutcome

PAGE: Final = Path(__file__).resolve().parents[3] / "docs" / "plates.md"
HEADING: Final = "## Campaign\n"
"""All from here on is written anew."""
SCOPE: Final = (
    "Every simulated fault is of a kind that the model of a plate has. One that it has not is not "
    "found: a gain of Fx that grows with the vertical force, by 10 % at 510 N, is called fit after "
    "correction by the mean gain at the recorded loads. How often a plate without a fault is "
    "called fit holds for the two designs below, their belt speeds (0.7 and 1 m/s; 0.3, 0.7 and "
    "1 m/s), the marker's noise of 0.1 mm and the plate's of 1 N at 1000 Hz. With 24 recordings at "
    "0.1 and 0.2 m/s, such a plate cannot be told."
)


def write_page(
    done: Sequence[PlateOutcome], perfect: Sequence[PlateOutcome], minutes: float, workers: int
) -> None:
    """Write the tables below what people wrote."""
    written = PAGE.read_text(encoding="utf-8").split(HEADING)[0]
    seeds = len({one.case.seed for one in done})
    invented = Counter(name for one in done for name in one.invented)
    lines = [
        written + HEADING.rstrip(),
        f"`python -m tests.campaign.plates --seeds {seeds}`: {len(FAULTS)} faults × "
        f"{len(SIZES)} sizes × {seeds} seeds of noise × 2 plates, and {len(perfect)} plates "
        f"without a fault; {minutes:.0f} minutes, {workers} at a time. Plates with a fault are "
        "recorded 24 times each (two speeds, three masses, two positions, two profiles), a third "
        "of the thesis' design. The true verdict is from the known fault by an independent "
        "formula: what the simulated plate shows of a person's loads in a minute, less the loads.",
        "Found: the fault, all its estimates, differs significantly from none. Sized: its size "
        "lies within the 95 % interval (of all gains: how many of the five that weights examine). "
        "A noise is not tested against none.",
        SCOPE,
        markdown(_fault_table(done)),
        f"Of all sizes, {_share([one.sized for one in done])} lie within their 95 % intervals. Of "
        f"all true total errors, {_share([one.totals[1:] for one in done])} are below the upper "
        f"bounds and {_share([one.totals[::2] for one in done])} above the lower ones: where a "
        "plate has little but noise, that of the marker's place counts as the plate's. "
        f"Verdicts: {_count(done, _right)} right, {_count(done, _untold)} cannot be told, "
        f"{_count(done, _wrong)} wrong. Of plates that are not fit as they are, "
        f"{_count([one for one in done if one.truth != 'fit'], _passed)} were called fit.",
        "Faults that were found where another one was simulated: "
        + (", ".join(f"{name} ({n})" for name, n in invented.most_common()) or "none")
        + f", in {_count(done, lambda one: bool(one.invented))} plates.",
        "Without a fault:",
        markdown(_perfect_table(perfect)),
    ]
    PAGE.write_text("\n\n".join(lines) + "\n", encoding="utf-8")


def _fault_table(done: Sequence[PlateOutcome]) -> pd.DataFrame:
    rows = []
    for fault in FAULTS:
        for share in SIZES:
            alike = [o for o in done if (o.case.fault, o.case.share) == (fault.name, share)]
            tested = fault.name != "noise"
            rows.append(
                {
                    "fault": fault.name,
                    "size": f"{share * fault.limit * fault.scale:.3g} {fault.unit}",
                    "of its limit": f"{share:g}",
                    "found": _count(alike, lambda one: one.found) if tested else "–",
                    "sized": _share([one.sized for one in alike]),
                    "true verdict": alike[0].truth,
                    "right": _count(alike, _right),
                    "cannot be told": _count(alike, _untold),
                    "wrong": _count(alike, _wrong),
                }
            )
    return pd.DataFrame(rows)


def _perfect_table(perfect: Sequence[PlateOutcome]) -> pd.DataFrame:
    rows = []
    for standard, words in ((False, "24 recordings"), (True, "the thesis' 72 recordings")):
        alike = [one for one in perfect if one.case.standard == standard]
        rows.append(
            {
                "design": words,
                "plates": len(alike),
                "fit": _count(alike, _right),
                "not fit": _count(alike, _wrong),
                "cannot be told": _count(alike, _untold),
                "with a fault that differs significantly from none": _count(
                    alike, lambda one: bool(one.invented)
                ),
            }
        )
    return pd.DataFrame(rows)


def _right(one: PlateOutcome) -> bool:
    return one.verdict == one.truth


def _untold(one: PlateOutcome) -> bool:
    return one.verdict == "cannot be told" and not _right(one)


def _wrong(one: PlateOutcome) -> bool:
    return not _right(one) and not _untold(one)


def _passed(one: PlateOutcome) -> bool:
    return one.verdict == "fit"


def _count(outcomes: Sequence[PlateOutcome], wanted: Callable[[PlateOutcome], bool]) -> str:
    return f"{sum(map(wanted, outcomes))} of {len(outcomes)}"


def _share(pairs: Sequence[tuple[int, int]]) -> str:
    return f"{sum(n for n, _ in pairs)} of {sum(n for _, n in pairs)}"
