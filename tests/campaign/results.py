"""What ``hbm run`` leaves: a stored trial, and why trials failed."""

import shutil
from pathlib import Path

from pipeline.cli.request import TrialRequest, chain_of, process
from pipeline.run.job import read_failures
from pipeline.run.load import collect
from pipeline.run.store import read_trial, recorded_study_folder, write_trial
from tests.campaign.formats import Format, read_alone
from tests.campaign.judgement import attempted
from tests.campaign.mutations import Damage
from tests.campaign.outcome import Outcome


def results(folder: Path, request: TrialRequest) -> list[Format]:
    """Write the results of one trial."""
    home = folder / "results"
    stored = home / "trials" / "sub01_level.parquet"
    write_trial(process(request, chain_of(request)), stored)
    (home / "failures.json").write_text('{"sub01 again": "no gait cycles"}', encoding="utf-8")
    (home / "run.json").write_text('{"study": "../study"}', encoding="utf-8")

    def judge_stored(path: Path, damage: Damage) -> Outcome:
        trials = path.parent / "trials"
        trials.mkdir()
        shutil.copy(path, trials)
        same = path.read_bytes() == stored.read_bytes()
        outcomes = [
            read_alone(lambda: read_trial(path), path),
            read_alone(lambda: collect(path.parent), path),
        ]
        for outcome in outcomes:
            if not outcome.survived:
                return outcome
            if outcome.kind == "fine" and not same:
                return Outcome("silent", "accepted")
        return outcomes[0]

    def judge_failures(path: Path, damage: Damage) -> Outcome:
        def act() -> Outcome:
            failures = read_failures(path.parent)
            texts = all(isinstance(text, str) for item in failures.items() for text in item)
            return Outcome("fine") if texts else Outcome("silent", f"read as {failures!r:.100}")

        return attempted(act, (path.name,))

    return [
        Format("stored trial", stored, judge_stored, text=False),
        Format("failures JSON", home / "failures.json", judge_failures),
        Format(
            "run JSON",
            home / "run.json",
            lambda path, damage: read_alone(lambda: recorded_study_folder(path.parent), path),
        ),
    ]
