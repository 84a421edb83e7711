"""How sure the RMS of residuals is, by the delta method and by Monte Carlo, trial by trial.

``python -m tests.campaign.delta_method [--draws N]``

A simulated study with a subject who walks on a treadmill that stands still, sways and pitches, and
a real recording where there is one. Prints the ratio of the standard deviations of both.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

import pipeline
from hbm.spatial import Array
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.config.study import read_study
from pipeline.explain.linearise import ExplainedPart, explained_part
from pipeline.explain.uncertainty import measured_uncertainty
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_trial
from pipeline.trial.residuals import AXES
from pipeline.trial.result import TrialResult
from pipeline.trial.study_files import read_study_file, read_study_laboratory
from tests.pipeline import lab
from tests.pipeline.explain.monte_carlo import drawn_rms

REAL: Final = (
    Path(__file__).resolve().parents[3] / "shared/data/treadmill_hbm2/treadmill_events.c3d"
)
REAL_MASS_KG: Final = 55.3


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.delta_method", description=__doc__
    )
    parser.add_argument("--draws", type=int, default=2000)
    draws = parser.parse_args().draws
    print(f"| delta method / Monte Carlo, {draws} draws | {' | '.join(AXES)} |")
    print("|---|" + "---|" * len(AXES))
    with tempfile.TemporaryDirectory() as folder:
        for name, part, result in trials(Path(folder)):
            mean, deviation = ratios(part, result, draws)
            print(f"| {name}: standard deviation | {' | '.join(f'{r:.2f}' for r in deviation)} |")
            print(f"| {name}: mean | {' | '.join(f'{r:.2f}' for r in mean)} |", flush=True)


def trials(folder: Path) -> Iterator[tuple[str, ExplainedPart, TrialResult]]:
    """Give the trials that are compared, with their causes."""
    study = read_study(lab.write_study(folder))
    laboratory = read_study_laboratory(study)
    for condition, trial in study.subject("sub01").trials.items():
        assert trial.file is not None
        recording = read_study_file(study, trial.file)
        result = process_trial(study, "sub01", condition)
        yield condition, explained_part(recording, laboratory, result), result
    if REAL.is_file():
        real = pipeline.read_recording(REAL)
        result = pipeline.process_recording(real, Subject(mass_kg=REAL_MASS_KG), Settings())
        yield "treadmill_events", explained_part(real, Laboratory(Treadmill()), result), result


def ratios(part: ExplainedPart, result: TrialResult, draws: int) -> tuple[Array, Array]:
    """Give mean and standard deviation by the delta method in those of the draws, (6,) each."""
    rms = np.sqrt((part.chain.residual[part.counts] ** 2).mean(axis=0))
    assert np.isfinite(rms).all()  # computed before all effects, whose chains keep its steps
    effects = np.nan_to_num([cause.effect(part.chain) for cause in part.causes])
    uncertainty, _, _ = measured_uncertainty(part, effects, result)
    delta, drawn = uncertainty[-1], drawn_rms(part, draws)
    return delta.mean / drawn.mean(axis=0), delta.deviation / drawn.std(axis=0, ddof=1)


if __name__ == "__main__":
    main()
