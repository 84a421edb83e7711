"""One subject in one condition, as the study's files state it.

    python subjects/one_condition.py [SUBJECT CONDITION [STUDY]]

The result is written to results/trials, as by `hbm run`. A trial that is done already is not
processed again; once all are done, `hbm report` makes the study's report of them. So this script
may run for every subject and condition at the same time, as on a cluster (docs/cluster.md).
"""

import sys
from pathlib import Path

import hbm_residuals as hr

subject, condition = sys.argv[1:3] or ("sub01", "sway")
study = hr.read_study(sys.argv[3] if len(sys.argv) > 3 else Path(__file__).parent)

# With the plates as measured and compensated; both from the same motion.
trials = hr.run(study, Path("results"), subjects=[subject], conditions=[condition], announce=print)
for outcome in trials:
    print(outcome)
    if outcome.failure is not None:
        sys.exit(1)

    # The stored result holds body, motion, forces, joint moments and residuals, frame by frame.
    result = hr.read_result(outcome.path)
    table = hr.residuals(result, condition).query("headline")
    columns = ["subject", "condition", "compensated", "axis", "unit", "rms", "peak", "n_cycles"]
    print(table[columns].round(1).to_string(index=False))
