"""Studies of which mixed models are compared with lme4's; ``python designs.py > designs.csv``.

Values are drawn by Python's own generator, whose sequence is the same in all its versions.
"""

import csv
import sys
from collections.abc import Iterator
from random import Random
from statistics import NormalDist

KINDS = (
    *("balanced", "unbalanced", "missing cells", "both in one recording"),
    *("groups", "sessions", "singular", "no variance", "few", "single recordings"),
    *("subjects far apart", "recordings close together"),
)
UNBALANCED = ("unbalanced", "groups", "subjects far apart", "recordings close together")
REPEATS = 20
"""Studies of each kind."""
COLUMNS = ("study", "kind", "group", "subject", "recording", "condition", "compensated", "value")
Row = tuple[str, ...]


def studies() -> Iterator[tuple[str, list[Row]]]:
    """Yield the name and the rows of each study."""
    for kind in KINDS:
        for number in range(REPEATS):
            name = f"{kind} {number:02d}"
            yield name, [(name, kind, *row) for row in _rows(kind, Random(name))]


def _rows(kind: str, random: Random) -> Iterator[Row]:
    """Yield group, subject, recording, condition, compensated and value of a study's rows."""

    def normal(deviation: float) -> float:
        return NormalDist().inv_cdf(random.random()) * deviation

    subjects = 4 if kind == "few" else random.randint(5, 10)
    repeats = 1 if kind == "single recordings" else random.randint(2, 4)
    conditions = ("a", "b", "c")
    compensated = ("no", "yes") if kind == "both in one recording" else ("no",)
    size = {"of_subject": 2.0, "of_cell": 1.0, "of_session": 0.0, "of_recording": 0.8, "error": 1.0}
    if kind == "sessions":
        size["of_session"] = 1.0
    if kind == "singular":
        size[random.choice(("of_subject", "of_cell"))] = 0.0
    if kind == "no variance":
        size = dict.fromkeys(size, 0.0) | {"error": 1.0}
    if kind == "subjects far apart":
        size |= {"of_subject": 20.0, "of_recording": 0.0, "error": 0.1}
    if kind == "recordings close together":
        size |= {"of_cell": 5.0, "of_recording": 0.0, "error": 0.01}
    for k in range(subjects):
        group = "old" if k % 2 and kind == "groups" else "young"
        of_subject = normal(size["of_subject"])
        of_session = [normal(size["of_session"]) for _ in range(2)]
        for condition in conditions:
            of_cell = {c: normal(size["of_cell"]) + (c == "yes") for c in compensated}
            absent = k > 1 and random.random() < 0.25
            if absent and kind in ("missing cells", "few", "single recordings"):
                continue
            count = random.randint(1, repeats) if kind in UNBALANCED else repeats
            for repeat in range(count):
                of_recording = normal(size["of_recording"])
                for c in compensated:
                    value = 20 + of_subject + of_session[repeat % 2] + of_cell[c] + of_recording
                    value += (condition == "b") + normal(size["error"])
                    recording = f"day {repeat % 2 + 1} {repeat}"
                    yield group, f"s{k}", recording, condition, c, f"{value:.6f}"


if __name__ == "__main__":
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(COLUMNS)
    for _, rows in studies():
        writer.writerows(rows)
