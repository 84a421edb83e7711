"""Run a study of our own: ``python -m tests.validation STUDY OUT``.

``--jobs`` processes. The tests beside this module are their short form.
"""

import argparse
from pathlib import Path

from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from tests.validation import published_compensation as published
from tests.validation import residual_reduction
from tests.validation.ablation import ablation
from tests.validation.table_3 import reproduce

STUDIES = ["ablation", "published_compensation", "residual_reduction", "table_3"]

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.validation", description=__doc__)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("out", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--belts", type=Path, help="folder of the real recordings of a belt")
    chosen = parser.parse_args()
    if chosen.study == "ablation":
        tables = {"ablation": ablation(jobs=chosen.jobs)}
    elif chosen.study == "published_compensation":
        left = published.summary(published.machines(chosen.jobs))
        belts = published.belts(chosen.belts, chosen.jobs)
        tables = {chosen.study: left, "published_belts": belts}
    elif chosen.study == "residual_reduction":
        trials = residual_reduction.reduction(chosen.jobs)
        tables = {chosen.study: trials}
    else:
        tables = reproduce(Setting(protocol=Protocol(beside_s=0.0)), chosen.jobs)
    chosen.out.mkdir(parents=True, exist_ok=True)
    if chosen.study == "published_compensation":
        published.draw(left, chosen.out / "published_compensation.svg")
    if chosen.study == "residual_reduction":
        residual_reduction.draw(trials, chosen.out / "residual_reduction.svg")
    for name, table in tables.items():
        table.to_csv(chosen.out / f"{name}.csv", index=False, float_format="%.4f")
