"""Studies of our own, whose numbers are in the notebooks beside this module."""

import argparse
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from tests.tables import command, described
from tests.validation import published_compensation as published
from tests.validation import residual_reduction
from tests.validation.ablation import ablation
from tests.validation.table_3 import reproduce

Tables = dict[str, pd.DataFrame]


def faults_alone(given: argparse.Namespace) -> Tables:
    return {"ablation": ablation(jobs=given.jobs)}


def published_and_ours(given: argparse.Namespace) -> Tables:
    left = published.summary(published.machines(given.jobs))
    belts = published.belts(given.belts, given.jobs)
    published.draw(left, given.out / "published_compensation.svg")
    return {"published_compensation": left, "published_belts": belts}


def reduction(given: argparse.Namespace) -> Tables:
    trials = residual_reduction.reduction(given.jobs)
    residual_reduction.draw(trials, given.out / "residual_reduction.svg")
    return {"residual_reduction": trials}


def thesis_table(given: argparse.Namespace) -> Tables:
    return reproduce(Setting(protocol=Protocol(beside_s=0.0)), given.jobs)


STUDIES: dict[str, tuple[str, Callable[[argparse.Namespace], Tables]]] = {
    "ablation": ("what each fault adds to the residuals (7 min)", faults_alone),
    "published_compensation": (
        "compensation as published and ours; needs --belts (30 min)",
        published_and_ours,
    ),
    "residual_reduction": ("residuals made small by changing motion (15 min)", reduction),
    "table_3": ("the thesis' Table III from simulated subjects (30 min)", thesis_table),
}


def main() -> None:
    studies = described("studies", {name: line for name, (line, _) in STUDIES.items()})
    parser = command("tests.validation", __doc__, studies)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("out", type=Path, help="folder of the tables and figures")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--belts", type=Path, help="folder of the real recordings of a belt")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name, table in STUDIES[given.study][1](given).items():
        table.to_csv(given.out / f"{name}.csv", index=False, float_format="%.4f")


if __name__ == "__main__":
    main()
