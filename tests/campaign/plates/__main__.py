"""Plates with one known fault each: ``python -m tests.campaign.plates [--seeds N] [--workers N]``.

Writes its tables to docs/plates.md, after every seed.
"""

import argparse
import time
from multiprocessing import Pool

from tests.campaign.plates.cases import PERFECT, STANDARD_STUDIES, carry_out, cases, faultless
from tests.campaign.plates.page import PAGE, write_page


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.plates", description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="of noise, for each fault and size")
    parser.add_argument("--workers", type=int, default=1, help="how many studies at a time")
    given = parser.parse_args()
    start, done = time.monotonic(), []
    with Pool(given.workers) as pool:
        studies = pool.imap(carry_out, faultless(PERFECT, STANDARD_STUDIES))
        perfect = [plate for study in studies for plate in study]
        for seed in range(given.seeds):
            done += [plate for study in pool.imap(carry_out, cases([seed])) for plate in study]
            minutes = (time.monotonic() - start) / 60
            write_page(done, perfect, minutes, given.workers)
            print(f"seed {seed}: {minutes:.0f} min, written: {PAGE}", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
