"""What do real recordings say at half and at twice each number of judgement of a trial?

    python -m tests.campaign.thresholds [--data ../shared/data] [SECTION | SECTION.NAME …]

Of `pipeline/trial/thresholds.toml`, by default of all. Healthy walks, a descent of steps with
plates that are not zeroed among them, are processed with one number changed, but for the body and
its inverse kinematics. A recording that then has other notes, findings, events, flags of frames,
residuals or joints, or an error, says something else. Prints a line for each number. Defaults of
arguments keep their value.
"""

import argparse
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import pipeline.trial.process  # noqa: F401  reads every section
from pipeline.trial.chain import Chain
from pipeline.trial.joints import joint_curves, joint_rows
from pipeline.trial.process import result_of
from pipeline.trial.residuals import residual_rows
from tests.campaign.walks import opencap, real

FILE = Path(__file__).resolve().parents[2] / "pipeline" / "trial" / "thresholds.toml"


def statements(chain: Chain) -> str:
    """All that a trial says; its inverse kinematics is solved once."""
    try:
        result = result_of(chain.changed(solved=chain.solved, body=chain.body))
    except (ArithmeticError, LookupError, ValueError) as error:
        return str(error)
    joints = joint_rows(result, "", joint_curves(result))
    told = *map(str, result.notes), result.findings, result.events, result.shortage
    return repr((told, result.quality.tobytes(), residual_rows(result), joints))


def scaled(value: Any, factor: float) -> Any:
    """The number, or each of several, times a factor; whole numbers stay whole."""
    if isinstance(value, dict):
        return {key: scaled(one, factor) for key, one in value.items()}
    if isinstance(value, list):
        return [scaled(one, factor) for one in value]
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


def places(names: set[str]) -> Iterator[SimpleNamespace]:
    """Where code holds the numbers of a section."""
    for module in [*sys.modules.values()]:
        limits = getattr(module, "LIMITS", None)
        if isinstance(limits, SimpleNamespace) and vars(limits).keys() == names:
            yield limits


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.thresholds")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("names", nargs="*")
    given = parser.parse_args()
    walks = [base.chain() for base in (*real(given.data), opencap(given.data))]
    usual = [statements(walk) for walk in walks]
    for section, entries in tomllib.loads(FILE.read_text(encoding="utf-8")).items():
        for name, entry in entries.items():
            if given.names and not {section, f"{section}.{name}"} & {*given.names}:
                continue
            others = dict[str, str]()
            for words, factor in (("half", 0.5), ("twice", 2.0)):
                for limits in places({*entries}):
                    value = scaled(entry["value"], factor)
                    setattr(limits, name, np.array(value) if isinstance(value, list) else value)
                said = [statements(walk) for walk in walks]
                changed = sum(one != two for one, two in zip(said, usual, strict=True))
                others[words] = f"{words} the value: {changed} of {len(walks)}"
            for limits in places({*entries}):
                value = entry["value"]
                setattr(limits, name, np.array(value) if isinstance(value, list) else value)
            print(f"{section}.{name}: " + ", ".join(others.values()), flush=True)


if __name__ == "__main__":
    main()
