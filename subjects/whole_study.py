"""The study: all trials, then tables, statistics, figures and the report.

    python subjects/whole_study.py [STUDY]

The same as `hbm run subjects` and `hbm report`. Results are in the folder results.
"""

import sys
from pathlib import Path

import hbm_residuals as hr

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
results = Path("results")
study = hr.read_study(folder)

# Two trials at a time. Those that are done already are kept, so that the same call continues a run
# that was interrupted; a trial that fails stops no other.
failed = 0
for outcome in hr.run(study, results, jobs=2, announce=print):
    print(outcome)
    failed += outcome.failure is not None

# Does compensation bring the residuals back to those at baseline? Table III of the thesis, the
# statistics behind it, and a page with figures, notes and a paragraph for the Methods section.
page = hr.report(results, folder)
print((results / "table_3.md").read_text(encoding="utf-8"))
print(f"report: {page}")
sys.exit(1 if failed else 0)
