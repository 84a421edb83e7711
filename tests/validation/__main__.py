"""Run a study of our own: ``python -m tests.validation ablation OUT`` or ``table_3 OUT``.

``--jobs`` processes. The tests beside this module are their short form.
"""

import argparse
from pathlib import Path

from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from tests.validation.ablation import ablation
from tests.validation.table_3 import reproduce

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.validation", description=__doc__)
    parser.add_argument("study", choices=["ablation", "table_3"])
    parser.add_argument("out", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    chosen = parser.parse_args()
    if chosen.study == "ablation":
        tables = {"ablation": ablation(jobs=chosen.jobs)}
    else:
        tables = reproduce(Setting(protocol=Protocol(beside_s=0.0)), chosen.jobs)
    chosen.out.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        table.to_csv(chosen.out / f"{name}.csv", index=False, float_format="%.4f")
