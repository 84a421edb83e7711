"""``python -m tests.campaign.inertia_models --seeds FIRST END``: tables of docs/inertia_models.md.

FIRST is the first seed, END one more than the last. Ends with 1 where the models do not do what is
demanded of them.
"""

import argparse
import sys
from itertools import chain
from multiprocessing import Pool

from tests.campaign.inertia_models.cases import ARRANGEMENTS, BEST, judge
from tests.campaign.inertia_models.tables import components, places_table, table, unmet


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 10), metavar=("FIRST", "END"))
    parser.add_argument("--jobs", type=int, default=1)
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
    for rows in (table(found, 0), table(found, 1), components(found), places_table(places)):
        print(*rows, "", sep="\n")
    missed = unmet(found)
    print(*(f"not met: {goal}" for goal in missed), sep="\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
