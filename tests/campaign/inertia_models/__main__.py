"""``python -m tests.campaign.inertia_models --seeds FIRST END [--page]``.

FIRST is the first seed, END one more than the last; with ``--page`` it writes
docs/inertia_models.md. Ends with 1 where the models do not do what is demanded of them.
"""

import argparse
import sys
from itertools import chain
from multiprocessing import Pool
from pathlib import Path
from typing import Final

from tests.campaign.inertia_models.cases import ARRANGEMENTS, BEST, judge
from tests.campaign.inertia_models.page import page, places_table, table, unmet

PAGE: Final = Path(__file__).resolve().parents[3] / "docs" / "inertia_models.md"
COMMAND: Final = "python -m tests.campaign.inertia_models"


def main() -> int:
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 10), metavar=("FIRST", "END"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--page", action="store_true", help="write docs/inertia_models.md")
    given = parser.parse_args()
    calibration, sensors = BEST
    cases = [(seed, machine) for seed in range(*given.seeds) for machine in ("default", "soft")]
    cases += [(seed, "rigid", (calibration,), (sensors,)) for seed in range(*given.seeds)]
    placed = {
        name: [
            (seed, "soft", (calibration,), (len(chosen),), tuple(chosen))
            for seed in range(*given.seeds)
        ]
        for name, chosen in ARRANGEMENTS.items()
    }
    with Pool(given.jobs) as pool:
        found = list(chain(*pool.starmap(judge, cases, 1)))
        places = {
            name: list(chain(*pool.starmap(judge, those, 1))) for name, those in placed.items()
        }
    print(*table(found, 0), "", *table(found, 1), "", *places_table(places), sep="\n")
    missed = unmet(found)
    print(*(f"not met: {goal}" for goal in missed), sep="\n")
    if given.page:
        command = f"{COMMAND} --seeds {given.seeds[0]} {given.seeds[1]} --page"
        PAGE.write_text(page(found, places, command), encoding="utf-8")
        print(f"written: {PAGE}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
